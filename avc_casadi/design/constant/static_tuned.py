"""Method `static-tuned`: the best constant gains with which every hand of the set settles.

The joint programme finds the gains of least error that are linearly stable with every hand with the
damping of the device reduced by a reserve. All hands try them in the problem's scene, without dry friction and with
it; where some hand does not settle, the reserve is raised and the programme solved again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.schedule.scope import worst_slack
from avc_casadi.design.schedule.solver import solve_schedule
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.gains import Gains, gains_at
from avc_casadi.model.hands import hand_set
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import relative_errors
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.simulation.scene import simulate_batch

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


# Gains are tried on a logarithmic scale down to this share of their largest value, and at their lower bound itself.
_DECADES = 6
_POINTS = {2: 25, 3: 11}
_NEAR = 5
_REFINEMENTS = 4
_SHRINK = 0.4
# Impedances in memory at a time while errors are computed.
_NUMBERS_AT_ONCE = 1_000_000


def gains_on_grid(problem: Problem) -> Gains | None:
    """Return the constant gains with the least error among those of a grid that meet the problem's scope, or None."""
    box = problem.coupling
    ends = [box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]
    low, high = np.array(ends[: 3 if box.contact_damping_ns_per_m[1] > 0 else 2], dtype=np.float64).T
    size = len(low)
    points = _grid(np.linspace(0, 1, _POINTS[size]), size)
    reach, best, least = 1.0 / (_POINTS[size] - 1), None, np.inf
    for _ in range(1 + _REFINEMENTS):
        gains = _gains(points, low, high)
        met = worst_slack(problem, np.zeros(gains.shape[1]), (gains[0], gains[1], gains[2])).met
        if met.any():
            errors = np.where(met, rms_errors(problem, gains), np.inf)
            if errors.min() < least:
                best, least = points[errors.argmin()], float(errors.min())
        if best is None:
            return None
        points = np.clip(best + reach * _grid(np.linspace(-1, 1, _NEAR), size), 0.0, 1.0)
        reach *= _SHRINK
    return None if best is None else Gains(*(float(gain[0]) for gain in _gains(best[None], low, high)))


def rms_errors(problem: Problem, gains: FloatArray) -> FloatArray:
    """Return the rms relative error of constant gains (3, m) over the problem's frequencies, shape (m,)."""
    loop, realism = loop_at(problem, problem.frequencies_hz()), problem.realism
    target = np.asarray(loop.target)[None]
    at_once = max(1, _NUMBERS_AT_ONCE // target.size)
    parts = []
    for first in range(0, gains.shape[1], at_once):
        b, k, contact = (gain[first : first + at_once, None] for gain in gains)
        errors = relative_errors(loop.perceived(b, k, contact), target, realism.objective, realism.jnd)
        parts.append(np.sqrt(np.mean(errors**2, axis=1)))
    return np.concatenate(parts)


def _gains(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return b, k and b_p of points (m, d), which are shares of the logarithmic ranges, shape (3, m)."""
    scale = high * 10.0**-_DECADES
    ratio = (high + scale) / np.where(high > 0, low + scale, 1.0)
    values = (low + scale) * np.where(high > 0, ratio, 1.0) ** points - scale
    values = np.clip(np.where(points <= 0, low, np.where(points >= 1, high, values)), low, high)
    return np.concatenate([values.T, np.zeros((3 - values.shape[1], len(values)))])


def _grid(values: FloatArray, size: int) -> FloatArray:
    return np.stack(np.meshgrid(*[values] * size, indexing="ij"), axis=-1).reshape(-1, size)


# Default reserve as a share of k_e T/2, the damping that sampling takes from the wall. It ensures decay, not only the
# absence of growth: 6 N.s/m at the wall of figure 5, where with less some hand bounces for ever.
TUNED_MARGIN_SHARE = 0.12
_RAISE = 1.5
# The smallest margin that a problem can state.
_LEAST_NS_PER_M = 1e-9


@dataclass(frozen=True)
class Budget:
    """Effort of the tuning.

    Attributes:
        draws: hands in the scene beside the corners of their ranges.
        seed: seed of the draws.
        raises: how often the reserve may be raised.
    """

    draws: int = 32
    seed: int = 0
    raises: int = 8


@dataclass(frozen=True)
class StaticTuned:
    """Tuned constant gains.

    Attributes:
        gains: the gains; None where none are found with which every hand settles.
        error: root of the mean squared relative error over the problem's frequencies, by the problem's objective;
            infinite without gains.
        reserve_ns_per_m: reduction of the device's damping with which every hand had to be linearly stable.
        raised: how often it was raised.
        rested: hands that settled in the last trial of the last gains.
        hands: hands of that trial.
        seed: seed of their draws.
        reason: why there are no gains; empty where there are.
    """

    gains: Gains | None
    error: float
    reserve_ns_per_m: float
    raised: int
    rested: int
    hands: int
    seed: int
    reason: str = ""

    def sentence(self) -> str:
        """Return a line on the result and its trial."""
        if self.gains is None:
            return self.reason
        b, k, b_p = vars(self.gains).values()
        contact = f", b_p = {b_p:.6g}" if b_p else ""
        raised = f", raised {self.raised} times" if self.raised else ""
        return (
            f"tuned constant gains: b = {b:.6g}, k = {k:.6g}{contact}, error "
            f"{100 * self.error:.4g} %; linearly stable with every hand with {self.reserve_ns_per_m:.4g} of "
            f"damping in reserve{raised}; {self.hands} hands (seed {self.seed}) at rest in the scene"
        )


def tuned_margin(problem: Problem) -> float:
    """Return the default damping reserve of tuned gains, N.s/m."""
    reserve = TUNED_MARGIN_SHARE * problem.environment.stiffness_n_per_m * problem.device.sample_time_s / 2
    return reserve if reserve >= _LEAST_NS_PER_M else 0.0


def tune_static(problem: Problem, budget: Budget | None = None, progress: Progress = SILENT) -> StaticTuned:
    """Tune constant gains for the problem's set of hands, in the problem's structure, gain box and frequencies.

    Args:
        problem: the problem; its scene defines the motion, its objective the error.
        budget: effort; None is the default.
        progress: reports the reserves tried.

    Raises:
        UnsupportedError: a scene whose hand is not the effect ``hand``.
    """
    _check_hand(problem)
    budget = budget or Budget()
    hands = hand_set(problem.hands, draws=budget.draws, seed=budget.seed)
    reserve = problem.stability.margin_ns_per_m or tuned_margin(problem)
    rested = raised = 0
    for raised in range(1 + budget.raises):
        progress.advance(raised, 1 + budget.raises, f"{reserve:.4g} in reserve")
        # Realism applies to tables: the best constant gains may be unrealistic at some row.
        stated = problem.changed(stability={"scope": "hands", "margin_ns_per_m": reserve}, realism={"require": "none"})
        table = solve_schedule(stated, constant=True)
        gains = gains_at(table) if table.usable.all() else gains_on_grid(stated)
        if gains is None:
            why = table.reason[0] if not raised else f"{_unsettled(rested, len(hands))}, and with more none are found"
            return StaticTuned(None, np.inf, reserve, raised, rested, len(hands), budget.seed, why)
        rest = np.ones(len(hands), dtype=bool)
        for friction in _frictions(problem):
            # The trial without friction costs least and comes first; where it fails the next is skipped.
            if rest.all():
                rest = simulate_batch(problem, hands, gains, friction=friction).stable
        rested = int(np.count_nonzero(rest))
        if rested == len(hands):
            error = float(rms_errors(stated, np.array([[value] for value in vars(gains).values()]))[0])
            return StaticTuned(gains, error, reserve, raised, rested, len(hands), budget.seed)
        reserve *= _RAISE
    why = _unsettled(rested, len(hands))
    return StaticTuned(None, np.inf, reserve / _RAISE, raised, rested, len(hands), budget.seed, why)


def solve_static_tuned(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by tuned constant gains; the same at every row; the notes report their trial.

    Args:
        problem: the problem.
        progress: reports the reserves tried.

    Raises:
        UnsupportedError: a scene whose hand is not the effect ``hand``.
    """
    started = time.perf_counter()
    found = tune_static(problem, progress=progress)
    n = len(problem.frequencies_hz())
    values = (np.nan,) * 3 if found.gains is None else tuple(vars(found.gains).values())
    b, k, contact = (np.full(n, value) for value in values)
    return gain_schedule(
        problem,
        "static-tuned",
        (b, k, contact),
        (Status.INFEASIBLE if found.gains is None else Status.SOLVED,) * n,
        reason=(found.reason,) * n,
        solve_seconds=time.perf_counter() - started,
        notes=(found.sentence(),),
    )


def _unsettled(rested: int, hands: int) -> str:
    return (
        f"no constant gains of the box make every hand settle in the scene: {rested} of {hands} with the last; "
        "narrow [hands], widen the box of [coupling], add device damping or soften the wall"
    )


def _frictions(problem: Problem) -> tuple[bool, ...]:
    """Return the friction settings: without dry friction, and with it where the scene has it."""
    listed = any(effect.kind == "coulomb-friction" for effect in scene_effects(problem))
    return (False, True) if listed else (False,)


def _check_hand(problem: Problem) -> None:
    kinds = {effect.kind for effect in scene_effects(problem)}
    if "hand" not in kinds:
        raise UnsupportedError(
            f"{problem.name}: static-tuned tries the hands of [hands] in the scene, which needs the effect hand "
            f"there; listed: {', '.join(sorted(kinds))}"
        )
