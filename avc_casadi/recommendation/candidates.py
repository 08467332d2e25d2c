"""Candidate couplings of `recommend`: springs and dampers, laws of the convex program, tuned gains."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling
from avc_casadi.design.program import ProgramAnswer, program_answers, why_no_law
from avc_casadi.design.tuned import tune, tuned_margin
from avc_casadi.loops.walls import DampingRange, damping_range, softest_wall_n_per_m
from avc_casadi.model.gains import Gains, near_rigid_n_per_m, spring_before
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.rank import FELT_ERROR, impedance_error

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.evaluator import Evaluator

# Contact damper as a share of the interval of stable dampings.
_SHARES = (0.5, 0.25, 0.1, 0.03, 0.01)
_MANY_SHARES = (0.5, 0.35, 0.25, 0.12, 0.05)
# Rendered stiffness where the wall itself does not hold, as shares of what spring and damper hold linearly.
_SOFTER = (0.9, 0.75, 0.6, 0.45, 0.33, 0.24, 0.15)
# The same of laws, as shares of the wall; and the rise of stiffness in the search for the stiffest.
_SOFTER_LAWS, _RISE = (0.6, 0.36, 0.22), 1.5
_MOST_RISES = 6
# Impedance error above which a softer spring may be nearer.
_POOR = 0.5
# Steps of the goals of further laws: factors on disk margin, noise gain and distance of the dead zone's loop from 0.
_STEPS = ((1.0, 0.6, 1.0), (1.0, 1.0, 1.3), (1.25, 0.6, 1.0), (1.0, 0.6, 1.3), (1.25, 0.6, 1.0), (1.25, 0.6, 1.3))


def judge_all(problem: Problem, evaluator: Evaluator, limit: DampingRange, progress: Progress = SILENT) -> None:
    """Judge candidates for the wall, the plainest first; softer ones only where none holds it."""
    wall, plainly = problem.environment.stiffness_n_per_m, limit.stiffness_n_per_m
    if wall <= plainly:
        plain = list(springs_and_dampers(problem))
        for one in plain:
            evaluator(one)
        if not evaluator.quiet():
            evaluator.first_complete(behind_observer(plain))
    if evaluator.least_error() > FELT_ERROR:
        judge_laws(problem, evaluator, wall)
    if evaluator.least_error() > _POOR:
        for share in _SOFTER:
            springs = list(softened(problem, share * min(wall, plainly)))
            if evaluator.first_complete((*springs, *behind_observer(springs))):
                break
    for share in _SOFTER_LAWS:
        if not evaluator.holds() and share * wall > plainly:
            judge_laws(problem, evaluator, share * wall)
    if not evaluator.holds():
        evaluator.first_complete(tuned_gains(problem, progress))


def judge_stiffest(problem: Problem, evaluator: Evaluator, limit: DampingRange) -> None:
    """Judge softer and softer springs until one holds, then laws for stiffer and stiffer walls until none does."""
    for share in _SOFTER:
        springs = list(softened(problem, share * limit.stiffness_n_per_m))
        if evaluator.first_complete((*springs, *behind_observer(springs))):
            break
    softest = softest_wall_n_per_m(problem.device)
    stiffness_n_per_m = max(limit.stiffness_n_per_m, evaluator.stiffest_n_per_m(), softest)
    for _ in range(_MOST_RISES):
        if not judge_laws(problem, evaluator, stiffness_n_per_m):
            return
        stiffness_n_per_m *= _RISE


def springs_and_dampers(problem: Problem) -> Iterator[Coupling]:
    """Yield the wall itself without a coupling, then rigid couplings with a contact damper."""
    wall, rigid = problem.environment, near_rigid_n_per_m(problem.device)
    yield Coupling.constant(problem, Gains(0.0, rigid), "none")
    for total in _dampings(problem, wall.stiffness_n_per_m, _SHARES):
        gains = Gains(0.0, rigid, max(0.0, total - wall.damping_ns_per_m))
        yield Coupling.constant(problem, gains, "contact damper")


def softened(problem: Problem, felt_n_per_m: float) -> Iterator[Coupling]:
    """Yield springs with a damper that render a wall at a stiffness, the nearest in motion first."""
    if not 0 < felt_n_per_m < problem.environment.stiffness_n_per_m:
        return
    spring, dampings = spring_before(problem, felt_n_per_m), _dampings(problem, felt_n_per_m, _MANY_SHARES)
    alike = [Coupling.constant(problem, Gains(0.0, spring, total), "softened wall") for total in dampings]
    yield from sorted(alike, key=impedance_error)


def judge_laws(problem: Problem, evaluator: Evaluator, felt_n_per_m: float) -> bool:
    """Judge laws for a wall at a stiffness, for stricter and stricter goals; return whether one is complete.

    Stricter goals cost error: they end where the least of theirs is above that of a complete law.
    """
    least = math.inf
    for answers in laws(problem, felt_n_per_m):
        nearer = sorted((one for one in answers if one.judged.error < least), key=lambda one: one.judged.error)
        if not nearer:
            break
        least = next((one.judged.error for one in nearer if evaluator.first_complete([one.coupling])), least)
    return least < math.inf


def laws(problem: Problem, felt_n_per_m: float) -> Iterator[list[ProgramAnswer]]:
    """Yield what the program finds for a wall at a stiffness, of each guess, then for stricter and stricter goals."""
    # Slopes of detents are not analysed behind an observer.
    if problem.detent is not None or why_no_law(problem):
        return
    answers = program_answers(problem, stiffness_n_per_m=felt_n_per_m)
    yield answers
    for step in _STEPS:
        answers = [one.moved(*step) for one in answers]
        yield answers


def tuned_gains(problem: Problem, progress: Progress = SILENT) -> Iterator[Coupling]:
    """Yield constant gains tuned for every hand and the released device, with growing reserves."""
    safe = problem.changed(hands={"let_go": True})
    for share in (1.0, 3.0):
        try:
            found = tune(safe, share * tuned_margin(safe), progress)
        except UnsupportedError:
            return
        if found is not None:
            one = Coupling.constant(problem, found, "static-tuned")
            yield from (one, *behind_observer([one]))


def behind_observer(couplings: Iterable[Coupling]) -> Iterator[Coupling]:
    """Yield couplings behind an observer of the quantised position; none with an ideal encoder."""
    for one in couplings:
        if one.problem.device.encoder_resolution_m > 0:
            runtime = Runtime(observer_mass_kg=one.problem.device.mass_kg + one.problem.hands.mass_kg[0])
            yield Coupling.constant(one.problem, one.table.at_rest, one.method, runtime)


def _dampings(problem: Problem, stiffness_n_per_m: float, shares: tuple[float, ...]) -> list[float]:
    people = with_released(hand_corners(problem.hands))
    found = damping_range(problem.device, people, stiffness_n_per_m)
    if np.isnan(found.lowest_ns_per_m):
        return []
    return [found.lowest_ns_per_m + share * (found.highest_ns_per_m - found.lowest_ns_per_m) for share in shares]
