"""A structure that resonates, undeclared and held by nobody, is named; a delay that is declared is not."""

import math

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.diagnose.causes import diagnose
from avc_casadi.identification.log import Columns

PERIOD_S = 1e-3
HZ, RATIO, HANDLE = 110.0, 0.02, 0.4


def notched(hertz):
    """The notch of [law], 20 dB deep and as wide as its frequency, by scipy's bilinear rule."""
    rate = 2 / PERIOD_S * math.tan(math.pi * hertz * PERIOD_S)
    return signal.bilinear([1, 0.1 * rate, rate**2], [1, rate, rate**2], fs=1 / PERIOD_S)


def released(stiffness, damping, limit_n=20.0, samples=1500, notch_hz=None, filter_hz=None):
    """Positions of the handle and forces of a spring and damper, a sample late, on a motor with a handle behind it."""
    above, below = ([1.0], [1.0]) if notch_hz is None else notched(notch_hz)
    memory = np.zeros(len(above) - 1)
    keep, speed = 0.0 if filter_hz is None else math.exp(-2 * math.pi * filter_hz * PERIOD_S), 0.0
    moved = np.array([0.12 * (1 - HANDLE), 0.12 * HANDLE])
    reduced = moved.prod() / moved.sum()
    spring, damper = reduced * (2 * math.pi * HZ) ** 2, 2 * RATIO * reduced * 2 * math.pi * HZ
    rate = np.zeros((5, 5))
    rate[0, 2] = rate[1, 3] = 1.0
    rate[2] = np.array([-spring, spring, -damper - 0.8, damper, 1.0]) / moved[0]
    rate[3] = np.array([spring, -spring, damper, -damper, 0.0]) / moved[1]
    step = expm(PERIOD_S * rate)[:4]
    state, waiting, last = np.array([5e-4, 5e-4, 0.0, 0.0]), 0.0, 5e-4
    rows = []
    for _ in range(samples):
        position = round(state[1] / 1e-5) * 1e-5
        speed = keep * speed + (1 - keep) * (position - last) / PERIOD_S
        (force,), memory = signal.lfilter(above, below, [-stiffness * position - damping * speed], zi=memory)
        force = min(max(force, -limit_n), limit_n)
        rows.append((position, force))
        state, waiting, last = step @ [*state, waiting], force, position
    return np.array(rows).T


@pytest.mark.slow
def test_a_released_device_that_resonates_behind_its_motor_gets_no_delay_and_remedies_that_hold(tmp_path):
    file = tmp_path / "device.toml"
    file.write_text(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\nencoder_resolution_m = 1e-5\n"
    )
    position, force = released(2500.0, 22.0)
    assert np.ptp(position[-300:]) > 1e-3
    log = Columns("log.csv", PERIOD_S * np.arange(len(position)), position, force)
    found = diagnose(log, device=avc.load_device(str(file)).device)
    assert found.cause == "resonance"
    for remedy in found.remedies:
        names = {"stiffness_n_per_m": "stiffness", "damping_ns_per_m": "damping", "velocity_filter_hz": "filter_hz"}
        changed = {"stiffness": 2500.0, "damping": 22.0} | {names.get(remedy.key, remedy.key): remedy.value}
        settled, _ = released(**changed, samples=4000)
        assert np.ptp(settled[-300:]) <= 3e-5
