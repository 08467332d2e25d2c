"""A log on its tick grid: which ticks ran, which are missing, their jitter, the hold time of a force."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.encoder import encoder_step_m
from avc_casadi.identification.record import Columns, Record

# A longer step, in periods, is a pause between two records, not a row of missed ticks.
_PAUSE = 40
# Between steps of one period and of two there are hardly any where ticks are missing; in periods.
_VALLEY, _TWICE, _FILLED = (1.3, 1.7), (1.7, 2.5), 0.1
# Forces that stay over so large a share of the ticks of one kind are held on purpose.
_HELD = 0.95
_MOST_HELD = 8


@dataclass(frozen=True)
class Ticks:
    """Timing of the loop by its time stamps.

    Attributes:
        sample_time_s: usual time from tick to tick, as logged.
        missed_share: share of the ticks that did not run.
        longest_gap: most ticks missed in a row.
        jitter_rms_s: of the time stamps about their grid, or of the times between them where that is less.
        held: logged samples for which each force is held; 2 where every other sample has a new one.
        repeats: whether ticks that did not run are rows of the log, with the force of the row before.
        uneven_share: scatter of the time from tick to tick as a share of it, where they keep to no even grid.
    """

    sample_time_s: float
    missed_share: float
    longest_gap: int
    jitter_rms_s: float
    held: int
    repeats: bool = False
    uneven_share: float = 0.0

    @property
    def period_s(self) -> float:
        """Time from one new force to the next."""
        return self.sample_time_s * self.held


@dataclass(frozen=True, eq=False)
class Log:
    """One record on an even grid of ticks.

    Attributes:
        name: of the file.
        ticks: timing by its time stamps.
        position_m: measured, shape (n,); linear across missed ticks.
        force_n: as commanded, positive against +x, held across missed ticks, shape (n,).
        ran: whether the tick is known to have run, shape (n,).
        seen: whether its position is in the log, shape (n,).
        telling: whether it shows if it ran, shape (n,).
        encoder_m: lattice step of the positions, 0 without one.
        start_s: time of the first sample.
        reach_m: travel of the hand per unit of position: 1, or the handle radius of a rotary device.
        outside_n: constant force outside contact, as of a weight that is compensated.
    """

    name: str
    ticks: Ticks
    position_m: FloatArray
    force_n: FloatArray
    ran: BoolArray
    seen: BoolArray
    telling: BoolArray
    encoder_m: float
    start_s: float
    reach_m: float = 1.0
    outside_n: float = 0.0

    @property
    def touching(self) -> BoolArray:
        """Whether each tick is in contact, by its force, shape (n,)."""
        return np.asarray(np.abs(self.force_n - self.outside_n) > 1e-9 * float(np.abs(self.force_n).max(initial=0.0)))

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick, shape (n,)."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.ticks.period_s)

    @property
    def pattern(self) -> BoolArray:
        """Whether each informative tick ran, in order."""
        return np.asarray(self.ran[self.telling])


def log_of(columns: Columns, *, flip_force: bool = False, reach_m: float = 1.0) -> tuple[Log, list[str]]:
    """Put a log on its tick grid.

    Args:
        columns: the log, its force along +position.
        flip_force: whether its force counts against +position.
        reach_m: travel of the hand per unit of position.

    Returns:
        The longest stretch without a pause, and notes for the user.
    """
    told = list(columns.told)
    steps = np.diff(columns.time_s)
    # Up to half of the ticks may be missed: the shortest steps are those of one period.
    short = float(np.quantile(steps, 0.1))
    usual = float(np.mean(steps[np.abs(steps - short) < 0.3 * short]))
    pauses = np.flatnonzero(steps > _PAUSE * usual)
    edges = np.concatenate([[0], pauses + 1, [columns.time_s.size]])
    longest = int(np.argmax(np.diff(edges)))
    part = slice(int(edges[longest]), int(edges[longest + 1]))
    if pauses.size:
        told.append(f"{pauses.size} pauses in the log; its longest stretch is taken, {np.diff(edges)[longest]} samples")
    time, position = columns.time_s[part], columns.position_m[part]
    force = columns.force_n[part] * (1.0 if flip_force else -1.0)
    counts = _ticks_between(np.diff(time), usual)
    at = np.concatenate([[0], np.cumsum(counts)])
    # With a clock that drifts or has few digits, the mean step is the period.
    period = float((time[-1] - time[0]) / at[-1])
    ran = np.zeros(at[-1] + 1, dtype=bool)
    ran[at] = True
    last = np.maximum.accumulate(np.where(ran, np.arange(ran.size), 0))
    whole = np.zeros(ran.size)
    whole[at] = force
    # Stamps scatter about a grid, or each about the one before.
    about, apart = float(np.std(time - time[0] - at * period)), float(np.std(np.diff(time) - counts * period))
    ticks = Ticks(
        sample_time_s=period,
        missed_share=float(1 - ran.mean()),
        longest_gap=int(counts.max(initial=1)) - 1,
        jitter_rms_s=min(about, apart),
        uneven_share=apart / period if apart < about else 0.0,
        held=_held(position, force),
    )
    # What the law read at a row that was filled in is not known, nor is it one that did not run.
    telling = np.ones_like(ran)
    if columns.filled is not None:
        telling[at] = ~columns.filled[part]
    log = Log(
        name=columns.file,
        ticks=ticks,
        position_m=np.interp(np.arange(ran.size), at, position),
        force_n=np.asarray(whole[last]),
        ran=ran & telling,
        seen=ran & telling,
        telling=telling,
        encoder_m=_encoder(columns.file, period, position, force),
        start_s=float(time[0]),
        reach_m=reach_m,
    )
    return _thinned(log), told


def _ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the ticks from each row to the next, more than one where ticks are missing.

    Those stand apart: a scattering clock has many more steps of one and a half periods than of two.

    Args:
        steps: from row to row, seconds.
        usual: the shorter ones.
    """
    for period in (usual, float(np.median(steps))):
        between, twice = (np.mean((steps > low * period) & (steps < high * period)) for low, high in (_VALLEY, _TWICE))
        if between <= _FILLED * twice:
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    return np.where(steps < _TWICE[1] * period, 1, np.round(steps / period)).astype(np.intp)


def _encoder(file: str, period: float, position: FloatArray, force: FloatArray) -> float:
    """Return the step of the lattice; with few positions, the smallest distance between two."""
    values = np.unique(position)
    if values.size < 2:
        return 0.0
    step = encoder_step_m([Record(file, period, position, force)])
    if step is None and values.size < 12:
        apart = np.diff(values)
        apart = apart[apart > 1e-6 * np.ptp(values)]
        step = float(apart.min())
    return step or 0.0


def _held(position: FloatArray, force: FloatArray) -> int:
    """Return the number of samples for which each force is held while the position changes."""
    moved = np.diff(position) != 0
    new = np.diff(force) != 0
    if np.count_nonzero(new & moved) < 20:
        return 1
    change = np.flatnonzero(new) + 1
    # A divisor of the hold has one phase too: the usual distance is looked at first.
    for held in range(max(_MOST_HELD, round(float(np.median(np.diff(change))))), 1, -1):
        phase = np.bincount(change % held, minlength=held)
        # New forces come in one phase of the period only, although the position moves in every one.
        if phase.max() >= _HELD * phase.sum() and np.count_nonzero(moved) > 1.3 * np.count_nonzero(new):
            return held
    return 1


def _thinned(log: Log) -> Log:
    """Keep the ticks at which new forces are computed."""
    held = log.ticks.held
    if held == 1:
        return log
    change = np.flatnonzero(np.diff(log.force_n) != 0) + 1
    first = int(np.argmax(np.bincount(change % held, minlength=held)))
    keep = slice(first, None, held)
    return replace(
        log,
        position_m=log.position_m[keep],
        force_n=log.force_n[keep],
        ran=log.ran[keep],
        seen=log.seen[keep],
        telling=log.telling[keep],
        start_s=log.start_s + first * log.ticks.sample_time_s,
    )
