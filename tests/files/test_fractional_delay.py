"""A delay of part of a sample: judged where that is exact, refused by name where only whole samples are known."""

import numpy as np
import pytest
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import frozen_parts, linear_stability, wall
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant

T = 1e-3
HAND = Hand(np.array([0.05]), np.array([3.0]), np.array([800.0]))


def text_of(delay):
    text = f"[device]\nmass_kg=0.1\ndamping_ns_per_m=2\ndelay_samples={delay}\n[environment]\ndamping_ns_per_m=10\n"
    return text + "stiffness_n_per_m=1e5\n[frequency]\nstop_hz=400\npoints=5\n"


def problem(delay, **tables):
    return avc.parse_problem(text_of(delay)).changed(**tables)


def marched(case, b, k, contact, samples):
    """The loop in steps of a thousandth of a sample, the force arriving where the delay says."""
    device, wall, parts = case.device, case.environment, 1000
    m, damping = 0.15, 5.0
    step = expm(np.array([[0, 1, 0], [-800 / m, -damping / m, -1 / m], [0, 0, 0]]) * T / parts)[:2]
    late = round(device.delay_samples * parts)
    forces, state, before, joint, trace = [], np.array([0.0, 0.1]), 0.0, 0.0, []
    for sample in range(samples):
        b_e, k_e, x = wall.damping_ns_per_m, wall.stiffness_n_per_m, state[0]
        new = (b * (x - before) / T + k * x + (b + b_e) * joint / T) / ((b + b_e) / T + k + k_e)
        forces.append(b_e * (new - joint) / T + k_e * new + contact * (x - before) / T)
        before, joint = x, new
        trace.append(x)
        for part in range(parts):
            arrived = (sample * parts + part - late) // parts
            state = step @ np.array([*state, forces[arrived] if arrived >= 0 else 0.0])
    return np.array(trace)


@pytest.mark.parametrize("delay", [0.25, 0.6, 1.0, 1.7, 2.5])
def test_the_judged_loop_is_the_marched_one(delay):
    case = problem(delay)
    rendering = ContactLaw.of(case, 5.0, 2e4, 10.0).rendering
    matrix = wall(Body.of(sampled_plant(case.device, HAND)).flat(), rendering)[0]
    state, trace = np.zeros(len(matrix)), []
    state[1] = 0.1 * T  # metres a sample
    for _ in range(100):
        trace.append(state[0])
        state = matrix @ state
    np.testing.assert_allclose(trace, marched(case, 5.0, 2e4, 10.0, 100), rtol=0, atol=1e-9 * np.abs(trace).max())
    radius = linear_stability(case.device, frozen_parts(case, 5.0, 2e4), 10.0, HAND).radius[0, 0]
    assert radius == pytest.approx(np.abs(np.linalg.eigvals(matrix)).max(), abs=1e-9)


@pytest.mark.parametrize("whole", [1, 2, 3])
def test_stability_is_continuous_where_the_delay_becomes_whole(whole):
    def radius(delay):
        case = problem(delay)
        return linear_stability(case.device, frozen_parts(case, 5.0, 2e4), 10.0, HAND).radius[0, 0]

    assert radius(whole - 1e-3) == pytest.approx(radius(whole), abs=1e-3)
    assert radius(whole + 1e-3) == pytest.approx(radius(whole), abs=1e-3)
    assert radius(whole - 0.5) != pytest.approx(radius(whole), abs=1e-3)
