"""Force ripple from encoder quantisation during motion, against the vibrotactile detection threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.model.scene import Press
from avc_casadi.recommendation.shaken import led
from avc_casadi.simulation.judge import QUIET
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.setup import Setup, traces

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

SPEEDS_M_PER_S = (0.02, 0.05)
"""Slow hand motions: at higher speed the encoder steps are more frequent and less detectable."""
# Duration of the prescribed motion, of which the last part is evaluated; the moved hands' is the same.
_LED_S, _COUNTS_S, _DRAWN_S = 1.0, 0.5, 1.5
# Relative increase of the prescribed speed over the motion.
_FASTER = 0.2
_HANDS = 16


@dataclass(frozen=True)
class Ripple:
    """Force ripple from encoder quantisation on a handle in steady motion in the wall.

    Attributes:
        force_n: rms of the ripple by speed of the device, m/s.
        hands: number simulated at the lowest of these.
        quiet: how many of them stay below the vibrotactile detection threshold.
    """

    force_n: dict[str, float]
    hands: int
    quiet: int


def ripple(coupling: Coupling, seed: int = 0) -> Ripple:
    """Return the ripple in steady motion, prescribed first, then by hands whose target moves.

    With a damper of b behind a step of the encoder q the force has pulses of b q/T, for b sqrt(q v/T - v^2) rms while
    the handle passes less than a step in a sample.
    """
    problem = coupling.problem
    radius = problem.device.metres_per_unit
    speeds = [speed / radius for speed in SPEEDS_M_PER_S]
    found = {f"{speed:g}": ripple_n(coupling, speed) for speed in speeds}
    people = people_of(problem.hands, _HANDS, seed)
    slowest = speeds[0]
    drawn = Press(start_m=0.0, end_m=2 * slowest * _DRAWN_S, speed_m_per_s=slowest)
    felt = [part.vibration for part in traces(Setup.of(coupling), people, drawn, _DRAWN_S)]
    return Ripple(found, len(people), int((np.concatenate(felt) < QUIET).sum()))


def ripple_n(coupling: Coupling, speed_per_s: float) -> float:
    """Return the rms force ripple of the encoder on a handle in prescribed motion in the wall."""
    device = coupling.problem.device
    if device.encoder_resolution_m == 0:
        return 0.0
    period = device.sample_time_s
    time = period * np.arange(round(_LED_S / period) + 1)
    goes = speed_per_s * time * (1 + _FASTER * (time / (2 * _LED_S) - 0.5))
    last = slice(-max(8, round(_COUNTS_S / period)), None)
    added = led(coupling, goes)[1][last] - led(coupling, goes, exact=True)[1][last]
    line = np.polynomial.Polynomial.fit(time[:-1][last], added, 1)
    return float(np.std(added - line(time[:-1][last])))
