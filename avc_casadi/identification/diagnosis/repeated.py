"""Ticks that did not run and are rows of the log all the same: the force stays where the law would have changed it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.diagnosis.law import Law, find_law
from avc_casadi.identification.diagnosis.log import Log

# A law of fewer samples is none to judge others by, nor one that leaves hardly less than that of all of them.
_SAMPLES, _BETTER = 25, 0.3
# A change that an output hides is half a step of it: 1.7 times what it leaves, root mean square.
_LEFT, _STEPS = 4.0, 1.5
# Steps of an output to the largest force, of which fewer are too coarse to tell.
_LEVELS = 20
# What is less, as a share of the largest force, are digits.
_DIGITS = 1e-6
# Fewer ticks, or a smaller share of those that tell, are left as they are; more than that are no loop that misses some.
_FEWEST, _SELDOM, _MOST = 10, 0.02, 0.9


def without_repeats(log: Log, limit_n: float | None) -> Log:
    """Return a log whose ticks that only repeat a force are marked as not run.

    A force also stays outside the wall, at a limit, within a step of a coarse output and where the position stays: the
    law, fitted to the ticks with a new force, tells where it would not have stayed.

    Args:
        log: on its grid.
        limit_n: force limit of the device, None where none was declared.
    """
    force = log.force_n
    same = np.diff(force, prepend=np.nan) == 0
    if np.count_nonzero(same & (force != 0)) < _FEWEST:
        return log
    size, step = float(np.abs(force).max()), _output_step_n(force)
    law = find_law(replace(log, ran=log.ran & ~same), limit_n)
    if law is None or not _judges(law, find_law(log, limit_n)) or _LEVELS * step > size:
        return log
    least = max(_LEFT * law.misfit * float(np.std(force[force != 0])), _STEPS * step, _DIGITS * size)
    between = (force != 0) & (force > force.min()) & (force < force.max())
    if limit_n is not None:
        between &= np.abs(force) < limit_n
    telling = np.append(False, between[:-1]) & log.ran & (_change(log, law, same) > least)
    missed = telling & same
    share = float(np.mean(missed[telling])) if telling.any() else 0.0
    if np.count_nonzero(missed) < _FEWEST or not _SELDOM < share < _MOST:
        return log
    ticks = replace(
        log.ticks,
        missed_share=1 - (1 - log.ticks.missed_share) * (1 - share),
        longest_gap=max(log.ticks.longest_gap, _longest(missed)),
        repeats=True,
    )
    # Where the force stays for another reason too, nothing tells whether the position before was used.
    return replace(log, ticks=ticks, ran=log.ran & ~same, telling=telling | ~log.seen)


def _judges(law: Law, every: Law | None) -> bool:
    """Whether a law is that of a wall, of enough samples, and leaves less than the one that every tick tells."""
    better = every is None or not every.told or law.misfit < _BETTER * every.misfit
    return better and law.told and law.samples >= _SAMPLES and min(law.stiffness_n_per_m, law.damping_ns_per_m) >= 0


def _output_step_n(force: FloatArray) -> float:
    """Return the smallest distance between two forces that is more than digits."""
    apart = np.diff(np.unique(force))
    return float(np.min(apart[apart > _DIGITS * np.abs(force).max()], initial=np.inf))


def _change(log: Log, law: Law, same: BoolArray) -> FloatArray:
    """Return by how much the law changes the force in each tick, at least.

    The speed may be that since the tick before or since the last one that ran.
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
