"""The search for a law: covariance matrix adaptation over its numbers, the same every time."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
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

_FAILED = 1e4
_POPULATION = 10
FROM_AFAR, FROM_NEAR = (0.35, 100), (0.2, 30)
"""Spread of the first generation and laws for each knob: from the usual start, and from the law of a near wall."""


@dataclass(frozen=True)
class Found:
    """A law, where it stands in the search space, and what it costs."""

    law: StateFeedback
    logarithms: FloatArray
    cost: Cost


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
        start: logarithms of a near law; None is the usual start.

    Raises:
        numpy.linalg.LinAlgError: the start has no law.
    """
    spread, for_each_knob = FROM_AFAR if start is None else FROM_NEAR
    begin = space.start if start is None else start
    stiffness = stiffness_at_rest(rendering)
    hardest = loops.hardest(space.law(begin, stiffness), rendering)

    with ThreadPoolExecutor(1) as beside:

        def weigh(points: FloatArray) -> FloatArray:
            laws = space.laws(points, stiffness)
            first, second = np.array_split(np.arange(len(laws)), 2)
            other = beside.submit(costs_of, laws.pick(second), rendering, hardest)
            costs = costs_of(laws.pick(first), rendering, hardest) + other.result()
            return np.minimum([cost.total for cost in costs], _FAILED)

        best = _evolve(weigh, begin, space.bounds, spread, for_each_knob * len(space.knobs))
    law = space.law(best, stiffness)
    return Found(law, best, cost_of(law, rendering, loops))


def _evolve(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    spread: float,
    evaluations: int,
) -> FloatArray:
    """Minimise by covariance matrix adaptation (Hansen 2016)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own plotting, on import
        import cma  # noqa: PLC0415

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
    least, best = function(start[None])[0], start
    while not evolution.stop():
        points = evolution.ask()
        values = function(np.array(points))
        evolution.tell(points, values.tolist())
        place = int(np.argmin(values))
        if values[place] < least:
            least, best = values[place], np.asarray(points[place])
    return best
