"""The exactly discretised loop: propagation, measured stability limits, hands and delay."""

import numpy as np
import pytest
from scipy.linalg import expm

from avc_casadi import parse_problem
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import (
    SampledLoop,
    fractions,
    frozen_parts,
    linear_stability,
    plants_of,
)
from avc_casadi.model.hands import Hand, no_hand

T = 1e-3


def problem(b_d=2.0, delay=0, mass=0.1, b_e=10.0, k_e=1e5):
    return parse_problem(
        f"[device]\nmass_kg={mass}\ndamping_ns_per_m={b_d}\nsample_time_s={T}\ndelay_samples={delay}\n"
        f"[environment]\ndamping_ns_per_m={b_e}\nstiffness_n_per_m={k_e}\n"
    )


def moved(m, b, k):
    """Position and velocity by the sample after a sample with a held force, from those before and the force."""
    body = Body.of(plants_of([problem(b_d=b, mass=m).device], Hand(0.0, 0.0, k))).flat()
    return np.concatenate([body.a[0], -body.b[0][:, None]], axis=1)


@pytest.mark.parametrize(
    ("m", "b", "k"), [(0.1, 2, 0), (0.1, 2, 500), (1e-6, 2, 0), (0.2, 0, 800), (5, 1e3, 1e4), (0.1, 0, 0)]
)
def test_propagation_is_the_matrix_exponential(m, b, k):
    exact = expm(np.array([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]]) * T)[:2]
    exact = np.array([[exact[0, 0], exact[0, 1] / T, exact[0, 2]], [exact[1, 0] * T, exact[1, 1], exact[1, 2] * T]])
    np.testing.assert_allclose(moved(m, b, k), exact, rtol=1e-11, atol=1e-15)


@pytest.mark.parametrize(("b", "k"), [(2.0, 500.0), (2.0, 0.0), (0.0, 500.0)])
def test_propagation_of_no_mass_is_the_limit_of_little_mass(b, k):
    light, none = moved(1e-9, b, k), moved(0.0, b, k)
    if b > 0:
        np.testing.assert_allclose(none[0, [0, 2]], light[0, [0, 2]], rtol=1e-5)
    else:
        np.testing.assert_allclose(none[0], [0, 0, 1 / k])


def largest_wall(b_d, b_e, delay, hand):
    """Largest wall stiffness that is linearly stable when rendered directly, N/m."""
    low, high = 0.0, 1e6
    device = problem(b_d, delay).device
    for _ in range(50):
        middle = (low + high) / 2
        wall = fractions(SampledLoop(b_d, b_e, np.array([middle]), T, delay, "sampled-data"), np.inf, 1.0)
        low, high = (middle, high) if linear_stability(device, wall, 0.0, hand).radius.max() < 1 else (low, middle)
    return low


@pytest.mark.parametrize(("b_e", "ratio"), [(0, 1.003), (5, 0.955), (50, 0.605), (100, 0.340)])
def test_limits_without_a_hand(b_e, ratio):
    assert largest_wall(2.0, float(b_e), 0, no_hand()) * T / (2 * (2 + b_e)) == pytest.approx(ratio, abs=1e-3)


def test_delay_leaves_nothing_of_a_heavily_damped_wall():
    assert largest_wall(2.0, 100.0, 1, no_hand()) < 1.0


def test_delay_leaves_a_third_with_a_hand():
    hand = Hand(0.2, 10.0, 500.0)
    free, delayed = largest_wall(2.0, 0.0, 0, hand), largest_wall(2.0, 0.0, 1, hand)
    assert delayed / free == pytest.approx(0.335, abs=2e-3)
    assert delayed == pytest.approx(2 / 3 * (2 + 10) / T, rel=0.02)


def step_by_step(case, b, k, contact, hand, samples):
    """The same loop as a program would run it: sampled position, joint of coupling and wall, held and delayed force."""
    device, wall = case.device, case.environment
    m, c, spring = (
        device.mass_kg + hand.mass_kg,
        device.damping_ns_per_m + hand.damping_ns_per_m,
        hand.stiffness_n_per_m,
    )
    step = expm(np.array([[0, 1, 0], [-spring / m, -c / m, 1 / m], [0, 0, 0]]) * T)[:2]
    x, v, before, joint = 1e-3, 0.0, 1e-3, 0.0
    waiting = [0.0] * device.delay_samples
    trace = []
    for _ in range(samples):
        b_e, k_e = wall.damping_ns_per_m, wall.stiffness_n_per_m
        # Force balance of the joint: b (dx - dy)/T + k (x - y) = b_e dy/T + k_e y.
        new_joint = (b * (x - before) / T + k * x + (b + b_e) * joint / T) / ((b + b_e) / T + k + k_e)
        force = b_e * (new_joint - joint) / T + k_e * new_joint + contact * (x - before) / T
        waiting.append(force)
        before, joint = x, new_joint
        x, v = step @ np.array([x, v, -waiting.pop(0)])
        trace.append(x)
    return np.array(trace)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize(("b", "k", "contact"), [(5.0, 3e3, 0.0), (1.0, 2e4, 0.0), (50.0, 5e4, 20.0)])
def test_spectral_radius_is_the_growth_of_the_running_loop(delay, b, k, contact):
    case = problem(delay=delay)
    hand = Hand(0.05, 3.0, 800.0)
    radius = linear_stability(case.device, frozen_parts(case, b, k), contact, hand).radius[0, 0]
    trace = np.abs(step_by_step(case, b, k, contact, hand, 1200))
    early, late = trace[400:800].max(), trace[800:1200].max()
    assert (late / early) ** (1 / 400) == pytest.approx(radius, abs=2e-3)
