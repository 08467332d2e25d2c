"""Numbers and quantities as text."""

from __future__ import annotations

import math

_NO_QUANTITY = 1e-12
"""Smaller quantities, in their unit, are a residue of rounding."""
_PREFIXES = {-9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""Prefixes of units by their power of ten."""

_LEAST_KG_M2 = 1e-3
"""Inertia, kg.m2, below which it is shown in g.cm2, as sheets of motors do."""


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where it is undefined."""
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:.{digits}g}"  # -0 is 0


def plural(count: int, thing: str) -> str:
    """Return a number of things: "1 row", "3 rows"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def quantity(value: float | None, unit: str, digits: int = 3, beside: float | None = None) -> str:
    """Return a value with its unit, to so many significant digits: 99 040 N/m as ``99.0 kN/m``; a dash for none.

    An inertia has the unit of that beside which it stands, if one is given.
    """
    if value is None or math.isnan(value):
        return "-"
    largest_power = max(_PREFIXES)
    if unit == "kg":  # never Mg
        value, unit, largest_power = 1e3 * value, "g", 3
    if unit == "kg.m2":
        size = abs(value if beside is None else beside)
        value, unit = (value, unit) if size >= _LEAST_KG_M2 or size == 0 else (1e7 * value, "g.cm2")
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}unbounded"
    if abs(value) < _NO_QUANTITY:
        return f"0 {unit}"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    power = min(max(3 * (exponent // 3), min(_PREFIXES)), largest_power)
    if unit in {"kg.m2", "g.cm2"} or (unit == "N.m.s/rad" and power == -3):  # no prefix, as users write them
        power = 0
    decimals = max(0, digits - 1 - (exponent - power))
    return f"{value / 10.0**power:.{decimals}f} {_PREFIXES[power]}{unit}"


_ROUNDS_TO_ALL = 99.95
"""Percentage from which on it is 100."""


def percent(share: float | None) -> str:
    """Return a share as a percentage to two significant digits, or three above 99 %."""
    if share is None or math.isnan(share):
        return "-"
    value = 100 * share
    if value < 99:
        return f"{value:.2g} %"
    # From 99.95 on one decimal rounds to 100.0.
    return f"{value:.1f} %" if value < _ROUNDS_TO_ALL else f"{value:.0f} %"
