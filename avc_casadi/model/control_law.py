"""The table `[law]`: what a user's controller does, as pieces of `law_pieces`."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny

from avc_casadi.model import law_pieces as p
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import Device
from avc_casadi.model.law import FRICTION_COMPENSATION, INTEGRAL_LIMIT, SPRING_DEAD_ZONE, Law, Sector

LARGEST_COMPENSATION = 0.5
"""Loop gain at half the sample rate up to which a negative virtual mass is allowed: a gain margin of 6 dB there."""
# Share by which a gain at that bound may exceed it: what a value loses that is printed and read.
_ROUNDING = 1e-9
_MOST_FILTERS = 16
# Longest timeout of the time between steps, in samples: its linear claim is a window of twice as many.
_MOST_TICKS = 128
# Limits are looked for up to windows of so many samples: a longer one delays the velocity by more than half of them.
_LONGEST_WINDOW = 64
# Frequencies at which limits are looked for, as shares of the sample rate: below the first a filter hardly moves.
_LEAST_SHARE = 1e-4
_MOST_SHARE = 0.499

_Signed = {"zero": True, "signed": True}
SignedDamping = Annotated[float, BeforeValidator(q.SIGNED_DAMPING)]
SignedMass = Annotated[float, BeforeValidator(q.Quantity("kg", 1e-9, 1e6, **_Signed))]
Integral = Annotated[float, BeforeValidator(q.Quantity("N/m/s", 1e-9, 1e15))]
_Width = Annotated[float, BeforeValidator(q.Quantity("", 1e-3, 10, zero=False))]
_Lead = Annotated[float, BeforeValidator(q.Quantity("", 0.1, 85, zero=False))]
_WindowSamples = Annotated[int, BeforeValidator(q.Whole(1, 256))]
_Divider = Annotated[int, BeforeValidator(q.Whole(1, 1000))]


class DifferenceVelocity(t.Table):
    """The backward difference (1 - 1/z)/T."""

    kind: Literal["difference"] = "difference"

    @property
    def piece(self) -> p.Velocity:
        """The estimator."""
        return p.Difference()


class WindowVelocity(t.Table):
    """The difference over a window, (1 - z^-n)/(n T)."""

    kind: Literal["window"] = "window"
    samples: _WindowSamples

    @property
    def piece(self) -> p.Velocity:
        """The estimator."""
        return p.Window(self.samples)


class LowPassVelocity(t.Table):
    """The backward difference behind a low pass."""

    kind: Literal["low-pass"] = "low-pass"
    cutoff_hz: q.Hertz
    order: Literal[1, 2] = 1

    @property
    def piece(self) -> p.Velocity:
        """The estimator."""
        return p.SmoothedDifference(self.cutoff_hz, self.order)


class KalmanVelocity(t.Table):
    """The steady Kalman filter of a constant velocity (alpha-beta filter)."""

    kind: Literal["kalman"] = "kalman"
    bandwidth_hz: q.Hertz

    @property
    def piece(self) -> p.Velocity:
        """The estimator."""
        return p.Kalman(self.bandwidth_hz)


class TicksVelocity(t.Table):
    """The way between two changes of the position over the time between them, 0 after a timeout."""

    kind: Literal["ticks"] = "ticks"
    timeout_s: q.Span

    @property
    def piece(self) -> p.Velocity:
        """The estimator."""
        return p.Ticks(self.timeout_s)


class CommandFilter(t.Table):
    """A filter of the command."""

    kind: Any

    @property
    @abstractmethod
    def piece(self) -> p.Filter:
        """The filter."""


class LowPassFilter(CommandFilter):
    """(1 - p)/(1 - p/z), p = exp(-2 pi f T), or Butterworth's of order 2."""

    kind: Literal["low-pass"] = "low-pass"
    cutoff_hz: q.Hertz
    order: Literal[1, 2] = 1

    @property
    def piece(self) -> p.Filter:
        """The filter."""
        return p.LowPass(self.cutoff_hz, self.order)


class NotchFilter(CommandFilter):
    """(s^2 + 2 depth width w s + w^2)/(s^2 + 2 width w s + w^2) by Tustin, prewarped at w."""

    kind: Literal["notch"] = "notch"
    frequency_hz: q.Hertz
    depth: q.Share = 0.1
    width: _Width = 0.5

    @property
    def piece(self) -> p.Filter:
        """The filter."""
        return p.Notch(self.frequency_hz, self.depth, self.width)


class LeadFilter(CommandFilter):
    """(1 + r s/w)/(1 + s/(r w)) by Tustin, prewarped at w, where its phase is the largest."""

    kind: Literal["lead"] = "lead"
    frequency_hz: q.Hertz
    phase_deg: _Lead

    @property
    def piece(self) -> p.Filter:
        """The filter."""
        return p.Lead(self.frequency_hz, self.phase_deg)


class TransferFilter(CommandFilter):
    """A transfer function in z, polynomials with the highest power first."""

    kind: Literal["transfer"] = "transfer"
    numerator: q.Entries
    denominator: q.Entries

    def faults(self) -> Iterator[t.Finding]:
        """Yield a transfer function that no computer can compute, or that grows by itself."""
        if self.denominator[0] == 0:
            yield ("denominator",), f"is {t.shown(self.denominator)}; allowed: a first coefficient other than 0"
            return
        degree = len(self.denominator) - 1
        if len(self.numerator) > len(self.denominator):
            why = f"improper: it needs future samples; allowed: at most degree {degree}, as the denominator"
            yield ("numerator",), f"is {t.shown(self.numerator)}, of degree {len(self.numerator) - 1}, {why}"
        radius = float(np.abs(np.roots(self.denominator)).max(initial=0.0))
        if radius >= 1:
            why = "unstable: its output never decays; allowed: poles of size below 1 (an integral has its own key)"
            yield ("denominator",), f"is {t.shown(self.denominator)}, with a pole of size {radius:.4g}, {why}"

    @property
    def piece(self) -> p.Filter:
        """The filter."""
        return p.Transfer(self.numerator, self.denominator)


FILTERS: dict[str, type[CommandFilter]] = {
    "low-pass": LowPassFilter,
    "notch": NotchFilter,
    "lead": LeadFilter,
    "transfer": TransferFilter,
}
VELOCITIES: dict[str, type[t.Table]] = {
    "difference": DifferenceVelocity,
    "window": WindowVelocity,
    "low-pass": LowPassVelocity,
    "kalman": KalmanVelocity,
    "ticks": TicksVelocity,
}
Velocity = Annotated[
    DifferenceVelocity | WindowVelocity | LowPassVelocity | KalmanVelocity | TicksVelocity,
    Field(discriminator="kind"),
]


def _filters(value: Any) -> tuple[Any, ...]:
    return t.of_kinds(value, FILTERS, "[[law.filters]]", _MOST_FILTERS)


class Compensation(t.Table):
    """Friction compensation: a push along the motion, force_n sat(v/velocity_m_per_s)."""

    force_n: q.ForceLimit
    velocity_m_per_s: q.Speed


@dataclass(frozen=True)
class SlopeRange:
    """A piece that is not linear, as its range of slopes.

    Attributes:
        key: its key in the table [law].
        sector: its name in the compiled law, with the same range as a share of the steepest slope.
        least, most: its slopes: of a spring in N/m, of friction compensation in N.s/m (it drives: below 0), of a limit
            the share that it leaves.
    """

    key: str
    sector: Sector
    least: float
    most: float


NumberPath = tuple[str | int, ...]

_GAINS = (
    "stiffness_n_per_m",
    "damping_ns_per_m",
    "local_damping_ns_per_m",
    "integral_n_per_m_s",
    "virtual_mass_kg",
)


@dataclass(frozen=True)
class LawNumber:
    """A number of a law: where it stands, its value, and between which values it may lie.

    `linear`: every matrix of the law is affine in it. `unlimited_below`: a search ends at the lowest, not the number.
    `sole`: every other gain is 0, so that with a value of 0 there is no law.
    """

    path: NumberPath
    value: float
    lowest: float = 0.0
    highest: float = math.inf
    linear: bool = False
    unlimited_below: bool = False
    sole: bool = False

    @property
    def key(self) -> str:
        """Its key as in a file."""
        return t.dotted(self.path)

    @property
    def whole(self) -> bool:
        """Whether it counts samples."""
        return self.path[-1] == "samples"


class ControlLaw(t.Table):
    """Your controller: k, b and ki act in the wall, all other pieces everywhere; filters act on the force command.

    With a `rate_divider` of n it runs at every n-th sample of the device, T n apart, and keeps its force between.
    """

    stiffness_n_per_m: q.Stiffness = 0.0
    damping_ns_per_m: q.Damping = 0.0
    local_damping_ns_per_m: SignedDamping = 0.0
    integral_n_per_m_s: Integral = 0.0
    virtual_mass_kg: SignedMass = 0.0
    velocity: Velocity = DifferenceVelocity()
    filters: Annotated[tuple[SerializeAsAny[CommandFilter], ...], BeforeValidator(_filters)] = ()
    dead_zone_m: q.Length = 0.0
    integral_limit_n: q.ForceLimit | None = None
    friction_compensation: Compensation | None = None
    rate_divider: _Divider = 1

    def faults(self) -> Iterator[t.Finding]:
        """Yield a law without any force, an integral without a spring, and what has nothing that it acts on."""
        if self.dead_zone_m and not self.stiffness_n_per_m:
            why = "needs a spring; give stiffness_n_per_m"
            yield ("dead_zone_m",), f"is {t.shown(self.dead_zone_m)}, which {why}"
        if self.integral_limit_n is not None and not self.integral_n_per_m_s:
            why = "needs an integral; give integral_n_per_m_s"
            yield ("integral_limit_n",), f"is {t.shown(self.integral_limit_n)}, which {why}"
        if not self.acts:
            yield (
                (_GAINS[0],),
                f"is 0, and so is every other gain; allowed: at least one other than 0, of {', '.join(_GAINS)}",
            )
        if self.integral_n_per_m_s and not self.stiffness_n_per_m:
            why = "needs a spring, because an integral alone is unstable; give stiffness_n_per_m"
            yield ("integral_n_per_m_s",), f"is {t.shown(self.integral_n_per_m_s)}, and {why}"

    @property
    def acts(self) -> bool:
        """Whether it gives any force."""
        return self.friction_compensation is not None or any(getattr(self, key) for key in _GAINS)

    def faults_beside(self, device: Device, lightest_kg: float) -> Iterator[t.Finding]:
        """Yield what of the law a device cannot run or bear; `lightest_kg` is what moves at least."""
        period = self.period_s(device.sample_time_s)
        yield from self._frequency_faults(period)
        yield from self._velocity_faults(device, period)
        compensation = self.friction_compensation
        if compensation is not None and compensation.force_n > (device.max_force_n or math.inf):
            allowed = f"up to device.max_force_n, {t.shown(device.max_force_n)}"
            yield ("friction_compensation", "force_n"), f"is {t.shown(compensation.force_n)}; allowed: {allowed}"
        gain = self.compensation_gain(device.sample_time_s, lightest_kg)
        if gain > LARGEST_COMPENSATION * (1 + _ROUNDING):
            value = t.shown(self.virtual_mass_kg)
            why = f"a loop gain of {gain:.3g} at half the sample rate with a mass of {q.plain(lightest_kg)}"
            allowed = (
                f"allowed: up to {LARGEST_COMPENSATION}; use a smaller value, or a slower velocity estimate or filter"
            )
            yield ("virtual_mass_kg",), f"is {value}, {why}; {allowed}"

    def _frequency_faults(self, period_s: float) -> Iterator[t.Finding]:
        """Yield the first frequency at or beyond half the rate of the law."""
        places: list[tuple[t.Path, float]] = [
            (("filters", index, "frequency_hz"), item.frequency_hz)
            for index, item in enumerate(self.filters)
            if isinstance(item, NotchFilter | LeadFilter)
        ]
        if isinstance(self.velocity, KalmanVelocity):
            places.append((("velocity", "bandwidth_hz"), self.velocity.bandwidth_hz))
        rate = "device.sample_time_s" + (" over rate_divider" if self.rate_divider > 1 else "")
        for path, frequency in places:
            if frequency * period_s >= 0.5:
                allowed = f"below {q.plain(0.5 / period_s)} Hz, half the rate of {rate}"
                yield path, f"is {t.shown(frequency)}; allowed: {allowed}"
                return

    def _velocity_faults(self, device: Device, period_s: float) -> Iterator[t.Finding]:
        """Yield a time between steps on a device without any, and a timeout of no sample or of too many."""
        if not isinstance(self.velocity, TicksVelocity):
            return
        if not device.encoder_resolution_m:
            why = "needs encoder steps, and device.encoder_resolution_m is 0"
            yield ("velocity", "kind"), f'"ticks" {why}; give a resolution, or another velocity'
        samples = self.velocity.timeout_s / period_s
        if not 1 <= round(samples) <= _MOST_TICKS:
            allowed = f"{q.plain(period_s)} to {q.plain(_MOST_TICKS * period_s)} s, 1 to {_MOST_TICKS} samples"
            yield ("velocity", "timeout_s"), f"is {t.shown(self.velocity.timeout_s)}; allowed: {allowed}"

    def period_s(self, sample_time_s: float) -> float:
        """Return the time between two samples of the law, at the sample time of the device."""
        return self.rate_divider * sample_time_s

    def compensation_gain(self, sample_time_s: float, lightest_kg: float) -> float:
        """Return the gain by which a negative virtual mass m feeds an acceleration back at half the sample rate.

        It is |m|/M |E F|, with M the lightest mass that moves, E the estimator of the velocity over the difference and
        F the filters of the command, at z = -1.
        """
        if self.virtual_mass_kg >= 0:
            return 0.0
        gain_per_kg = self._compensation_gain_per_kg(sample_time_s, lightest_kg)
        return -self.virtual_mass_kg * gain_per_kg

    def lowest_virtual_mass_kg(self, sample_time_s: float, lightest_kg: float) -> float:
        """Return the negative virtual mass whose compensation gain is the largest that a file may state."""
        gain_per_kg = self._compensation_gain_per_kg(sample_time_s, lightest_kg)
        return -LARGEST_COMPENSATION / gain_per_kg if gain_per_kg else -math.inf

    def _compensation_gain_per_kg(self, sample_time_s: float, lightest_kg: float) -> float:
        half_rate = np.array(-1.0 + 0j)
        period = self.period_s(sample_time_s)
        growth = self.velocity.piece.growth(period).transfer(half_rate)
        filters = p.compiled((p.Spring(1.0),), self.filter_pieces, period).transfer(half_rate)
        shape = float(abs(growth * filters)) / 2
        return shape / lightest_kg if lightest_kg else math.inf

    @property
    def filter_pieces(self) -> tuple[p.Filter, ...]:
        """The filters of the command, in order."""
        return tuple(item.piece for item in self.filters)

    def law(self, sample_time_s: float) -> Law:
        """Return the law in contact, linear: each nonlinear piece at its steepest slope."""
        return self.with_sectors(sample_time_s).linear

    def outside(self, sample_time_s: float) -> Law:
        """Return what acts outside the wall, linear: all but spring, damper and integral, behind the same filters."""
        return self.with_sectors(sample_time_s, contact=False).linear

    def with_sectors(self, sample_time_s: float, *, contact: bool = True) -> Law:
        """Return the law in contact or outside, at its own period; nonlinear pieces are its sectors.

        `sample_time_s` is the device's. `slope_ranges` says what the slopes of the sectors are.
        """
        period = self.period_s(sample_time_s)
        # A piece of 0 is left out: the state of an integral that acts on nothing would be a pole at 1.
        forces = (*self.forces_in_wall(), *self.forces_everywhere()) if contact else self.forces_everywhere()
        return p.compiled(forces, self.filter_pieces, period)

    def forces_in_wall(self) -> tuple[p.Force, ...]:
        """Return the pieces that act in the wall alone where there is one: spring, damper, integral."""
        forces: list[tuple[float, p.Force]] = [
            (self.stiffness_n_per_m, p.Spring(self.stiffness_n_per_m, self.dead_zone_m)),
            (self.damping_ns_per_m, p.Damper(self.damping_ns_per_m, self.velocity.piece)),
            (self.integral_n_per_m_s, p.Integral(self.integral_n_per_m_s, self.integral_limit_n)),
        ]
        return tuple(force for value, force in forces if value)

    def forces_everywhere(self) -> tuple[p.Force, ...]:
        """Return the pieces that act outside the wall too: damper b_p, virtual mass and friction compensation."""
        velocity = self.velocity.piece
        forces: list[p.Force] = []
        if self.local_damping_ns_per_m:
            forces.append(p.Damper(self.local_damping_ns_per_m, velocity))
        if self.virtual_mass_kg:
            forces.append(p.VirtualMass(self.virtual_mass_kg, velocity))
        if self.friction_compensation is not None:
            switched = self.friction_compensation
            forces.append(p.FrictionCompensation(switched.force_n, switched.velocity_m_per_s, velocity))
        return tuple(forces)

    @property
    def slope_ranges(self) -> tuple[SlopeRange, ...]:
        """The least and the largest slope of each nonlinear piece; the force limit belongs to the device."""
        ranges: list[SlopeRange] = []
        if self.dead_zone_m:
            ranges.append(SlopeRange("dead_zone_m", SPRING_DEAD_ZONE, 0.0, self.stiffness_n_per_m))
        if self.integral_limit_n is not None:
            ranges.append(SlopeRange("integral_limit_n", INTEGRAL_LIMIT, 0.0, 1.0))
        if self.friction_compensation is not None:
            steepest = -self.friction_compensation.force_n / self.friction_compensation.velocity_m_per_s
            ranges.append(SlopeRange("friction_compensation", FRICTION_COMPENSATION, steepest, 0.0))
        return tuple(ranges)

    @property
    def is_linear(self) -> bool:
        """Whether each piece is linear and runs at every sample: `law` is then all of it."""
        return not self.slope_ranges and self.rate_divider == 1 and not isinstance(self.velocity, TicksVelocity)

    @property
    def acts_outside(self) -> bool:
        """Whether something acts outside the wall."""
        return bool(self.forces_everywhere())

    @property
    def is_spring_damper(self) -> bool:
        """Whether it is k, b and b_p alone, with at most a low pass of first order on the velocity."""
        more = self.integral_n_per_m_s or self.virtual_mass_kg or self.filters or self.local_damping_ns_per_m < 0
        usual = self.velocity.kind == "difference" or getattr(self.velocity, "order", 2) == 1
        return usual and self.is_linear and not more

    def numbers(self, sample_time_s: float, lightest_kg: float | None = None) -> list[LawNumber]:
        """Return its numbers that are not 0, gains first; coefficients of a transfer function are none.

        Without the lightest moving mass a negative virtual mass has no bound.
        """
        lowest = {"local_damping_ns_per_m": -math.inf, "virtual_mass_kg": -math.inf}
        if lightest_kg is not None:
            lowest["virtual_mass_kg"] = self.lowest_virtual_mass_kg(sample_time_s, lightest_kg)
        sole = sum(bool(getattr(self, key)) for key in _GAINS) == 1
        gains = [LawNumber((key,), getattr(self, key), lowest.get(key, 0.0), linear=True, sole=sole) for key in _GAINS]
        if self.friction_compensation is not None:
            force_n = self.friction_compensation.force_n
            gains.append(LawNumber(("friction_compensation", "force_n"), force_n, linear=True))
        inner: list[LawNumber] = []
        tables = [
            (("velocity",), self.velocity),
            *((("filters", index), item) for index, item in enumerate(self.filters)),
        ]
        for path, table in tables:
            inner += [
                LawNumber(
                    (*path, key),
                    value,
                    *_bounds(key, value, table, sample_time_s),
                    unlimited_below=key.endswith("_hz"),
                )
                for key, value in table
                if key not in ("kind", "order", "numerator", "denominator")
            ]
        return [number for number in (*gains, *inner) if number.value]

    def document(self) -> dict[str, Any]:
        """Return its values, JSON values."""
        return self.model_dump(mode="json")

    def with_number(self, path: NumberPath, value: float) -> Self:
        """Return the law with another value of a number, which is not validated: a search tries it."""
        changed: Self = _replaced(self, path, value)
        return changed


def _bounds(key: str, value: float, table: t.Table, sample_time_s: float) -> tuple[float, float]:
    """Return the least and the largest value of a number of an estimator or filter of which a limit is looked for.

    Frequencies, Hz, are bounded by shares of the sample rate, windows by samples.
    """
    known = {"depth": (0.0, 1.0), "width": (1e-3, 10.0), "phase_deg": (0.1, 85.0)}
    if isinstance(table, WindowVelocity):
        return 1, max(value, _LONGEST_WINDOW)
    if isinstance(table, TicksVelocity):
        # Its window is twice as long as its timeout.
        return sample_time_s, max(value, _LONGEST_WINDOW / 2 * sample_time_s)
    lowest = min(value, _LEAST_SHARE / sample_time_s)
    highest = _MOST_SHARE / sample_time_s if isinstance(table, NotchFilter | LeadFilter) else math.inf
    return known.get(key, (lowest, max(value, highest)))


def _replaced(value: Any, path: NumberPath, new: float) -> Any:
    if not path:
        return new
    first, *rest = path
    if isinstance(value, tuple):
        return tuple(_replaced(item, tuple(rest), new) if index == first else item for index, item in enumerate(value))
    return value.model_copy(update={str(first): _replaced(getattr(value, str(first)), tuple(rest), new)})
