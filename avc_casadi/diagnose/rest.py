"""Whether a device is at rest in a log: what toggles by an encoder step, and what decays under the force."""

from __future__ import annotations

import math

import numpy as np

from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.model.device import Device
from avc_casadi.simulation.judge import QUIET, vibration_level

_STILL_STEPS = 1.5
"""Encoder steps, half of peak to peak, up to which a motion is at rest."""

_ONE_STEP = 2.5
"""Encoder steps, peak to peak, below which a position toggles by one step to either side."""

_RESTED = 0.3
"""Ratio of the envelope at the end to the largest below which a motion has come to rest."""

_TOUCHING_SHARE = 0.5
"""Share of a large motion in contact above which its decay tells of the force."""

_AT_LIMIT = 0.999
"""Share of the force limit from which on a force is at the limit."""


def toggles_by_a_step(log: Log, swing: Oscillation, device: Device) -> bool:
    """Return whether a swing is one encoder step to either side, whose vibration nobody feels.

    At each frequency the smaller motion counts: as it reads, or as the force moves the mass, F/(m omega^2).
    """
    later_half = slice((swing.first + swing.last) // 2, swing.last)
    position, force = log.position_m[later_half], log.force_n[later_half]
    read = np.fft.rfft(position)
    omega = 2 * math.pi * np.fft.rfftfreq(position.size, log.period_s)
    moved = np.fft.rfft(force) / (device.mass_kg * np.maximum(omega, omega[1]) ** 2)
    motion = np.fft.irfft(np.where(np.abs(moved) < np.abs(read), moved, read), position.size)
    vibration = vibration_level(device.metres_per_unit * motion, log.period_s)
    return bool(np.ptp(position) < _ONE_STEP * log.encoder_m and vibration < QUIET)


def rests(log: Log, swing: Oscillation, limit_n: float | None) -> bool:
    """Return whether a motion in contact comes to rest, by its envelope, m, and not at the force limit."""
    envelope = swing.envelope_m
    late, most = float(np.median(envelope[-max(envelope.size // 5, 5) :])), float(envelope.max())
    still = _STILL_STEPS * log.encoder_m
    decays = swing.kind == "decaying" or late < max(still, _RESTED * most)
    if not (decays and most > still and below_limit(log, limit_n)):
        return False
    return bool(log.touching[envelope > _RESTED * most].mean() > _TOUCHING_SHARE)


def below_limit(log: Log, limit_n: float | None) -> bool:
    """Return whether the force ends below its limit."""
    return bool(abs(log.force_n[-1]) < _AT_LIMIT * (limit_n or math.inf))
