"""Logs: the columns of a file, and records of even samples between its gaps.

A force is held from tick to tick, so that its effect on a mass over an even sample is that of its mean there. Where the
clock scatters, positions are those of a cubic spline; parameters are known to s^2/6 under steps with a scatter of s.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number, plural
from avc_casadi._util.units import MotionKind
from avc_casadi.model.device import Device
from avc_casadi.model.quantity import RADII_M

_GAP = 1.5
"""Steps of time longer than so many usual ones are gaps, where the clock is even."""
_LONGEST_STEP = 6.0
"""Steps of time longer than so many usual ones are gaps, where the clock scatters."""
_SHORTEST = 200
"""Fewest samples of a record."""
_SHORTEST_SWING = 60
"""Fewest samples of the log of a swing."""
_MOST_EMPTY_SHARE = 0.01
"""Share of rows without a number up to which they are left out as gaps."""
_LARGEST_SOUND = 1e100
"""Numbers from here on cannot be squared safely."""

_UNEVEN_STEP = 0.25
"""A step is uneven where it differs from the usual one by more than this share of it."""
_MOST_UNEVEN_SHARE = 0.01
"""Share of uneven steps beyond which the clock scatters."""
_EVEN_SCATTER = 0.02
"""Scatter of the steps, as a share of the usual one, up to which a clock is even."""
_WALK = 3.0
"""A clock walks where its sum of deviations scatters by more than so many times a single deviation."""

_LONG_PIECES_S = (1.0, 0.5, 0.4, 0.3)
"""Lengths of pieces that are asked for, s: the first one that enough of the log reaches."""
_ENOUGH_S = 2.0
"""Seconds of long pieces that are enough of a log."""
_ENOUGH_SHARE = 0.2
"""Share of a log that long pieces must hold at least."""
_SHORTEST_SHARE = 0.1
"""Shorter pieces than this share of the longest one are left out."""

_SHORTEST_STEP_S = 1e-5
"""Shortest likely sample time, s."""
_LONGEST_STEP_S = 0.05
"""Longest likely sample time, s."""
_LIKELY_SIZES: Mapping[MotionKind, Mapping[str, tuple[float, float]]] = {
    "linear": {"position": (2e-6, 5.0), "force": (1e-3, 1e5)},
    "rotary": {"position": (1e-5, math.inf), "force": (1e-5, 1e4)},
}
"""Least and largest span of positions (m, rad) and size of forces (N, N.m) of haptic devices and machine drives.

A mistaken unit is a factor of 1000. A motor may turn for ever.
"""

_STANDSTILL = 1e-6
"""Moves up to this share of the range are none, where the smallest move is looked for."""
_WRAP_SHARE = 0.5
"""A counter that wraps moves by more than this share of its range in one sample."""
_WRAP_STEPS = 8
"""A counter that wraps moves by more than so many of its smallest moves."""
_WRAP_NEIGHBOURS = 0.1
"""Moves before and after a wrap are shorter than this share of it."""

_MOST_CLOCK_DIGITS = 4
_CLOCK_ROUNDING = 2e-5
"""A clock means a sample time of few digits where it is so near to it, as a share."""
_MOST_TICKS = 4
"""Ticks by which a force may act late beside a clock that scatters."""
_MOST_EXCERPTS = 8
"""Pieces that are kept of a long record at most."""
_EXCERPT_SAMPLES = 8000
"""A long record gives one excerpt for each so many samples of it."""

_FEWEST_VALUES = 6
"""Fewest different readings that show a lattice."""
_MOST_VALUES = 4000
"""Readings of a lattice that are compared at most."""
_SAME_VALUE = 1e-9
"""Readings nearer than this share of their range differ by rounding only."""
_SMALL_GAPS = 0.1
"""Quantile of the gaps between readings that a single step of the encoder is near to."""
_LIKE_SMALL_GAP = 1.5
"""Gaps below so many times that quantile are taken as single steps."""
_MOST_STEPS_AT_ONCE = 6
"""Steps of the encoder that the smallest gap between readings may hold."""
_FEWEST_STEPS = 5
"""A lattice spans more steps than this."""
_MOST_OFF_LATTICE = 0.08
"""Largest root mean square distance of readings from a lattice, steps: files and time stamps are rounded."""
_FIRST_REACH = 20
"""Steps over which they are counted first, where a step is refined."""
_REACH_GROWTH = 3
"""Each further count reaches so many times as far."""
_LAST_REACH = 4
"""Counting ends where it reaches so many times beyond all readings."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of a log in SI units, each of shape (rows,), not yet checked to be a record."""

    file: str
    time_s: FloatArray
    position_m: FloatArray
    force_n: FloatArray
    line: IndexArray | None = None
    motion: MotionKind = "linear"
    notes: tuple[str, ...] = ()

    def rows(self, selection: BoolArray | IndexArray) -> Columns:
        """Return the selected rows."""
        return replace(
            self,
            time_s=self.time_s[selection],
            position_m=self.position_m[selection],
            force_n=self.force_n[selection],
            line=None if self.line is None else self.line[selection],
        )

    def line_of(self, row: int) -> int | None:
        """Return the line of the file that a row stands in, or None where the file has no lines."""
        return None if self.line is None else int(self.line[row])

    def complete(self) -> Columns:
        """Return the log without rows that hold no number, where these are few: they become gaps."""
        empty = ~(_sound(self.time_s) & _sound(self.position_m) & _sound(self.force_n))
        count = int(np.count_nonzero(empty))
        if not 0 < count <= max(1.0, _MOST_EMPTY_SHARE * empty.size):
            return self
        line = self.line_of(int(np.argmax(empty)))
        where = "" if line is None else f", the first in line {line}"
        note = f"{self.file}: {count} sample{'' if count == 1 else 's'} without a number left out{where}"
        return replace(self.rows(~empty), notes=(*self.notes, note))


def require_radius(handle_radius_m: float | None) -> None:
    """Refuse a radius at which no hand holds a device, before a log is read.

    Raises:
        InputError: it is not in the range of a device file.
    """
    lowest, highest = RADII_M
    if handle_radius_m is not None and not lowest <= handle_radius_m <= highest:
        message = f"is {number(handle_radius_m)}; allowed: {lowest:g} to {highest:g} m, from the axis to the hand"
        raise InputError.of(message, key="handle_radius_m")


def allowed_sign(*, flip_force: bool) -> str:
    """Return which sign of the force is allowed, with the option that reverses it in what it was read."""
    return f"a force that is positive along +position, or {'without' if flip_force else 'with'} --flip-force"


def require_radius_of(motion: MotionKind, handle_radius_m: float | None, device: Device | None) -> None:
    """Refuse a radius that a log does not take, or one that is missing and that no device states.

    Raises:
        InputError: the log is linear and has a radius, or it is rotary and has none.
    """
    message = ""
    if motion == "linear" and handle_radius_m is not None:
        message = "applies to logs in rad only; leave it out"
    elif motion == "rotary" and handle_radius_m is None and device is None:
        message = "is missing, and the log is of a rotary device; give it (from the axis to the hand), or --device"
    if message:
        raise InputError.of(message, key="handle_radius_m")


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one uninterrupted record; of a rotary device in rad, N.m and kg.m2.

    Positions and forces have the shape (samples,). Where the clock scatters, `scatter` is that of its steps as a share
    of the sample time, `readings_m` holds the positions as they were read, shape (readings,), and `later_n` the forces
    as they act so many ticks late, shape (ticks, samples).
    """

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


@dataclass(frozen=True)
class CutLog:
    """A log cut into records, or the faults for which it is none, and notes for the user."""

    records: list[Record]
    faults: list[Fault]
    notes: list[str]


def records_of(columns: Columns) -> CutLog:
    """Return a log as records cut at its gaps, resampled where its clock scatters, or why it is unusable."""
    columns = columns.complete()
    faults = faults_of(columns)
    if faults:
        return CutLog([], faults, [])
    even = _resampled(columns) if _clock_scatters(columns.time_s) else _EvenColumns(columns)
    steps = np.diff(even.columns.time_s)
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * usual)
    edges = [0, *(gaps + 1).tolist(), steps.size + 1]
    every_piece = [slice(first, end) for first, end in itertools.pairwise(edges)]
    sizes = np.array([piece.stop - piece.start for piece in every_piece])
    shortest = _shortest_piece(sizes, usual)
    pieces = [piece for piece in every_piece if piece.stop - piece.start >= shortest]
    if not pieces:
        message = (
            f"has no {_SHORTEST} samples in a row without a gap; give a log with such a part. If no row is missing and "
            "the times have too few digits, use --sample-time"
        )
        return CutLog([], [Fault(columns.file, None, "time", message)], [])
    notes = list(even.columns.notes)
    if gaps.size:
        notes.append(_note_of_gaps(columns.file, gaps.size, len(pieces), int(sizes[sizes < shortest].sum())))
    period_s = _round(float(np.mean(np.delete(steps, gaps))))
    return CutLog(_records(even, pieces, period_s), [], notes)


def _clock_scatters(time_s: FloatArray) -> bool:
    """Return whether steps of time between gaps differ by more than an even clock's."""
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    without_gap = steps <= _GAP * usual
    uneven = (np.abs(steps - usual) > _UNEVEN_STEP * usual) & without_gap
    deviations = steps[without_gap] - usual
    # Ticks that each come late after the one before are late themselves; about an even grid the stamps may be.
    drift = np.cumsum(deviations - deviations.mean())
    walks = deviations.std() > _EVEN_SCATTER * usual and drift.std() > _WALK * deviations.std()
    return bool(walks or np.mean(uneven) > _MOST_UNEVEN_SHARE)


def _shortest_piece(sizes: IndexArray, period_s: float) -> float:
    """Return the fewest samples of a piece between gaps that is taken as a record."""
    seconds = sizes * period_s
    # The initial state of each piece must decay before it is judged, and a fast observer biases the estimates.
    enough_s = max(_ENOUGH_S, _ENOUGH_SHARE * seconds.sum())
    long_enough = next(
        (length_s / period_s for length_s in _LONG_PIECES_S if seconds[seconds >= length_s].sum() >= enough_s), 0.0
    )
    return float(max(_SHORTEST, _SHORTEST_SHARE * sizes.max(), long_enough))


def _note_of_gaps(file: str, gaps: int, pieces: int, left_out: int) -> str:
    note = f"{file}: {gaps} gap{'' if gaps == 1 else 's'} in time; used as {pieces} record{'' if pieces == 1 else 's'}"
    return f"{note}, {left_out} samples in shorter pieces left out" if left_out else note


def _records(even: _EvenColumns, pieces: Sequence[slice], period_s: float) -> list[Record]:
    """Return the pieces of a log as records of one sample time, numbered where there are several."""
    columns = even.columns
    return [
        Record(
            name=f"{columns.file}#{index}" if len(pieces) > 1 else columns.file,
            sample_time_s=period_s,
            position_m=columns.position_m[piece],
            force_n=columns.force_n[piece],
            motion=columns.motion,
            log=columns.file,
            scatter=even.scatter,
            readings_m=even.readings_m,
            later_n=None if even.later_n is None else even.later_n[:, piece],
        )
        for index, piece in enumerate(pieces, start=1)
    ]


def faults_of(columns: Columns, *, swing: bool = False) -> list[Fault]:
    """Return what makes a log unusable; of a swing fewer samples are enough, and it may be at rest."""
    faults: list[Fault] = []
    for key, values in (("time", columns.time_s), ("position", columns.position_m), ("force", columns.force_n)):
        rows = [(columns.line_of(int(row)), f"is {values[row]}") for row in np.flatnonzero(~_sound(values))]
        faults += faults_of_rows(columns.file, key, rows, "a finite number")
    fewest = _SHORTEST_SWING if swing else _SHORTEST
    if columns.time_s.size < fewest:
        message = f"has {plural(columns.time_s.size, 'sample')}; allowed: at least {fewest}"
        faults.append(Fault(columns.file, None, "", message))
    if faults:
        return faults
    return [
        *_faults_of_order(columns),
        *_faults_of_wraps(columns),
        *_faults_of_period(columns),
        *_faults_of_sizes(columns, may_rest=swing),
    ]


def _faults_of_order(columns: Columns) -> list[Fault]:
    """Return the rows whose time does not increase, as a fault."""
    rows = [
        (columns.line_of(int(row) + 1), f"is {number(columns.time_s[row + 1])} s, not after the row before")
        for row in np.flatnonzero(np.diff(columns.time_s) <= 0)
    ]
    allowed = "times that increase, one recording in a file; for rounded times without missing rows give --sample-time"
    return faults_of_rows(columns.file, "time", rows, allowed)


def _faults_of_wraps(columns: Columns) -> list[Fault]:
    """Return the fault of a position that jumps over most of its range, as a counter that overflows; or none."""
    wraps = _wraps(columns)
    if not wraps.size:
        return []
    message = (
        f"jumps over most of its range from one sample to the next, {wraps.size} time(s); allowed: a position "
        "without jumps. If the counter wraps around, add its range after each jump"
    )
    return [Fault(columns.file, columns.line_of(int(wraps[0])), "position", message)]


def _faults_of_period(columns: Columns) -> list[Fault]:
    """Return an unlikely sample time as a fault."""
    step_s = float(np.median(np.diff(columns.time_s)))
    if step_s <= 0 or _SHORTEST_STEP_S <= step_s <= _LONGEST_STEP_S:
        return []
    message = f"steps of {number(step_s)} s; allowed: 1e-5 to 0.05 s; is the unit right?"
    return [Fault(columns.file, None, "time", message)]


def _faults_of_sizes(columns: Columns, *, may_rest: bool) -> list[Fault]:
    """Return positions and forces of unlikely size as faults."""
    sizes = {"position": float(np.ptp(columns.position_m)), "force": float(np.abs(columns.force_n).max())}
    faults = []
    for key, (lowest, highest) in _LIKELY_SIZES[columns.motion].items():
        size = sizes[key]
        too_small = size < lowest and not may_rest
        if size > highest or too_small:
            fact = f"reaches {number(size)} at most" if key == "force" else f"spans {number(size)}"
            hint = "is the unit right?" if size else "log a multisine of several times the friction (avc excite)"
            faults.append(Fault(columns.file, None, key, f"{fact}; allowed: {lowest:g} to {highest:g}; {hint}"))
    return faults


def faults_of_rows(file: str, key: str, rows: Sequence[tuple[int | None, str]], allowed: str) -> list[Fault]:
    """Return the first fault of one column, given each with its line, with the number of the others."""
    if not rows:
        return []
    first_line, wrong = rows[0]
    last_line, _ = rows[-1]
    more = f", with {len(rows) - 1} more such rows" if len(rows) > 1 else ""
    until = f", to line {last_line}" if more and last_line is not None else ""
    return [Fault(file, first_line, key, f"{wrong}{more}{until}; allowed: {allowed}")]


def _sound(values: FloatArray) -> BoolArray:
    """Return which values are finite and can be squared."""
    return np.asarray(np.abs(values) < _LARGEST_SOUND)


def _wraps(columns: Columns) -> IndexArray:
    """Return the rows at which a counter overflows: a move over half of the range, those before and after it short."""
    steps = np.diff(columns.time_s)
    moves = np.abs(np.diff(columns.position_m))
    span = float(np.ptp(columns.position_m))
    smallest_move = float(moves[moves > _STANDSTILL * span].min(initial=span))
    # An encoder that goes to and fro between a few counts has no larger range.
    far = max(_WRAP_SHARE * span, _WRAP_STEPS * smallest_move)
    neighbours = np.maximum(np.append(0.0, moves[:-1]), np.append(moves[1:], 0.0))
    without_gap = steps < _GAP * np.median(steps)
    return np.flatnonzero((moves > far) & (neighbours < _WRAP_NEIGHBOURS * moves) & without_gap) + 1


def _round(period: float) -> float:
    """Return a sample time rounded to few digits where the clock means one."""
    rounded = (float(f"{period:.{digits}g}") for digits in range(1, _MOST_CLOCK_DIGITS + 1))
    return next((value for value in rounded if abs(value - period) <= _CLOCK_ROUNDING * period), period)


@dataclass(frozen=True, eq=False)
class _EvenColumns:
    """Columns of an even clock; of one that scattered with what `Record` keeps of it."""

    columns: Columns
    scatter: float = 0.0
    readings_m: FloatArray | None = None
    later_n: FloatArray | None = None


def _resampled(columns: Columns) -> _EvenColumns:
    """Resample a log with clock jitter, with the scatter of its steps and the forces that act ticks later."""
    time = columns.time_s
    steps = np.diff(time)
    usual = float(np.median(steps))
    period_s = _round(float(np.mean(steps[steps < _LONGEST_STEP * usual])))
    edges = [0, *(np.flatnonzero(steps > _LONGEST_STEP * period_s) + 1).tolist(), time.size]
    pieces = [slice(first, end) for first, end in itertools.pairwise(edges) if end - first > _MOST_TICKS + 1]
    times = []
    positions = []
    forces = []
    for piece in pieces:
        even_s = np.arange(time[piece][0], time[piece][-1] - 0.5 * period_s, period_s)
        times.append(even_s)
        positions.append(make_interp_spline(time[piece], columns.position_m[piece], k=3)(even_s))
        forces.append(_mean_forces(time[piece], columns.force_n[piece], even_s, period_s))
    scatter_s = float(np.std(steps[steps <= _LONGEST_STEP * period_s]))
    note = (
        f"{columns.file}: the times between samples scatter by {number(1e3 * scatter_s, 2)} ms about "
        f"{number(1e3 * period_s, 3)} ms; if the samples are regular and only the time stamps scatter, "
        "use --sample-time"
    )
    later_n = np.concatenate(forces, axis=1)
    even = Columns(
        columns.file,
        np.concatenate(times),
        np.concatenate(positions),
        later_n[0],
        motion=columns.motion,
        notes=(*columns.notes, note),
    )
    return _EvenColumns(even, scatter_s / period_s, readings_m=columns.position_m, later_n=later_n)


def _mean_forces(time_s: FloatArray, force_n: FloatArray, begin_s: FloatArray, period_s: float) -> FloatArray:
    """Return the mean force over each even sample, shape (ticks, samples).

    The force is held from tick to tick, and acts 0, 1, ... ticks late. Samples begin at `begin_s`, shape (samples,).
    """
    means = []
    for late in range(_MOST_TICKS + 1):
        ticks = time_s[late:]
        impulse = np.concatenate([[0.0], np.cumsum(force_n[: ticks.size - 1] * np.diff(ticks))])
        # Before the first force has arrived it is that force, and after the last tick the last.
        edges = np.append(begin_s, begin_s[-1] + period_s) + late * period_s
        until = np.interp(edges, ticks, impulse)
        until += np.minimum(edges - ticks[0], 0.0) * force_n[0]
        until += np.maximum(edges - ticks[-1], 0.0) * force_n[ticks.size - 1]
        means.append(np.diff(until) / period_s)
    return np.array(means)


def excerpts(records: Sequence[Record], most_samples: int) -> list[Record]:
    """Keep evenly spread pieces of long records, of about so many samples in all."""
    total = sum(record.position_m.size for record in records)
    if total <= most_samples:
        return list(records)
    kept = []
    for record in records:
        size = record.position_m.size
        pieces = max(1, min(_MOST_EXCERPTS, size // _EXCERPT_SAMPLES))
        length = max(_SHORTEST, int(size * most_samples / total / pieces))
        for index, first in enumerate(np.linspace(0, size - length, pieces).astype(int).tolist(), start=1):
            part = slice(first, first + length)
            kept.append(
                replace(
                    record,
                    name=f"{record.name}@{index}",
                    log=record.whole,
                    position_m=record.position_m[part],
                    force_n=record.force_n[part],
                )
            )
    return kept


def lattice_step(readings_m: FloatArray) -> float | None:
    """Return the resolution of the encoder, m, or None where the readings lie on no lattice."""
    values = np.unique(readings_m)
    if values.size < _FEWEST_VALUES:
        return None
    gaps = np.diff(values)
    gaps = gaps[gaps > _SAME_VALUE * (values[-1] - values[0])]
    usual = float(np.median(gaps[gaps < _LIKE_SMALL_GAP * np.quantile(gaps, _SMALL_GAPS)]))
    # A fast hand crosses some steps between two readings.
    guesses = {
        gap / steps_apart for gap in (usual, float(gaps.min())) for steps_apart in range(1, _MOST_STEPS_AT_ONCE + 1)
    }
    for guess in sorted(guesses, reverse=True):
        step = _refine(guess, gaps, values)
        steps = (values[:: max(1, values.size // _MOST_VALUES)] - values[0]) / step
        off_lattice = steps - np.round(steps)
        if steps.max() > _FEWEST_STEPS and float(np.sqrt(np.mean(off_lattice**2))) < _MOST_OFF_LATTICE:
            return step
    return None


def _refine(step: float, gaps: FloatArray, values: FloatArray) -> float:
    """Refine a step by counting steps over ever longer spans: the least-squares step of so many counts n.

    step = sum of span n over sum of n^2.
    """
    reach = _FIRST_REACH * step
    spans = gaps[gaps <= reach]
    while True:
        counts = np.round(spans / step)
        if counts.any():
            step = float(spans @ counts / (counts @ counts))
        if reach > _LAST_REACH * (values[-1] - values[0]):
            return step
        reach *= _REACH_GROWTH
        spans = values[: np.searchsorted(values, values[0] + reach, side="right")] - values[0]
        spans = spans[:: max(1, spans.size // _MOST_VALUES)]
