"""What an identification found: estimates with intervals, what was refused, and how the model stands to the log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.units import MotionKind
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.uncertainty import Trial


@dataclass(frozen=True)
class Estimate:
    """A number with its interval.

    Attributes:
        key: as in a device file where it stands there.
        unit: SI.
        value: the best.
        low, high: ends of the interval at `level`.
        level: share of logs in which such an interval holds the truth.
        how: in a few words.
    """

    key: str
    unit: str
    value: float
    low: float
    high: float
    level: float
    how: str

    def digits(self, of_half_width: int, least: int) -> int:
        """Return how many significant digits show an interval.

        Args:
            of_half_width: digits of the half width that are to be seen.
            least: digits at least.
        """
        half, size = (self.high - self.low) / 2, max(abs(self.low), abs(self.high))
        if not 0 < half < math.inf or not size > 0:
            return least
        return min(max(least, of_half_width + math.ceil(math.log10(size / half))), 15)


@dataclass(frozen=True)
class Refusal:
    """What a log cannot tell.

    Attributes:
        key: its name.
        why: what hides it.
        excitation: the log that would tell.
        bounds: value and ends of the interval that is too wide to be told; None where there is none.
    """

    key: str
    why: str
    excitation: str
    bounds: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Shown:
    """One stretch of a record beside the model that runs freely through it.

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
    """A device as its logs tell it.

    Attributes:
        sources: the logs.
        seconds: of all records.
        records: number of records.
        sample_time_s: T.
        terms: what the model is made of.
        encoder_at: where the position is measured.
        amplifier_order: 1, a lag; 2, a current loop.
        assumed_share: of the mass at the handle, and the least and most, where a resonance is told and this is not.
        estimates: by key.
        refused: what the logs cannot tell.
        trials: evidence for and against each term.
        names: of the numbers that were searched for together.
        correlation: of their estimates, shape (names, names).
        sensitivity: correlations of their normalised sensitivities, the same shape.
        collinearity: index of the sensitivities.
        spread_from: where the intervals come from.
        error_rms_m: of the prediction from sample to sample.
        observer_rate_per_s: how fast a disturbance is forgotten.
        error_m: the prediction error, shape (samples,).
        feedback: whether the force follows the measured position.
        lags: autocorrelation of the error, shape (lags,), from lag 1 on.
        notes: what the user should know.
        response: measured frequency response.
        modelled: that of the model.
        shown: stretches for the eye.
        device: the device file, or None where mass or damping stay unknown.
        motion: of the device; what turns has rad, N.m and kg.m2 in all of these.
        handle_radius_m: of a device that turns, where the hand holds it.
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
