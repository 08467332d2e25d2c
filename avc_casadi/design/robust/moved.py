"""The law of one device as the beginning of a search for one that is much like it."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.robust.cma_continuation import Step, candidate_at
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.preconditions import softened
from avc_casadi.design.robust.uncertainty_set import Loops

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def moved(step: Step, before: Problem, problem: Problem) -> Step | None:
    """Take the numbers of a law for another device, each as far from where its search begins as before.

    Args:
        step: a wall and its law, which need not hold on the other device.
        before: the device that it was found for.
        problem: the other device, before the same wall.

    Returns:
        The same wall on the other device; None where the numbers give no law there.
    """
    space, usual = Space(problem.device, problem.hands), Space(before.device, before.hands)
    names = [knob.name for knob in usual.knobs]
    away = dict(zip(names, step.best.logarithms - usual.starts[0], strict=True))
    logarithms = np.clip(space.starts[0] + [away.get(knob.name, 0.0) for knob in space.knobs], *space.bounds)
    gains, rendering = softened(problem, step.stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        found = candidate_at(space, Loops.of(problem.device, problem.hands), rendering, logarithms)
        return Step(gains, step.stiffness_n_per_m, (found,))
    return None
