"""Identification of the control law from position to force, and of ticks without computation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.closed_loop import regression
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.loops.wall import Rendering

_MOST_LAG = 8
_FEWEST = 25
# Fewer samples identify a law with no larger residual, where they are different and twice as many as its parameters: a
# force that is 0 or saturated most of the time has few samples in between, each exact.
_EXACT, _TWICE = 1e-3, 2
# Residual share of the force up to which a law is identified.
TOLD = 0.05
# A filter, or a longer lag, is accepted only with a residual so much smaller.
_BETTER = 0.3


@dataclass(frozen=True)
class Law:
    """F(n) = k x(n-lag) + b v(n-lag) + offset; v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T.

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
        keep: share of the old velocity, 0 without a filter.
        lag: samples from a position to the force that was computed from it, in the log.
        wall_m: rest position of the spring.
        misfit: root mean square residual of the force in contact, as a share.
        samples: samples in contact that identify it.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    lag: int
    wall_m: float
    misfit: float
    samples: int

    @property
    def told(self) -> bool:
        """Whether the force is identified as that of a spring and a damper."""
        return self.misfit < TOLD

    def filter_hz(self, sample_time_s: float) -> float | None:
        """Return the cut-off of the velocity filter, or None without one below the Nyquist frequency."""
        return None if self.keep <= math.exp(-math.pi) else -math.log(self.keep) / (2 * math.pi * sample_time_s)

    def rendering(
        self,
        sample_time_s: float,
        stiffness: FloatArray | float = 1.0,
        damping: FloatArray | float = 1.0,
    ) -> Rendering:
        """Return the law as the loop takes it, its gains scaled by factors of shape (n,)."""
        k, b = np.broadcast_arrays(
            np.atleast_1d(np.asarray(stiffness, dtype=np.float64)) * self.stiffness_n_per_m,
            np.atleast_1d(np.asarray(damping, dtype=np.float64)) * self.damping_ns_per_m,
        )
        rate = b * (1 - self.keep) / sample_time_s
        force = np.stack([k + rate, -(k * self.keep + rate), np.full_like(k, self.keep)], axis=-1)
        return Rendering(force, force)


def find_law(log: Log, limit_n: float | None) -> Law | None:
    """Fit the law to the samples in contact.

    Args:
        log: on its tick grid.
        limit_n: force limit of the device, at which forces saturate.

    Returns:
        The law, identified or not; None without enough samples in contact.
    """
    force, position = log.force_n, log.position_m
    size = float(np.abs(force).max())
    if size == 0:
        return None
    limit = size if limit_n is None else min(size, limit_n)
    touching = log.touching
    # Besides the largest force, possibly a limit, the last sample before saturation is left in. Where the position
    # toggles between two steps, the largest force belongs to one of them.
    top = np.abs(force) >= 0.9999 * limit
    cut = np.zeros_like(top)
    if limit == limit_n or np.ptp(position[top]) > 1.5 * log.encoder_m:
        cut = top
        touching &= ~top
    best: Law | None = None
    for lag in range(_MOST_LAG + 1):
        for filtered in (False, True):
            rows = _rows(log.ran, touching, lag, filtered=filtered)
            found = _fit(position, force, rows, lag, filtered=filtered, period=log.ticks.period_s)
            if found is not None and cut.any():
                found = _also_cut(found, log, _rows(log.ran, cut, lag, filtered=False), limit)
            if found is not None and (best is None or found.misfit < _BETTER * best.misfit):
                best = found
    return best


def _also_cut(law: Law, log: Log, rows: IndexArray, limit_n: float) -> Law:
    """Include the residuals of saturated forces, which the law has to reach; not of one with a filter."""
    if law.filter_hz(log.ticks.period_s) is not None or not rows.size:
        return law
    position = log.position_m
    speed = (position[rows - law.lag] - position[rows - law.lag - 1]) / log.ticks.period_s
    told = law.stiffness_n_per_m * (position[rows - law.lag] - law.wall_m) + law.damping_ns_per_m * speed
    left = np.clip(told, -limit_n, limit_n) - log.force_n[rows]
    return replace(law, misfit=max(law.misfit, float(np.sqrt(np.mean(left**2))) / limit_n))


def _rows(ran: BoolArray, touching: BoolArray, lag: int, *, filtered: bool) -> IndexArray:
    """Return the ticks in contact whose lagged samples are in the log; a filter needs the force before in contact."""
    use = ran & touching
    use[: lag + 2] = False
    for back in {lag, lag + 1} - {0}:
        use[back:] &= ran[:-back]
    if filtered:
        use[1:] &= (ran & touching)[:-1]
    return np.flatnonzero(use)


def _fit(
    position: FloatArray, force: FloatArray, rows: IndexArray, lag: int, *, filtered: bool, period: float
) -> Law | None:
    if not rows.size:
        return None
    middle = float(position[rows].mean())
    columns = [position[rows - lag] - middle, position[rows - lag] - position[rows - lag - 1], np.ones(rows.size)]
    if filtered:
        columns.append(force[rows - 1])
    matrix = np.stack(columns, axis=1)
    different = len(np.unique(matrix, axis=0)) if rows.size < _FEWEST else rows.size
    if different < _TWICE * len(columns):
        return None
    values, left, rank = regression(matrix, force[rows])
    changes = float(np.std(force[rows]))
    if rank < len(columns) or changes == 0:
        return None
    keep = float(values[3]) if filtered else 0.0
    if not 0 <= keep < 0.98:
        return None
    left /= changes
    if rows.size < _FEWEST and left > _EXACT:
        return None
    k = float(values[0]) / (1 - keep)
    # F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before)
    b = (float(values[1]) - k * keep) * period / (1 - keep)
    wall = middle - float(values[2]) / (1 - keep) / k if k else math.nan
    return Law(k, b, keep, lag, wall, max(left, 1e-12), int(rows.size))


# So many samples have one force that is none; positions without contact lie so surely on one side of those in contact.
_FEWEST_OUTSIDE, _ON_ONE_SIDE = 25, 0.95


def with_outside_force(log: Log, limit_n: float | None) -> Log:
    """Return a log with the constant force that stands outside contact, as of a weight that is compensated.

    It is the commonest force, on one side of all others, without which those tell a law.

    Args:
        log: on its tick grid.
        limit_n: force limit of the device, None where none was declared.
    """
    forces, counts = np.unique(log.force_n, return_counts=True)
    outside_n = float(forces[np.argmax(counts)])
    out = log.force_n == outside_n
    most = float(np.abs(log.force_n).max())
    if not outside_n or abs(outside_n) > 0.999 * min(most, limit_n or math.inf) or counts.max() < _FEWEST_OUTSIDE:
        return log
    free, touched = np.sort(log.position_m[out]), log.position_m[~out]
    # Of all pairs, the share in which contact is at the larger position (Mann and Whitney).
    above = float(np.mean(np.searchsorted(free, touched))) / free.size
    if max(above, 1 - above) < _ON_ONE_SIDE:
        return log
    other = replace(log, outside_n=outside_n)
    law, without = find_law(other, limit_n), find_law(log, limit_n)
    better = law is not None and law.told and (without is None or law.misfit < _BETTER * without.misfit)
    return other if better else log


# Least share of the changes of a force that come of its integral term.
_INTEGRATES = 0.02


@dataclass(frozen=True)
class IntegralTerm:
    """F = k x + b dx/dt + i sum(x) T + a constant.

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
        integral_n_per_ms: i.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    integral_n_per_ms: float

    def takes_ns_per_m(self, frequency_hz: float) -> float:
        """Return the damping that the integral term takes at a frequency: i / omega^2, a quarter turn late."""
        return self.integral_n_per_ms / (2 * math.pi * frequency_hz) ** 2


def find_integral(log: Log, law: Law | None, limit_n: float | None) -> IntegralTerm | None:
    """Return the integral term of a force that is no exact law of spring and damper, or None.

    The changes of the force from tick to tick are fitted, so that neither where the integral begins nor what becomes of
    it at the force limit matters.

    Args:
        log: on its tick grid.
        law: its spring and damper.
        limit_n: force limit of the device, None where none was declared.
    """
    size = np.abs(log.force_n)
    if law is None or law.misfit < _EXACT:
        return None
    whole = log.ran & log.touching & (size < 0.9999 * min(float(size.max()), limit_n or math.inf))
    rows = np.flatnonzero(whole[2:] & whole[1:-1] & log.ran[:-2]) + 2
    if rows.size < _FEWEST:
        return None
    position, period = log.position_m, log.ticks.period_s
    moved = np.diff(position, prepend=position[0])
    plain = np.stack([moved[rows], moved[rows] - moved[rows - 1], np.ones(rows.size)], axis=1)
    changes = log.force_n[rows] - log.force_n[rows - 1]
    here = position[rows] - position[rows].mean()
    without = regression(plain, changes)[1]
    (k, rate, _, integral), left, rank = regression(np.column_stack([plain, here]), changes)
    share = abs(integral) * float(np.std(here)) / (float(np.std(changes)) or math.inf)
    if rank < 4 or left > min(TOLD * float(np.std(changes)), _BETTER * without) or share < _INTEGRATES:
        return None
    return IntegralTerm(float(k), float(rate) * period, float(integral) / period)


# A law of fewer samples does not judge others, nor one with hardly a smaller residual than that of all of them.
_SAMPLES, _BETTER_REPEATED = 25, 0.3
# The output hides changes below half its step: 1.7 times its residual, root mean square.
_LEFT, _STEPS = 4.0, 1.5
# Steps of the output within the largest force; fewer are too coarse.
_LEVELS = 20
# Smaller values, as a share of the largest force, are rounding.
_DIGITS = 1e-6
# Fewer ticks, or a smaller share of the informative ones, are left as they are, as is a share above the last one, which
# is no loop that misses ticks.
_FEWEST_REPEATED, _SELDOM, _MOST = 10, 0.02, 0.9


def without_repeats(log: Log, limit_n: float | None) -> Log:
    """Mark the ticks of a log that only repeat a force as not run.

    A force also stays outside the wall, at saturation, within a step of a coarse output and where the position stays:
    the law, fitted to the ticks with a new force, predicts where it would have changed.

    Args:
        log: on its tick grid.
        limit_n: force limit of the device, None where none was declared.
    """
    force = log.force_n
    same = np.diff(force, prepend=np.nan) == 0
    if np.count_nonzero(same & log.touching) < _FEWEST_REPEATED:
        return log
    size, step = float(np.abs(force).max()), output_step_n(force)
    law = find_law(replace(log, ran=log.ran & ~same), limit_n)
    if law is None or not _judges(law, find_law(log, limit_n)) or _LEVELS * step > size:
        return log
    least = max(_LEFT * law.misfit * float(np.std(force[log.touching])), _STEPS * step, _DIGITS * size)
    between = log.touching & (force > force.min()) & (force < force.max())
    if limit_n is not None:
        between &= np.abs(force) < limit_n
    telling = np.append(False, between[:-1]) & log.ran & (_change(log, law, same) > least)
    missed = telling & same
    share = float(np.mean(missed[telling])) if telling.any() else 0.0
    if np.count_nonzero(missed) < _FEWEST_REPEATED or not _SELDOM < share < _MOST:
        return log
    ticks = replace(
        log.ticks,
        missed_share=1 - (1 - log.ticks.missed_share) * (1 - share),
        longest_gap=max(log.ticks.longest_gap, _longest(missed)),
        repeats=True,
    )
    # Where the force stays for another reason, it is unknown whether the position before was used.
    return replace(log, ticks=ticks, ran=log.ran & ~same, telling=telling | (log.telling & ~log.seen))


def _judges(law: Law, every: Law | None) -> bool:
    """Return whether a law is that of a wall, of enough samples, with a smaller residual than that of all ticks."""
    better = every is None or not every.told or law.misfit < _BETTER_REPEATED * every.misfit
    return better and law.told and law.samples >= _SAMPLES and min(law.stiffness_n_per_m, law.damping_ns_per_m) >= 0


def output_step_n(force: FloatArray) -> float:
    """Return the smallest distance between two forces above rounding."""
    apart = np.diff(np.unique(force))
    return float(np.min(apart[apart > _DIGITS * np.abs(force).max()], initial=np.inf))


def _change(log: Log, law: Law, same: BoolArray) -> FloatArray:
    """Return the least change of the force by the law in each tick.

    The speed may be taken since the tick before or since the last one that ran.
    """
    position, force, stiffness, damping = log.position_m, log.force_n, law.stiffness_n_per_m, law.damping_ns_per_m
    tick = np.arange(force.size)
    ran_last = np.append(0, np.maximum.accumulate(np.where(same, 0, tick))[:-1])
    here, before, last = (position[np.maximum(at - law.lag, 0)] for at in (tick, tick - 1, ran_last))
    held = np.append(force[0], force[:-1])
    kept = law.keep * (held - stiffness * (last - law.wall_m)) if law.keep else np.zeros(force.size)
    told = [
        stiffness * (here - law.wall_m) + kept + damping * (1 - law.keep) * (here - past) / log.ticks.period_s
        for past in (before, last)
    ]
    changes = [np.abs(np.clip(one, force.min(), force.max()) - held) for one in told]
    return np.asarray(np.minimum(*changes))


def _longest(missed: BoolArray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missed.astype(int), [0]])))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
