"""Method `static-tuned`: the best constant gains with which every hand of the set comes to rest.

The joint programme finds the gains of least error that are linearly stable with every hand while the device is robbed
of a reserve of damping. They are tried in the problem's scene by all hands, without dry friction and with it; where
somebody does not come to rest, the reserve is raised and the programme solved again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Gains, GainSchedule, Status, gain_schedule, gains_at
from avc_casadi.design.constant._tuning_grid import gains_on_grid, rms_errors
from avc_casadi.design.joint import ScheduleSolver
from avc_casadi.loop import hand_set
from avc_casadi.problem import scene_effects
from avc_casadi.scene import simulate_batch
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

# Reserve where the problem states none, as a share of k_e T/2, the damping that sampling takes from the wall. It leaves
# decay, not only the absence of growth: 6 N.s/m at the wall of figure 5, where with less somebody bounces for ever.
TUNED_MARGIN_SHARE = 0.12
_RAISE = 1.5
# The smallest margin that a problem can state.
_LEAST_NS_PER_M = 1e-9


@dataclass(frozen=True)
class Budget:
    """What the tuning may spend.

    Attributes:
        draws: hands tried in the scene beside the corners of their ranges.
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
        gains: the gains; None where none are found with which every hand comes to rest.
        error: root of the mean squared relative error over the problem's frequencies, by the problem's objective;
            infinite without gains.
        reserve_ns_per_m: damping of which the device was robbed while every hand had to be linearly stable.
        raised: how often it was raised.
        rested: hands that came to rest in the scene in the last trial of the last gains.
        hands: hands that were tried in the scene.
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
        """Say what was found and how it was tried."""
        if self.gains is None:
            return self.reason
        b, k, b_p = vars(self.gains).values()
        contact = f", b_p = {b_p:.6g} N.s/m" if b_p else ""
        raised = f", raised {self.raised} times" if self.raised else ""
        return (
            f"tuned constant gains: b = {b:.6g} N.s/m, k = {k:.6g} N/m{contact}, error {100 * self.error:.4g} %; "
            f"linearly stable with every hand with {self.reserve_ns_per_m:.4g} N.s/m of damping in reserve{raised}; "
            f"{self.hands} hands (seed {self.seed}) at rest in the scene"
        )


def tuned_margin(problem: Problem) -> float:
    """Damping that tuned gains keep in reserve where the problem states no margin, N.s/m."""
    reserve = TUNED_MARGIN_SHARE * problem.environment.stiffness_n_per_m * problem.device.sample_time_s / 2
    return reserve if reserve >= _LEAST_NS_PER_M else 0.0


def tune_static(problem: Problem, budget: Budget | None = None, progress: Progress = SILENT) -> StaticTuned:
    """Tune constant gains for the problem's set of hands, in the problem's structure, gain box and frequencies.

    Args:
        problem: the problem; its scene is what the hands do, its objective what counts as error.
        budget: what may be spent; None is the default.
        progress: told of the reserves that are tried.

    Raises:
        UnsupportedError: a scene whose hand is not the effect ``hand``.
    """
    _check_hand(problem)
    budget = budget or Budget()
    hands = hand_set(problem.hands, draws=budget.draws, seed=budget.seed)
    solver, reserve = ScheduleSolver(constant=True), problem.stability.margin_ns_per_m or tuned_margin(problem)
    rested = raised = 0
    for raised in range(1 + budget.raises):
        progress.advance(raised, 1 + budget.raises, f"{reserve:.4g} N.s/m in reserve")
        # Realism is for the tables: a row may be unreal where the constant gains are the best that there are.
        stated = problem.changed(stability={"scope": "hands", "margin_ns_per_m": reserve}, realism={"require": "none"})
        table = solver.solve(stated)
        gains = gains_at(table) if table.usable.all() else gains_on_grid(stated)
        if gains is None:
            why = table.reason[0] if not raised else f"{_restless(rested, len(hands))}, and with more none are found"
            return StaticTuned(None, np.inf, reserve, raised, rested, len(hands), budget.seed, why)
        rest = np.ones(len(hands), dtype=bool)
        for friction in _frictions(problem):
            # The trial without friction, which costs least, comes first; where somebody fails the next is spared.
            if rest.all():
                rest = simulate_batch(problem, hands, gains, friction=friction).stable
        rested = int(np.count_nonzero(rest))
        if rested == len(hands):
            error = float(rms_errors(stated, np.array([[value] for value in vars(gains).values()]))[0])
            return StaticTuned(gains, error, reserve, raised, rested, len(hands), budget.seed)
        reserve *= _RAISE
    why = _restless(rested, len(hands))
    return StaticTuned(None, np.inf, reserve / _RAISE, raised, rested, len(hands), budget.seed, why)


def solve_static_tuned(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by tuned constant gains; every row has the same ones, and the notes say how they were tried.

    Args:
        problem: the problem.
        progress: told of the reserves that are tried.

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


def _restless(rested: int, hands: int) -> str:
    return (
        f"no constant gains of the box bring every hand to rest in the scene: {rested} of {hands} with the last; "
        "narrow [hands], widen the box of [coupling], add device damping or soften the wall"
    )


def _frictions(problem: Problem) -> tuple[bool, ...]:
    """Without dry friction, and with it where the scene has it."""
    listed = any(effect.kind == "coulomb-friction" for effect in scene_effects(problem))
    return (False, True) if listed else (False,)


def _check_hand(problem: Problem) -> None:
    kinds = {effect.kind for effect in scene_effects(problem)}
    if "hand" not in kinds:
        raise UnsupportedError(
            f"{problem.name}: static-tuned tries the hands of [hands] in the scene, which needs the effect hand "
            f"there; listed: {', '.join(sorted(kinds))}"
        )
