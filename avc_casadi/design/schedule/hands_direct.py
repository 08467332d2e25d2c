"""`direct` with scope hands: the gains stable with every hand are the same at all frequencies, and are searched once.

Each frequency takes the best of them, improves it from several starts, and shares its result with the others. Interior
hands that are unstable with a result are added and its frequencies searched again, until there are none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.schedule.hands import HandsRadii, admissible_states
from avc_casadi.design.schedule.polish import Evaluate, polished
from avc_casadi.design.schedule.scope import realism_slack, worst_slack
from avc_casadi.design.schedule.states import States
from avc_casadi.model.problem import Problem
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.rows import GainArrays

_TIE = 1e-3
"""Share of the squared complex error that breaks ties, before the magnitude alone is minimised from there."""
_EQUAL = 1e-7
"""Magnitude errors closer than this, relative to |Z_h_ds|, are equal: the smaller distance wins."""
_APART = 1.5
"""Least distance of starts, in spacings of the lattice."""
_SPACINGS = {2: 40, 3: 15}
_ROWS_AT_ONCE = 64
_UNREAL = 1e2
_JUDGED = 60
"""Number of points judged between a start and a rejected end."""
_GAINED = 1e-7
_CUTS, _RESERVE = 4, 1.2
"""Rounds in which interior hands are added, and the last reserve as a share of the violation."""


def hands_optima(problem: Problem, states: States, frequency_hz: FloatArray, progress: Progress = SILENT) -> GainArrays:
    """Minimise (11) at each frequency over the gains stable with every hand, and realistic where required.

    Args:
        problem: the problem.
        states: map from states to gains.
        frequency_hz: the frequencies, (n,).
        progress: reports the steps.

    Returns:
        (b, k, b_p), each (n,); not a number where none were found.
    """
    goal, radii = _Goal(problem, states, frequency_hz), HandsRadii(problem, states)
    progress.advance(0, 4, "gains that hold every hand")
    pool = admissible_states(radii)
    if not pool.shape[1]:
        nothing = np.full(len(frequency_hz), np.nan)
        return nothing, nothing.copy(), nothing.copy()
    best, first = _search(radii, goal, pool, progress)
    for cut in range(_CUTS):
        worst = worst_slack(problem, frequency_hz, states.gains(best))
        again = np.flatnonzero(~worst.met)
        if not again.size or worst.hands is None:
            break
        # Each cut leaves about a quarter of the violation; the last ones remove it with a reserve.
        reserve = _RESERVE * float(-worst.slack.min()) if cut >= _CUTS - 2 else 0.0
        radii = radii.with_hands(worst.hands.pick(again), worst.slack[again], reserve)
        pool = radii.kept_by_the_latest(np.concatenate((pool, best[:, worst.met]), axis=1))
        if not pool.shape[1]:
            break
        found = _search(radii, replace(goal, frequency_hz=frequency_hz[again]), pool, progress)
        best[:, again], first[:, again] = found
    best, met = _judged(problem, states, frequency_hz, best, first, goal)
    progress.advance(4, 4, "exact check")
    b, k, contact = (np.where(met, gain, np.nan) for gain in states.gains(best))
    return b, k, contact


def _search(radii: HandsRadii, goal: _Goal, pool: FloatArray, progress: Progress) -> tuple[FloatArray, FloatArray]:
    """Return the best states of each frequency and their starts from a pool of admissible ones, (d, n) each."""
    n, rows = len(goal.frequency_hz), np.arange(len(goal.frequency_hz))
    spacing = (radii.high - radii.low) / (_SPACINGS[len(pool)] - 1)
    spacing = np.where(spacing > 0, spacing, 1.0)
    progress.advance(1, 4, "best gains of each frequency")
    first, second, near = _starts(pool, goal, spacing, n)
    # Where the goal's magnitude is attainable many gains have it: those nearest in phase are sought first.
    second[:, near] = polished(radii, second[:, near], near, replace(goal, tie=_TIE), spacing)
    found = polished(radii, np.concatenate((first, second), axis=1), np.tile(rows, 2), goal, spacing)
    best = goal.better(found[:, :n], found[:, n:], rows)
    progress.advance(2, 4, "gains of other frequencies")
    offered = _on_faces(radii, _best_shared(best, goal), goal)
    own, others = (goal.value(points[:, :, None], rows)[:, 0] for points in (best, offered))
    gaining = np.flatnonzero(others < own - _GAINED)
    if gaining.size:
        best[:, gaining] = polished(radii, offered[:, gaining], gaining, goal, spacing / 4)
    progress.advance(3, 4, "exact check")
    return best, first


@dataclass(frozen=True)
class _Goal:
    """Magnitude error, of |Z_h_ds|, with a share of the squared complex one; far above it where realism is violated.

    Attributes:
        problem: the problem.
        states: map from states to gains.
        frequency_hz: the stages, (n,).
        tie: the share.
    """

    problem: Problem
    states: States
    frequency_hz: FloatArray
    tie: float = 0.0

    def errors(self, points: FloatArray, stage: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the signed magnitude error and the complex error, relative to |Z_h_ds|, (m, s) each.

        Args:
            points: states, (d, m, s), or (d, 1, s) for all stages.
            stage: positions in ``frequency_hz``, (m,).
        """
        loop = loop_at(self.problem, self.frequency_hz[stage][:, None])
        gains = self.states.gains(points)
        z, target = loop.perceived(*gains), np.asarray(loop.target)
        radius = np.abs(target)
        error, distance = np.abs(z) / radius - 1, np.abs(z - target) / radius
        if self.problem.realism.require != "none":
            slack = realism_slack(self.problem, loop, gains)
            error = np.where(slack < 0, np.copysign(np.abs(error) + _UNREAL * (1 - slack), error), error)
        return error, distance

    def value(self, points: FloatArray, stage: IndexArray) -> FloatArray:
        """Return the objective, (m, s)."""
        error, distance = self.errors(points, stage)
        return np.asarray(np.sqrt(error**2 + self.tie * distance**2) if self.tie else np.abs(error))

    def window(self, centre: FloatArray, half: FloatArray, stage: IndexArray) -> tuple[Evaluate, Evaluate]:
        """Return the objective and the signed magnitude error at points of windows."""

        def value(at: FloatArray) -> FloatArray:
            return self.value(centre[:, :, None] + half[:, :, None] * at, stage)

        def error(at: FloatArray) -> FloatArray:
            return self.errors(centre[:, :, None] + half[:, :, None] * at, stage)[0]

        return value, error

    def better(self, one: FloatArray, other: FloatArray, stage: IndexArray) -> FloatArray:
        """Return for each stage the states of smaller magnitude error or, if equal, of smaller distance, (d, m)."""
        first, second = (self.errors(points[:, :, None], stage) for points in (one, other))
        gain = np.abs(first[0]) - np.abs(second[0])
        closer = (np.abs(gain) <= _EQUAL) & (second[1] < first[1])
        return np.where(((gain > _EQUAL) | closer)[:, 0], other, one)


def _starts(pool: FloatArray, goal: _Goal, spacing: FloatArray, n: int) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Return two starts for each stage from the pool, (d, n) each, and the stages of attainable goal magnitude.

    The best states, and the best at some distance from those; where some states stay below the goal's magnitude and
    others exceed it, those of least magnitude and complex error together.
    """
    first, second = (np.empty(n, dtype=np.intp) for _ in range(2))
    reached = np.zeros(n, dtype=bool)
    scaled = pool / spacing[:, None]
    for begin in range(0, n, _ROWS_AT_ONCE):
        rows = np.arange(begin, min(begin + _ROWS_AT_ONCE, n))
        error, distance = goal.errors(pool[:, None], rows)
        value = np.abs(error)
        first[rows] = value.argmin(axis=1)
        away = np.abs(scaled[:, None] - scaled[:, first[rows]][:, :, None]).max(axis=0) > _APART
        reached[rows] = (error.min(axis=1) <= 0) & (error.max(axis=1) >= 0)
        apart = np.where(away, value, np.inf)
        second[rows] = np.where(reached[rows][:, None], value + distance, apart).argmin(axis=1)
    return pool[:, first], pool[:, second], np.flatnonzero(reached)


def _best_shared(best: FloatArray, goal: _Goal) -> FloatArray:
    """Return for each stage the best of all stages' results, (d, n)."""
    n = best.shape[1]
    chosen = [
        goal.value(best[:, None], np.arange(first, min(first + _ROWS_AT_ONCE, n))).argmin(axis=1)
        for first in range(0, n, _ROWS_AT_ONCE)
    ]
    return best[:, np.concatenate(chosen)]


def _on_faces(radii: HandsRadii, best: FloatArray, goal: _Goal) -> FloatArray:
    """Return for each stage the states projected onto a face of the box, where admissible and better, (d, n).

    Along a nearly flat border the polish converges slowly and stops short of the face.
    """
    best, rows = best.copy(), np.arange(best.shape[1])
    least = goal.value(best[:, :, None], rows)[:, 0]
    for axis in range(len(best)):
        for end in (radii.low[axis], radii.high[axis]):
            moved = best.copy()
            moved[axis] = end
            value = goal.value(moved[:, :, None], rows)[:, 0]
            better = np.flatnonzero(value < least - _GAINED)
            better = better[radii.largest(moved[:, better]) <= radii.most] if better.size else better
            best[:, better], least[better] = moved[:, better], value[better]
    return best


def _judged(
    problem: Problem, states: States, frequency_hz: FloatArray, best: FloatArray, start: FloatArray, goal: _Goal
) -> tuple[FloatArray, BoolArray]:
    """Return states (d, n) that pass the exact check of scope and realism, and whether there are any, (n,).

    Where a result is rejected, the points on the way back to the start are judged.
    """
    met = _met(problem, states, frequency_hz, best)
    for row in np.flatnonzero(~met):
        way = best[:, [row]] + np.linspace(0, 1, _JUDGED) * (start[:, [row]] - best[:, [row]])
        fits = np.flatnonzero(_met(problem, states, np.full(_JUDGED, frequency_hz[row]), way))
        if fits.size:
            value = goal.value(way[:, None, fits], np.array([row]))[0]
            best[:, row], met[row] = way[:, fits[value.argmin()]], True
    return best, met


def _met(problem: Problem, states: States, frequency_hz: FloatArray, at: FloatArray) -> BoolArray:
    gains = states.gains(at)
    real = realism_slack(problem, loop_at(problem, frequency_hz), gains) >= 0
    return np.asarray(worst_slack(problem, frequency_hz, gains).met & real)
