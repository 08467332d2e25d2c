"""Result of an identification: estimates with intervals, refusals, and the model beside the log.

A rotary device is identified as the equivalent linear one at its handle, and the result converted to rotary units.

All thresholds are then the same for a knob, a wheel and a slide: they apply at the hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.units import MotionKind
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.record import Record
from avc_casadi.identification.uncertainty import Trial
from avc_casadi.model.quantity import power_at_handle


@dataclass(frozen=True)
class Estimate:
    """An estimate with its interval.

    Attributes:
        key: as in a device file where it stands there.
        unit: SI.
        value: the estimate.
        low, high: ends of the interval at `level`.
        level: share of logs in which such an interval holds the truth.
        how: in a few words.
        doubt: why the interval may not hold the truth, in a few words; empty without a doubt.
    """

    key: str
    unit: str
    value: float
    low: float
    high: float
    level: float
    how: str
    doubt: str = ""

    @property
    def told(self) -> str:
        """How it was found, with its doubt."""
        return f"{self.how}; in doubt: {self.doubt}" if self.doubt else self.how

    def digits(self, of_half_width: int, least: int) -> int:
        """Return the number of significant digits that resolve the interval.

        Args:
            of_half_width: digits of the half width that are shown.
            least: digits at least.
        """
        half, size = (self.high - self.low) / 2, max(abs(self.low), abs(self.high))
        if not 0 < half < math.inf or not size > 0:
            return least
        return min(max(least, of_half_width + math.ceil(math.log10(size / half))), 15)


@dataclass(frozen=True)
class Doubt:
    """Why intervals may not hold the truth.

    Attributes:
        why: in a few words.
        note: one sentence for the user.
        keys: of the estimates that it concerns; None for all that the model's dynamics tell.
    """

    why: str
    note: str
    keys: frozenset[str] | None = None

    def concerns(self, one: Estimate) -> bool:
        """Return whether an estimate is in doubt; what is known beforehand never is."""
        if self.keys is None:
            return one.level < 1 and one.key not in _OF_THE_READINGS
        return one.key in self.keys


# Told by the readings alone, whatever moves the device.
_OF_THE_READINGS = {"encoder_resolution_m", "position_noise_rms_m"}


def doubted(estimates: Mapping[str, Estimate], doubts: Sequence[Doubt]) -> dict[str, Estimate]:
    """Return the estimates, each with what throws doubt on it."""
    return {
        key: replace(one, doubt="; ".join(doubt.why for doubt in doubts if doubt.concerns(one)))
        for key, one in estimates.items()
    }


@dataclass(frozen=True)
class Refusal:
    """A parameter that is not identifiable from the log.

    Attributes:
        key: its name.
        why: what it is confounded with.
        excitation: the log that would identify it.
        bounds: value and ends of an interval too wide for an estimate; None where there is none.
    """

    key: str
    why: str
    excitation: str
    bounds: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Shown:
    """A stretch of a record beside the free-running model.

    Attributes:
        record: its name.
        time_s, measured_m, simulated_m, force_n: shape (samples,).
    """

    record: str
    time_s: FloatArray
    measured_m: FloatArray
    simulated_m: FloatArray
    force_n: FloatArray


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified device.

    Attributes:
        sources: the logs.
        seconds: of all records.
        records: number of records.
        sample_time_s: T.
        terms: of the model.
        encoder_at: where the position is measured.
        amplifier_order: 1, a lag; 2, a current loop.
        assumed_share: mass fraction at the handle, and its range, where a resonance is identified and this is not.
        estimates: by key.
        refused: parameters that are not identifiable.
        trials: evidence for and against each term.
        names: of the parameters that were searched together.
        correlation: of their estimates, shape (names, names).
        sensitivity: correlations of their normalised sensitivities, the same shape.
        collinearity: index of the sensitivities.
        spread_from: source of the intervals.
        error_rms_m: of the prediction from sample to sample.
        observer_rate_per_s: rate at which a disturbance is forgotten.
        error_m: the prediction error, shape (samples,).
        feedback: whether the force follows the measured position.
        lags: autocorrelation of the error, shape (lags,), from lag 1 on.
        notes: what the user should know.
        response: measured frequency response.
        modelled: that of the model.
        shown: stretches for plotting.
        device: the device file, or None where mass or damping are unknown.
        motion: of the device; rotary has rad, N.m and kg.m2 in all of these.
        handle_radius_m: radius at which the hand holds a rotary device.
    """

    sources: tuple[str, ...]
    seconds: float
    records: int
    sample_time_s: float
    terms: tuple[str, ...]
    encoder_at: str
    amplifier_order: int
    assumed_share: tuple[float, float, float] | None
    estimates: Mapping[str, Estimate]
    refused: tuple[Refusal, ...]
    trials: tuple[Trial, ...]
    names: tuple[str, ...]
    correlation: FloatArray
    sensitivity: FloatArray
    collinearity: float
    spread_from: str
    error_rms_m: float
    observer_rate_per_s: float
    error_m: FloatArray
    feedback: bool
    lags: FloatArray
    notes: tuple[str, ...]
    response: Response
    modelled: ComplexArray
    shown: tuple[Shown, ...]
    device: DeviceFile | None
    motion: MotionKind = "linear"
    handle_radius_m: float | None = None

    def __repr__(self) -> str:
        told = ", ".join(f"{one.key} {one.value:.4g}" for one in self.estimates.values())
        return f"Identification({told}; {len(self.refused)} refused)"


_ALLOWED = "0.002 to 10 m"


def radius_of(records: Sequence[Record], base: DeviceFile | None, handle_radius_m: float | None) -> float | None:
    """Return the handle's travel per radian of the logs, m; None for a linear device.

    Args:
        records: of one device.
        base: what is known of it.
        handle_radius_m: given by the user, else that of the base.

    Raises:
        InputError: it is rotary without a handle radius, or logs and base differ in kind of motion.
    """
    motion: MotionKind = records[0].motion
    if any(one.motion != motion for one in records):
        raise InputError.of("are of a device that turns and of one that does not; allowed: one kind", key="logs")
    if base is not None and base.device.motion != motion:
        logs, device = ("rad and N.m", "a length") if motion == "rotary" else ("metres and newtons", "an angle")
        raise InputError.of(
            f"are in {logs}, and the position of {base.name} is {device}; allowed: a base of the logs' motion"
            + ("; behind a capstan of radius r log x = r theta and F = tau/r" if motion == "rotary" else ""),
            key="logs",
        )
    if motion == "linear":
        if handle_radius_m is not None:
            raise InputError.of("says nothing of logs in metres; allowed: beside logs in rad", key="handle_radius_m")
        return None
    radius = handle_radius_m or (None if base is None else base.device.handle_radius_m)
    if radius is None:
        raise InputError.of(
            "are of a device that turns, and nothing says where the hand holds it; allowed: --handle-radius-m R "
            f"({_ALLOWED}), or a base with handle_radius_m",
            key="logs",
        )
    if not 2e-3 <= radius <= 10:
        raise InputError.of(f"is {radius:g}; allowed: {_ALLOWED}", key="handle_radius_m")
    return radius


def known_at_handle(known: Mapping[str, float], radius_m: float) -> dict[str, float]:
    """Return rotary values as their linear equivalents at the handle, by key."""
    return {key: value * radius_m ** power_at_handle(key) for key, value in known.items()}


def of_the_turn(found: Identification, radius_m: float) -> Identification:
    """Return an identification at the handle as that of the rotary device.

    Args:
        found: in metres and newtons at the handle.
        radius_m: travel per radian.
    """
    return replace(
        found,
        motion="rotary",
        handle_radius_m=radius_m,
        estimates={key: _estimate(one, radius_m) for key, one in found.estimates.items()},
        refused=tuple(_refusal(one, radius_m) for one in found.refused),
        error_rms_m=found.error_rms_m / radius_m,
        error_m=found.error_m / radius_m,
        response=replace(found.response, velocity_per_force=found.response.velocity_per_force / radius_m**2),
        modelled=found.modelled / radius_m**2,
        shown=tuple(_shown(one, radius_m) for one in found.shown),
    )


def _estimate(one: Estimate, radius_m: float) -> Estimate:
    by = radius_m ** -power_at_handle(one.key)
    return replace(one, value=one.value * by, low=one.low * by, high=one.high * by)


def _refusal(one: Refusal, radius_m: float) -> Refusal:
    if one.bounds is None:
        return one
    value, low, high = (each * radius_m ** -power_at_handle(one.key) for each in one.bounds)
    return replace(one, bounds=(value, low, high))


def _shown(one: Shown, radius_m: float) -> Shown:
    return replace(
        one,
        measured_m=one.measured_m / radius_m,
        simulated_m=one.simulated_m / radius_m,
        force_n=one.force_n * radius_m,
    )
