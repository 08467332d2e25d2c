"""The complex error that is told is that of a hand that shakes the device: force over velocity, integrated in time."""

import numpy as np
import pytest
from scipy.linalg import expm
from studies.error_curve import error_curve

import avc_casadi as avc
from avc_casadi.model.gains import Gains

T, STEPS = 1e-3, 20
STIFFNESS, DAMPING = 1200.0, 1.0
RIGID = {"mass_kg": 0.2, "damping_ns_per_m": 3.0, "sample_time_s": T}
MODE = {"frequency_hz": 60.0, "damping_ratio": 0.06, "mass_ratio": 0.4}
DEVICES = {
    "ideal": {},
    "late": {"delay_samples": 1.4},
    "amplifier": {"amplifier_bandwidth_hz": 300.0},
    "amplifier of second order, late": {
        "amplifier_bandwidth_hz": 200.0,
        "amplifier_order": 2,
        "delay_samples": 1.0,
    },
    "structure": {"resonance": MODE},
    "structure, encoder at the handle": {"resonance": MODE, "encoder_at": "handle", "delay_samples": 0.5},
}


def plant(device):
    """States: motor x, v; handle x, v; lagged force and its rate. Inputs: commanded force, push of the hand."""
    mode, m, b = device.get("resonance"), device["mass_kg"], device["damping_ns_per_m"]
    a, inputs = np.zeros((6, 6)), np.zeros((6, 2))
    if mode is None:
        a[0, 1], a[1, 1], a[1, 4], inputs[1, 1] = 1.0, -b / m, -1 / m, 1 / m
    else:
        handle = mode["mass_ratio"] * m
        motor, reduced, rate = m - handle, handle * (1 - mode["mass_ratio"]), 2 * np.pi * mode["frequency_hz"]
        k, c = reduced * rate**2, 2 * mode["damping_ratio"] * reduced * rate
        a[0, 1], a[2, 3] = 1.0, 1.0
        a[1] = np.array([-k, -c - b, k, c, -1.0, 0.0]) / motor
        a[3] = np.array([k, c, -k, -c, 0.0, 0.0]) / handle
        inputs[3, 1] = 1 / handle
    lag = 2 * np.pi * device.get("amplifier_bandwidth_hz", 1e5)
    if device.get("amplifier_order", 1) == 1:
        a[4, 4], inputs[4, 0] = -lag, lag
    else:
        a[4, 5], a[5, 4], a[5, 5], inputs[5, 0] = 1.0, -(lag**2), -1.4 * lag, lag**2
    return a, inputs


def shaken(device, frequency_hz):
    """Return the force over the velocity at the handle, at that frequency."""
    a, inputs = plant(device)
    step = T / STEPS
    whole = np.zeros((8, 8))
    whole[:6, :6], whole[:6, 6:] = a, inputs
    advance = expm(whole * step)
    handle = 0 if device.get("resonance") is None else 2
    seen = handle if device.get("encoder_at") == "handle" else 0
    late = round(device.get("delay_samples", 0.0) * STEPS)
    each = round(1 / (frequency_hz * step))
    count = each * max(20, round(4 * frequency_hz))  # until what swings on its own has died out
    push = np.sin(2 * np.pi * np.arange(count) / each)
    held, state, before, force = np.zeros(count + late + 1), np.zeros(6), 0.0, 0.0
    velocity = np.empty(count)
    for at in range(count):
        if at % STEPS == 0:
            force = STIFFNESS * state[seen] + DAMPING * (state[seen] - before) / T
            before = state[seen]
        held[at + late] = force
        velocity[at] = state[handle + 1]
        state = advance[:6] @ np.concatenate([state, [held[at], push[at]]])
    last = slice(count - 10 * each, count)
    wave = np.exp(-2j * np.pi * np.arange(count)[last] / each)
    # The push is held for a step, half of which it is late.
    return (push[last] @ wave) / (velocity[last] @ wave) * np.exp(-1j * np.pi / each)


@pytest.mark.parametrize("name", DEVICES)
@pytest.mark.parametrize("frequency_hz", [5.0, 40.0])
def test_a_shaken_device_has_the_error_that_is_told(name, frequency_hz):
    device = RIGID | DEVICES[name]
    problem = avc.load_problem("soft").changed(
        device=device, environment={"stiffness_n_per_m": STIFFNESS, "damping_ns_per_m": DAMPING}
    )
    curve = error_curve(problem, Gains(0.0, 1e12), np.array([frequency_hz]))
    s = 2j * np.pi * frequency_hz
    wall = RIGID["mass_kg"] * s + RIGID["damping_ns_per_m"] + DAMPING + STIFFNESS / s
    measured = abs(shaken(device, frequency_hz) - wall) / abs(wall)
    assert curve.physical[0] == pytest.approx(measured, rel=0.005, abs=1e-4)
