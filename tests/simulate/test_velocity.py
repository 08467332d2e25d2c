"""Estimators of velocity against their algorithms in plain Python, in the region of zwidth, and refused by key."""

import math

import numpy as np
import plain_velocity
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.model.velocity import VelocityFilterEffect, velocity_poles

T, STEP = 1e-3, 2e-5
KEYS = {"first-order": {"cutoff_hz": 80.0}, "kalman": {"acceleration_m_per_s2": 5.0}}


def poles(estimator, **keys):
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "sample_time_s": T, "encoder_resolution_m": STEP}
    wall = {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1e3}
    problem = avc.Problem.model_validate(
        {"device": device, "environment": wall, "scene": {"effects": [{"kind": "wall"}, {"kind": "encoder"}]}}
    )
    return velocity_poles(problem, VelocityFilterEffect(estimator=estimator, **keys))


def rates(poles, way):
    """Velocities of the backward difference behind the poles, from rest at the first position."""
    found = [0.0, 0.0]
    for before, value in zip(np.append(way[0], way), way, strict=False):
        found.append((1 + sum(poles)) * (value - before) / T - poles[0] * found[-1] - poles[1] * found[-2])
    return found[2:]


@given(st.floats(1e-3, 1e4), st.floats(-1, 1))
def test_the_poles_of_the_kalman_filter_are_its_velocity(acceleration, phase):
    way = 1e-3 * np.cumsum(np.sin(np.arange(80) ** 1.3 + phase))
    plain = plain_velocity.Kalman(T, float(way[0]), acceleration, 1e-5)
    found = rates(poles("kalman", acceleration_m_per_s2=acceleration, noise_rms_m=1e-5), way)
    np.testing.assert_allclose(found, [plain(value) for value in way.tolist()], rtol=1e-5, atol=1e-6)


def test_the_first_order_lag_passes_a_held_velocity_by_its_exponential():
    ramp = rates(poles("first-order", cutoff_hz=80.0), 0.1 * T * np.arange(60))
    np.testing.assert_allclose(ramp, 0.1 * (1 - np.exp(-2 * math.pi * 80.0 * T * np.arange(60))), atol=1e-12)


@pytest.mark.parametrize("name", KEYS)
def test_zwidth_takes_each(name):
    text = (
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\nencoder_resolution_m = 2e-5\nmax_force_n = 5.0\n"
        "[environment]\nstiffness_n_per_m = 1e3\ndamping_ns_per_m = 2.0\n"
    )
    plain = avc.parse_problem(text, name="p")
    effects = [{"kind": "encoder"}, {"kind": "velocity-filter", "estimator": name, **KEYS[name]}]
    region = avc.zwidth(plain.changed(scene={"effects": effects}))
    curve, other = region.curves[-1], avc.zwidth(plain).curves[-1]
    assert not np.array_equal(curve.stiffness_n_per_m, other.stiffness_n_per_m, equal_nan=True)
    assert "scene.effects: velocity-filter" in region.used
