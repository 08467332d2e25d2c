"""Where nothing can be recommended, the reason is the true one, and what may be a slip of a unit stands before it."""

import math

import numpy as np
import pytest

import avc_casadi as avc

DEVICE = {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 1}


def asked(device, **wall):
    return avc.Problem(
        device=DEVICE | device, environment=wall, stability={"model": "sampled-data", "scope": "hands"}, name="asked"
    )


def decays(damper, mass=0.2, drag=1.0, period=1e-3, seconds=2.0):
    """A released device on a damper, its force a sample late and held: exact steps of the mass, written out."""
    kept = math.exp(-drag * period / mass)
    lasts = (1 - kept) / drag
    position, speed, before, acts = 0.0, 0.1, 0.0, 0.0
    swung = []
    for _ in range(int(seconds / period)):
        force = damper * (position - before) / period
        before = position
        position += mass * lasts * speed - acts * (period - mass * lasts) / drag
        speed = kept * speed - lasts * acts
        acts = force
        swung.append(abs(speed))
    return np.max(swung[-100:]) < 1e-3


def test_a_damper_that_is_too_strong_is_told_with_the_largest_that_is_stable():
    reason = avc.recommend(asked({}, stiffness_n_per_m=0.0, damping_ns_per_m=500.0)).reason
    most = float(reason.split("above ")[1].split(" ")[0])
    assert decays(0.98 * most)
    assert not decays(1.02 * most)


@pytest.mark.thorough
def test_what_is_only_linearly_stable_is_no_help_where_hands_refute_it():
    engine = {"tool_mass_kg": 0.05, "step_s": 0.004, "integrator": "explicit", "exchange": "held-force"}
    device = {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 1, "max_force_n": 8.0}
    problem = avc.Problem(device=device, simulation=engine | {"stiffness_n_per_m": 2000.0}, name="asked")
    found = avc.recommend(problem)
    assert found.coupling is None
    assert found.pair.stiffest.stiffness_n_per_m > 2000
    assert (found.pair.least_tool_mass_kg, found.pair.slowest_step_s, found.pair.exchanges) == (None, None, {})
    assert "same K" not in str(found)
