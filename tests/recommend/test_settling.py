"""How long a released device swings in its wall is told, is what a simulation shows, and counts in what is chosen."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.margins import SETTLED, transients
from avc_casadi.model.gains import Gains

WHEEL = """
[device]
motion = "rotary"
handle_radius_m = 0.15
inertia_kgm2 = 0.05
damping_nms_per_rad = 0.02
sample_time_s = 0.0166667
delay_samples = 1
coulomb_friction_nm = 0.05
encoder_counts_per_turn = 65536
max_torque_nm = {limit}
[environment]
stiffness_nm_per_rad = 8.0
damping_nms_per_rad = 0.0
"""


def swinging(mass, damping, t, wall, damper, hand=(0.0, 0.0, 0.0), steps=50):
    """Return positions at the samples: a spring and damper held for a sample, the plant in fine explicit steps."""
    x, v, before, path = 1.0, 0.0, 1.0, []
    m, b, k = mass + hand[0], damping + hand[1], hand[2]
    for _ in range(4000):
        force, before = wall * x + damper * (x - before) / t, x
        path.append(x)
        for _ in range(steps):
            v -= t / steps * (force + b * v + k * x) / m
            x += t / steps * v
    return np.array(path)


@pytest.mark.parametrize("hand", [(0.0, 0.0, 0.0), (0.05, 4.0, 300.0)])
def test_it_is_the_time_that_a_simulated_device_takes(hand):
    t, mass, damping, wall, damper = 1e-3, 0.1, 0.5, 8000.0, 9.0
    ranges = dict(zip(("mass_kg", "damping_ns_per_m", "stiffness_n_per_m"), ([v, v] for v in hand), strict=True))
    problem = avc.load_problem("spring").changed(
        device={"mass_kg": mass, "damping_ns_per_m": damping, "sample_time_s": t},
        environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0},
        **({"hands": ranges} if any(hand) else {}),
    )
    found = transients(Coupling.constant(problem, Gains(0.0, 1e12, damper), "mine"))[int(any(hand))]
    path = np.abs(swinging(mass, damping, t, wall, damper, hand))
    largest = np.maximum.accumulate(path[::-1])[::-1]
    settled = t * float(np.argmax(largest < SETTLED))
    assert settled == pytest.approx(found.settling_s, rel=0.1, abs=1 / found.frequency_hz)
    peaks = np.flatnonzero((path[1:-1] > path[:-2]) & (path[1:-1] >= path[2:]) & (path[1:-1] > 0.01)) + 1
    assert t * float(np.diff(peaks).mean()) == pytest.approx(0.5 / found.frequency_hz, rel=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("limit", [8.0, 5.0])
def test_a_wheel_is_damped_until_it_settles(limit):
    """With the least damping that is stable it swings for seven seconds."""
    found = avc.recommend(avc.parse_problem(WHEEL.format(limit=limit)), hands=20)
    document = found.data()
    assert found.deployable
    assert document["felt"]["share_of_wall"] > 0.99
    assert document["transient"]["released"]["settling_s"] < 1.0


@pytest.mark.thorough
@pytest.mark.parametrize(
    "slip", [{"encoder_resolution_m": 0.055}, {"encoder_resolution_m": 0.04}, {"max_force_n": 0.0033}]
)
def test_what_renders_nothing_is_not_deployable(slip):
    problem = avc.load_problem("spring").changed(
        device={"coulomb_friction_n": 0.2, **slip}, environment={"stiffness_n_per_m": 1000.0}
    )
    found = avc.recommend(problem, hands=10)
    assert not found.deployable
    assert found.reason.startswith("nothing of the wall is rendered")
    assert next(iter(slip)) in found.reason
