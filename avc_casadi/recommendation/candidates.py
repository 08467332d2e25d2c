"""Candidate couplings of `recommend`: springs and dampers, observer laws, tuned gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi._util.text import quantity
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import WIDTHS, with_dead_zone
from avc_casadi.design.program import DISK_MARGIN, ProgramAnswer, program_answers, why_no_law
from avc_casadi.design.tuned import tune, tuned_margin
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import DampingRange, damping_range, softest_wall_n_per_m
from avc_casadi.model.gains import Gains, near_rigid_n_per_m, spring_before
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_casadi.recommendation.evaluator import Evaluator, unstable_when_perturbed
from avc_casadi.recommendation.preconditions import why_infeasible
from avc_casadi.recommendation.rank import NOTICED_ERROR, UNNOTICED, error_in_motion, impedance_error
from avc_casadi.recommendation.reasons import NotNear, NoWallRendered, Reason, StifferWall

# Rendered stiffness where the wall itself does not hold, as shares of what spring and damper hold linearly.
_SOFTER = (0.9, 0.75, 0.6, 0.45, 0.33, 0.24, 0.15)
# Shares of the wall that laws render where none renders the wall itself.
_SOFTER_LAWS = (0.6, 0.36, 0.22, 0.13)
# Distance from the wall beyond which something softer may be nearer.
_FAR = 0.5
# Factors on disk margin, noise gain and distance of the dead zone's loop from 0. Each step multiplies the goals of the
# step before.
_STRICTER = (
    (1.0, 0.8, 1.0),
    (1.0, 0.75, 1.0),
    (1.0, 1.0, 1.3),
    (1.25, 0.6, 1.0),
    (1.0, 0.6, 1.3),
    (1.25, 0.6, 1.0),
    (1.25, 0.6, 1.3),
)
# Step of the search for the stiffest wall, and the last one: 1 % of the linear limit.
_STIFFER = 1.2
_USUAL_WALLS = 8
"""Walls that are tried for the stiffest one, on most devices."""
_SOFTEST = -26


def judge_all(problem: Problem, evaluator: Evaluator, limit: DampingRange, progress: Progress = SILENT) -> None:
    """Judge candidates for the wall, the plainest first: springs and dampers, observer laws, softer walls, tuned gains.

    `limit` is the stiffest wall that a spring and damper renders. Each kind is tried only where those before leave the
    motion off the wall's, or settle with no hand.
    """
    wall, plainly = problem.environment.stiffness_n_per_m, limit.stiffness_n_per_m
    if wall <= plainly:
        plain = list(springs_and_dampers(problem))
        for coupling in plain:
            evaluator(coupling)
        if not any(bool(candidate.trial.quiet.all()) for candidate in evaluator.complete()):
            evaluator.first_complete(behind_observer(plain))
    judge_laws(problem, evaluator, wall, evaluator.least_distance() - NOTICED_ERROR)
    if evaluator.least_distance() > _FAR:
        judge_softer_walls(problem, evaluator, plainly)
    if not evaluator.complete():
        evaluator.first_complete(tuned_gains(problem, progress))


def judge_softer_walls(problem: Problem, evaluator: Evaluator, plainly_n_per_m: float) -> None:
    """Judge laws that render a share of the wall, where none renders it whole, then springs with a damper.

    `plainly_n_per_m` is the stiffness that springs and dampers hold linearly; only laws of more than that are tried.
    """
    wall = problem.environment.stiffness_n_per_m
    for share in _SOFTER_LAWS:
        has_law = any(candidate.coupling.runtime.state_feedback is not None for candidate in evaluator.complete())
        if has_law or share * wall <= plainly_n_per_m:
            break
        judge_laws(problem, evaluator, share * wall)
    for share in _SOFTER:
        springs = list(softened(problem, share * min(wall, plainly_n_per_m)))
        if evaluator.first_complete((*springs, *behind_observer(springs))):
            break


def stiffest_rendered(
    problem: Problem, limit: DampingRange, evaluator_of: Callable[[Problem], Evaluator], progress: Progress = SILENT
) -> tuple[Problem, Evaluator, Reason]:
    """Return the problem with the stiffest wall, to a fifth, that a complete coupling renders, its couplings, and why.

    Walls differ by a factor of 1.2. The reason is the flaw of the next stiffer wall. `limit` is the stiffest wall of a
    spring and damper, `evaluator_of` makes the judge of a problem.
    """
    about = limit.stiffness_n_per_m or 1e3 * softest_wall_n_per_m(problem.device)
    stages = Stages(progress, _USUAL_WALLS)

    @cache
    def evaluation(step: int) -> tuple[Problem, Evaluator, Reason | None]:
        wall = {"stiffness_n_per_m": float(f"{about * _STIFFER**step:.3g}"), "damping_ns_per_m": 0.0}
        walled = problem.changed(environment=wall, detent=None)
        stages.begin(f"walls, {quantity(wall['stiffness_n_per_m'], problem.units.unit('N/m'))}")
        evaluator = evaluator_of(walled)
        infeasible = why_infeasible(walled)
        if infeasible is None:
            for coupling in springs_and_dampers(walled):
                evaluator(coupling)
            if not evaluator.complete():
                judge_laws(walled, evaluator, walled.environment.stiffness_n_per_m, UNNOTICED)
        best = evaluator.best()
        return walled, evaluator, (infeasible or NotNear(UNNOTICED)) if best is None else evaluator.flaw(best)

    step = 10
    while not evaluation(step)[2]:
        step += 2
    # From above: below the stiffest there may be walls without a law that holds.
    while evaluation(step)[2] and step > _SOFTEST:
        step -= 2
    step += not evaluation(step + 1)[2]
    walled, evaluator, flaw = evaluation(step)
    if flaw is not None:
        evaluator.candidates = []
        return walled, evaluator, NoWallRendered(flaw)
    stiffer, tried, flaw = evaluation(step + 1)
    assert flaw is not None  # noqa: S101 - else the search above would have gone on
    return walled, evaluator, StifferWall(stiffer.environment.stiffness_n_per_m, bool(tried.candidates), flaw)


def springs_and_dampers(problem: Problem) -> Iterator[Coupling]:
    """Yield the wall itself without a coupling, then rigid couplings with a contact damper b_p, the largest first."""
    wall, rigid = problem.environment, near_rigid_n_per_m(problem.device)
    yield Coupling.constant(problem, Gains(0.0, rigid), "none")

    def contact_damper(total_ns_per_m: float) -> Coupling:
        gains = Gains(0.0, rigid, max(0.0, total_ns_per_m - wall.damping_ns_per_m))
        return Coupling.constant(problem, gains, "contact damper")

    yield from _dampers(problem, wall.stiffness_n_per_m, contact_damper)


def softened(problem: Problem, rendered_n_per_m: float) -> Iterator[Coupling]:
    """Yield springs with a damper before the wall that render a stiffness, N/m, the nearest in motion first."""
    if not 0 < rendered_n_per_m < problem.environment.stiffness_n_per_m:
        return
    spring = spring_before(problem, rendered_n_per_m)
    alike = _dampers(
        problem, rendered_n_per_m, lambda total: Coupling.constant(problem, Gains(0.0, spring, total), "softened wall")
    )
    yield from sorted(alike, key=impedance_error)


def judge_laws(problem: Problem, evaluator: Evaluator, rendered_n_per_m: float, error_below: float = math.inf) -> None:
    """Judge laws at a stiffness, each with ever wider dead zones; for stricter goals until a complete one is calm.

    A calm law does not throw a hand off faster than it came. A law that is complete and not calm is kept, and laws for
    stricter goals are tried. Laws with at least the impedance error `error_below` are not tried.
    """
    for answers in laws(problem, rendered_n_per_m) if error_below > 0 else ():
        nearer = [answer for answer in answers if answer.performance.error < error_below]
        if not nearer:
            break
        calm = False
        for answer in sorted(nearer, key=lambda answer: answer.performance.error):
            error = answer.performance.error
            candidate = evaluator.first_complete(with_widths(answer.coupling)) if error < error_below else None
            if candidate is not None:
                calm = calm or candidate.rebound_excess <= 0
                # Another law is nearer only if it has less error than this one and its prices on settling leave it.
                error_below = min(error_below, error + candidate.distance - candidate.error)
                error_below = 0.0 if candidate.distance < 2 * NOTICED_ERROR else error_below
        if calm:
            break


def laws(problem: Problem, rendered_n_per_m: float) -> Iterator[list[ProgramAnswer]]:
    """Yield what the optimisation finds for a wall at a stiffness, of each guess: first for the usual goals.

    Then those that withstand perturbed devices, which costs accuracy where a resonance is lightly damped: dry friction
    often holds the others there. Then those for stricter and stricter goals.
    """
    # Slopes of detents are not analysed behind an observer.
    if problem.detent is not None or why_no_law(problem):
        return
    # Starts for the usual margin too: who asks for less gets nothing worse.
    asked = problem.robustness.disk_margin or DISK_MARGIN
    goals = {asked, max(asked, DISK_MARGIN)}
    answers = [
        answer for goal in goals for answer in program_answers(problem, goal, stiffness_n_per_m=rendered_n_per_m)
    ]
    yield answers
    stable_when_perturbed = [answer.stable_when_perturbed() for answer in answers]
    changed = [new for new, old in zip(stable_when_perturbed, answers, strict=True) if new is not old]
    if changed:
        yield changed
    # Without friction a loop that is unstable on a device a tenth off does not rest there.
    stricter = answers if problem.device.coulomb_friction_n > 0 else stable_when_perturbed
    for step in _STRICTER:
        stricter = [new for answer in stricter if (new := answer.with_goals(*step)).performance.stable]
        yield stricter


def with_widths(coupling: Coupling) -> Iterator[Coupling]:
    """Yield a law with the narrowest dead zone, then wider ones, until a hand in motion would notice the width.

    A law without encoder steps has none. Where the narrowest is not deployable the wider ones are not tried.
    """
    law = coupling.runtime.state_feedback
    if law is None or law.dead_zone_m == 0:  # a device without encoder steps
        yield coupling
        return
    narrow, *wider = (_with_width(coupling, law, steps) for steps in WIDTHS)
    yield narrow
    if not deployable(narrow).passed or unstable_when_perturbed(narrow):  # nor is it better with any other width
        return
    noticed = error_in_motion(narrow) + NOTICED_ERROR
    for wide in wider:
        if not error_in_motion(wide) <= noticed:
            return
        yield wide


def _with_width(coupling: Coupling, law: StateFeedback, steps: float) -> Coupling:
    """Return the coupling with another half width of its law's dead zone, in encoder steps."""
    runtime = Runtime(state_feedback=with_dead_zone(law, coupling.problem.device, steps))
    return Coupling.constant(coupling.problem, coupling.table.at_rest, coupling.method, runtime)


def tuned_gains(problem: Problem, progress: Progress = SILENT) -> Iterator[Coupling]:
    """Yield constant gains tuned for every hand and the released device, with growing reserves."""
    safe = problem.changed(hands={"let_go": True})
    for share in (1.0, 3.0):
        try:
            gains = tune(safe, share * tuned_margin(safe), progress)
        except UnsupportedError:
            return
        if gains is not None:
            coupling = Coupling.constant(problem, gains, "static-tuned")
            yield from (coupling, *behind_observer([coupling]))


def behind_observer(couplings: Iterable[Coupling]) -> Iterator[Coupling]:
    """Yield couplings behind an observer of the quantised position; none with an ideal encoder."""
    for coupling in couplings:
        problem = coupling.problem
        if problem.device.encoder_resolution_m > 0:
            runtime = Runtime(observer_mass_kg=problem.device.mass_kg + problem.hands.mass_kg[0])
            yield Coupling.constant(problem, coupling.table.at_rest, coupling.method, runtime)


def _dampers(problem: Problem, stiffness_n_per_m: float, damper: Callable[[float], Coupling]) -> list[Coupling]:
    """Return couplings with the least damping that has each of some disk margins, the most damping first.

    `damper` makes a coupling of the total damping b_p + b_e, N.s/m. Margins are 4, 3, 2, 1.5 and 1 times the required
    one, or the widest there is; dampings are shares of the stable range at `stiffness_n_per_m`.
    """
    stable = damping_range(PlantFamily.of(problem), stiffness_n_per_m)
    if np.isnan(stable.lowest_ns_per_m):
        return []
    goal = DISK_MARGIN if problem.robustness.disk_margin is None else problem.robustness.disk_margin

    def coupling(share: float) -> Coupling:
        return damper(stable.lowest_ns_per_m + share * (stable.highest_ns_per_m - stable.lowest_ns_per_m))

    def disk(share: float) -> float:
        return OpenLoop.of(coupling(share)).quick_disk_margin

    margins, tried = goal * np.array([4.0, 3.0, 2.0, 1.5, 1.0]), np.geomspace(0.5, 0.005, 12)
    disks = np.array([disk(share) for share in tried])
    shares = set()
    for margin in np.minimum(margins, disks.max()):
        widest = np.flatnonzero(disks >= margin)[-1]
        enough, less = tried[widest], tried[min(widest + 1, len(tried) - 1)]
        for _ in range(4):
            middle = math.sqrt(enough * less)
            enough, less = (middle, less) if disk(middle) >= margin else (enough, middle)
        shares.add(float(enough))
    return [coupling(share) for share in sorted(shares, reverse=True)]
