"""Robust laws by covariance matrix adaptation with continuation in the wall's stiffness.

The objective of a law covers linear loops only. Encoder quantisation and the force limit may still keep a hand from
settling, differently with neighbouring laws. So laws whose loops are all damped are simulated, where a simulation is
given, and the residual speeds of the hands guide the search.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from threading import get_ident
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.robust.goal import cost_of, costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops, softened
from avc_casadi.loops.wall import Rendering, stiffness_at_rest

if TYPE_CHECKING:
    from avc_casadi.design.robust.goal import Cost
    from avc_casadi.loops.wall import Laws
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback


ResidualSpeed = Callable[[Sequence["StateFeedback"]], FloatArray]
"""Laws to the residual speed of each hand over the settling threshold, shape (laws, hands)."""
ResidualSpeedAt = Callable[["Gains", "StateFeedback"], ResidualSpeed]
"""Spring before the wall and a law to that function, for laws of this one's structure."""

CLOSE = 1.04
"""Stiffness ratio to the next wall below which a continuation ends."""
MOST_SOFTER = 12
"""Largest number of softer walls tried before one is stabilised."""
POPULATION = 10
"""Number of laws drawn in a generation."""
# Initial spread of laws about the start, in logarithms; least spread along the widest axis at each wall; widening.
_SPREAD, _LEAST_SPREAD, _WIDER = 0.3, 0.08, 1.5
# Continuation step in stiffness: initial, largest, and the number of generations up to which it grows.
_RISE, _MOST_RISE, _AT_ONCE = 1.3, 1.4, 2
# Exponent by which the step grows.
_FASTER = 1.5
# Generations after which a wall is given up, and the ratio to a softer one where none is stable yet.
_PATIENCE, _SOFTER = 12, 1.4
# Generations after the first wall with a law, at which a continuation ends.
_MOST_GENERATIONS = 60
# Target of the residual speed over the settling threshold, and its saturation. Weights of a factor of e in between, of
# a law's own cost, and of missing decay for each 1/s.
_AIM, _FASTEST = 0.5, 1e3
_PER_UNREST, _PER_COST, _PER_DECAY = 4.0, 0.02, 10.0
# Offset of laws that lack decay, which are not simulated: above the cost of any simulated law.
_NEVER = 1e4
MOST_LAWS = 3
"""Number of laws kept for a wall."""


@dataclass(frozen=True)
class Candidate:
    """A law with its point in the search space and its cost.

    Attributes:
        law: observer and feedback.
        logarithms: of its parameters.
        cost: before all loops of the uncertainty set.
    """

    law: StateFeedback
    logarithms: FloatArray
    cost: Cost


@dataclass(frozen=True)
class Step:
    """A continuation step: a wall and laws that stabilise it.

    Attributes:
        gains: the spring in series with the wall, rigid where the wall itself is rendered.
        stiffness_n_per_m: static, of both in series.
        candidates: laws, best first. The objective resolves the last hand in a hundred poorly: where one law fails
            with it, another may not.
    """

    gains: Gains
    stiffness_n_per_m: float
    candidates: tuple[Candidate, ...]

    @property
    def best(self) -> Candidate:
        """The first law."""
        return self.candidates[0]


def candidate_at(space: Space, loops: Loops, rendering: Rendering, logarithms: FloatArray) -> Candidate:
    """Return the law of one point with its cost over all loops.

    Args:
        space: of the parameters.
        loops: loops that the law must stabilise.
        rendering: coupling and wall behind it.
        logarithms: of the parameters.

    Raises:
        numpy.linalg.LinAlgError: the point has no law.
    """
    law = space.law(logarithms, stiffness_at_rest(rendering))
    return Candidate(law, logarithms, cost_of(law, rendering, loops))


def continuation(
    problem: Problem,
    start: FloatArray,
    walls_n_per_m: tuple[float, float],
    residual_speed_at: ResidualSpeedAt | None = None,
    *,
    seed: int = 0,
    rise: float = _RISE,
    close: float = CLOSE,
    softer: int = MOST_SOFTER,
) -> list[Step]:
    """Return laws for walls of increasing stiffness.

    Args:
        problem: device with its ranges, hands and wall.
        start: initial guess, logarithms of the parameters.
        walls_n_per_m: static stiffness of the first wall, and of the last.
        residual_speed_at: simulates hands, who must all settle; None requires damped loops only.
        seed: of the draw of laws.
        rise: the second wall over the first.
        close: a wall without a law ends the continuation at this ratio to the last one with a law, or below.
        softer: largest number of softer walls tried before one has a law.

    Returns:
        The stabilised walls, softest first, with laws whose loops are all damped.

    Raises:
        numpy.linalg.LinAlgError: the start has no law.
    """
    first, last = walls_n_per_m
    search = _Search(problem, start, residual_speed_at, np.random.default_rng(seed))
    held: list[Step] = []
    wall, point, lowered, spent = first, start, 0, 0
    while spent < _MOST_GENERATIONS:
        step, took = search.held(point, wall)
        spent += took if held else 0
        if step is not None:
            held.append(step)
            if wall >= last:
                return held
            point = step.best.logarithms
            rise = min(_MOST_RISE, rise**_FASTER) if took <= _AT_ONCE else rise
            wall = min(last, wall * rise)
        elif held:
            reached = held[-1].stiffness_n_per_m
            if wall < close * reached:
                return held
            rise = math.sqrt(wall / reached)
            wall = reached * rise
        elif lowered < softer:
            lowered, wall = lowered + 1, wall / _SOFTER
        else:
            break
    return held


class _Search:
    """The search for laws with which all hands settle, wall by wall; arguments as for `continuation`.

    It is one evolution: the covariance learned at one wall, stabilised or not, serves the next.
    """

    def __init__(
        self,
        problem: Problem,
        start: FloatArray,
        residual_speed_at: ResidualSpeedAt | None,
        draw: np.random.Generator,
    ) -> None:
        self._problem, self._residual_speed_at = problem, residual_speed_at
        self._space, self._loops = Space(problem.device, problem.hands), Loops.of(problem)
        self._evolution = evolution(start, self._space.bounds, _SPREAD, draw)

    def held(self, point: FloatArray, stiffness_n_per_m: float) -> tuple[Step | None, int]:
        """Search laws for one wall, a given one in the first generation; return the step and the generations taken.

        Args:
            point: logarithms of the given law's parameters.
            stiffness_n_per_m: static, of the wall.
        """
        space, loops = self._space, self._loops
        gains, rendering = softened(self._problem, stiffness_n_per_m)
        stiffness = stiffness_at_rest(rendering)
        law = space.law(point, stiffness)
        hardest = loops.hardest(law, rendering)
        residual_speed = None if self._residual_speed_at is None else self._residual_speed_at(gains, law)
        search = self._evolution
        for done in range(1, _PATIENCE + 1):
            if search.stds.max() < _LEAST_SPREAD:
                search.sigma *= _WIDER
            points = search.ask()
            if done == 1:
                points[0] = np.clip(point, *space.bounds)
            laws = space.laws(np.array(points), stiffness)
            value, settled = weighed(space, laws, costs_of(laws, rendering, hardest), residual_speed)
            found = laws_of_all(space, loops, rendering, [np.asarray(points[row]) for row in settled])
            search.tell(points, value.tolist())
            whole = sorted((one for one in found if one.cost.holds), key=lambda one: one.cost.total)[:MOST_LAWS]
            if whole:
                return Step(gains, stiffness_n_per_m, tuple(whole)), done
            # The critical loops of these laws differ from those of the first.
            for one in found:
                hardest = hardest.and_of(loops.hardest(one.law, rendering))
        return None, _PATIENCE


def weighed(
    space: Space, laws: Laws, costs: list[Cost], residual_speed: ResidualSpeed | None
) -> tuple[FloatArray, list[int]]:
    """Return the objective of laws, to be minimised, and those with which all hands settle."""
    total = np.array([cost.total for cost in costs])
    lacks = np.nan_to_num([cost.lacks_per_s for cost in costs], posinf=0.0)
    value: FloatArray = _NEVER + np.minimum(total + _PER_DECAY * lacks, _NEVER)
    damped = np.flatnonzero([cost.holds for cost in costs])
    if len(damped) == 0:
        return value, []
    if residual_speed is None:
        value[damped] = total[damped]
        return value, damped.tolist()
    ends = residual_speed([space.one_of(laws, row) for row in damped.tolist()])
    paid = np.log(np.clip(np.nan_to_num(ends, nan=_FASTEST), _AIM, _AIM * _FASTEST) / _AIM).sum(axis=1)
    value[damped] = _PER_UNREST * paid + _PER_COST * total[damped]
    return value, damped[(ends < 1).all(axis=1)].tolist()


def settling(space: Space, laws: Laws, rows: list[int], residual_speed: ResidualSpeed | None) -> list[int]:
    """Return those of some laws with which all hands settle."""
    if residual_speed is None or not rows:
        return rows
    ends = residual_speed([space.one_of(laws, row) for row in rows])
    return [row for row, speeds in zip(rows, ends, strict=True) if (speeds < 1).all()]


def laws_of_all(space: Space, loops: Loops, rendering: Rendering, points: list[FloatArray]) -> list[Candidate]:
    """Return the points' laws with their cost over all loops, without points that have no law."""
    found: list[Candidate] = []
    for point in points:
        with suppress(np.linalg.LinAlgError):
            found.append(candidate_at(space, loops, rendering, point))
    return found


class _Without(MetaPathFinder):
    """Block the import of modules in this thread, unless they are loaded already."""

    def __init__(self, *names: str) -> None:
        self._names, self._thread = names, get_ident()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Raise for blocked modules; return None so that the other finders look."""
        if fullname in self._names and get_ident() == self._thread:
            raise ModuleNotFoundError(f"{fullname} is left out", name=fullname)


def _cma() -> Any:
    """Import cma without plotting and statistics, which cost a second and are not used."""
    unused = _Without("matplotlib", "matplotlib.pyplot", "scipy.stats")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about blocked modules
        sys.meta_path.insert(0, unused)
        try:
            import cma  # noqa: PLC0415
        finally:
            sys.meta_path.remove(unused)
    return cma


def evolution(
    start: FloatArray, bounds: tuple[FloatArray, FloatArray], spread: float, draw: np.random.Generator
) -> Any:
    """Return a covariance matrix adaptation (Hansen 2016) with `ask` for points and `tell` for their values.

    Args:
        start: initial guess, shape (parameters,).
        bounds: lower and upper.
        spread: of the first points.
        draw: random generator; cma's own would seed numpy's global one.
    """
    options = {
        "bounds": [bound.tolist() for bound in bounds],
        "popsize": POPULATION,
        "randn": lambda *shape: draw.standard_normal(shape),
        "seed": np.nan,
        "verbose": -9,
        "verb_log": 0,
    }
    return _cma().CMAEvolutionStrategy(np.clip(start, *bounds), spread, options)


def moved(step: Step, before: Problem, problem: Problem) -> Step | None:
    """Return a law's parameters for another device, each at the same ratio to its initial guess.

    Args:
        step: a wall and its law, which need not be stable on the other device.
        before: problem of the original device.
        problem: of the other device, with the same wall.

    Returns:
        The same wall on the other device; None where the parameters give no law there.
    """
    space, usual = Space(problem.device, problem.hands), Space(before.device, before.hands)
    names = [knob.name for knob in usual.knobs]
    away = dict(zip(names, step.best.logarithms - usual.starts[0], strict=True))
    logarithms = np.clip(space.starts[0] + [away.get(knob.name, 0.0) for knob in space.knobs], *space.bounds)
    gains, rendering = softened(problem, step.stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        found = candidate_at(space, Loops.of(problem), rendering, logarithms)
        return Step(gains, step.stiffness_n_per_m, (found,))
    return None
