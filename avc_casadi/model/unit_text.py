"""Values typed with a unit, such as `55 um` or `1 kHz`, and the units of keys."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache

from avc_casadi._util.units import ROTARY, Units

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
    "lb": (0.45359237, (1, 0, 0, 0)),
    "lbf": (4.4482216152605, (1, 1, -2, 0)),
    "kgf": (9.80665, (1, 1, -2, 0)),
    "gf": (9.80665e-3, (1, 1, -2, 0)),
    "ozf": (0.27801385095378, (1, 1, -2, 0)),
    **dict.fromkeys(("deg", "degrees", "\N{DEGREE SIGN}"), (math.pi / 180, (0, 0, 0, 1))),
    "arcmin": (math.pi / 10800, (0, 0, 0, 1)),
    "arcsec": (math.pi / 648000, (0, 0, 0, 1)),
    **dict.fromkeys(("turn", "turns", "rev"), (2 * math.pi, (0, 0, 0, 1))),
    **dict.fromkeys(("CPR", "cpr"), (1 / (2 * math.pi), (0, 0, 0, -1))),
    **dict.fromkeys(("count", "counts", "step", "steps", "sample", "samples"), (1.0, (0, 0, 0, 0))),
}
_NAMED = {
    prefix + symbol: (size * 10.0**power, of)
    for symbol, (size, of) in _SYMBOLS.items()
    for prefix, power in {"": 0, "k": 3, "c": -2, "m": -3, "u": -6, "n": -9, "M": 6, "G": 9}.items()
}
_NAMES = _NAMED | _ALONE
# The longest first, mega last, as it is rare.
_SPELT_NAMES = sorted(_NAMES, key=lambda name: (name.startswith("M"), -len(name)))
UNIT_WORDS = {name.lower() for name in _SPELT_NAMES}
"""Units as the last word of a key, in small letters."""
_MOST_FACTORS = 3
"""Units in a row without a sign, as in `gcm2`, up to which an ending of a key is read."""
# Unit of a key, as its ending, the longest first; and the power of the metres per radian that takes a value of what
# turns to the handle.
_ENDINGS = {
    "_ns2_per_m2": ("N.s2/m2", -3),
    "_ns_per_m": ("N.s/m", -2),
    "_n_per_m_s": ("N/m/s", -2),
    "_n_per_m": ("N/m", -2),
    "_m_per_s": ("m/s", 1),
    "_n_per_s": ("N/s", -1),
    "_kg": ("kg", -2),
    "_n": ("N", -1),
    "_m": ("m", 1),
    "_samples": ("samples", 0),
    "_hz": ("Hz", 0),
    "_s": ("s", 0),
}
_POWERS = dict(_ENDINGS.values())
_Unit = tuple[float, tuple[int, ...]]
_NO_POWERS: tuple[int, ...] = (0, 0, 0, 0)
_LONGEST_ENDING = 12
"""Characters of an ending of a key that is read as a unit; the longest of a key here is `nms2_per_rad2`."""


def power_at_handle(key: str) -> int:
    """Return the power of the radius that converts a rotary value to the handle, by the unit of its key."""
    return next((power for ending, (_, power) in _ENDINGS.items() if key.endswith(ending)), 0)


def ending_of(key: str) -> str:
    """Return the ending of a linear key that names its unit; empty where it has none."""
    return next((ending for ending in _ENDINGS if key.endswith(ending)), "")


def unit_of_key(key: str, units: Units) -> str:
    """Return the SI unit of a key as a file states it; empty where it has none."""
    inner = units.inner(key)
    unit = next((unit for ending, (unit, _) in _ENDINGS.items() if inner.endswith(ending)), "")
    return unit if inner == key else units.unit(unit)


@lru_cache(maxsize=1024)
def unit_named(ending: str, unit: str) -> str:
    """Return the unit of a quantity that the ending of a key names: `n_per_mm` of N/m is N/mm; empty where it is none.

    It is another one than `unit`, in which such a key would be right. A time is a unit of what counts samples.
    """
    if len(ending) > _LONGEST_ENDING or ending.startswith("sample"):
        return ""
    target = "s" if unit == "samples" else unit
    _, wanted = next(_readings(target))
    for over, *under in itertools.product(*(_spelt(part) for part in ending.split("_per_"))):
        factors = [(over, 1), *((part, -1) for part in under)]
        sizes = [_NAMES[name][0] ** (sign * power) for part, sign in factors for name, power in part]
        powers = [[sign * power * own for own in _NAMES[name][1]] for part, sign in factors for name, power in part]
        size, total = math.prod(sizes), tuple(map(sum, zip(*powers, strict=True)))
        if _in_unit(size, total, target, wanted) is not None:
            is_unit_of_key = size == 1 and total == wanted and unit == target
            return "" if is_unit_of_key else "/".join(_written(part) for part in (over, *under))
    return ""


def _written(factors: tuple[tuple[str, int], ...]) -> str:
    """Return units that are multiplied, as read back: N.cm2."""
    return ".".join(f"{name}{power if power > 1 else ''}" for name, power in factors)


def _spelt(ending: str, most: int = _MOST_FACTORS) -> Iterator[tuple[tuple[str, int], ...]]:
    """Yield the units and powers that small letters without signs may mean: `ncm` and `n_cm` as N and cm."""
    for name in _SPELT_NAMES:
        for power in (2, 1):
            start = name.lower() + (str(power) if power > 1 else "")
            rest = ending.removeprefix(start).removeprefix("_")
            if ending == start:
                yield ((name, power),)
            elif ending.startswith(start) and most > 1:
                yield from (((name, power), *more) for more in _spelt(rest, most - 1))


def _words(word: str) -> Iterator[_Unit]:
    """Yield each reading of a word as units without a sign between them: ``Ncm``, ``gcm2``, ``mNm``."""
    alone, times = (word[:-1], int(word[-1])) if word[-1:].isdecimal() else (word, 1)
    if not word or alone in _ALONE:
        size, powers = _ALONE.get(alone, (1.0, _NO_POWERS))
        yield size**times, tuple(times * power for power in powers)
        return
    for name, (size, powers) in _NAMED.items():
        if word.startswith(name):
            rest = word.removeprefix(name)
            power, rest = (int(rest[0]), rest[1:]) if rest[:1].isdecimal() else (1, rest)
            for more, more_powers in _words(rest):
                yield size**power * more, tuple(power * a + b for a, b in zip(powers, more_powers, strict=True))


def _readings(text: str) -> Iterator[_Unit]:
    """Yield each reading of a unit, such as ``N.m/rad`` or ``counts per 10 mm``: its size in SI units, its powers."""
    text = text.translate(str.maketrans("\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}\N{SUPERSCRIPT TWO}", "uu2", "^"))
    # Each factor behind a stroke divides, in brackets or not.
    text = re.sub(r"\(([^()/]*)\)", r"\1", text)
    sign, factors = 1, []
    factor = r"\d+\.?\d*|[^\W\d_]+\d?|\N{DEGREE SIGN}|/|[^\s.\N{MIDDLE DOT}*]"
    for part in re.findall(factor, re.sub(r"\bper\b", "/", text)):
        if part == "/":
            sign = -1
        elif part[0].isdecimal():
            factors.append([(float(part) ** sign, _NO_POWERS)] if float(part) else [])
        else:
            read = _words(part) if len(part) <= 12 else ()
            factors.append([(size**sign, tuple(sign * power for power in powers)) for size, powers in read])
    for parts in itertools.product(*factors):
        powers = zip(_NO_POWERS, *(powers for _, powers in parts), strict=True)
        yield math.prod(size for size, _ in parts), tuple(map(sum, powers))


def read_quantity(text: str, unit: str, metres_per_radian: float | None = None) -> float:
    """Return a quantity as typed in SI units: ``55 um`` as 5.5e-5, ``1 kHz`` for a time, ``450 dpi`` for a step."""
    gear = r"(.+?)[\s,]+(?:gear\s+(\d+\.?\d*)(?:\s*:\s*(\d+\.?\d*))?|pitch\s+(.+?))\s*"
    geared = re.fullmatch(gear, text)
    if geared:
        return _behind(geared, unit)
    bits = re.match(r"\s*(\d{1,2})[\s-]*bits?\b", text)
    if bits:
        text = f"{2 ** int(bits[1])} counts{text[bits.end() :]}"
    typed = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text, re.DOTALL)
    readings = [] if typed is None else list(_readings(typed[2]))
    number = math.nan if typed is None else float(typed[1])
    if typed is None or not readings or not math.isfinite(number):
        raise ValueError(_no_quantity(unit, text))
    if not typed[2]:
        return number
    _, wanted = next(_readings(unit))
    for size, powers in readings:
        value = _in_unit(number * size, powers, unit, wanted)
        if value is not None:
            return float(f"{value:.15g}")
    linear = _linear(unit)
    if metres_per_radian is not None and linear != unit:
        with suppress(ValueError):
            return float(f"{read_quantity(text, linear) * metres_per_radian ** -_POWERS[linear]:.15g}")
    raise ValueError(_no_quantity(unit, text))


def _in_unit(value: float, powers: tuple[int, ...], unit: str, wanted: tuple[int, ...]) -> float | None:
    """Return a value in SI units, of some powers, in the unit that is wanted; None where it is none of that kind."""
    # N.m/rad typed without the angle is meant with it.
    if powers == wanted or (any(powers[:3]) and powers[:3] == wanted[:3]):
        return value
    # Counts of a turn, for the angle of a step.
    if not any(powers) and unit == "rad" and value:
        return 2 * math.pi / value
    # The reciprocal: a rate for a time, steps per length for a step.
    if any(powers) and tuple(-power for power in powers) == wanted and value:
        return 1 / value
    return None


_EXAMPLES = {
    "rad": '"2000 counts" (four times the lines), "12 bit", "0.09 deg"; with a radius "4000 counts per 10 mm"',
    "m": '"5 um", "450 dpi", "4000 counts per 10 mm", "4096 counts, pitch 5 mm"',
    "N.m": '"45 N.cm", "13 kgf.cm", "25 ozf.in", "90 mN.m, gear 30:1"',
    "N": '"8 N", "2 lbf", "0.2 N.m, pitch 5 mm"',
    "kg.m2": '"300 g.cm2", "50 g.cm2, gear 10"',
    "kg": '"45 g", "50 g.cm2, pitch 10 mm"',
    "N/m": '"3 kN/m", "3 N/mm"',
    "N.m/rad": '"500 mN.m/rad"; with a radius "200 N/m"',
    "N.s/m": '"12 N.s/m", "0.012 N.s/mm"',
    "N.m.s/rad": '"2 mN.m.s/rad"; with a radius "0.8 N.s/m"',
    "N/m/s": '"2 kN/(m.s)"',
    "N.m/rad/s": '"2 N.m/(rad.s)"',
    "m/s": '"20 mm/s"',
    "rad/s": '"90 deg/s"',
    "Hz": '"80 Hz", "0.08 kHz"',
    "s": '"2 ms", "1 kHz"',
    "samples": '"2 samples"; in a file "2 ms"',
}
"""Texts that are read in a unit."""


def _no_quantity(unit: str, text: str) -> str:
    """Return what to write for a unit in place of a text."""
    examples = f": {_EXAMPLES[unit]}" if unit in _EXAMPLES else ""
    finite = "a finite number" if re.fullmatch(r"\s*[-+]?(nan|inf(inity)?)\s*", text, re.IGNORECASE) else "a number"
    comma = re.search(r"(\d+),(\d+)", text)
    point = f"; a decimal point is a dot: {comma[1]}.{comma[2]}" if comma else ""
    return f"not a quantity in {unit}; give {finite}, or a text with such a unit{examples}{point}"


def _linear(unit: str) -> str:
    """Return the unit of a linear device for that of one that turns; any other unchanged."""
    return next((linear for linear in _POWERS if ROTARY.unit(linear) == unit), unit)


def _behind(geared: re.Match[str], unit: str) -> float:
    """Return a quantity of a motor as that of what a reduction or a screw moves."""
    typed, teeth, driver_teeth, pitch = geared.groups()
    power = _POWERS.get(_linear(unit), 0)
    if not power or (pitch and unit != _linear(unit)):
        raise ValueError(
            f"with a {'pitch' if pitch else 'gear'}, which has no effect on {unit} here; give the value without it"
        )
    if pitch:
        per_radian = read_quantity(pitch, "m") / (2 * math.pi)
    else:
        per_radian = min(float(teeth), float(driver_teeth or 1)) / max(float(teeth), float(driver_teeth or 1))
    if not per_radian > 0:
        raise ValueError("with a gear or pitch of 0; allowed: above 0")
    return float(f"{read_quantity(typed, ROTARY.unit(unit) if pitch else unit) * per_radian**power:.15g}")
