"""Method `static-tuned`: the constant gains that a good engineer finds by trying them with many hands.

Gains are ranked by their error and must be linearly stable with every hand of the set; the first whose simulated hands
all come to rest, with dry friction and without, is taken. The search is then refined about it.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Gains, GainSchedule, Status, gain_schedule
from avc_casadi.loop import HandSet, hand_set, loop_at, relative_errors
from avc_casadi.scene import simulate_batch
from avc_casadi.stability import frozen_parts, linear_stability
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


# Gains are tried on a logarithmic scale down to this share of their largest value, and at their lower bound itself.
_DECADES = 6
_SHRINK = 0.35
# Impedances held at a time while errors are computed.
_NUMBERS_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class Budget:
    """What the tuning may spend.

    Attributes:
        series_points: gains tried for each of b and k.
        damped_points: gains tried for each of b, k and b_p.
        refinements: searches about the best gains, each in a smaller neighbourhood of 7 points a gain.
        scenes: candidates simulated in each search before it gives up, and in the first search as many again among
            the rest.
        hands: hands of the set: the corners of its ranges and draws.
        seed: seed of the draws.
    """

    series_points: int = 41
    damped_points: int = 19
    refinements: int = 3
    scenes: int = 16
    hands: int = 40
    seed: int = 0


@dataclass(frozen=True)
class StaticTuned:
    """Tuned constant gains.

    Attributes:
        gains: the gains; None where no candidate brought every hand to rest.
        error: root of the mean squared relative error over the problem's frequencies, by the problem's objective.
        tried: candidates judged by spectral radius.
        linear: candidates that are linearly stable with every hand.
        simulated: candidates simulated with every hand.
        hands: number of hands.
        seed: seed of the draws.
    """

    gains: Gains | None
    error: float
    tried: int
    linear: int
    simulated: int
    hands: int
    seed: int

    def sentence(self) -> str:
        """Say what was found at what expense."""
        spent = (
            f"{self.tried} candidates by spectral radius with {self.hands} hands (seed {self.seed}), "
            f"{self.linear} of them linearly stable, {self.simulated} simulated with all hands"
        )
        if self.gains is None:
            return f"no constant gains of the box bring every hand to rest: {spent}"
        found = self.gains
        contact = f", b_p = {found.contact_damping_ns_per_m:.6g} N.s/m" if found.contact_damping_ns_per_m else ""
        return (
            f"tuned constant gains: b = {found.damping_ns_per_m:.6g} N.s/m, k = {found.stiffness_n_per_m:.6g} N/m"
            f"{contact}, error {100 * self.error:.4g} %; {spent}"
        )


def tune_static(problem: Problem, budget: Budget | None = None) -> StaticTuned:
    """Tune constant gains for the problem's set of hands, in the problem's structure and gain box.

    Args:
        problem: the problem; its scene is what the hands do, its objective what counts as error.
        budget: what may be spent; None is the default.

    Raises:
        UnsupportedError: a scene whose hand is not the effect ``hand``.
    """
    return _Tuning(problem, budget or Budget()).run()


def solve_static_tuned(problem: Problem) -> GainSchedule:
    """Solve by tuned constant gains; every row has the same ones, and the notes say what they cost.

    Raises:
        UnsupportedError: a scene whose hand is not the effect ``hand``.
    """
    started = time.perf_counter()
    found = tune_static(problem)
    n = len(problem.frequencies_hz())
    if found.gains is None:
        empty, status = np.full(n, np.nan), (Status.INFEASIBLE,) * n
        gains, reason = (empty, empty, empty), (found.sentence(),) * n
    else:
        b, k, contact = (np.full(n, value) for value in vars(found.gains).values())
        gains, status, reason = (b, k, contact), (Status.SOLVED,) * n, ("",) * n
    return gain_schedule(
        problem,
        "static-tuned",
        gains,
        status,
        reason=reason,
        solve_seconds=time.perf_counter() - started,
        notes=(found.sentence(),),
    )


class _Tuning:
    """One search; points are shares of the logarithmic ranges of b, k and, in the damped structure, b_p."""

    def __init__(self, problem: Problem, budget: Budget) -> None:
        kinds = {effect.kind for effect in problem.scene.effects} or {"hand"}
        if "hand" not in kinds:
            raise UnsupportedError(
                f"{problem.name}: static-tuned tries the hands of [hands] in the scene, which needs the effect hand "
                f"there; listed: {', '.join(sorted(kinds))}"
            )
        self.problem, self.budget = problem, budget
        box = problem.coupling
        ends = [box.damping_ns_per_m, box.stiffness_n_per_m]
        if box.structure == "damped":
            ends.append(box.contact_damping_ns_per_m)
        self.low, self.high = np.array(ends, dtype=np.float64).T
        self.loop = loop_at(problem, problem.frequencies_hz())
        every = hand_set(problem.hands, draws=budget.hands, seed=budget.seed)
        count = min(budget.hands, len(every))
        self.hands = HandSet(
            every.mass_kg[:count], every.damping_ns_per_m[:count], every.stiffness_n_per_m[:count],
            min(every.corners, count), budget.seed,
        )  # fmt: skip
        self.tried = self.linear = self.simulated = 0

    def run(self) -> StaticTuned:
        """Search the whole box, then about what was found."""
        size = len(self.low)
        points = self.budget.series_points if size == 2 else self.budget.damped_points
        best, cost = self._search(_grid(np.linspace(0, 1, points), size), math.inf)
        reach = 1.0 / (points - 1)
        for _ in range(self.budget.refinements):
            if best is None:
                break
            near = np.clip(best + reach * _grid(np.linspace(-1, 1, 7), size), 0.0, 1.0)
            better, lower = self._search(near, cost)
            best, cost = (best, cost) if better is None else (better, lower)
            reach *= _SHRINK
        gains = None if best is None else Gains(*(float(value) for value in self._gains(best[None])[:, 0]))
        return StaticTuned(
            gains, math.sqrt(cost), self.tried, self.linear, self.simulated, len(self.hands), self.budget.seed
        )

    def _search(self, points: FloatArray, below: float) -> tuple[FloatArray | None, float]:
        """Return the best point with a cost below the given one that brings every hand to rest, or None."""
        gains = self._gains(points)
        cost = self._cost(gains)
        self.tried += len(points)
        promising = cost < below
        points, gains, cost = points[promising], gains[:, promising], cost[promising]
        b, k, contact = gains
        # The margin is a reserve: the hands must be held by a device robbed of that much damping, as in scope hands.
        reserve = -self.problem.stability.margin_ns_per_m
        stable = np.zeros(0, dtype=bool)
        if len(points):
            parts = frozen_parts(self.problem, b, k)
            stable = linear_stability(self.problem.device, parts, contact, self.hands, reserve).stable
        self.linear += int(np.count_nonzero(stable))
        order = np.flatnonzero(stable)[np.argsort(cost[stable], kind="stable")]
        for row in order[self._places(len(order), widely=math.isinf(below))]:
            if self._rests(Gains(*(float(gain) for gain in gains[:, row]))):
                return points[row], float(cost[row])
        return None, below

    def _places(self, candidates: int, *, widely: bool) -> NDArray[np.intp]:
        """Return which of the ranked candidates to simulate: the first ones, then ever farther apart."""
        first = np.arange(min(self.budget.scenes, candidates))
        if not widely or candidates <= self.budget.scenes:
            return first
        rest = np.geomspace(self.budget.scenes, candidates - 1, self.budget.scenes).round().astype(np.intp)
        return np.unique(np.concatenate([first, rest]))

    def _rests(self, gains: Gains) -> bool:
        self.simulated += 1
        return all(
            bool(simulate_batch(self.problem, self.hands, gains, friction=friction).stable.all())
            for friction in self._frictions
        )

    @property
    def _frictions(self) -> tuple[bool, ...]:
        """Without dry friction, and with it where the scene lists it."""
        listed = any(effect.kind == "coulomb-friction" for effect in self.problem.scene.effects)
        return (False, True) if listed else (False,)

    def _gains(self, points: FloatArray) -> FloatArray:
        """Return b, k and b_p of points, shape (3, m)."""
        scale = self.high * 10.0**-_DECADES
        ratio = (self.high + scale) / np.where(self.high > 0, self.low + scale, 1.0)
        values = (self.low + scale) * np.where(self.high > 0, ratio, 1.0) ** points - scale
        values = np.clip(np.where(points <= 0, self.low, np.where(points >= 1, self.high, values)), self.low, self.high)
        return np.concatenate([values.T, np.zeros((3 - values.shape[1], len(values)))])

    def _cost(self, gains: FloatArray) -> FloatArray:
        """Return the mean squared relative error of gains (3, m), shape (m,)."""
        realism, target = self.problem.realism, self.loop.target[None]
        at_once = max(1, _NUMBERS_AT_ONCE // target.size)
        parts = []
        for first in range(0, gains.shape[1], at_once):
            b, k, contact = (gain[first : first + at_once, None] for gain in gains)
            errors = relative_errors(self.loop.perceived(b, k, contact), target, realism.objective, realism.jnd)
            parts.append(np.mean(errors**2, axis=1))
        return np.concatenate(parts)


def _grid(values: FloatArray, size: int) -> FloatArray:
    return np.stack(np.meshgrid(*[values] * size, indexing="ij"), axis=-1).reshape(-1, size)
