"""A first guess: inverse dynamics by least squares and instrumental variables on signals filtered without phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import offset_of

_DELAYS = tuple(np.arange(0.0, 8.5, 0.5))
_SHARE_OF_RATE = 1 / 12
_CUTOFF_HZ = 40.0
_EDGE = 60
# Shares of the largest force at which it may be cut. Cut there, this share of what is left otherwise is left at most
# (0.13 where it is cut, 0.96 where it is not), and this one of the force.
_CUT_AT = (0.9, 0.75, 0.6, 0.5, 0.4, 0.3, 0.2)
_CUT_LEAVES, _EXPLAINED = 0.5, 0.1


def first_guess(records: Sequence[Record]) -> tuple[dict[str, float], float]:
    """Return mass, damping, Coulomb friction, delay and the constant force of each log, of a rigid device.

    Velocity and acceleration come from every other sample; those of the samples between are the instruments. Their
    noise is not that of the regressors, so that it neither thins the estimates nor, in a closed loop, leans them.

    Args:
        records: of one device.

    Returns:
        The values, and the share of the force's square that they explain.
    """
    motion = _Motion.of(records)
    delay, (left, whole, found) = min(
        ((delay, motion.explains(delay)) for delay in _DELAYS), key=lambda explained: explained[1][0]
    )
    rigid = dict(zip(("mass_kg", "damping_ns_per_m", "coulomb_friction_n"), map(float, found), strict=False))
    offsets = {offset_of(log): -float(force) for log, force in enumerate(found[len(rigid) :])}
    return {**rigid, **offsets, "delay_samples": float(delay)}, 1 - left / whole


def cut_force_n(records: Sequence[Record], delay_samples: float) -> float | None:
    """Return where the force that acts is cut off, below the one that is logged; None where it acts as it is logged.

    A device that follows the force up to its limit moves as inverse dynamics say with the force cut there, and much
    less so with the force as it is logged.

    Args:
        records: of one device.
        delay_samples: of the first guess.
    """
    motion = _Motion.of(records)
    largest = max(float(np.abs(record.force_n).max()) for record in records)
    near = [max(0.0, delay_samples + step) for step in (-1.0, 0.0, 1.0)]

    def left(share: float) -> float:
        explained = (motion.explains(delay, share * largest) for delay in near)
        return min(left / whole for left, whole, _ in explained)

    uncut, cut = left(1.0), {share: left(share) for share in _CUT_AT}
    share = min(cut, key=lambda one: cut[one])
    return share * largest if cut[share] < min(_CUT_LEAVES * uncut, _EXPLAINED) else None


def play_guess_m(records: Sequence[Record], last_went: Sequence[FloatArray], delay_samples: float) -> float:
    """Return the play of which inverse dynamics ask that the encoder stands behind it; below 0 where there is none.

    Args:
        records: of one device.
        last_went: which way each of them last went, from -1 to 1.
        delay_samples: of the force.
    """
    motion, period = _Motion.of(records), records[0].sample_time_s
    smooth = [_filtered(way, period, motion.cutoff_hz) for way in last_went]
    bent = np.concatenate([np.gradient(np.gradient(way, period), period)[_EDGE:-_EDGE] for way in smooth])[:, None]
    more = replace(
        motion,
        regressors=np.concatenate([motion.regressors, bent], axis=1),
        instruments=np.concatenate([motion.instruments, bent], axis=1),
    )
    found = more.explains(delay_samples)[2]
    return 2 * float(found[-1] / found[0])


@dataclass(frozen=True)
class _Motion:
    """What the motion of a rigid device asks of the force.

    Attributes:
        records: of it.
        regressors: acceleration, velocity, direction, and the constant force of each log.
        instruments: the same from the samples between.
        added_n: what known added masses take.
        cutoff_hz: below which all of it is compared.
    """

    records: Sequence[Record]
    regressors: FloatArray
    instruments: FloatArray
    added_n: FloatArray
    cutoff_hz: float

    @classmethod
    def of(cls, records: Sequence[Record]) -> _Motion:
        """Differentiate the positions."""
        period = records[0].sample_time_s
        cutoff = min(_CUTOFF_HZ, _SHARE_OF_RATE / period)
        logs = list(dict.fromkeys(record.whole for record in records))
        parts = [_parts(record, period, cutoff, np.arange(len(logs)) == logs.index(record.whole)) for record in records]
        regressors, instruments, added = (np.concatenate(part) for part in zip(*parts, strict=True))
        return cls(records, regressors, instruments, added, cutoff)

    def explains(self, delay: float, limit_n: float = np.inf) -> tuple[float, float, FloatArray]:
        """Return the force's square that is left, that of the force, and the numbers, with a delay and a limit."""
        period = self.records[0].sample_time_s
        forces = [
            _filtered(_delayed(np.clip(record.force_n, -limit_n, limit_n), delay), period, self.cutoff_hz)[_EDGE:-_EDGE]
            for record in self.records
        ]
        wanted = np.concatenate(forces) - self.added_n
        found = np.linalg.lstsq(self.instruments.T @ self.regressors, self.instruments.T @ wanted, rcond=None)[0]
        left = float(np.sum((wanted - self.regressors @ found) ** 2))
        return left, max(float(np.sum((wanted - wanted.mean()) ** 2)), 1e-300), np.asarray(found, dtype=np.float64)


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
