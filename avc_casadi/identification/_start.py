"""A first guess: inverse dynamics by least squares and instrumental variables on signals filtered without phase."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from avc_casadi.identification._record import Record
from avc_casadi.identification._terms import offset_of
from avc_casadi.support import BoolArray, FloatArray

_DELAYS = tuple(np.arange(0.0, 8.5, 0.5))
_SHARE_OF_RATE = 1 / 12
_CUTOFF_HZ = 40.0
_EDGE = 60


def first_guess(records: Sequence[Record]) -> tuple[dict[str, float], float]:
    """Return mass, damping, Coulomb friction, delay and the constant force of each log, of a rigid device.

    Velocity and acceleration come from every other sample; those of the samples between are the instruments. Their
    noise is not that of the regressors, so that it neither thins the estimates nor, in a closed loop, leans them.

    Args:
        records: of one device.

    Returns:
        The values, and the share of the force's square that they explain.
    """
    period = records[0].sample_time_s
    cutoff = min(_CUTOFF_HZ, _SHARE_OF_RATE / period)
    logs = list(dict.fromkeys(record.whole for record in records))
    parts = [_parts(record, period, cutoff, np.arange(len(logs)) == logs.index(record.whole)) for record in records]
    regressors = np.concatenate([part[0] for part in parts])
    instruments = np.concatenate([part[1] for part in parts])
    added = np.concatenate([part[2] for part in parts])
    best: tuple[float, dict[str, float], float] | None = None
    for delay in _DELAYS:
        force = np.concatenate(
            [_filtered(_delayed(record.force_n, delay), period, cutoff)[_EDGE:-_EDGE] for record in records]
        )
        wanted = force - added
        found = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ wanted, rcond=None)[0]
        left = float(np.sum((wanted - regressors @ found) ** 2))
        if best is None or left < best[0]:
            rigid = dict(zip(("mass_kg", "damping_ns_per_m", "coulomb_friction_n"), map(float, found), strict=False))
            offsets = {offset_of(log): -float(force) for log, force in enumerate(found[len(rigid) :])}
            explained = 1 - left / max(float(np.sum((wanted - wanted.mean()) ** 2)), 1e-300)
            best = left, {**rigid, **offsets, "delay_samples": float(delay)}, explained
    assert best is not None  # noqa: S101 - there are delays
    return best[1], best[2]


def _parts(record: Record, period: float, cutoff: float, log: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return regressors, instruments and the force that the added mass takes, without the edges."""
    time = np.arange(record.position_m.size)
    both = []
    for first in (0, 1):
        some = np.interp(time, time[first::2], record.position_m[first::2])
        smooth = _filtered(some, period, cutoff)
        velocity = np.gradient(smooth, period)
        acceleration = np.gradient(velocity, period)
        speed = float(np.sqrt(np.mean(velocity**2)))
        # The held force acts half a sample after the position on the mean.
        columns = (acceleration, velocity, _filtered(np.tanh(velocity / (0.05 * speed + 1e-12)), period, cutoff))
        constant = np.tile(log.astype(np.float64), (velocity.size, 1))
        both.append(np.concatenate([np.stack(columns, axis=1), constant], axis=1)[_EDGE:-_EDGE])
    return both[0], both[1], record.added_mass_kg * both[0][:, 0]


def _filtered(values: FloatArray, period: float, cutoff: float) -> FloatArray:
    sections = signal.butter(4, cutoff, fs=1 / period, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, values), dtype=np.float64)


def _delayed(force: FloatArray, delay: float) -> FloatArray:
    """Return the force as it acts at each sample, on the mean half a sample after it is held."""
    time = np.arange(force.size)
    return np.asarray(np.interp(time - delay - 0.5, time, force), dtype=np.float64)
