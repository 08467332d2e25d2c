"""The law of one device as the beginning of a search for one that is much like it."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.robust.ladder import Rung, softened
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.design.robust.search import found_at

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def moved(rung: Rung, before: Problem, problem: Problem) -> Rung | None:
    """Take the numbers of a law for another device, each as far from where its search begins as before.

    Args:
        rung: a wall and its law, which need not hold on the other device.
        before: the device that it was found for.
        problem: the other device, before the same wall.

    Returns:
        The same wall on the other device; None where the numbers give no law there.
    """
    space, usual = Space(problem.device, problem.hands), Space(before.device, before.hands)
    names = [knob.name for knob in usual.knobs]
    away = dict(zip(names, rung.found.logarithms - usual.starts[0], strict=True))
    logarithms = np.clip(space.starts[0] + [away.get(knob.name, 0.0) for knob in space.knobs], *space.bounds)
    gains, rendering = softened(problem, rung.stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        found = found_at(space, Loops.of(problem.device, problem.hands), rendering, logarithms)
        return Rung(gains, rung.stiffness_n_per_m, found)
    return None
