"""Contact onset of a wall for a moving hand: the depth at which the device's force sets in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.model.hands import Hand
from avc_casadi.model.scene import Press
from avc_casadi.simulation.population.setup import Setup, traces

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

SPEEDS_M_PER_S = (0.1, 0.4)
"""Approach speeds of exploration and of a strike."""
NOTICED_N = 0.1
"""Detectable force."""
# Grip stiff enough that the wall does not slow the hand.
_FIRM = Hand(np.array([1.0]), np.array([600.0]), np.array([1e5]))
_FROM_M = -0.04
REACHED_M = 0.01
"""Depth to which the hand is led, at the handle."""


def contact_onset_m(coupling: Coupling) -> dict[str, float | None]:
    """Return the depth at which the device's force sets in, by speed of the hand; below 0 before the wall.

    The hand comes from free space, every declared effect simulated; None where no force is felt within `REACHED_M`.
    """
    device = coupling.problem.device
    radius, hand = device.metres_per_unit, _FIRM.at_handle(device.metres_per_unit)
    found: dict[str, float | None] = {}
    for speed in SPEEDS_M_PER_S:
        press = Press(start_m=_FROM_M / radius, end_m=REACHED_M / radius, speed_m_per_s=speed / radius)
        duration_s = (REACHED_M - _FROM_M) / speed
        (run,) = traces(Setup.of(coupling), hand, press, duration_s)
        pushed = np.flatnonzero(run.force_n[0] / radius > NOTICED_N)
        found[f"{speed / radius:g}"] = float(run.depth_m[0, pushed[0]]) if len(pushed) else None
    return found
