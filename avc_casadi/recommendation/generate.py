"""Candidate couplings of `recommend`, each designed for every hand and the released device."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.parallel import ALONE, Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.passivity.rendered_impedance import Excitation, Handle, below_quarter_rate, wall_over_position
from avc_casadi.coupling import Coupling
from avc_casadi.design.constant.static_tuned import tuned_margin
from avc_casadi.design.robust.cma_continuation import continuation
from avc_casadi.design.robust.goal import BAND_HZ
from avc_casadi.design.robust.known_laws import KnownLaws
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.refinement import refined
from avc_casadi.design.robust.solve import FIRST
from avc_casadi.design.robust.uncertainty_set import why_no_law
from avc_casadi.design.tuning import tuned
from avc_casadi.loops.walls import DampingRange, damping_range
from avc_casadi.model.gains import Gains, near_rigid_n_per_m, spring_before
from avc_casadi.model.hands import with_released
from avc_casadi.model.problem import Impedance
from avc_casadi.model.runtime import Runtime

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.design.robust.cma_continuation import ResidualSpeed, ResidualSpeedAt, Step
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.recommendation.screening import Screening

# Damping reserves, as multiples of the tuned designs' own: a coarse encoder needs more.
_RESERVES = (1.0, 3.0)
# Contact damper as a share of the interval of stable dampings: each tried, or together behind a spring, where a few
# hands settle with some of them only.
_SHARES = (0.5, 0.25, 0.1, 0.03, 0.01)
_MANY_SHARES = (0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.01)
OF_STIFFEST = (0.9, 0.82, 0.75)
"""Rendered stiffness for a wall that is too stiff, as shares of the stiffest that is stable with all hands."""
SAFER = (0.6, 0.45, 0.33, 0.24, 0.15)
"""The same where all hands settle with nothing stiffer: of the wall, if that is softer."""
SOFTENED = "softened wall"
Alternatives = list[Coupling]
"""Equally stiff couplings, the nearest first: the first acceptable one is taken."""
# Softest wall for which known laws are tried, as a share of the stiffest one stable with spring and damper.
_SOFTEST = 0.05
# A continuation from a known law: stiffness ratio of its first step, and that at which it ends.
_FROM_KNOWN: dict[str, Any] = {"rise": 1.15, "close": 1.06, "softer": 0}
_FROM_GUESS: dict[str, Any] = {"close": 1.12}
# Distances that differ by less do not outweigh that all hands settle on perturbed devices too.
_ABOUT_AS_NEAR = 0.1
# Least stiffness ratio of two walls tried.
_BARELY = 1.02


def static_stiffness_n_per_m(coupling: Coupling) -> float:
    """Return the stiffness of coupling and wall in series at rest."""
    k, wall = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return k * wall / (k + wall) if k + wall else 0.0


def plain_candidates(problem: Problem, subjects: Hand | StylusHand, stiffest: DampingRange) -> Iterator[Alternatives]:
    """Yield couplings of spring and damper.

    The wall itself without a coupling; a rigid coupling with a contact damper; for a wall beyond the stability limit,
    springs that soften it to just below that.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        stiffest: the stiffest wall stable with all hands and released.
    """
    people = with_released(subjects)
    for gains, name in _rigid(problem, people):
        yield [Coupling.constant(problem, gains, name)]
    for share in OF_STIFFEST:
        yield from _softened(problem, people, share * stiffest.stiffness_n_per_m)


def stiffer_n_per_m(problem: Problem, stiffest: DampingRange, felt_n_per_m: float) -> float | None:
    """Return the next stiffer wall behind a spring that is tried; None where it is the wanted one.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall stable with all hands and released.
        felt_n_per_m: rendered so far.
    """
    wall, limit = problem.environment.stiffness_n_per_m, stiffest.stiffness_n_per_m
    looked = [share * limit for share in (*OF_STIFFEST, 1.0)] + [share * min(limit, wall) for share in SAFER]
    above = [one for one in (*looked, wall) if _BARELY * felt_n_per_m < one <= wall]
    return min(above, default=None)


def softened_to(problem: Problem, subjects: Hand | StylusHand, felt_n_per_m: float) -> Iterator[Alternatives]:
    """Yield springs that render the wall at a stiffness, then the same behind an observer.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        felt_n_per_m: of spring and wall in series.
    """
    found = list(_softened(problem, with_released(subjects), felt_n_per_m))
    yield from (*found, *behind_observers(found))


class RobustCandidates:
    """Walls behind an observer with state feedback; none for a device without a law, nor beside detents.

    Attributes:
        steps: walls and laws found so far.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall stable with all hands and released.
        crew: workers of the search.
        start: a wall and a law for it, known beside those of the table; None without.
    """

    def __init__(self, problem: Problem, stiffest: DampingRange, crew: Crew = ALONE, start: Step | None = None) -> None:
        self._problem, self._crew, self._start = problem, crew, start
        self.steps: list[Step] = []
        self._wanted = problem.environment.stiffness_n_per_m
        # Slopes of detents are not analysed behind an observer.
        self._possible = problem.detent is None and not why_no_law(problem)
        self._first = FIRST * stiffest.stiffness_n_per_m

    def continuations(self, asked: Screening, numbers: range) -> Iterator[list[Step]]:
        """Yield the wanted wall, where a known law stabilises it; then walls up to it, the softest first.

        Every other continuation begins at the stiffest softer wall that a known law stabilises, where there is one;
        else at a default guess: either may end in the better basin.

        Args:
            asked: screening hands, who must all settle.
            numbers: of the continuations, each with its own random draws.
        """
        if not self._possible:
            return
        problem, wanted = self._problem, self._wanted
        known = _known(problem, self._first, asked, self._start)
        if known is not None:
            yield self._kept([known])
            if known.stiffness_n_per_m >= wanted:
                laws = KnownLaws(problem, residual_speed_at(problem, asked))
                known = laws.softer(_SOFTEST * self._first, wanted) or known
        starts = Space(problem.device, problem.hands).starts
        tasks: list[Callable[[], list[Step]]] = []
        for number in numbers:
            point, first, how = starts[number % len(starts)], self._first, _FROM_GUESS
            if known is not None and number % 2 == 0:
                point, first, how = known.best.logarithms, known.stiffness_n_per_m, _FROM_KNOWN
            walls = (min(first, wanted), wanted)
            tasks.append(partial(_continued, problem, point, walls, asked, seed=number, **how))
        yield from map(self._kept, self._crew.each(tasks))

    def refined(self, asked: Screening) -> list[Step]:
        """Return laws nearer to the wanted wall than the nearest one found with which all settle, else than any.

        Where there are any, these are laws with which all hands also settle on perturbed devices; none where no law was
        found.

        Args:
            asked: screening hands, who must all settle.
        """
        each = [replace(step, candidates=(one,)) for step in self.steps for one in step.candidates]
        each.sort(key=lambda step: step.best.cost.distance)
        settled = (step for step in each if _settles(self._problem, step, asked))
        start = next(settled, each[0] if each else None)
        return [] if start is None else self._kept([_refined(self._problem, start, asked)])

    def nearest(self) -> float:
        """Return the smallest distance from the wanted wall of the laws found so far; infinite where there is none."""
        return min((step.best.cost.distance for step in self.steps), default=math.inf)

    def alternatives(self, step: Step) -> Alternatives:
        """Return the couplings of a wall."""
        return [_robust(self._problem, step.gains, one.law) for one in step.candidates]

    def _kept(self, steps: list[Step]) -> list[Step]:
        self.steps += steps
        return steps


def _refined(problem: Problem, step: Step, asked: Screening) -> Step:
    """Return laws nearer to the wanted wall, also on perturbed devices where those are about as near."""
    who, best = asked, step.best
    if asked.off:
        everybody = asked.and_off()
        if _settles(problem, step, asked.only_off()):
            who = everybody
        else:
            known = KnownLaws(problem, residual_speed_at(problem, everybody)).before(step.stiffness_n_per_m)
            if known is not None and known.best.cost.distance < best.cost.distance + _ABOUT_AS_NEAR:
                step, who = known, everybody
    wanted = problem.environment.stiffness_n_per_m
    return refined(problem, step, residual_speed_at(problem, who), wanted_n_per_m=wanted)


def _settles(problem: Problem, step: Step, asked: Screening) -> bool:
    """Return whether all hands settle with the best law of a step."""
    law = step.best.law
    return bool((asked.ends(_robust(problem, step.gains, law))([law]) < 1).all())


def _known(problem: Problem, first_n_per_m: float, asked: Screening, start: Step | None) -> Step | None:
    """Return the wanted wall with known laws that stabilise it, else a softer one; None where there is none."""
    wanted, more = problem.environment.stiffness_n_per_m, () if start is None else (start.best.logarithms,)
    # Laws with which all settle on perturbed devices too come first, even if others are nearer.
    for who in (asked.and_off(), asked) if asked.off else (asked,):
        laws = KnownLaws(problem, residual_speed_at(problem, who), more)
        if (found := laws.before(wanted)) is not None:
            return found
    return laws.softer(_SOFTEST * first_n_per_m, wanted)


def _continued(
    problem: Problem, point: FloatArray, walls_n_per_m: tuple[float, float], asked: Screening, **how: Any
) -> list[Step]:
    """Continue from a point; no walls where it has no law."""
    with suppress(np.linalg.LinAlgError):
        return continuation(problem, point, walls_n_per_m, residual_speed_at(problem, asked), **how)
    return []


def residual_speed_at(problem: Problem, asked: Screening) -> ResidualSpeedAt:
    """Return the simulation of some hands, for walls and laws.

    Args:
        problem: device, wall and hands.
        asked: the hands.
    """

    def before(gains: Gains, law: StateFeedback) -> ResidualSpeed:
        return asked.ends(_robust(problem, gains, law))

    return before


def _robust(problem: Problem, gains: Gains, law: StateFeedback) -> Coupling:
    return Coupling.constant(problem, gains, "robust", Runtime(state_feedback=law))


def tuned_candidates(problem: Problem, progress: Progress = SILENT) -> Iterator[Alternatives]:
    """Yield constant gains tuned for every hand and the released device, with growing reserves.

    Args:
        problem: device, wall and hands.
        progress: reports the tuning.
    """
    safe = problem.changed(hands={"let_go": True})
    for share in _RESERVES:
        found = _tuned(safe, share, progress)
        if isinstance(found, Gains):
            yield from _with_observer(Coupling.constant(problem, found, "static-tuned"))


def _tuned(problem: Problem, share: float, progress: Progress) -> object:
    try:
        return tuned(problem, scheduled=False, margin_ns_per_m=share * tuned_margin(problem), progress=progress)
    except UnsupportedError:
        return None


def _rigid(problem: Problem, people: Hand | StylusHand) -> Iterator[tuple[Gains, str]]:
    wall, rigid = problem.environment, near_rigid_n_per_m(problem.device)
    yield Gains(0.0, rigid), "none"
    for total in _dampings(damping_range(problem.device, people, wall.stiffness_n_per_m)):
        yield Gains(0.0, rigid, max(0.0, total - wall.damping_ns_per_m)), "contact damper"


def _softened(problem: Problem, people: Hand | StylusHand, felt_n_per_m: float) -> Iterator[Alternatives]:
    """Put a spring in series with a wall that is too stiff, for a wanted total stiffness; nearest in motion first."""
    wall = problem.environment.stiffness_n_per_m
    if 0 < felt_n_per_m < wall:
        spring = spring_before(problem, felt_n_per_m)
        dampings = _dampings(damping_range(problem.device, people, felt_n_per_m), _MANY_SHARES)
        dampings.sort(key=partial(_mismatch, problem, felt_n_per_m))
        alike = [Coupling.constant(problem, Gains(0.0, spring, total), SOFTENED) for total in dampings]
        yield from [alike] if alike else []


def _mismatch(problem: Problem, stiffness_n_per_m: float, damping_ns_per_m: float) -> float:
    """Return the root mean square mismatch in motion of a spring and damper that never pull."""
    heard = below_quarter_rate(problem.device, BAND_HZ)
    excitation = Excitation.of(problem.device, stiffness_n_per_m)
    both = Impedance(damping_ns_per_m=damping_ns_per_m, stiffness_n_per_m=stiffness_n_per_m)
    rendered = Handle.of(problem, heard).rendered(wall_over_position(both, excitation, heard), excitation)
    return float(np.sqrt(np.mean(rendered.mismatch**2)))


def _dampings(found: DampingRange, shares: tuple[float, ...] = _SHARES) -> list[float]:
    if np.isnan(found.lowest_ns_per_m):
        return []
    return [found.lowest_ns_per_m + share * (found.highest_ns_per_m - found.lowest_ns_per_m) for share in shares]


def _with_observer(coupling: Coupling) -> Iterator[Alternatives]:
    yield [coupling]
    yield from behind_observers([[coupling]])


def behind_observers(some: Iterable[Alternatives]) -> Iterator[Alternatives]:
    """Yield couplings behind an observer of the quantised position; none with an ideal encoder."""
    for alternatives in some:
        problem = alternatives[0].problem
        if problem.device.encoder_resolution_m > 0:
            runtime = Runtime(observer_mass_kg=problem.device.mass_kg + problem.hands.mass_kg[0])
            yield [Coupling.constant(problem, one.table.at_rest, one.method, runtime) for one in alternatives]
