"""Logs: the columns of a file, and records of even samples between its gaps.

A force is held from tick to tick, so that its effect on a mass over an even sample is that of its mean there. Where the
clock scatters, positions are those of a cubic spline; parameters are known to s^2/6 under steps with a scatter of s.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from avc_casadi._errors import Fault
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind

# Steps of time so many times the usual one are gaps, beside a clock that scatters much longer ones.
_GAP, _LONGEST_STEP = 1.5, 6.0
# Fewest samples of a record; ticks by which a force may act late beside a clock that scatters; most values of a lattice
# that are compared.
_SHORTEST, _MOST_TICKS, _MOST_VALUES = 200, 4, 4000


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a log in SI units, not yet checked to be a record."""

    file: str
    time_s: FloatArray
    position_m: FloatArray
    force_n: FloatArray
    line: IndexArray | None = None
    motion: MotionKind = "linear"
    notes: tuple[str, ...] = ()

    def rows(self, some: BoolArray | IndexArray) -> Columns:
        """Return some of the rows."""
        time, position, force = (one[some] for one in (self.time_s, self.position_m, self.force_n))
        line = None if self.line is None else self.line[some]
        return replace(self, time_s=time, position_m=position, force_n=force, line=line)

    def at(self, row: int) -> int | None:
        """Return the line of a row."""
        return None if self.line is None else int(self.line[row])

    def complete(self) -> Columns:
        """Return the log without rows that hold no number, where these are few: they become gaps."""
        empty = ~(_sound(self.time_s) & _sound(self.position_m) & _sound(self.force_n))
        count = int(np.count_nonzero(empty))
        if not 0 < count <= max(1.0, 0.01 * empty.size):
            return self
        line = self.at(int(np.argmax(empty)))
        where = "" if line is None else f", the first in line {line}"
        note = f"{self.file}: {count} sample{'' if count == 1 else 's'} without a number left out{where}"
        return replace(self.rows(~empty), notes=(*self.notes, note))


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one uninterrupted record; of a rotary device in rad, N.m and kg.m2."""

    name: str
    sample_time_s: float
    position_m: FloatArray
    force_n: FloatArray
    motion: MotionKind = "linear"
    log: str = ""
    scatter: float = 0.0
    readings_m: FloatArray | None = None
    later_n: FloatArray | None = None

    @property
    def whole(self) -> str:
        """The log that it is a piece of, or its own name."""
        return self.log or self.name

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.position_m.size * self.sample_time_s


def records_of(columns: Columns) -> tuple[list[Record], list[Fault], list[str]]:
    """Cut a log into records at its gaps; return them, its faults, and notes for the user."""
    columns = columns.complete()
    faults = faults_of(columns)
    if faults:
        return [], faults, []
    steps = np.diff(columns.time_s)
    usual = float(np.median(steps))
    uneven = (np.abs(steps - usual) > 0.25 * usual) & (steps <= _GAP * usual)
    scatter, readings = 0.0, None
    later: FloatArray | None = None
    near = steps[steps <= _GAP * usual] - usual
    # Ticks that each come late after the one before are late themselves; about an even grid the stamps may be.
    walks = near.std() > 0.02 * usual and np.cumsum(near - near.mean()).std() > 3 * near.std()
    if walks or np.mean(uneven) > 0.01:
        readings = columns.position_m
        columns, scatter, later = _resample(columns, _round(float(np.mean(steps[steps < _LONGEST_STEP * usual]))))
        steps = np.diff(columns.time_s)
        usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * usual)
    whole = list(itertools.pairwise([0, *(gaps + 1).tolist(), steps.size + 1]))
    sizes = np.array([b - a for a, b in whole])
    seconds = sizes * usual
    # The initial state of each piece must decay before it is judged, and a fast observer biases the estimates.
    enough = max(2.0, 0.2 * seconds.sum())
    lengths_s = (1.0, 0.5, 0.4, 0.3)
    worth = next((least / usual for least in lengths_s if seconds[seconds >= least].sum() >= enough), 0.0)
    shortest = max(_SHORTEST, 0.1 * sizes.max(), worth)
    pieces = [slice(a, b) for a, b in whole if b - a >= shortest]
    if not pieces:
        message = (
            f"has no {_SHORTEST} samples in a row without a gap; allowed: at least one such record; or --sample-time, "
            "where no row is missing and the clock is written with too few digits"
        )
        return [], [Fault(columns.file, None, "time", message)], []
    notes = list(columns.notes)
    if gaps.size:
        left = int(sizes[sizes < shortest].sum())
        notes.append(
            f"{columns.file}: {gaps.size} gap{'' if gaps.size == 1 else 's'} in time; taken as {len(pieces)} "
            f"record{'' if len(pieces) == 1 else 's'}"
            + (f", {left} samples in shorter pieces left out" if left else "")
        )
    period = _round(float(np.mean(np.delete(steps, gaps))))
    records = [
        Record(
            f"{columns.file}#{index}" if len(pieces) > 1 else columns.file,
            period,
            columns.position_m[part],
            columns.force_n[part],
            columns.motion,
            columns.file,
            scatter,
            readings,
            None if later is None else later[:, part],
        )
        for index, part in enumerate(pieces, start=1)
    ]
    return records, [], notes


def faults_of(columns: Columns, *, swing: bool = False) -> list[Fault]:
    """Return what makes a log unusable; of a swing fewer samples are enough, and it may be at rest."""
    file, faults, shortest = columns.file, [], 60 if swing else _SHORTEST
    for key, values in (("time", columns.time_s), ("position", columns.position_m), ("force", columns.force_n)):
        rows = [(columns.at(int(row)), f"is {values[row]}") for row in np.flatnonzero(~_sound(values))]
        faults += faults_of_rows(file, key, rows, "a finite number")
    if columns.time_s.size < shortest:
        message = f"has {columns.time_s.size} samples; allowed: at least {shortest}"
        faults.append(Fault(file, None, "", message))
    if faults:
        return faults
    steps = np.diff(columns.time_s)
    rows = [
        (columns.at(int(row) + 1), f"is {number(columns.time_s[row + 1])} s, not after the row before")
        for row in np.flatnonzero(steps <= 0)
    ]
    allowed = "increasing times; one file for each record; --sample-time where the stamps are coarse and no row missing"
    faults += faults_of_rows(file, "time", rows, allowed)
    wraps = _wraps(columns)
    if wraps.size:
        message = (
            f"jumps over most of its range from one sample to the next, {wraps.size} time(s); allowed: a position "
            "without jumps; add the counter's range where it wraps around"
        )
        faults.append(Fault(file, columns.at(int(wraps[0])), "position", message))
    step = float(np.median(steps))
    if step > 0 and not 1e-5 <= step <= 0.05:
        message = f"steps of {number(step)} s; allowed: 1e-5 to 0.05 s; is the unit right?"
        faults.append(Fault(file, None, "time", message))
    sizes = {"position": float(np.ptp(columns.position_m)), "force": float(np.abs(columns.force_n).max())}
    # The range of haptic devices and machine drives; a mistaken unit is a factor of 1000. A motor may turn for ever.
    likely = {"position": (2e-6, 5.0), "force": (1e-3, 1e5)}
    if columns.motion == "rotary":
        likely = {"position": (1e-5, math.inf), "force": (1e-5, 1e4)}
    for key, (low, high) in likely.items():
        if sizes[key] > high or (sizes[key] < low and not swing):
            what = f"reaches {number(sizes[key])} at most" if key == "force" else f"spans {number(sizes[key])}"
            hint = "is the unit right?" if sizes[key] else "log a multisine of several times the friction (avc excite)"
            faults.append(Fault(file, None, key, f"{what}; allowed: {low:g} to {high:g}; {hint}"))
    return faults


def faults_of_rows(file: str, key: str, rows: Sequence[tuple[int | None, str]], allowed: str) -> list[Fault]:
    """Return the first fault of one column, with the number of the others."""
    if not rows:
        return []
    (line, wrong), (last, _) = rows[0], rows[-1]
    more = f", with {len(rows) - 1} more such rows" if len(rows) > 1 else ""
    until = f", to line {last}" if more and last is not None else ""
    return [Fault(file, line, key, f"{wrong}{more}{until}; allowed: {allowed}")]


def _sound(values: FloatArray) -> BoolArray:
    """Return which values are finite and can be squared."""
    return np.asarray(np.abs(values) < 1e100)


def _wraps(columns: Columns) -> IndexArray:
    """Return the rows at which a counter overflows: one step over half of the range, those beside it short."""
    steps = np.diff(columns.time_s)
    moves, covers = np.abs(np.diff(columns.position_m)), float(np.ptp(columns.position_m))
    steps_m = moves[moves > 1e-6 * covers]
    # An encoder that goes to and fro between a few counts has no larger range.
    far = max(0.5 * covers, 8 * float(steps_m.min(initial=covers)))
    beside = np.maximum(np.append(0.0, moves[:-1]), np.append(moves[1:], 0.0))
    return np.flatnonzero((moves > far) & (beside < 0.1 * moves) & (steps < _GAP * np.median(steps))) + 1


def _round(period: float) -> float:
    """Return a sample time rounded to few digits where the clock means one."""
    near = (float(f"{period:.{digits}g}") for digits in range(1, 5))
    return next((one for one in near if abs(one - period) <= 2e-5 * period), period)


def _resample(columns: Columns, period_s: float) -> tuple[Columns, float, FloatArray]:
    """Resample a log with clock jitter; return it, the scatter of its steps, and the forces that act ticks later."""
    time, steps = columns.time_s, np.diff(columns.time_s)
    edges = [0, *(np.flatnonzero(steps > _LONGEST_STEP * period_s) + 1).tolist(), time.size]
    times, positions, forces = [], [], []
    for part in (slice(a, b) for a, b in itertools.pairwise(edges) if b - a > _MOST_TICKS + 1):
        at = np.arange(time[part][0], time[part][-1] - 0.5 * period_s, period_s)
        times.append(at)
        positions.append(make_interp_spline(time[part], columns.position_m[part], k=3)(at))
        forces.append(_mean_forces(time[part], columns.force_n[part], at, period_s))
    scatter = float(np.std(steps[steps <= _LONGEST_STEP * period_s]))
    note = (
        f"{columns.file}: its steps of time scatter by {number(1e3 * scatter, 2)} ms about "
        f"{number(1e3 * period_s, 3)} ms; where only the stamps scatter, --sample-time says so"
    )
    later = np.concatenate(forces, axis=1)
    even = Columns(
        columns.file,
        np.concatenate(times),
        np.concatenate(positions),
        later[0],
        motion=columns.motion,
        notes=(*columns.notes, note),
    )
    return even, scatter / period_s, later


def _mean_forces(time_s: FloatArray, force_n: FloatArray, at_s: FloatArray, period_s: float) -> FloatArray:
    """Return the mean force over each even sample, held from tick to tick and some late, shape (ticks, samples)."""
    means = []
    for late in range(_MOST_TICKS + 1):
        ticks = time_s[late:]
        impulse = np.concatenate([[0.0], np.cumsum(force_n[: ticks.size - 1] * np.diff(ticks))])
        # Before the first force has arrived it is that force, and after the last tick the last.
        edges = np.append(at_s, at_s[-1] + period_s) + late * period_s
        until = np.interp(edges, ticks, impulse)
        until += np.minimum(edges - ticks[0], 0.0) * force_n[0]
        until += np.maximum(edges - ticks[-1], 0.0) * force_n[ticks.size - 1]
        means.append(np.diff(until) / period_s)
    return np.array(means)


def excerpts(records: Sequence[Record], most_samples: int) -> list[Record]:
    """Keep evenly spread pieces of long records."""
    total = sum(record.position_m.size for record in records)
    if total <= most_samples:
        return list(records)
    parts = []
    for record in records:
        size = record.position_m.size
        pieces = max(1, min(8, size // 8000))
        length = max(_SHORTEST, int(size * most_samples / total / pieces))
        for index, start in enumerate(np.linspace(0, size - length, pieces).astype(int).tolist(), start=1):
            part = slice(start, start + length)
            position, force = record.position_m[part], record.force_n[part]
            name = f"{record.name}@{index}"
            parts.append(replace(record, name=name, log=record.whole, position_m=position, force_n=force))
    return parts


def lattice_step(readings_m: FloatArray) -> float | None:
    """Return the resolution of the encoder, or None where the readings lie on no lattice."""
    values = np.unique(readings_m)
    if values.size < 6:
        return None
    gaps = np.diff(values)
    # Values that differ by rounding only are one.
    gaps = gaps[gaps > 1e-9 * (values[-1] - values[0])]
    usual = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
    # A fast hand crosses some steps between two readings.
    guesses = {guess / apart for guess in (usual, float(gaps.min())) for apart in range(1, 7)}
    for guess in sorted(guesses, reverse=True):
        step = _refine(guess, gaps, values)
        steps = (values[:: max(1, values.size // _MOST_VALUES)] - values[0]) / step
        off = steps - np.round(steps)
        if steps.max() > 5 and float(np.sqrt(np.mean(off**2))) < 0.08:  # files and time stamps are rounded
            return step
    return None


def _refine(step: float, gaps: FloatArray, values: FloatArray) -> float:
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
