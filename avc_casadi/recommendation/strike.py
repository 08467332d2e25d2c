"""Strikes faster than those of the trial: how many hands settle after them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi.model.scene import Press
from avc_casadi.simulation.population.motions import at_handle, course_of
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import Conditions, resting

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

STRIKES_M_PER_S = (0.3, 0.5, 1.0)
"""Speeds of the hand; a tap of the trial has 0.19 m/s at most."""
STRIKING = 32
"""Number of hands, the corners of [hands] among them."""
# The hand comes from so far, and goes on as far into the wall as in a press.
_FROM_M = -0.05


def strikes(coupling: Coupling, seed: int = 0) -> dict[str, int]:
    """Return how many of `STRIKING` hands settle after a strike, by its speed, with the declared dry friction.

    A loop that is stable may go on for ever once it is thrown to its force limit. Speeds are the device's, in rad/s of
    a rotary one.

    Args:
        coupling: gains and runtime.
        seed: of the draw of the hands.
    """
    problem, radius = coupling.problem, coupling.problem.device.metres_per_unit
    people, duration_s = people_of(problem.hands, STRIKING, seed), course_of(problem).longest_s
    gains = coupling.table.at_rest if coupling.table.constant else coupling.table
    found = {}
    for speed in STRIKES_M_PER_S:
        motion = at_handle(Press(start_m=_FROM_M, speed_m_per_s=speed), problem.device)
        settled = resting(problem, gains, people, (motion, duration_s), Conditions.of(coupling))
        found[f"{speed / radius:g}"] = int(settled.sum())
    return found
