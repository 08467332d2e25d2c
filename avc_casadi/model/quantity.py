"""Physical quantities of a problem file: allowed values, as printed to the user, and values typed with a unit.

Each has a range: a wrong unit is refused, no equation overflows. 0 means "absent", a subnormal number is a mistake.
"""

import itertools
import math
import numbers
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BeforeValidator

from avc_casadi._util.units import ROTARY, Units
from avc_casadi.model.table import refusal, shown


def plain(number: float) -> str:
    """Return a number in the usual form: 1e-9, not 1e-09."""
    return f"{number:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


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


def power_at_handle(key: str) -> int:
    """Return the power of the radius that converts a rotary value to the handle, by the unit of its key."""
    return next((power for ending, (_, power) in _ENDINGS.items() if key.endswith(ending)), 0)


def unit_of_key(key: str, units: Units) -> str:
    """Return the SI unit of a key as a file states it; empty where it has none."""
    inner = units.inner(key)
    unit = next((unit for ending, (unit, _) in _ENDINGS.items() if inner.endswith(ending)), "")
    return unit if inner == key else units.unit(unit)


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
        raise ValueError(_no_quantity(unit))
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
    raise ValueError(_no_quantity(unit))


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


def _no_quantity(unit: str) -> str:
    """Return what to write for a unit."""
    as_in = {
        "rad": ': "2000 counts" (four times the lines), "12 bit", "0.09 deg"; with a radius "4000 counts per 10 mm"',
        "m": ': "5 um", "450 dpi", "4000 counts per 10 mm", "4096 counts, pitch 5 mm"',
        "N.m": ': "45 N.cm", "13 kgf.cm", "25 ozf.in", "90 mN.m, gear 30:1"',
        "N": ': "8 N", "2 lbf", "0.2 N.m, pitch 5 mm"',
        "kg.m2": ': "300 g.cm2", "50 g.cm2, gear 10"',
        "kg": ': "45 g", "50 g.cm2, pitch 10 mm"',
    }.get(unit, "")
    return f"not a quantity in {unit}; give a number, or a text with such a unit{as_in}"


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


@dataclass(frozen=True)
class Quantity:
    """Validator of one real quantity."""

    unit: str
    lowest: float
    highest: float
    zero: bool = True
    signed: bool = False

    @property
    def allowed(self) -> str:
        """Return the allowed range, for example ``0 or 1e-9 to 1e6``."""
        span = f"{plain(self.lowest)} to {plain(self.highest)}"
        return f"{'0 or ' if self.zero else ''}{span}{' of either sign' if self.signed else ''}"

    def __call__(self, value: Any) -> float:
        """Return the value as a float, or refuse it."""
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise refusal(f"is {shown(value)}, not a number; allowed: {self.allowed}")
        number: Any = value  # an integer of any length, which float() might refuse
        if self.zero and number == 0:
            return 0.0
        magnitude = abs(number) if self.signed else number
        if not self.lowest <= magnitude <= self.highest:
            raise refusal(f"is {shown(value)}; allowed: {self.allowed}")
        return float(number)


@dataclass(frozen=True)
class Whole:
    """Validator of an integer from `lowest` to `highest`."""

    lowest: int
    highest: int

    @property
    def allowed(self) -> str:
        """Return the allowed values."""
        return f"an integer {self.lowest} to {self.highest}"

    def __call__(self, value: Any) -> int:
        """Return the value as an int, or refuse it."""
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise refusal(f"is {shown(value)}, not an integer; allowed: {self.allowed}")
        if not self.lowest <= int(value) <= self.highest:
            raise refusal(f"is {shown(value)}; allowed: {self.allowed}")
        return int(value)


LEAST_DELAY_SAMPLES = 1e-3
MOST_LOOP_DELAY_SAMPLES = 32
"""Longest delay for which the loops of a device with a force sensor are computed."""


def _whole(number: float) -> float:
    """Return a number of samples, an int where it is whole."""
    return int(number) if float(number).is_integer() else number


def _pair(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refusal(f"is {shown(value)}; allowed: two numbers, [lowest, highest]")
    return tuple(value)


def ordered(value: tuple[float, float]) -> tuple[float, float]:
    """Return two numbers, or refuse them where the first is the larger."""
    if value[0] > value[1]:
        raise refusal(f"is {shown(value)}, reversed; allowed: [lowest, highest], which may be equal")
    return value


def sequence(value: Any) -> Any:
    """Return a list as a tuple, or refuse what is no list, empty or too long."""
    if not isinstance(value, list | tuple) or not value:
        raise refusal(f"is {shown(value)}; allowed: a list of at least one number")
    if len(value) > MOST_FREQUENCIES:
        raise refusal(f"has {len(value)} numbers; allowed: at most {MOST_FREQUENCIES}")
    return tuple(value)


LARGEST_DAMPING_NS_PER_M = 1e9
"""Largest damper of a problem or of a coupling."""
LARGEST_STIFFNESS_N_PER_M = 1e12
"""Largest spring of a problem or of a coupling."""
RADII_M = (2e-3, 10.0)
"""Admissible radii of the grip on a rotary device."""
MOST_FREQUENCIES = 20_000
"""Largest number of rows of a problem or of a gain table."""

DAMPING = Quantity("N.s/m", 1e-9, LARGEST_DAMPING_NS_PER_M)
STIFFNESS = Quantity("N/m", 1e-9, LARGEST_STIFFNESS_N_PER_M)
HERTZ = Quantity("Hz", 1e-6, 1e7, zero=False)

Mass = Annotated[float, BeforeValidator(Quantity("kg", 1e-9, 1e6))]
Damping = Annotated[float, BeforeValidator(DAMPING)]
Stiffness = Annotated[float, BeforeValidator(STIFFNESS)]
Force = Annotated[float, BeforeValidator(Quantity("N", 1e-9, 1e6))]
ForceLimit = Annotated[float, BeforeValidator(Quantity("N", 1e-6, 1e6, zero=False))]
Length = Annotated[float, BeforeValidator(Quantity("m", 1e-12, 1))]
Amplitude = Annotated[float, BeforeValidator(Quantity("m", 1e-12, 10))]
Radius = Annotated[float, BeforeValidator(Quantity("m", *RADII_M, zero=False))]
Position = Annotated[float, BeforeValidator(Quantity("m", 1e-9, 10, signed=True))]
Speed = Annotated[float, BeforeValidator(Quantity("m/s", 1e-6, 100, zero=False))]
Acceleration = Annotated[float, BeforeValidator(Quantity("m/s^2", 1e-6, 1e9, zero=False))]
SampleTime = Annotated[float, BeforeValidator(Quantity("s", 1e-7, 10, zero=False))]
Span = Annotated[float, BeforeValidator(Quantity("s", 1e-7, 3600, zero=False))]
Wait = Annotated[float, BeforeValidator(Quantity("s", 1e-9, 3600))]
Hertz = Annotated[float, BeforeValidator(HERTZ)]
Rate = Annotated[float, BeforeValidator(Quantity("1/s", 1e-6, 1e9, zero=False))]
Weight = Annotated[float, BeforeValidator(Quantity("", 1e-12, 1e12))]
Slope = Annotated[float, BeforeValidator(Quantity("", 1e-6, 1e6, zero=False))]
Factor = Annotated[float, BeforeValidator(Quantity("", 1, 1e6, zero=False))]
Threshold = Annotated[float, BeforeValidator(Quantity("", 1e-3, 0.999, zero=False))]
Share = Annotated[float, BeforeValidator(Quantity("", 1e-9, 1))]
DampingRatio = Annotated[float, BeforeValidator(Quantity("", 1e-6, 10))]
LoopDampingRatio = Annotated[float, BeforeValidator(Quantity("", 0.05, 10, zero=False))]
MassShare = Annotated[float, BeforeValidator(Quantity("", 1e-6, 0.999999, zero=False))]
DiskMargin = Annotated[float, BeforeValidator(Quantity("", 0.01, 1, zero=False))]
GainMargin = Annotated[float, BeforeValidator(Quantity("", 1, 4, zero=False))]
_Samples = BeforeValidator(Quantity("samples", LEAST_DELAY_SAMPLES, 1000))
DelaySamples = Annotated[int | float, _Samples, AfterValidator(_whole)]
_FewSamples = BeforeValidator(Quantity("samples", LEAST_DELAY_SAMPLES, MOST_LOOP_DELAY_SAMPLES))
LoopDelaySamples = Annotated[int | float, _FewSamples, AfterValidator(_whole)]
Substeps = Annotated[int, BeforeValidator(Whole(1, 1000))]
Points = Annotated[int, BeforeValidator(Whole(1, MOST_FREQUENCIES))]
Seed = Annotated[int, BeforeValidator(Whole(0, 2**32 - 1))]

One = TypeVar("One", bound=float)
Pair = Annotated[tuple[One, One], BeforeValidator(_pair), AfterValidator(ordered)]
Entry = Annotated[float, BeforeValidator(Quantity("", 1e-30, 1e12, signed=True))]
Entries = Annotated[tuple[Entry, ...], BeforeValidator(sequence)]
EntryRows = Annotated[tuple[Entries, ...], BeforeValidator(sequence)]
Place = Annotated[int, BeforeValidator(Whole(0, 63))]
Places = Annotated[tuple[Place, ...], BeforeValidator(sequence)]
Frequencies = Annotated[tuple[Hertz, ...], BeforeValidator(sequence)]
