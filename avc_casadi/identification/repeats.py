"""Logs that repeat themselves to the encoder's step: what its rounding does is the same in each repeat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import find_peaks

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi.identification.record import Record

# Velocities so alike may be one motion, of which so large a share must come out the same to the step.
_ALIKE, _SAME = 0.9, 0.3
# What repeats less than this share of a record hardly matters.
_LONGEST = 0.7
_SHORTEST = 10
_MOST_TRIED = 20


def repeats_of(records: Sequence[Record], step_m: float | None) -> tuple[int, ...]:
    """Return after how many samples each record repeats itself to the encoder's step; 0 where it does not.

    Args:
        records: of one device.
        step_m: of the encoder; without one the readings hold noise, which never repeats.
    """
    return tuple(0 if step_m is None else _repeat(record.position_m, step_m) for record in records)


def repeat_notes(records: Sequence[Record], repeats: Sequence[int]) -> list[str]:
    """Return what repeats mean to the user; nothing where there are none.

    Args:
        records: of one device.
        repeats: samples after which each repeats itself.
    """
    told = {
        record.whole: f"{record.whole} repeats itself every {number(count * record.sample_time_s, 3)} s"
        for record, count in zip(records, repeats, strict=True)
        if count
    }
    if not told:
        return []
    each = "its rounding is the same in each repeat, so that more of them tell little more"
    return [f"{'; '.join(told.values())}, to the step of the encoder: {each}. Better: a multisine as long as the log"]


def _repeat(position_m: FloatArray, step_m: float) -> int:
    moves = np.diff(position_m) / step_m
    moving = np.abs(moves) > 0.5
    longest = int(_LONGEST * moves.size)
    if moves.size < 2 * _SHORTEST or not moving.any():
        return 0
    spectrum = rfft(moves, next_fast_len(2 * moves.size))
    overlap = irfft(spectrum * np.conj(spectrum))[: longest + 1]
    energy = np.concatenate([[0.0], np.cumsum(moves**2)])
    lags = np.arange(longest + 1)
    alike = overlap / np.sqrt(np.maximum(energy[moves.size - lags] * (energy[-1] - energy[lags]), 1e-300))
    peaks, _ = find_peaks(alike, height=_ALIKE, distance=_SHORTEST)
    for lag in sorted(int(one) for one in peaks[np.argsort(-alike[peaks])][:_MOST_TRIED] if one >= _SHORTEST):
        # Between steps that are passed one by one any two readings of one place are the same.
        both = moving[lag:] & moving[:-lag]
        same = np.abs(position_m[lag:-1] - position_m[: -lag - 1]) < 0.5 * step_m
        if both.any() and float(same[both].mean()) > _SAME:
            return lag
    return 0
