"""Rebound of the released device: its speed when it leaves the wall over that when it came."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.model.hands import Hand
from avc_casadi.model.scene import Hold
from avc_casadi.recommendation.contact_onset import SPEEDS_M_PER_S
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.population.setup import FRICTION, Setup, engine_for, prepare

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.coupling import Coupling

# Far enough for an observer to know the speed before the wall, and the duration after that.
_FROM_M, _LATER_S = 0.03, 0.5
# Strikes at each speed, the wall's face anywhere between two encoder steps; steps of the approach.
_STRIKES, _BACK = 8, 200


def rebound(coupling: Coupling) -> dict[str, float]:
    """Return the largest rebound by approach speed, with the declared dry friction and without.

    Above 1 the wall gives energy: a passive one never does. 0 where the device stays in the wall, or does not reach it.
    Speeds are the device's, in rad/s of a rotary one.
    """
    setup, radius = Setup.of(coupling), coupling.problem.device.metres_per_unit
    some = (setup, setup.without(FRICTION)) if setup.rough else (setup,)
    return {
        f"{speed / radius:g}": max(float(_strikes(one, speed / radius).max()) for one in some)
        for speed in SPEEDS_M_PER_S
    }


def _strikes(setup: Setup, speed_m_per_s: float) -> FloatArray:
    """Return the rebound of each strike, shape (strikes,)."""
    device = setup.problem.device
    friction_n = device.coulomb_friction_n if setup.rough else 0.0
    far = _FROM_M / device.metres_per_unit
    # Back from the wall: m v dv/dx = -(friction + b v).
    start = speed_m_per_s
    for _ in range(_BACK):
        start += far / _BACK * (friction_n / start + device.damping_ns_per_m) / device.mass_kg
    nobody = Hand(*(np.zeros(_STRIKES),) * 3)
    duration_s = far / speed_m_per_s + _LATER_S
    scene, parameters, inputs = prepare(setup, nobody, Hold(start_m=-far, end_m=-far), duration_s)
    moving = [start if name.endswith("_velocity_m_per_s") else 0.0 for name in scene.states]
    run = execute(replace(scene, initial=scene.initial + moving), parameters, inputs, engine=engine_for(_STRIKES))
    return np.array([_rebound(*pair) for pair in zip(run["position_m"], run["velocity_m_per_s"], strict=True)])


def _rebound(position_m: FloatArray, velocity_m_per_s: FloatArray) -> float:
    inside = position_m > 0
    came = int(np.argmax(inside))
    left = came + int(np.argmax(~inside[came:]))
    if not inside[came] or left == came:
        return 0.0
    return float(-velocity_m_per_s[left] / velocity_m_per_s[came - 1])
