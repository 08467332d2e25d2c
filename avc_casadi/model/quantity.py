"""Physical quantities of a problem file: allowed values, as printed to the user.

Every quantity has a stated range, so that a wrong unit is refused and no equation overflows. Zero is
special: 0 means "absent", and a subnormal number means a mistake.
"""

import difflib
import numbers
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict
from pydantic_core import PydanticCustomError

from avc_casadi._util.units import KG, M_PER_S, M_PER_S2, METRE, N_PER_M, NEWTON, NS_PER_M, Wording


class Table(BaseModel):
    """A frozen table: unknown keys, wrong types and non-finite numbers are refused."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)


_SHOWN = 60


def refusal(text: str) -> PydanticCustomError:
    """Return the error that a validator raises; `text` reaches the user unchanged."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def visible(text: str) -> str:
    """Return a text of the file, shortened, with control and invisible characters escaped."""
    marks = [mark if mark.isprintable() else f"\\u{ord(mark):04x}" for mark in text[:_SHOWN]]
    return "".join(marks) + ("..." if len(text) > _SHOWN else "")


def shown(value: object) -> str:
    """Return a value as in the file, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping | BaseModel):
        return "a table"
    if isinstance(value, str):
        return f'"{visible(value)}"'
    if isinstance(value, int) and abs(value) >= 10**_SHOWN:
        return f"an integer of more than {_SHOWN} digits"
    if isinstance(value, list | tuple):
        return visible(f"[{', '.join(shown(item) for item in value[:_SHOWN])}]")
    return visible(str(value))


def one_of(choices: Iterable[object], value: object) -> str:
    """Return the list of choices as in a file, with the one close to a value."""
    known = list(choices)
    near = difflib.get_close_matches(str(value)[:60], [str(choice) for choice in known], n=1)
    return f"{', '.join(map(shown, known))}{f'; did you mean {shown(near[0])}?' if near else ''}"


def nearest_key(typed: str, keys: Iterable[str]) -> str | None:
    """Return the key that a mistyped one means, if any is close: one that begins with the same word comes first.

    Args:
        typed: what stands in the file.
        keys: those of its table.
    """
    near = difflib.get_close_matches(typed[:60], list(keys), n=5)
    return min(near, key=lambda one: one.split("_")[0] != typed.split("_", maxsplit=1)[0], default=None)


def plain(number: float) -> str:
    """Return a number in the usual form: 1e-9, not 1e-09."""
    return f"{number:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


@dataclass(frozen=True)
class Quantity:
    """Validator of one real quantity.

    Attributes:
        unit: SI unit, as printed.
        lowest: smallest magnitude other than 0.
        highest: largest magnitude.
        zero: whether 0 is allowed.
        signed: whether the negative range is allowed too.
    """

    unit: str | Wording
    lowest: float
    highest: float
    zero: bool = True
    signed: bool = False

    @property
    def allowed(self) -> str:
        """Return the allowed range, for example ``0 or 1e-9 to 1e6 kg``."""
        span = f"{plain(self.lowest)} to {plain(self.highest)}{self.unit and ' '}{self.unit}"
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
"""Least delay other than 0."""


def _delay(value: Any) -> float:
    """Return a number of samples, an int where it is whole."""
    number = Quantity("samples", LEAST_DELAY_SAMPLES, 1000)(value)
    return int(number) if number.is_integer() else number


def _pair(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refusal(f"is {shown(value)}; allowed: two numbers, [lowest, highest]")
    return tuple(value)


def ordered(value: tuple[float, float]) -> tuple[float, float]:
    """Return two numbers, or refuse them where the first is the larger."""
    if value[0] > value[1]:
        raise refusal(f"is {shown(value)}, reversed; allowed: [lowest, highest], both may be equal")
    return value


def sequence(value: Any) -> Any:
    """Return a list as a tuple, or refuse what is no list, empty or too long."""
    if not isinstance(value, list | tuple) or not value:
        raise refusal(f"is {shown(value)}; allowed: a list of at least one number")
    if len(value) > MOST_FREQUENCIES:
        raise refusal(f"has {len(value)} numbers; allowed: at most {MOST_FREQUENCIES}")
    return tuple(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise refusal(f"is {shown(value)}, not a text; allowed: text in quotation marks")
    if len(value) > 2000:
        raise refusal(f"has {len(value)} characters; allowed: at most 2000")
    if any(unicodedata.category(mark) in {"Cc", "Cs"} and mark not in "\n\t" for mark in value):
        raise refusal("holds a control character; allowed: text, line feeds and tabs")
    return value


LARGEST_DAMPING_NS_PER_M = 1e9
"""Largest damper of a problem or of a coupling."""
LARGEST_STIFFNESS_N_PER_M = 1e12
"""Largest spring of a problem or of a coupling."""
RADII_M = (2e-3, 10.0)
"""Admissible radii of the grip on a rotary device."""
FREQUENCIES_HZ = (1e-6, 1e7)
"""Lowest and highest frequency of a problem or of a gain table."""

MOST_FREQUENCIES = 20_000
"""Largest number of rows of a problem or of a gain table."""

Text = Annotated[str, BeforeValidator(_text)]

Mass = Annotated[float, BeforeValidator(Quantity(KG, 1e-9, 1e6))]
Damping = Annotated[float, BeforeValidator(Quantity(NS_PER_M, 1e-9, LARGEST_DAMPING_NS_PER_M))]
Stiffness = Annotated[float, BeforeValidator(Quantity(N_PER_M, 1e-9, LARGEST_STIFFNESS_N_PER_M))]
Force = Annotated[float, BeforeValidator(Quantity(NEWTON, 1e-9, 1e6))]
ForceLimit = Annotated[float, BeforeValidator(Quantity(NEWTON, 1e-6, 1e6, zero=False))]
Length = Annotated[float, BeforeValidator(Quantity(METRE, 1e-12, 1))]
Amplitude = Annotated[float, BeforeValidator(Quantity(METRE, 1e-12, 10))]
Radius = Annotated[float, BeforeValidator(Quantity("m", *RADII_M, zero=False))]
Position = Annotated[float, BeforeValidator(Quantity(METRE, 1e-9, 10, signed=True))]
Speed = Annotated[float, BeforeValidator(Quantity(M_PER_S, 1e-6, 100, zero=False))]
Acceleration = Annotated[float, BeforeValidator(Quantity(M_PER_S2, 1e-6, 1e9, zero=False))]
SampleTime = Annotated[float, BeforeValidator(Quantity("s", 1e-7, 10, zero=False))]
Span = Annotated[float, BeforeValidator(Quantity("s", 1e-7, 3600, zero=False))]
Wait = Annotated[float, BeforeValidator(Quantity("s", 1e-9, 3600))]
Hertz = Annotated[float, BeforeValidator(Quantity("Hz", *FREQUENCIES_HZ, zero=False))]
Rate = Annotated[float, BeforeValidator(Quantity("1/s", 1e-6, 1e9, zero=False))]
Weight = Annotated[float, BeforeValidator(Quantity("", 1e-12, 1e12))]
Slope = Annotated[float, BeforeValidator(Quantity("", 1e-6, 1e6, zero=False))]
Factor = Annotated[float, BeforeValidator(Quantity("", 1, 1e6, zero=False))]
Threshold = Annotated[float, BeforeValidator(Quantity("", 1e-3, 0.999, zero=False))]
Share = Annotated[float, BeforeValidator(Quantity("", 1e-9, 1))]
DampingRatio = Annotated[float, BeforeValidator(Quantity("", 1e-6, 10))]
LoopDampingRatio = Annotated[float, BeforeValidator(Quantity("", 0.05, 10, zero=False))]
MassRatio = Annotated[float, BeforeValidator(Quantity("", 1e-6, 1e3, zero=False))]
MassShare = Annotated[float, BeforeValidator(Quantity("", 1e-6, 0.999999, zero=False))]
DelaySamples = Annotated[int | float, BeforeValidator(_delay)]
Substeps = Annotated[int, BeforeValidator(Whole(1, 1000))]
Points = Annotated[int, BeforeValidator(Whole(1, MOST_FREQUENCIES))]
Seed = Annotated[int, BeforeValidator(Whole(0, 2**32 - 1))]

MassInterval = Annotated[tuple[Mass, Mass], BeforeValidator(_pair), AfterValidator(ordered)]
DampingInterval = Annotated[tuple[Damping, Damping], BeforeValidator(_pair), AfterValidator(ordered)]
StiffnessInterval = Annotated[tuple[Stiffness, Stiffness], BeforeValidator(_pair), AfterValidator(ordered)]
FrequencyInterval = Annotated[tuple[Hertz, Hertz], BeforeValidator(_pair), AfterValidator(ordered)]
ForceInterval = Annotated[tuple[Force, Force], BeforeValidator(_pair), AfterValidator(ordered)]
ForceLimitInterval = Annotated[tuple[ForceLimit, ForceLimit], BeforeValidator(_pair), AfterValidator(ordered)]
LengthInterval = Annotated[tuple[Length, Length], BeforeValidator(_pair), AfterValidator(ordered)]
DampingRatioInterval = Annotated[tuple[DampingRatio, DampingRatio], BeforeValidator(_pair), AfterValidator(ordered)]
LoopDampingRatioInterval = Annotated[
    tuple[LoopDampingRatio, LoopDampingRatio], BeforeValidator(_pair), AfterValidator(ordered)
]
MassShareInterval = Annotated[tuple[MassShare, MassShare], BeforeValidator(_pair), AfterValidator(ordered)]
DelayInterval = Annotated[tuple[DelaySamples, DelaySamples], BeforeValidator(_pair), AfterValidator(ordered)]
Entry = Annotated[float, BeforeValidator(Quantity("", 1e-30, 1e12, signed=True))]
Entries = Annotated[tuple[Entry, ...], BeforeValidator(sequence)]
EntryRows = Annotated[tuple[Entries, ...], BeforeValidator(sequence)]
Place = Annotated[int, BeforeValidator(Whole(0, 63))]
Places = Annotated[tuple[Place, ...], BeforeValidator(sequence)]
Frequencies = Annotated[tuple[Hertz, ...], BeforeValidator(sequence)]
