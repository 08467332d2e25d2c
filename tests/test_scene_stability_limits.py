"""Where scenes lose stability: against the exact spectral radius, written independently, and the measured ratios."""

import math

import casadi as ca
import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.model.corners import device_with
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene

T = 1e-3
RELEASED = 'kind = "hold"\nend_m = -0.001\n'


def scene_radius(problem, gains):
    """Spectral radius of the Jacobian of one sample, of a scene without any switch."""
    scene = compile_scene(problem, coupled=not gains.rigid, damped=gains.contact_damping_ns_per_m > 0)
    function = scene.function
    states, inputs, parameters = (ca.SX.sym(name, function.sparsity_in(i)) for i, name in enumerate("xup"))
    rate = ca.jacobian(function(states, inputs, parameters)[0], states)
    matrix = ca.Function("rate", [states, inputs, parameters], [rate])
    value = matrix(scene.initial, 0, scene.parameter_values(gains)[0]).full()
    return np.abs(np.linalg.eigvals(value)).max()


def two_sided(k_e, b_e=0.0, delay=0, hand=None):
    effects = [f'kind = "environment"\nstiffness_n_per_m = {k_e}\ndamping_ns_per_m = {b_e}']
    if delay:
        effects.append(f'kind = "delay"\nsamples = {delay}')
    if hand:
        names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
        effects.append('kind = "hand"\n' + "\n".join(f"{n} = {v}" for n, v in zip(names, hand, strict=True)))
    return scene_problem(effects, motion=RELEASED)


@pytest.mark.parametrize("delay", [0, 1, 4])
@pytest.mark.parametrize(
    "gains", [NO_COUPLING, Gains(10, 7e3), Gains(200, 1e5), Gains(math.inf, math.inf, 80), Gains(30, 2e4, 25)]
)
def test_the_jacobian_of_a_sample_has_the_independent_spectral_radius(gains, delay):
    hand = (0.17, 9.0, 450.0)
    problem = two_sided(1e5, 10.0, delay, hand)
    device = device_with(problem.device, {"delay_samples": delay})
    parts = frozen_parts(problem, np.array([gains.damping_ns_per_m]), np.array([gains.stiffness_n_per_m]))
    hands = Hand(*hand)
    independent = linear_stability(device, parts, gains.contact_damping_ns_per_m, hands).radius[0, 0]
    assert scene_radius(problem, gains) == pytest.approx(independent, abs=1e-10)


def limit(b_e=0.0, delay=0, hand=None):
    low, high = 10.0, 1e6
    for _ in range(40):
        middle = math.sqrt(low * high)
        stable = scene_radius(two_sided(middle, b_e, delay, hand), NO_COUPLING) < 1
        low, high = (middle, high) if stable else (low, middle)
    return low


@pytest.mark.parametrize(("b_e", "ratio"), [(0.0, 1.003), (5.0, 0.955), (50.0, 0.61), (100.0, 0.34)])
def test_virtual_damping_buys_less_and_less(b_e, ratio):
    found = limit(b_e)
    assert found * T / (2 * (2.0 + b_e)) == pytest.approx(ratio, abs=0.005)
    for share, grows in ((0.97, False), (1.03, True)):
        x = simulate(two_sided(share * found, b_e), NO_COUPLING).position_m
        early, late = np.abs(x[:100]).max(), np.abs(x[-100:]).max()
        assert (late > early) == grows


def test_one_sample_of_delay_with_a_hand_leaves_a_third():
    hand = (0.2, 10.0, 500.0)
    assert limit(0.0, 1, hand) / limit(0.0, 0, hand) == pytest.approx(0.335, abs=0.01)
    assert limit(0.0, 0, hand) == pytest.approx(2 * 12.0 / T, rel=0.03)
