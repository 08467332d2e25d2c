"""Encoder resolution, quantisation that repeats itself, and backlash before the encoder.

An encoder behind a backlash g follows only when g is taken up: the measured position is that of the mass less g/2 in
the direction of the last motion. The reversals stand in the log, and the mass crosses the backlash from a slow start:
the hidden part is then g/2 times a number between -1 and 1 for each sample, and g is one more linear parameter. Dry
friction holds a device at a reversal as well, but releases it from rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import find_peaks

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi.identification.record import Record

_MOST_VALUES = 4000
# Readings off the lattice by this share of a step, root mean square, are still on it: files and time stamps are
# rounded.
_OFF = 0.08
_FEWEST = 6
# A fast hand crosses many steps between two readings: the nearest two may be so many steps apart.
_APART = 6


def encoder_step_m(records: Sequence[Record]) -> float | None:
    """Return the resolution of the encoder, or None where the readings lie on no lattice."""
    values = np.unique(
        np.concatenate([record.position_m if record.readings_m is None else record.readings_m for record in records])
    )
    if values.size < _FEWEST:
        return None
    gaps = np.diff(values)
    # Values that differ by rounding only are one.
    gaps = gaps[gaps > 1e-9 * (values[-1] - values[0])]
    usual = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
    guesses = {guess / apart for guess in (usual, float(gaps.min())) for apart in range(1, _APART + 1)}
    for guess in sorted(guesses, reverse=True):
        step = _refined(guess, gaps, values)
        steps = (values[:: max(1, values.size // _MOST_VALUES)] - values[0]) / step
        off = steps - np.round(steps)
        if steps.max() >= _FEWEST - 0.5 and float(np.sqrt(np.mean(off**2))) < _OFF:
            return step
    return None


def _refined(step: float, gaps: FloatArray, values: FloatArray) -> float:
    """Refine a step by counting steps over ever longer spans."""
    reach = 20 * step
    some = gaps[gaps <= reach]
    while True:
        counts = np.round(some / step)
        if counts.any():
            step = float(some @ counts / (counts @ counts))
        if reach > 4 * (values[-1] - values[0]):
            return step
        reach *= 3
        some = values[: np.searchsorted(values, values[0] + reach, side="right")] - values[0]
        some = some[:: max(1, some.size // _MOST_VALUES)]


# Velocities so alike may be one motion; so large a share of it must repeat to the encoder's step.
_ALIKE, _SAME = 0.9, 0.3
# Repeats of less than this share of a record hardly matter.
_LONGEST = 0.7
_SHORTEST = 10
_MOST_TRIED = 20


def repeats_of(records: Sequence[Record], step_m: float | None) -> tuple[int, ...]:
    """Return the period in samples at which each record repeats to the encoder's step; 0 where it does not.

    Args:
        records: of one device.
        step_m: encoder resolution; without one the readings hold noise, which never repeats.
    """
    return tuple(0 if step_m is None else _repeat(record.position_m, step_m) for record in records)


def repeat_notes(records: Sequence[Record], repeats: Sequence[int]) -> list[str]:
    """Return notes for the user on repeats; none without repeats.

    Args:
        records: of one device.
        repeats: period of each record, samples.
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
        # Between steps that are passed one by one any two readings at one position are the same.
        both = moving[lag:] & moving[:-lag]
        same = np.abs(position_m[lag:-1] - position_m[: -lag - 1]) < 0.5 * step_m
        if both.any() and float(same[both].mean()) > _SAME:
            return lag
    return 0


# A reversal goes back by more than these shares of the encoder's step, or of the noise; it begins by more than those.
_BACK_STEPS, _BACK_NOISE = 1.5, 6.0
_OFF_STEPS, _OFF_NOISE = 0.5, 3.0
# The crossing of the backlash goes as this power of time: the mass starts slowly.
SLOWLY, EVENLY = 2.0, 1.0
# The encoder follows within the sample in which it is first seen to.
_WITHIN = 0.5
# Fewer reversals do not show what all of them have in common.
_FEWEST_PLAY = 8
# Upper share of the spectrum in which no device moves: noise alone.
_NOISE_ONLY = 0.2


def last_went(position_m: FloatArray, step_m: float, power: float = SLOWLY) -> FloatArray | None:
    """Return the direction of the last motion, from -1 to 1 during a reversal; None with hardly any reversals.

    Args:
        position_m: measured, shape (samples,).
        step_m: encoder resolution; 0 without one.
        power: of time, by which the backlash is taken up.
    """
    noise = _noise_m(position_m)
    off = max(_OFF_STEPS * step_m, _OFF_NOISE * noise)
    turns = _turns(position_m, max(_BACK_STEPS * step_m, _BACK_NOISE * noise))
    if len(turns) < _FEWEST_PLAY:
        return None
    way = np.empty(position_m.size)
    way[:] = turns[0][2]
    for turn, back, was in turns:
        goes = back
        while goes > turn and abs(position_m[goes - 1] - position_m[turn]) > off:
            goes -= 1
        share = np.minimum(np.arange(goes - turn + 1) / max(goes - turn - _WITHIN, _WITHIN), 1.0)
        way[turn : goes + 1] = was * (1 - 2 * share**power)
        way[goes:] = -was
    return way


def _turns(position: FloatArray, least: float) -> list[tuple[int, int, int]]:
    """Return the samples of the reversals, each detected once it exceeds the least travel, and the direction before."""
    found = []
    way, at, low, high = 0, 0, 0, 0
    values = position.tolist()
    for index, value in enumerate(values):
        if way == 0:
            low, high = (index if value < values[low] else low), (index if value > values[high] else high)
            if max(value - values[low], values[high] - value) > least:
                way, at = (1 if value - values[low] > least else -1), index
        elif way * (value - values[at]) > 0:
            at = index
        elif way * (values[at] - value) > least:
            found.append((at, index, way))
            way, at = -way, index
    return found


def _noise_m(position: FloatArray) -> float:
    """Return the noise of the readings, quantisation included, root mean square."""
    window = np.hanning(position.size)
    power = np.abs(np.fft.rfft((position - position.mean()) * window)) ** 2
    top = power[-max(1, int(_NOISE_ONLY * power.size)) :]
    return float(np.sqrt(np.mean(top) / np.sum(window**2)))
