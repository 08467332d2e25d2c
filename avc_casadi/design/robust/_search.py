"""The search for a law: covariance matrix adaptation over its numbers, the same every time."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from importlib.abc import MetaPathFinder
from operator import itemgetter
from threading import get_ident
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.design.robust._goal import Cost, cost_of, costs_of
from avc_casadi.stability import stiffness_at_rest
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.design.robust._law import Space
    from avc_casadi.design.robust._loops import Loops
    from avc_casadi.runtime import StateFeedback
    from avc_casadi.stability import Rendering

# Values and points.
Seen = list[tuple[float, FloatArray]]

_FAILED = 1e4
_POPULATION = 10
_SPREAD = 0.3
MOST_LAWS = 60
"""Laws for each knob and start, at most."""
# A search ends where, after so many generations, so many more have made the cheapest law no more than this share
# cheaper, unless with that some loop grows at once.
_FIRST, _MORE, _SHARE, _GROWS = 10, 8, 0.01, 1000.0
# A search that lost sight of the loops that are hardest for what it found, so that it costs so many times as much,
# goes on with them, so often at most.
_MISLED, _MOST_MISLED = 1.1, 4
# Cost of a loop that grows, for each 1/s, where without it the cheapest law has one.
_PER_GROWTH = 10.0
# Other laws that are kept: those whose cost is no more than so many times the least and that differ by so much in some
# logarithm from each other.
_AS_CHEAP, _APART, _MOST_OTHERS = 1.15, 0.15, 9


@dataclass(frozen=True)
class Found:
    """A law, where it stands in the search space, and what it costs.

    Attributes:
        law: observer and feedback.
        logarithms: its numbers.
        cost: what it costs.
        others: laws that cost hardly more. The goal tells little of the last hand in a hundred: where one law loses
            it, another may not.
    """

    law: StateFeedback
    logarithms: FloatArray
    cost: Cost
    others: tuple[Found, ...] = ()

    def beside(self, others: Iterable[Found]) -> Found:
        """Return it with others."""
        return replace(self, others=tuple(others))


def search(
    space: Space,
    loops: Loops,
    rendering: Rendering,
    start: FloatArray | None = None,
) -> Found:
    """Find the cheapest law for a rendering.

    The goal has corners and valleys (spectral radii over many loops), and is cheap: a population without derivatives
    does well. Nothing says that what it finds is the best there is.

    Args:
        space: what is searched.
        loops: what the law must hold.
        rendering: coupling and wall behind it.
        start: logarithms of a near law; None begins at each of the usual starts.

    Raises:
        numpy.linalg.LinAlgError: the start has no law.
    """
    if start is not None:
        return _searched(space, loops, rendering, start, from_afar=False)
    each = [_searched(space, loops, rendering, begin, from_afar=True) for begin in space.starts]
    laws = (law for one in each for law in (one, *one.others))
    first, *others = sorted(laws, key=lambda law: (not law.cost.holds, law.cost.total))
    return first.beside(one for one in others if one.cost.holds)


def _searched(space: Space, loops: Loops, rendering: Rendering, begin: FloatArray, *, from_afar: bool) -> Found:
    """Search from one start on."""
    stiffness = stiffness_at_rest(rendering)

    def weigh(points: FloatArray, hardest: Loops, per_growth: float) -> FloatArray:
        laws = space.laws(points, stiffness)
        costs = costs_of(laws, rendering, hardest)
        growth = [cost.growth_per_s if math.isfinite(cost.growth_per_s) else 0.0 for cost in costs]
        return np.minimum([cost.total for cost in costs] + per_growth * np.array(growth), _FAILED)

    def best_from(point: FloatArray, per_growth: float) -> Found:
        hardest = loops.hardest(space.law(point, stiffness), rendering)
        # A loop that grows is taken in hand slowly.
        ends = {} if per_growth else {"enough": _hardly_cheaper}
        for _ in range(_MOST_MISLED + 1):
            goal = partial(weigh, hardest=hardest, per_growth=per_growth)
            seen = evolve(goal, point, space.bounds, _SPREAD, MOST_LAWS * len(space.knobs), **ends)
            first, *others = (found_at(space, loops, rendering, one) for one in _apart(seen))
            if first.cost.holds or first.cost.total < _MISLED * cost_of(first.law, rendering, hardest).total:
                break
            # The loops that are hardest for this law were not among those that were for the first.
            hardest, point = hardest.and_of(loops.hardest(first.law, rendering)), first.logarithms
        return first.beside(one for one in others if one.cost.holds)

    found = best_from(begin, 0.0)
    if found.cost.holds or not math.isfinite(found.cost.growth_per_s):
        return found
    # What some loops lose by growing others may gain: then none may grow. From afar that is a way of its own.
    return best_from(begin if from_afar else found.logarithms, _PER_GROWTH)


def found_at(space: Space, loops: Loops, rendering: Rendering, logarithms: FloatArray) -> Found:
    """Weigh the law of one point before all loops; arguments as for `search`.

    Raises:
        numpy.linalg.LinAlgError: the point has no law.
    """
    law = space.law(logarithms, stiffness_at_rest(rendering))
    return Found(law, logarithms, cost_of(law, rendering, loops))


def _apart(seen: Seen) -> list[FloatArray]:
    """Take the cheapest point, and others that cost hardly more and are not next to one that was taken."""
    ranked = sorted(seen, key=itemgetter(0))
    taken: list[FloatArray] = []
    for cost, point in ranked:
        if len(taken) > _MOST_OTHERS or cost > _AS_CHEAP * ranked[0][0]:
            break
        if all(float(np.abs(point - other).max()) > _APART for other in taken):
            taken.append(point)
    return taken


def _hardly_cheaper(seen: Seen) -> bool:
    """Whether the last generations have made the cheapest hardly cheaper."""
    values = [value for value, _ in seen]
    before = values[: -_MORE * _POPULATION]
    return len(before) > _FIRST * _POPULATION and min(values) < _GROWS and min(values) > (1 - _SHARE) * min(before)


class _Without(MetaPathFinder):
    """Modules that this thread does not find, unless they are loaded already."""

    def __init__(self, *names: str) -> None:
        self._names, self._thread = names, get_ident()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Find nothing, for everybody else to look on."""
        if fullname in self._names and get_ident() == self._thread:
            raise ModuleNotFoundError(f"{fullname} is left out", name=fullname)


def _cma() -> Any:
    """Import the package without what it can do without: plotting and statistics cost a second and are not used."""
    unused = _Without("matplotlib", "matplotlib.pyplot", "scipy.stats")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is left out
        sys.meta_path.insert(0, unused)
        try:
            import cma  # noqa: PLC0415
        finally:
            sys.meta_path.remove(unused)
    return cma


def evolve(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    spread: float,
    evaluations: int,
    enough: Callable[[Seen], bool] = lambda _: False,
) -> Seen:
    """Minimise by covariance matrix adaptation (Hansen 2016); return what was seen.

    Args:
        function: points, shape (n, knobs), to values.
        start: where to begin.
        bounds: lower and upper.
        spread: of the first points.
        evaluations: at most.
        enough: asked after every generation, with what was seen so far.
    """
    cma = _cma()
    # Its own generator would seed numpy's, which belongs to the caller.
    draw: Any = np.random.default_rng(0).standard_normal
    options = {
        "bounds": [bound.tolist() for bound in bounds],
        "maxfevals": evaluations,
        "popsize": _POPULATION,
        "randn": lambda *shape: draw(shape),
        "seed": np.nan,
        "verbose": -9,
        "verb_log": 0,
    }
    evolution = cma.CMAEvolutionStrategy(np.clip(start, *bounds), spread, options)
    seen = [(float(function(start[None])[0]), start)]
    while not (evolution.stop() or enough(seen)):
        points = evolution.ask()
        values = function(np.array(points)).tolist()
        evolution.tell(points, values)
        seen += zip(values, map(np.asarray, points), strict=True)
    return seen
