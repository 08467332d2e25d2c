"""The couplings among which `recommend` chooses: today's designs, each for every hand and the device let go."""

from __future__ import annotations

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
from avc_casadi.design.robust.between import between
from avc_casadi.design.robust.climb import climb
from avc_casadi.design.robust.ladder import robust_at, why_no_law
from avc_casadi.design.robust.law import Space
from avc_casadi.model.gains import Gains, near_rigid_n_per_m, spring_before
from avc_casadi.model.hands import with_let_go
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.reach import tuned

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi._util.parallel import Crew
    from avc_casadi.design.robust.climb import EndsAt, Unrest
    from avc_casadi.design.robust.ladder import Rung
    from avc_casadi.design.robust.search import Found
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.recommendation.asked_first import AskedFirst

# Damping kept in reserve, as multiples of the tuned designs' own: a coarse encoder asks for more.
_RESERVES = (1.0, 3.0)
# Where in the interval of stable dampings the contact damper stands.
_SHARES = (0.5, 0.25, 0.1, 0.03, 0.01)
# Stiffness felt before a wall that is too stiff, as a share of the stiffest that is stable with everybody.
_OF_STIFFEST = (0.9, 0.82, 0.75)
SAFER = (0.6, 0.45, 0.33, 0.24, 0.15)
"""The same where nothing stiffer brings everybody to rest: of the wall, if that is softer."""
SOFTENED = "softened wall"
Alternatives = list[Coupling]
"""Couplings that are equally stiff, the likeliest first: the first that is safe and quiet will do."""
# Laws for the wanted wall are searched at once if it is no more than so many times what spring and damper hold. Climbs
# begin at this share of that, or of the wanted wall where that is softer.
_AT_ONCE, _FIRST, _SOFT = 4.0, 0.9, 0.25
# A climb ends so near to a wall that is not held; what is held is climbed on from in smaller steps.
_ROUGHLY, _NEARLY, _ONWARDS = 1.12, 1.06, 1.15
# Numbers of their draws.
_OTHERS = 100
# From a law that was given no much softer wall is tried: what is near it is no good then.
_NEAR: dict[str, Any] = {"softer": 2}
# Laws with which all surely rest are drawn so often, while those found are so many times as soft in motion.
_SURE_DRAWS, _AS_SOFT = 3, 1.1
# How much stiffer another wall is at least.
_BARELY = 1.02


def felt_at_rest_n_per_m(coupling: Coupling) -> float:
    """Return the stiffness of coupling and wall in series at rest."""
    k, wall = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return k * wall / (k + wall) if k + wall else 0.0


def plain_candidates(problem: Problem, subjects: Hand | StylusHand, stiffest: DampingRange) -> Iterator[Alternatives]:
    """Yield couplings of spring and damper.

    No coupling but the wall itself; a rigid coupling with a contact damper; for a wall beyond what the device can give,
    springs that soften it to just below that.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
    """
    people = with_let_go(subjects)
    for gains, name in _rigid(problem, people):
        yield [Coupling.constant(problem, gains, name)]
    for share in _OF_STIFFEST:
        yield from _softened(problem, people, share * stiffest.stiffness_n_per_m)


def stiffer_n_per_m(problem: Problem, stiffest: DampingRange, felt_n_per_m: float) -> float | None:
    """Return the next stiffer of the walls behind a spring that are looked at; None where it is the wanted one.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
        felt_n_per_m: what is felt so far.
    """
    wall, limit = problem.environment.stiffness_n_per_m, stiffest.stiffness_n_per_m
    looked = [share * limit for share in (*_OF_STIFFEST, 1.0)] + [share * min(limit, wall) for share in SAFER]
    above = [one for one in (*looked, wall) if _BARELY * felt_n_per_m < one <= wall]
    return min(above, default=None)


def softened_to(problem: Problem, subjects: Hand | StylusHand, felt_n_per_m: float) -> Iterator[Alternatives]:
    """Yield springs with which the wall feels so stiff, then the same behind an observer.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        felt_n_per_m: of spring and wall in series.
    """
    found = list(_softened(problem, with_let_go(subjects), felt_n_per_m))
    yield from (*found, *behind_observers(found))


class RobustCandidates:
    """Walls behind an observer with state feedback; none for a device without a law, nor beside detents.

    Attributes:
        rungs: walls and laws that were found so far.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
        crew: who searches.
        start: a wall, and the law for it, from which to climb; None begins where spring and damper end.
    """

    def __init__(self, problem: Problem, stiffest: DampingRange, crew: Crew, start: Rung | None = None) -> None:
        self._problem, self._crew, self._start = problem, crew, start
        self.rungs: list[Rung] = []
        self._wanted = problem.environment.stiffness_n_per_m
        # Whose slopes nobody judges behind an observer.
        self._possible = problem.detent is None and not why_no_law(problem)
        self._plain = stiffest.stiffness_n_per_m

    def climbs(self, asked: AskedFirst, numbers: range) -> Iterator[list[Rung]]:
        """Yield walls up to the wanted one, the softest of a climb first.

        Laws for the wanted wall itself, if it is not far, come before those.

        Args:
            asked: who must all rest.
            numbers: of the climbs: from each of the places where laws begin in turn, and with other draws of laws.
        """
        # Mostly enough where it is tried.
        if self._possible and self._start is None and self._wanted <= _AT_ONCE * self._plain:
            yield self._kept(_at_once(self._problem, self._wanted, asked))
        tasks: list[Callable[[], list[Rung]]] = []
        places = self._beginnings() if self._possible else []
        for number in numbers if places else ():
            draw, place = divmod(number, len(places))
            point, first = places[place]
            walls = (min(first, self._wanted), self._wanted)
            how: dict[str, Any] = {"seed": draw, "close": _ROUGHLY} | ({} if self._start is None else _NEAR)
            tasks.append(partial(_climbed, self._problem, point, walls, asked, **how))
        yield from map(self._kept, self._crew.each(tasks))

    def onwards(
        self, coupling: Coupling, felt_n_per_m: float, asked: AskedFirst, numbers: range
    ) -> Iterator[list[Rung]]:
        """Yield stiffer walls, up to the wanted one, from one that is held on; none where its law is not of here.

        Args:
            coupling: that holds it.
            felt_n_per_m: its stiffness.
            asked: who must all rest.
            numbers: of the climbs: each has its own draw of laws.
        """
        law = coupling.runtime.state_feedback
        laws = (one for rung in self.rungs for one in (rung.found, *rung.found.others))
        point = next((one.logarithms for one in laws if one.law is law), None)
        if point is None:
            return
        walls = (min(felt_n_per_m, self._wanted), self._wanted)
        how: dict[str, Any] = {"rise": _ONWARDS, "close": _NEARLY, "softer": 0}
        tasks = [partial(_climbed, self._problem, point, walls, asked, seed=_OTHERS + one, **how) for one in numbers]
        yield from map(self._kept, self._crew.each(tasks))

    def alternatives(self, rung: Rung) -> Alternatives:
        """Return the couplings of a wall."""
        laws = (rung.found.law, *(one.law for one in rung.found.others))
        return [_robust(self._problem, rung.gains, law) for law in laws]

    def _beginnings(self) -> list[tuple[FloatArray, float]]:
        """Return where laws begin, and the first wall from each."""
        usual = Space(self._problem.device, self._problem.hands).starts
        if self._start is None:
            first = _FIRST * self._plain
            return [(point, first if self._wanted > first else _SOFT * self._wanted) for point in usual]
        return [(self._start.found.logarithms, self._start.stiffness_n_per_m)]

    def _kept(self, rungs: list[Rung]) -> list[Rung]:
        self.rungs += rungs
        return rungs


def _at_once(problem: Problem, wanted_n_per_m: float, asked: AskedFirst) -> list[Rung]:
    """Return laws for a wall with which everybody rests, near those that a search finds or among them; none may be."""
    found = list(robust_at(problem, wanted_n_per_m))
    for rung in found:
        climbed = _climbed(problem, rung.found.logarithms, (wanted_n_per_m, wanted_n_per_m), asked, softer=0)
        if climbed:
            return [_surely(problem, climbed[-1], asked) if asked.off else climbed[-1]]
    return [rung for rung in (_resting(problem, rung, asked) for rung in found) if rung is not None]


def _resting(problem: Problem, rung: Rung, asked: AskedFirst) -> Rung | None:
    """Return a wall with those of its laws with which everybody rests, if there are any."""
    laws = (rung.found, *rung.found.others)
    ends = asked.ends(_robust(problem, rung.gains, laws[0].law))([one.law for one in laws])
    rest = [laws[row] for row in np.flatnonzero((ends < 1).all(axis=1)).tolist()]
    return replace(rung, found=rest[0].beside(rest[1:])) if rest else None


def _surely(problem: Problem, rung: Rung, asked: AskedFirst) -> Rung:
    """Return a wall with laws with which all rest on devices a little off their file too, before those it has.

    Such a law may give way more in motion, so a few are searched; of those on the line between the best of them and
    the best of all the nearest to that comes first.
    """
    best, wall = rung.found, rung.stiffness_n_per_m
    laws, everybody = (best, *best.others), asked.and_off()
    ends = asked.only_off().ends(_robust(problem, rung.gains, best.law))([one.law for one in laws])
    rest = np.flatnonzero((ends < 1).all(axis=1)).tolist()
    if 0 in rest:
        return rung
    sure, others = [laws[row] for row in rest], [law for row, law in enumerate(laws) if row not in rest]
    for draw in range(_SURE_DRAWS):
        # Where one draw finds nobody at rest, another hardly does, and takes as long.
        if (draw > 0 and not sure) or any(_softness(one) <= _AS_SOFT * _softness(best) for one in sure):
            break
        rungs = _climbed(problem, best.logarithms, (wall, wall), everybody, seed=draw, softer=0)
        sure += [law for one in rungs for law in (one.found, *one.found.others)]
    if not sure:
        return rung
    sure.sort(key=_softness)
    nearer = between(problem, wall, best, sure[0], _ends_at(problem, everybody))
    found = [*([] if nearer is None else [nearer]), *sure, *others]
    return replace(rung, found=found[0].beside(found[1:]))


def _softness(law: Found) -> float:
    """Return by what share of the wall a law gives way in motion, at 3 and at 10 Hz together."""
    return law.cost.facts["softness_3hz"] + law.cost.facts["softness_10hz"]


def _climbed(
    problem: Problem, point: FloatArray, walls_n_per_m: tuple[float, float], asked: AskedFirst, **how: Any
) -> list[Rung]:
    with suppress(np.linalg.LinAlgError):
        return climb(problem, point, walls_n_per_m, _ends_at(problem, asked), **how)
    return []


def _ends_at(problem: Problem, asked: AskedFirst) -> EndsAt:
    def ends_at(gains: Gains, law: StateFeedback) -> Unrest:
        return asked.ends(_robust(problem, gains, law))

    return ends_at


def _robust(problem: Problem, gains: Gains, law: StateFeedback) -> Coupling:
    return Coupling.constant(problem, gains, "robust", Runtime(state_feedback=law))


def tuned_candidates(problem: Problem, progress: Progress = SILENT) -> Iterator[Alternatives]:
    """Yield constant gains tuned for every hand and the device let go, with growing reserves.

    Args:
        problem: device, wall and hands.
        progress: told of the tuning.
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
    """Put a spring before a wall that is too stiff, so that both are as stiff as wanted; the least damped first.

    The less damped the less a hand feels before the wall, and of what is as stiff many dampers are much alike.
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
    """Yield couplings behind an observer between the steps of the encoder; none where it has none."""
    for alternatives in some:
        problem = alternatives[0].problem
        if problem.device.encoder_resolution_m > 0:
            runtime = Runtime(observer_mass_kg=problem.device.mass_kg + problem.hands.mass_kg[0])
            yield [Coupling.constant(problem, one.table.at_rest, one.method, runtime) for one in alternatives]
