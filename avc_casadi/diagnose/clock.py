"""The clocks of a log: the steps of its time stamps, and the ticks at which its force is new."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray

_USUAL_STEP_QUANTILE = 0.1
"""Quantile of the steps of time that is a step without a missed tick."""

_USUAL_STEP_SCATTER = 0.3
"""Steps that differ from that quantile by less than this share count for the usual step."""

_BETWEEN_TICKS = (1.3, 1.7)
"""Steps, in periods, that are neither one tick nor two: only a clock that scatters has them."""

_TWO_TICKS = (1.7, 2.5)
"""Steps, in periods, that are of two ticks."""

_CLEAN_CLOCK_SHARE = 0.1
"""Steps between one tick and two, per step of two ticks, up to which the clock does not scatter."""

_FEWEST_FORCES = 4
"""Different forces below which a force is that of a relay and not held."""

_FEWEST_CHANGES = 12
"""Changes of the force below which a log does not tell whether it is held."""

_MOVES_PER_NEW_FORCE = 1.3
"""Changes of the position per change of the force up to which the force is not held."""

_LONGEST_HOLD = 8
"""Samples up to which a hold is always searched; beyond it, up to the median time between two changes."""

_ONE_PHASE_SHARE = 0.95
"""Share of events that have one phase where they come every so many ticks."""


def usual_step(steps: FloatArray) -> float:
    """Return the step of time from one row to the next where none is missed, s."""
    short = float(np.quantile(steps, _USUAL_STEP_QUANTILE))
    return float(np.mean(steps[np.abs(steps - short) < _USUAL_STEP_SCATTER * short]))


def ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the ticks from row to row: missing ones stand apart, a scattering clock has steps of 1.5 periods too."""

    def share_of(limits: tuple[float, float], period: float) -> float:
        low, high = limits
        return float(np.mean((steps > low * period) & (steps < high * period)))

    median = float(np.median(steps))
    for period in (usual, median):
        if share_of(_BETWEEN_TICKS, period) <= _CLEAN_CLOCK_SHARE * share_of(_TWO_TICKS, period):
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    missed_from = _TWO_TICKS[1]
    return np.where(steps < missed_from * median, 1, np.round(steps / median)).astype(np.intp)


def hold_of(position: FloatArray, force: FloatArray) -> tuple[int, int]:
    """Return the samples for which each force is held while the position changes (no relay), and the first new."""
    moves = np.diff(position) != 0
    changes = np.flatnonzero(np.diff(force) != 0) + 1
    if np.unique(force).size < _FEWEST_FORCES or changes.size < _FEWEST_CHANGES:
        return 1, 0
    if moves.sum() <= _MOVES_PER_NEW_FORCE * changes.size:
        return 1, 0
    longest = max(_LONGEST_HOLD, round(float(np.median(np.diff(changes)))))
    return even_phase(changes, longest) or (1, 0)


def even_phase(events: IndexArray, most: int) -> tuple[int, int] | None:
    """Return the ticks from one event to the next, where nearly all have one phase, and the phase.

    `events` are the ticks of the events; `most` is the longest time between two, ticks.
    """
    for ticks in range(most, 1, -1):
        phases = np.bincount(events % ticks, minlength=ticks)
        if phases.max() >= _ONE_PHASE_SHARE * events.size:
            return ticks, int(np.argmax(phases))
    return None
