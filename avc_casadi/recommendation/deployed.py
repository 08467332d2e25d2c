"""Responses of a deployed coupling: rendered impedance, presses against time, and the open loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loops.margins import OpenLoop, Transient
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.scene import Press
from avc_casadi.recommendation.shaken import Shaken, shaken
from avc_casadi.simulation.population.motions import at_handle
from avc_casadi.simulation.population.setup import Setup, traces

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.hands import Hand

_SHAKEN_HZ = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 70.0, 100.0)
_PRESSED_S = 1.0
STRUCK_M_PER_S = 0.1
"""Impact speed in the linear loop."""
# Duration over the settling time, and the largest number of samples.
_BEYOND, _MOST = 1.2, 5000


@dataclass(frozen=True, eq=False)
class Deployed:
    """Responses of a coupling with h corners of the hands.

    Attributes:
        coupling: gains and runtime.
        shaken: rendered impedance of the excited handle.
        hands: the corners.
        worst: the one with the least damped loop.
        press_s: time of the presses, shape (n,).
        press_m: position of each pressing hand, with every declared effect simulated, shape (h, n).
        loop: broken at the actuator, with the corners, then released.
        frequency_hz: of its gain, shape (f,).
        gain: L, shape (h + 1, f).
        struck_s: time after impact, shape (m,).
        struck_m: position of the device in the linear loop, shape (h + 1, m).
    """

    coupling: Coupling
    shaken: Shaken
    hands: Hand
    worst: int
    press_s: FloatArray
    press_m: FloatArray
    loop: OpenLoop
    frequency_hz: FloatArray
    gain: ComplexArray
    struck_s: FloatArray
    struck_m: FloatArray


def deployed(coupling: Coupling) -> Deployed:
    """Return the responses of a coupling."""
    problem = coupling.problem
    device, period = problem.device, problem.device.sample_time_s
    hands = hand_corners(problem.hands.model_copy(update={"let_go": False}))
    loop = OpenLoop.of(coupling)
    each = [Transient.of(one, period) for one in loop.poles]
    settled_s = [one.settling_s for one in each if np.isfinite(one.settling_s)]
    samples = int(np.clip(_BEYOND * max(settled_s, default=0.0) / period, 50, _MOST))
    turn = loop.turns()
    # The wall's face lies at mid-step of the encoder, as in a scene.
    setup = replace(Setup.of(coupling), steps_anywhere=False)
    pressed = np.concatenate(
        [
            one.position_m if one.held_m is None else one.held_m
            for one in traces(setup, hands, at_handle(Press(), device), _PRESSED_S)
        ]
    )
    return Deployed(
        coupling=coupling,
        shaken=shaken(coupling, coupling.static_stiffness_n_per_m, _SHAKEN_HZ),
        hands=hands,
        worst=int(np.argmin([one.damping_ratio for one in each[:-1]])),
        press_s=np.asarray(period * np.arange(pressed.shape[-1])),
        press_m=pressed,
        loop=loop,
        frequency_hz=turn / (2 * np.pi * period),
        gain=loop.gain(turn),
        struck_s=np.asarray(period * np.arange(samples)),
        struck_m=loop.struck(STRUCK_M_PER_S / device.metres_per_unit, samples),
    )
