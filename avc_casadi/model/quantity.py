"""Physical quantities of a problem file: allowed values, as printed to the user.

Each has a range: a wrong unit is refused, no equation overflows. 0 means "absent", a subnormal number is a mistake.
"""

import numbers
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BeforeValidator
from pydantic_core import PydanticCustomError

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.table import refusal, shown


def plain(number: float) -> str:
    """Return a number in the usual form: 1e-9, not 1e-09."""
    return f"{number:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


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


def refuse_quantities(given: Mapping[str, tuple[object, Quantity]]) -> None:
    """Refuse numbers of a call that a file would refuse; None is one that is left out.

    Raises:
        InputError: with all of them.
    """
    faults = []
    for key, (value, quantity) in given.items():
        try:
            if value is not None:
                quantity(value)
        except PydanticCustomError as error:
            faults.append(Fault("", None, key, error.message()))
    if faults:
        raise InputError(faults)


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
SIGNED_DAMPING = Quantity("N.s/m", 1e-9, LARGEST_DAMPING_NS_PER_M, signed=True)
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
