"""A log on the grid of its ticks: which ran, which are missing, how late they came, how long a force is held."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.encoder import encoder_step_m
from avc_casadi.identification.record import Columns, Record

# A step of time beyond so many periods is a pause between two records, not a row of missed ticks.
_PAUSE = 40
# Forces that stay over so large a share of the ticks of one kind are held there on purpose.
_HELD = 0.95
_MOST_HELD = 8


@dataclass(frozen=True)
class Ticks:
    """What the time stamps say of the computer.

    Attributes:
        sample_time_s: usual time from tick to tick, as logged.
        missed_share: share of the ticks that did not run.
        longest_gap: most ticks missed in a row.
        jitter_rms_s: of the time stamps about their grid.
        held: logged samples that each force is held for; 2 where every other sample has a new one.
        repeats: whether ticks that did not run are rows of the log, with the force of the row before.
    """

    sample_time_s: float
    missed_share: float
    longest_gap: int
    jitter_rms_s: float
    held: int
    repeats: bool = False

    @property
    def period_s(self) -> float:
        """Time from one new force to the next."""
        return self.sample_time_s * self.held


@dataclass(frozen=True, eq=False)
class Log:
    """One record on an even grid of ticks.

    Attributes:
        name: of the file.
        ticks: what its time stamps say.
        position_m: measured, shape (n,); on a straight line across missed ticks.
        force_n: as commanded, positive against +x, held across missed ticks, shape (n,).
        ran: whether the tick is known to have run, shape (n,).
        seen: whether its position is in the log, shape (n,).
        telling: whether it tells that it ran or not, shape (n,).
        encoder_m: step of the lattice that the positions lie on, 0 where they lie on none.
        start_s: time of the first sample.
        reach_m: how far the hand moves for a unit of the position: 1, or the radius of the handle of what turns.
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

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick, shape (n,)."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.ticks.period_s)

    @property
    def pattern(self) -> BoolArray:
        """Which of the ticks that tell it ran, in their order."""
        return np.asarray(self.ran[self.telling])


def log_of(columns: Columns, *, flip_force: bool = False, reach_m: float = 1.0) -> tuple[Log, list[str]]:
    """Lay a log on its grid.

    Args:
        columns: the log, its force along +position.
        flip_force: whether its force counts against +position.
        reach_m: how far the hand moves for a unit of the position.

    Returns:
        The longest stretch without a pause, and what the user should know.
    """
    told = list(columns.told)
    steps = np.diff(columns.time_s)
    # Ticks may be missed half of the time: the shortest steps are those of one period.
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
    counts = np.maximum(np.round(np.diff(time) / usual), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(counts)])
    # Of a clock that drifts or is written with few digits, the mean step is the period.
    period = float((time[-1] - time[0]) / at[-1])
    ran = np.zeros(at[-1] + 1, dtype=bool)
    ran[at] = True
    last = np.maximum.accumulate(np.where(ran, np.arange(ran.size), 0))
    whole = np.zeros(ran.size)
    whole[at] = force
    ticks = Ticks(
        sample_time_s=period,
        missed_share=float(1 - ran.mean()),
        longest_gap=int(counts.max(initial=1)) - 1,
        jitter_rms_s=float(np.std(time - time[0] - at * period)),
        held=_held(position, force),
    )
    log = Log(
        name=columns.file,
        ticks=ticks,
        position_m=np.interp(np.arange(ran.size), at, position),
        force_n=np.asarray(whole[last]),
        ran=ran,
        seen=ran,
        telling=np.ones_like(ran),
        encoder_m=_encoder(columns.file, period, position, force),
        start_s=float(time[0]),
        reach_m=reach_m,
    )
    return _thinned(log), told


def _encoder(file: str, period: float, position: FloatArray, force: FloatArray) -> float:
    """Return the step of the lattice; of a few positions it is the smallest distance between two."""
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
    """Return for how many samples each force is held while the position changes."""
    moved = np.diff(position) != 0
    new = np.diff(force) != 0
    if np.count_nonzero(new & moved) < 20:
        return 1
    change = np.flatnonzero(new) + 1
    for held in range(_MOST_HELD, 1, -1):
        phase = np.bincount(change % held, minlength=held)
        # New forces come in one phase of the period only, and come there though the position moves in every one.
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
