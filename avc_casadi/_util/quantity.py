"""A quantity with its unit as people write it: three digits and an SI prefix; and read as they type it."""

from __future__ import annotations

import math
import re

# Less than that in SI units is told as such.
_LEAST = 1e-12
_PREFIXES = {-9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """Return a value with its unit, to so many significant digits: 99 040 N/m as ``99.0 kN/m``; a dash for none.

    Args:
        value: in the unit, which may have a prefix of its own only where it is the kilogram.
        unit: such as ``N/m``; a mass is told in grams.
        digits: significant ones.
    """
    if value is None or math.isnan(value):
        return "-"
    if unit.startswith("kg"):
        value, unit = 1e3 * value, unit[1:]
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}unbounded"
    if value == 0:
        return f"0 {unit}"
    if abs(value) < _LEAST:
        return f"below 0.001 n{unit}"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    group = min(max(3 * (exponent // 3), min(_PREFIXES)), max(_PREFIXES))
    decimals = max(0, digits - 1 - (exponent - group))
    return f"{value / 10.0**group:.{decimals}f} {_PREFIXES[group]}{unit}"


def percent(share: float | None) -> str:
    """Return a share as a percentage to two significant digits, or three above 99 %."""
    if share is None or math.isnan(share):
        return "-"
    value = 100 * share
    return f"{value:.1f} %" if 99 <= value < 99.95 else f"{value:.2g} %" if value < 99 else f"{value:.0f} %"


# Size in SI units, and powers of kg, m, s and rad.
_SYMBOLS = {
    "g": (1e-3, (1, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0)),
    "s": (1.0, (0, 0, 1, 0)),
    "N": (1.0, (1, 1, -2, 0)),
    "Hz": (1.0, (0, 0, -1, 0)),
    "rad": (1.0, (0, 0, 0, 1)),
}
_ALONE = {
    "in": (0.0254, (0, 1, 0, 0)),
    "dpi": (1 / 0.0254, (0, -1, 0, 0)),
    **dict.fromkeys(("deg", "degrees", "\N{DEGREE SIGN}"), (math.pi / 180, (0, 0, 0, 1))),
    **dict.fromkeys(("turn", "turns", "rev"), (2 * math.pi, (0, 0, 0, 1))),
    **dict.fromkeys(("count", "counts", "step", "steps", "sample", "samples"), (1.0, (0, 0, 0, 0))),
}
_TYPED_PREFIXES = {"": 0, "k": 3, "M": 6, "G": 9, "c": -2, "m": -3, "u": -6, "n": -9}
# What is typed without a sign between its units.
_GLUED = ((r"Nms\b", "N.m.s"), (r"Nm\b", "N.m"), (r"Ns\b", "N.s"), (r"g(?=[cm]?m2)", "g."))
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)


def read_quantity(text: str, unit: str) -> float:
    """Return a quantity as typed in SI units: ``55 um`` as 5.5e-5, ``1 kHz`` for a time, ``450 dpi`` for a step.

    Args:
        text: a number, and its unit; without one it is in SI units. A number a way or time, in place of the way or
            time itself, is inverted; counts alone are those of a turn.
        unit: that is wanted, such as ``N.m/rad`` or ``samples``.

    Raises:
        ValueError: it is no number, or of another unit.
    """
    found = _NUMBER.fullmatch(text)
    typed, wanted = None if found is None else _unit(found[2]), _unit(unit)
    if found is None or typed is None or wanted is None or not math.isfinite(number := float(found[1])):
        raise ValueError(f"{text!r} is no number with a unit")
    if not found[2]:
        return number
    factor, powers = typed
    if not any(powers) and wanted == _unit("rad"):
        factor, powers = factor / (2 * math.pi), (0, 0, 0, -1)
    value, inverse = number * factor, tuple(-power for power in powers)
    if any(powers) and inverse == wanted[1] and value:
        value = 1 / value
    # Who leaves the angle out of N.m/rad means it.
    elif powers != wanted[1] and not (any(powers[:3]) and powers[:3] == wanted[1][:3]):
        raise ValueError(f"{text!r} has another unit")
    return float(f"{value:.15g}")


def _unit(text: str) -> tuple[float, tuple[int, ...]] | None:
    """Return the size of a unit in SI units and its powers of kg, m, s and rad; None where it is none."""
    for pattern, plain in _GLUED:
        text = re.sub(pattern, plain, text)
    text = text.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    text = text.replace("\N{SUPERSCRIPT TWO}", "2").replace("^", "")
    above, *below = text.split("/")
    size, powers = 1.0, [0, 0, 0, 0]
    for part, sign in ((above, 1), *((one, -1) for one in below)):
        for symbol in filter(None, re.split(r"[.\N{MIDDLE DOT}*\s]+", part)):
            found = re.fullmatch(r"(\D+)(\d?)", symbol)
            one = None if found is None else _symbol(found[1])
            if found is None or one is None:
                return None
            power = sign * int(found[2] or 1)
            size *= one[0] ** power
            powers = [before + power * here for before, here in zip(powers, one[1], strict=True)]
    return size, tuple(powers)


def _symbol(text: str) -> tuple[float, tuple[int, ...]] | None:
    if text in _ALONE:
        return _ALONE[text]
    for symbol, (size, powers) in _SYMBOLS.items():
        exponent = _TYPED_PREFIXES.get(text.removesuffix(symbol))
        if text.endswith(symbol) and exponent is not None:
            return size * 10.0**exponent, powers
    return None
