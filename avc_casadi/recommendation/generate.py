"""Candidate couplings of `recommend`, each designed for every hand and the released device."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.stability.stiffest_wall import DampingRange, damping_range
from avc_casadi.coupling import Coupling
from avc_casadi.design.constant.static_tuned import tuned_margin
from avc_casadi.design.robust.cma_continuation import continuation, refined
from avc_casadi.design.robust.known_laws import from_known
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.solve import FIRST
from avc_casadi.design.robust.uncertainty_set import why_no_law
from avc_casadi.design.tuning import tuned
from avc_casadi.model.gains import Gains, near_rigid_n_per_m, spring_before
from avc_casadi.model.hands import with_released
from avc_casadi.model.runtime import Runtime

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi._util.parallel import SharedTasks
    from avc_casadi.design.robust.cma_continuation import ResidualSpeed, ResidualSpeedAt, Step
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.recommendation.screening import Screening

# Damping reserves, as multiples of the tuned designs' own: a coarse encoder needs more.
_RESERVES = (1.0, 3.0)
# Contact damper as a share of the interval of stable dampings.
_SHARES = (0.5, 0.25, 0.1, 0.03, 0.01)
OF_STIFFEST = (0.9, 0.82, 0.75)
"""Rendered stiffness for a wall that is too stiff, as shares of the stiffest that is stable with all hands."""
SAFER = (0.6, 0.45, 0.33, 0.24, 0.15)
"""The same where all hands settle with nothing stiffer: of the wall, if that is softer."""
SOFTENED = "softened wall"
Alternatives = list[Coupling]
"""Equally stiff couplings, the likeliest first: the first acceptable one is taken."""
# Start of a continuation, as a share of the stiffest wall stable with spring and damper.
_SOFT = 0.25
# Stiffness ratio at which a continuation ends below an unstable wall, and the smaller steps of a resumed one.
_ROUGHLY, _NEARLY, _ONWARDS = 1.12, 1.06, 1.15
# Seed offset of their draws.
_OTHERS = 100
# From a given law, continuation retries a few softer walls only: if these fail, its neighbourhood is poor.
_NEAR: dict[str, Any] = {"softer": 2}
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
        start: a wall, and the law for it, from which to continue; None starts from the limit of spring and damper.
    """

    def __init__(self, problem: Problem, stiffest: DampingRange, crew: SharedTasks, start: Step | None = None) -> None:
        self._problem, self._crew, self._start = problem, crew, start
        self.steps: list[Step] = []
        self._wanted = problem.environment.stiffness_n_per_m
        # Slopes of detents are not analysed behind an observer.
        self._possible = problem.detent is None and not why_no_law(problem)
        first = FIRST * stiffest.stiffness_n_per_m
        self._first = first if self._wanted > first else _SOFT * self._wanted

    def continuations(self, asked: Screening, numbers: range) -> Iterator[list[Step]]:
        """Yield walls up to the wanted one, the softest of a continuation first.

        Args:
            asked: screening hands, who must all settle.
            numbers: of the continuations: from the known laws, then from each initial guess in turn, and with
                other draws.
        """
        if not self._possible:
            return
        first, starts = self._first, (None, *Space(self._problem.device, self._problem.hands).starts[1:])
        how: dict[str, Any] = {"close": _ROUGHLY}
        if self._start is not None:
            first, starts, how = self._start.stiffness_n_per_m, (self._start.best.logarithms,), how | _NEAR
        tasks: list[Callable[[], list[Step]]] = []
        for number in numbers:
            draw, place = divmod(number, len(starts))
            walls = (min(first, self._wanted), self._wanted)
            tasks.append(partial(_continued, self._problem, starts[place], walls, asked, seed=draw, **how))
        yield from map(self._kept, self._crew.each(tasks))

    def onwards(
        self, coupling: Coupling, felt_n_per_m: float, asked: Screening, numbers: range
    ) -> Iterator[list[Step]]:
        """Yield stiffer walls, up to the wanted one, from a stable one; none for a law of another structure.

        Args:
            coupling: that stabilises it.
            felt_n_per_m: its stiffness.
            asked: screening hands, who must all settle.
            numbers: of the continuations, each with its own random draws.
        """
        law = coupling.runtime.state_feedback
        point = next((one.logarithms for step in self.steps for one in step.candidates if one.law is law), None)
        if point is None:
            return
        walls = (min(felt_n_per_m, self._wanted), self._wanted)
        how: dict[str, Any] = {"rise": _ONWARDS, "close": _NEARLY, "softer": 0}
        tasks = [partial(_continued, self._problem, point, walls, asked, seed=_OTHERS + one, **how) for one in numbers]
        yield from map(self._kept, self._crew.each(tasks))

    def refinements(self, coupling: Coupling, asked: Screening) -> Iterator[list[Step]]:
        """Yield the same wall with laws of less compliance in motion; none for a law of another structure.

        Where such exist, these are laws with which all hands also settle on perturbed devices.

        Args:
            coupling: that stabilises it.
            asked: screening hands, who must all settle.
        """
        law = coupling.runtime.state_feedback
        pairs = ((step, one) for step in self.steps for one in step.candidates if one.law is law)
        for step, one in itertools.islice(pairs, 1):
            task = partial(_refined, self._problem, replace(step, candidates=(one,)), asked)
            yield from map(self._kept, self._crew.each([task]))

    def alternatives(self, step: Step) -> Alternatives:
        """Return the couplings of a wall."""
        return [_robust(self._problem, step.gains, one.law) for one in step.candidates]

    def _kept(self, steps: list[Step]) -> list[Step]:
        self.steps += steps
        return steps


def _refined(problem: Problem, step: Step, asked: Screening) -> list[Step]:
    """Return laws for a wall with less compliance in motion, also on perturbed devices where one is found."""
    everybody, wall, best = _residual_speed_at(problem, asked.and_off()), step.stiffness_n_per_m, step.best
    if asked.off:
        if (asked.only_off().ends(_robust(problem, step.gains, best.law))([best.law]) < 1).all():
            return [refined(problem, step, everybody)]
        known = from_known(problem, wall, everybody)
        from_here = partial(_continued, problem, best.logarithms, (wall, wall), asked.and_off(), softer=0)
        found = from_here() if known is None else [known]
        if found:
            return [refined(problem, found[-1], everybody)]
    return [refined(problem, step, _residual_speed_at(problem, asked))]


def _continued(
    problem: Problem, point: FloatArray | None, walls_n_per_m: tuple[float, float], asked: Screening, **how: Any
) -> list[Step]:
    """Continue from a point; without one from the initial guess, unless a known law stabilises the last wall."""
    if point is None:
        # Laws with which all settle on perturbed devices too come first, even if others have a smaller mismatch.
        for who in (asked.and_off(), asked) if asked.off else (asked,):
            known = from_known(problem, walls_n_per_m[1], _residual_speed_at(problem, who))
            if known is not None:
                return [known]
        point = Space(problem.device, problem.hands).starts[0]
    with suppress(np.linalg.LinAlgError):
        return continuation(problem, point, walls_n_per_m, _residual_speed_at(problem, asked), **how)
    return []


def _residual_speed_at(problem: Problem, asked: Screening) -> ResidualSpeedAt:
    def residual_speed_at(gains: Gains, law: StateFeedback) -> ResidualSpeed:
        return asked.ends(_robust(problem, gains, law))

    return residual_speed_at


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
    """Put a spring in series with a wall that is too stiff, for a wanted total stiffness; least damped first.

    Less damping means less force before contact, and at equal stiffness many dampers perform alike.
    """
    wall = problem.environment.stiffness_n_per_m
    if 0 < felt_n_per_m < wall:
        spring = spring_before(problem, felt_n_per_m)
        dampings = _dampings(damping_range(problem.device, people, felt_n_per_m))
        alike = [Coupling.constant(problem, Gains(0.0, spring, total), SOFTENED) for total in reversed(dampings)]
        yield from [alike] if alike else []


def _dampings(found: DampingRange) -> list[float]:
    if np.isnan(found.lowest_ns_per_m):
        return []
    return [found.lowest_ns_per_m + share * (found.highest_ns_per_m - found.lowest_ns_per_m) for share in _SHARES]


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
