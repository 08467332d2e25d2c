"""A record of a device: position and commanded force at equal times, cut at missing ticks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import Fault
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.identification.repair import (
    LONGEST_STEP,
    laid_evenly,
    left_out,
    sound,
    wrapped,
)

# A step of time may differ from the usual one by this share of it; a longer one is a gap.
_JITTER = 0.25
# Steps longer than so many usual ones are gaps.
_GAP = 1.5
# Share of the steps that may differ more before the clock counts as jittering.
_SCATTERS = 0.01
# Number of places reported of one fault.
TOLD = 3
_SHORTEST = 200
# With a piece shorter than this share of the longest every record would be judged from too early on.
_SHORT = 0.1
# Pieces of these lengths are preferred to shorter ones where they hold so much of the log.
_PIECES_S = (1.0, 0.5, 0.4, 0.3)
_ENOUGH_S, _ENOUGH = 2.0, 0.2


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one uninterrupted record; of a rotary device in rad, N.m and kg.m2."""

    name: str
    sample_time_s: float
    position_m: FloatArray
    force_n: FloatArray
    added_mass_kg: float = 0.0
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


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a log in SI units, not yet checked to be a record."""

    file: str
    time_s: FloatArray
    position_m: FloatArray
    force_n: FloatArray
    line: IndexArray | None = None
    motion: MotionKind = "linear"
    told: tuple[str, ...] = ()
    filled: BoolArray | None = None

    @property
    def units(self) -> Units:
        """Names and units in which its values are printed."""
        return units_for(self.motion)

    def rows(self, kept: BoolArray | IndexArray) -> Columns:
        """Return some of the rows."""
        time, position, force = (one[kept] for one in (self.time_s, self.position_m, self.force_n))
        line = None if self.line is None else self.line[kept]
        return replace(self, time_s=time, position_m=position, force_n=force, line=line)

    def at(self, row: int) -> int | None:
        """Return the line of a row."""
        return None if self.line is None else int(self.line[row])


def records_of(columns: Columns, added_mass_kg: float = 0.0) -> tuple[list[Record], list[Fault], list[str]]:
    """Cut a log into records at its gaps; return them, its faults, and notes for the user."""
    backwards = backwards_of(columns)
    columns = left_out(columns)
    faults = implausible(columns)
    if columns.time_s.size >= _SHORTEST:
        faults += backwards
    if faults:
        return [], faults, []
    steps = np.diff(columns.time_s)
    usual = float(np.median(steps))
    # Time stamps have few digits: a step is compared with the usual one.
    uneven = (np.abs(steps - usual) > _JITTER * usual) & (steps <= _GAP * usual)
    scatter, readings = 0.0, None
    later: FloatArray | None = None
    if np.mean(uneven) > _SCATTERS:
        readings = columns.position_m
        columns, scatter, later = laid_evenly(columns, _round(float(np.mean(steps[steps < LONGEST_STEP * usual]))))
        steps = np.diff(columns.time_s)
        usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * usual)
    edges = [0, *(int(gap) + 1 for gap in gaps), steps.size + 1]
    whole = list(itertools.pairwise(edges))
    sizes = np.array([b - a for a, b in whole])
    shortest = max(_SHORTEST, _SHORT * sizes.max(), _worth(sizes, usual))
    pieces = [(a, b) for a, b in whole if b - a >= shortest]
    told = list(columns.told)
    if gaps.size:
        lost = columns.time_s.size - sum(b - a for a, b in pieces)
        told.append(
            f"{columns.file}: {gaps.size} gap{'' if gaps.size == 1 else 's'} in time; taken as {len(pieces)} "
            f"record{'' if len(pieces) == 1 else 's'}"
            + (f", {lost} samples in shorter pieces left out" if lost else "")
        )
    if not pieces:
        message = (
            f"has no {_SHORTEST} samples in a row without a gap; allowed: at least one such record; or --sample-time, "
            "where no row is missing and the clock is written with too few digits"
        )
        return [], [Fault(columns.file, None, "time", message)], []
    period = _round(float(np.mean(np.delete(steps, gaps))))
    several = len(pieces) > 1
    records = [
        Record(
            f"{columns.file}#{index}" if several else columns.file,
            period,
            columns.position_m[a:b],
            columns.force_n[a:b],
            added_mass_kg,
            columns.motion,
            columns.file,
            scatter,
            readings,
            None if later is None else later[:, a:b],
        )
        for index, (a, b) in enumerate(pieces, start=1)
    ]
    return records, [], told


def _worth(sizes: IndexArray, period_s: float) -> float:
    """Return the least samples of a piece that is kept, where enough is left.

    The initial state of each piece must decay before it is judged, and a fast observer biases the estimates.
    """
    seconds = sizes * period_s
    enough = max(_ENOUGH_S, _ENOUGH * seconds.sum())
    return next((least / period_s for least in _PIECES_S if seconds[seconds >= least].sum() >= enough), 0.0)


def backwards_of(columns: Columns) -> list[Fault]:
    """Return the rows at which the time of a log does not increase."""
    there = np.flatnonzero(sound(columns.time_s))
    after = there[1:][np.diff(columns.time_s[there]) <= 0]
    rows = [(columns.at(int(row)), f"is {number(columns.time_s[row])} s, not after the row before") for row in after]
    allowed = "increasing times; one file for each record; --sample-time where the stamps are coarse and no row missing"
    return faults_of_rows(columns.file, "time", rows, allowed)


def faults_of_rows(file: str, key: str, rows: Sequence[tuple[int | None, str]], allowed: str) -> list[Fault]:
    """Return the faults of one column: all of a few, otherwise the first with the number of the others."""
    if len(rows) <= TOLD:
        return [Fault(file, line, key, f"{wrong}; allowed: {allowed}") for line, wrong in rows]
    (line, wrong), (last, _) = rows[0], rows[-1]
    until = "" if last is None else f", to line {last}"
    return [Fault(file, line, key, f"{wrong}, with {len(rows) - 1} more such rows{until}; allowed: {allowed}")]


def _round(period: float) -> float:
    """Return a sample time rounded to few digits where the clock means one."""
    for digits in range(1, 5):
        near = float(f"{period:.{digits}g}")
        if abs(near - period) <= 2e-5 * period:
            return near
    return period


# Range of haptic devices and machine drives; a mistaken unit is a factor of 1000. A motor may turn for ever.
_LIKELY: Mapping[MotionKind, Mapping[str, tuple[float, float]]] = {
    "linear": {"position": (2e-6, 5.0), "force": (1e-3, 1e5)},
    "rotary": {"position": (1e-5, math.inf), "force": (1e-5, 1e4)},
}
_MORE = {
    "position": "log a multisine with several times the force, more than dry friction holds",
    "force": "without a force no mass is identified: log a multisine, as avc excite plays one",
}


def implausible(columns: Columns, *, idle: bool = False) -> list[Fault]:
    """Return implausible data: no numbers, too few samples, magnitudes of another unit.

    With `idle` a device at rest, or without a commanded force, is allowed.
    """
    file, faults = columns.file, []
    for key, values in (("time", columns.time_s), ("position", columns.position_m), ("force", columns.force_n)):
        rows = [(columns.at(int(row)), f"is {values[row]}") for row in np.flatnonzero(~sound(values))]
        faults += faults_of_rows(file, key, rows, "a finite number")
    # A swing that grows is read from fewer samples than a device.
    shortest = 60 if idle else _SHORTEST
    if columns.time_s.size < shortest:
        message = f"has {columns.time_s.size} samples; allowed: at least {shortest}"
        return [*faults, Fault(file, None, "", message)]
    if faults:
        return faults
    jumps = wrapped(columns.position_m, columns.time_s)
    if jumps.size:
        message = (
            f"jumps over most of its range from one sample to the next, {jumps.size} time(s); allowed: a position "
            "without jumps; add the counter's range where it wraps around"
        )
        return [Fault(file, columns.at(int(jumps[0])), "position", message)]
    step = float(np.median(np.diff(columns.time_s)))
    # Times that stand still or go back are told row by row.
    if step > 0 and not 1e-5 <= step <= 0.05:
        message = f"steps of {number(step)} s; allowed: 1e-5 to 0.05 s; is the unit right?"
        faults.append(Fault(file, None, "time", message))
    sizes = {"position": float(np.ptp(columns.position_m)), "force": float(np.abs(columns.force_n).max())}
    for key, (low, high) in _LIKELY[columns.motion].items():
        size = sizes[key]
        if size > high or (size < low and not idle):
            what = f"reaches {number(size)} at most" if key == "force" else f"spans {number(size)}"
            hint = "is the unit right?" if size else _MORE[key]
            faults.append(Fault(file, None, key, f"{what}; allowed: {low:g} to {high:g}; {hint}"))
    return faults


def shortened(records: Sequence[Record], most_samples: int) -> list[Record]:
    """Keep evenly spread pieces of long records."""
    total = sum(record.position_m.size for record in records)
    if total <= most_samples:
        return list(records)
    kept = []
    for record in records:
        size = record.position_m.size
        pieces = max(1, min(8, size // 8000))
        length = max(_SHORTEST, int(size * most_samples / total / pieces))
        for index, start in enumerate(np.linspace(0, size - length, pieces).astype(int), start=1):
            part = slice(int(start), int(start) + length)
            position, force = record.position_m[part], record.force_n[part]
            name = f"{record.name}@{index}"
            kept.append(replace(record, name=name, log=record.whole, position_m=position, force_n=force))
    return kept
