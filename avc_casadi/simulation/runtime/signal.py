"""The common input of all estimators: the velocity between two corner frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass

from avc_casadi.simulation.runtime.step import Expr, StepBuilder

# Of the hand; for a rotary device, at its handle.
_FLOOR_M_PER_S = 3e-3
_FASTEST_M_PER_S = 5.0


@dataclass(frozen=True)
class EstimatorSettings:
    """Thresholds of motion of an estimator, in the unit of the position: metres, or rad for a rotary device."""

    low_hz: float = 1.0
    high_hz: float = 60.0
    floor_m_per_s: float = _FLOOR_M_PER_S
    fastest_m_per_s: float = _FASTEST_M_PER_S

    def top_hz(self, sample_time_s: float) -> float:
        """Highest frequency at a sampling rate."""
        return max(min(self.high_hz, 0.2 / sample_time_s), 1.5 * self.low_hz)

    @classmethod
    def for_encoder(cls, resolution_m: float, sample_time_s: float, metres_per_unit: float = 1.0) -> EstimatorSettings:
        """Return settings with the floor above the response of the estimators' low pass to one encoder step."""
        corner = min(1.0, math.tau * cls().top_hz(sample_time_s) * sample_time_s)
        floor, fastest = _FLOOR_M_PER_S / metres_per_unit, _FASTEST_M_PER_S / metres_per_unit
        return cls(floor_m_per_s=max(floor, 0.5 * corner * resolution_m / sample_time_s), fastest_m_per_s=fastest)


def band_passed(builder: StepBuilder, velocity: Expr, settings: EstimatorSettings, sample_time_s: float) -> Expr:
    """Remove drift by a first-order high pass at half the lowest frequency, noise by two low passes."""
    import casadi as ca  # noqa: PLC0415

    mean = builder.state("mean_m_per_s")
    slow = 1.0 - ca.exp(-math.tau * 0.5 * settings.low_hz * sample_time_s)
    seen = ca.fmin(ca.fmax(velocity, -settings.fastest_m_per_s), settings.fastest_m_per_s)
    builder.follow("mean_m_per_s", mean + slow * (seen - mean))
    signal = seen - mean
    fast = 1.0 - ca.exp(-math.tau * settings.top_hz(sample_time_s) * sample_time_s)
    for name in ("smoothed_m_per_s", "twice_smoothed_m_per_s"):
        before = builder.state(name)
        signal = before + fast * (signal - before)
        builder.follow(name, signal)
    return signal


def envelope(
    builder: StepBuilder, signal: Expr, frequency_hz: Expr, settings: EstimatorSettings, sample_time_s: float
) -> Expr:
    """Return the envelope, decaying over half a period: it distinguishes a hand at rest from a filter that rings on."""
    import casadi as ca  # noqa: PLC0415

    before = builder.state("envelope_m_per_s")
    held = ca.fmax(ca.fabs(signal), before * (1 - 2 * sample_time_s * ca.fmax(frequency_hz, settings.low_hz)))
    builder.follow("envelope_m_per_s", held)
    return held
