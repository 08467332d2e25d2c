"""Refinement of a law by an evolution strategy: laws nearer to the wanted wall about one that is found."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.robust.cma_continuation import MOST_LAWS, POPULATION, Step, laws_of_all, settling
from avc_casadi.design.robust.goal import costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops, softened
from avc_casadi.loops.wall import stiffness_at_rest

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.design.robust.cma_continuation import ResidualSpeed, ResidualSpeedAt
    from avc_casadi.loops.wall import Rendering
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.problem import Problem

# Generations of a refinement, and the spread of its laws, in logarithms: initial, its factor after a generation without
# a nearer law, and that at which the refinement ends.
_REFINED, _NEAR, _NARROWER, _NEAREST = 20, 0.2, 0.85, 0.02
# The same below the wanted stiffness, and every how many of these are drawn for another wall; spread of its logarithm;
# stiffnesses that differ by less are equal.
_REFINED_FREE, _EVERY, _OTHER_WALL, _AS_STIFF = 30, 3, 0.08, 0.01


def refined(
    problem: Problem,
    step: Step,
    residual_speed_at: ResidualSpeedAt | None = None,
    *,
    wanted_n_per_m: float = 0.0,
) -> Step:
    """Return a step with laws of smaller distance from the wall, where an evolution strategy finds any.

    It draws laws about the best one so far, nearer after a failure (after Rechenberg 1973): close to the limit of what
    hands settle with, only near laws do too. Below the wanted stiffness every third generation is drawn for another
    one, as the nearest law in motion is seldom the stiffest.

    Args:
        problem: device with its ranges, hands and wall.
        step: a wall and laws that stabilise it.
        residual_speed_at: as for `continuation`.
        wanted_n_per_m: static stiffness below which that of the step may be changed.
    """
    draw = np.random.default_rng(0)
    free = step.stiffness_n_per_m < (1 - _AS_STIFF) * wanted_n_per_m
    search = _Refinement(problem, step, residual_speed_at)
    spread, done = _NEAR, 0
    while spread > _NEAREST and done < (_REFINED_FREE if free else _REFINED):
        done += 1
        other = free and done % _EVERY == 0
        ratio = math.exp(_OTHER_WALL * draw.standard_normal()) if other else 1.0
        wall = min(search.step.stiffness_n_per_m * ratio, max(wanted_n_per_m, step.stiffness_n_per_m))
        away = spread * draw.standard_normal((POPULATION, len(step.best.logarithms)))
        if other:
            away[0] = 0.0
        if not search.improved(wall, away) and not other:
            spread *= _NARROWER
    return search.step


class _Refinement:
    """The best laws so far of a refinement.

    Attributes:
        step: their wall and laws, by increasing distance.
    """

    def __init__(self, problem: Problem, step: Step, residual_speed_at: ResidualSpeedAt | None) -> None:
        self._problem, self._residual_speed_at = problem, residual_speed_at
        self._space, self._loops = Space(problem.device, problem.hands), Loops.of(problem)
        best = sorted(step.candidates, key=lambda one: one.cost.distance)
        self.step = replace(step, candidates=tuple(best[:MOST_LAWS]))
        self._tried = self._before(step.stiffness_n_per_m)

    def improved(self, stiffness_n_per_m: float, away: FloatArray) -> bool:
        """Try laws for a wall; return whether one is nearer than the best so far.

        Args:
            stiffness_n_per_m: static, of the wall.
            away: logarithms of the parameters relative to those of the best law, shape (laws, parameters).
        """
        if stiffness_n_per_m != self._tried.stiffness_n_per_m:
            self._tried = self._before(stiffness_n_per_m)
        space, wall, before = self._space, self._tried, self.step.best
        points = np.clip(before.logarithms + away, *space.bounds)
        laws = space.laws(points, stiffness_at_rest(wall.rendering))
        costs = costs_of(laws, wall.rendering, wall.hardest)
        nearer = [row for row, cost in enumerate(costs) if cost.holds and cost.distance < before.cost.distance]
        settled = settling(space, laws, nearer, wall.residual_speed)
        found = []
        for one in laws_of_all(space, self._loops, wall.rendering, list(points[settled])):
            if one.cost.holds:
                found.append(one)
            else:
                hardest = wall.hardest.and_of(self._loops.hardest(one.law, wall.rendering))
                self._tried = wall = replace(wall, hardest=hardest)
        found = [one for one in found if one.cost.distance < before.cost.distance]
        if not found:
            return False
        same = stiffness_n_per_m == self.step.stiffness_n_per_m
        best = sorted([*found, *(self.step.candidates if same else ())], key=lambda one: one.cost.distance)
        self.step = Step(wall.gains, stiffness_n_per_m, tuple(best[:MOST_LAWS]))
        return True

    def _before(self, stiffness_n_per_m: float) -> _Wall:
        """Return a wall with what judges laws before it."""
        gains, rendering = softened(self._problem, stiffness_n_per_m)
        law = self._space.law(self.step.best.logarithms, stiffness_at_rest(rendering))
        residual_speed = None if self._residual_speed_at is None else self._residual_speed_at(gains, law)
        return _Wall(stiffness_n_per_m, gains, rendering, self._loops.hardest(law, rendering), residual_speed)


@dataclass(frozen=True)
class _Wall:
    """A wall with its critical loops, and the simulation of hands."""

    stiffness_n_per_m: float
    gains: Gains
    rendering: Rendering
    hardest: Loops
    residual_speed: ResidualSpeed | None
