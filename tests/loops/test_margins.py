"""Gain, phase and delay margins beside loops that are written out here: at a margin the spectral radius is 1."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.wall import frozen_rendering, observed_wall
from avc_casadi.model.corners import unmodelled
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.plant import sampled_plant
from avc_casadi.simulation.population.trial import residual_speeds

# Mass, damping, T, samples of delay; wall k_e and b_e; coupling k and b_p.
LOOPS = {
    "stylus": (0.12, 0.8, 1e-3, 1, 3000.0, 0.0, 1e6, 6.0),
    "pedal": (2.0, 5.0, 2e-3, 2, 2500.0, 3.0, 1e5, 10.0),
    "fast": (0.05, 0.3, 1e-4, 0, 2e4, 0.0, 5e4, 0.5),
    "slow": (0.3, 40.0, 5e-3, 1, 900.0, 0.0, 1e4, 0.0),
}
CORNERS = [(0.0, 0.0, 0.0), *itertools.product((0.05, 0.3), (3.0, 20.0), (200.0, 800.0))]


def coupling_of(case):
    mass, damping, period, delay, wall, wall_damping, stiffness, contact = case
    problem = avc.parse_problem(
        f"[device]\nmass_kg = {mass}\ndamping_ns_per_m = {damping}\nsample_time_s = {period}\n"
        f"delay_samples = {delay}\n[environment]\nstiffness_n_per_m = {wall}\ndamping_ns_per_m = {wall_damping}\n"
        f"[coupling]\nstructure = 'damped'\ncontact_damping_ns_per_m = [0.0, 1e3]\n"
    )
    return Coupling.constant(problem, Gains(0.0, stiffness, contact), "written out")


def closed(case, hand, factor=1.0, more=0):
    """The loop of one hand: position, velocity, the position before, that of the joint, forces under way.

    The force that reaches the device is `factor` times the one that is asked for, `more` samples later.
    """
    mass, damping, period, delay, wall, wall_damping, stiffness, contact = case
    m, b, k = mass + hand[0], damping + hand[1], hand[2]
    moves = expm(period * np.array([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]]))
    late = delay + more
    loop = np.zeros((4 + late, 4 + late), dtype=complex)
    loop[:2, :2] = moves[:2, :2]
    loop[2, 0] = 1.0
    # The joint between spring and wall, in backward differences.
    joint = np.zeros(4 + late)
    whole = (stiffness + wall) * period + wall_damping
    joint[[0, 3]] = stiffness * period / whole, wall_damping / whole
    loop[3] = joint
    force = -stiffness * joint
    force[0] += stiffness + contact / period
    force[2] -= contact / period
    if late == 0:
        loop[:2] -= factor * np.outer(moves[:2, 2], force)
    else:
        loop[4] = force
        loop[np.arange(5, 4 + late), np.arange(4, 3 + late)] = 1.0
        loop[:2, -1] -= factor * moves[:2, 2]
    return loop


def radius(case, hand, **how):
    return np.abs(np.linalg.eigvals(closed(case, hand, **how))).max()


@pytest.mark.parametrize("case", LOOPS.values(), ids=LOOPS)
def test_at_a_margin_the_spectral_radius_is_one(case):
    released, held = OpenLoop.of(coupling_of(case)).margins()
    for found, hands in ((released, CORNERS[:1]), (held, CORNERS[1:])):
        assert max(radius(case, hand) for hand in hands) < 1
        at = [radius(case, hand, factor=found.gain) for hand in hands]
        assert max(at) == pytest.approx(1, abs=1e-9)
        assert max(radius(case, hand, factor=1.01 * found.gain) for hand in hands) > 1
        between = np.linspace(1, 0.999 * found.gain, 30)
        assert max(radius(case, hand, factor=one) for hand in hands for one in between) < 1
        assert found.gain_down == 0
        turned = [
            radius(case, hand, factor=np.exp(1j * sign * math.radians(found.phase_deg)))
            for hand in hands
            for sign in (1, -1)
        ]
        assert max(turned) == pytest.approx(1, abs=1e-9)
        whole = math.floor(found.delay_samples)
        assert max(radius(case, hand, more=whole) for hand in hands) < 1
        assert max(radius(case, hand, more=whole + 1) for hand in hands) > 1


def loop_gain(case, hand, turn):
    """Force over force at z = exp(j turn), part by part."""
    mass, damping, period, delay, wall, wall_damping, stiffness, contact = case
    m, b, k, z = mass + hand[0], damping + hand[1], hand[2], np.exp(1j * turn)
    moves = expm(period * np.array([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]]))
    position = np.linalg.solve(z * np.eye(2) - moves[:2, :2], moves[:2, 2])[0]
    joint = stiffness * period / ((stiffness + wall) * period + wall_damping * (1 - 1 / z))
    return (stiffness * (1 - joint) + contact / period * (1 - 1 / z)) * position / z**delay


@pytest.mark.parametrize("case", LOOPS.values(), ids=LOOPS)
def test_phase_and_delay_are_read_from_the_frequency_response(case):
    period = case[2]
    released, held = OpenLoop.of(coupling_of(case)).margins()
    for found, hands in ((released, CORNERS[:1]), (held, CORNERS[1:])):
        phases, delays = [], []
        for hand in hands:
            size = lambda turn, hand=hand: math.log(abs(loop_gain(case, hand, turn)))  # noqa: E731
            grid = np.geomspace(1e-3, math.pi, 500)
            above = np.array([size(turn) > 0 for turn in grid])
            for place in np.flatnonzero(np.diff(above)):
                turn = brentq(size, grid[place], grid[place + 1], xtol=1e-14)
                lag = (np.angle(loop_gain(case, hand, turn)) + math.pi) % (2 * math.pi)
                phases.append(math.degrees(min(lag, 2 * math.pi - lag)))
                delays.append((lag / turn, turn / (2 * math.pi * period)))
        assert found.phase_deg == pytest.approx(min(phases), rel=1e-7)
        assert (found.delay_samples, found.delay_hz) == pytest.approx(min(delays), rel=1e-7)


@pytest.fixture(scope="module")
def fed_back():
    """A coupling with an observer and state feedback."""
    problem = avc.load_problem("reference-r2")
    return Coupling.of(problem, avc.solve(problem, "robust"))


@pytest.mark.slow
def test_with_state_feedback_the_observer_knows_the_force_that_was_asked_for(fed_back):
    """The loop of the project itself, its device pushed by so many times the force."""
    problem, law, gains = fed_back.problem, fed_back.runtime.state_feedback, fed_back.table.at_rest
    assert law is not None
    rendering = frozen_rendering(problem, *vars(gains).values())
    corners = with_released(hand_corners(problem.hands))
    body = Body.of(sampled_plant(problem.device, corners)).flat()

    def radii(factor):
        # Forces under way are what was asked for: the factor stands where they reach the device.
        moved, under_way = body.a.copy(), body.size - len(body.names)
        first = body.b.copy()
        if under_way:
            states = len(body.names)
            moved[:, :states, states:] *= factor
            first[:, :states] *= factor
        else:
            first *= factor
        pushed = replace(body, a=moved, b=first)
        return np.abs(np.linalg.eigvals(observed_wall(pushed, law, rendering)[0])).max(axis=-1)

    released, held = OpenLoop.of(fed_back).margins()
    for found, some in ((released, slice(-1, None)), (held, slice(-1))):
        assert radii(1.0)[some].max() < 1
        assert radii(found.gain)[some].max() == pytest.approx(1, abs=1e-8)
        assert radii(1.001 * found.gain)[some].max() > 1
        if found.gain_down:
            assert radii(found.gain_down)[some].max() == pytest.approx(1, abs=1e-8)


# A lighter device, missed samples: told as a plant of its own says, and kept where asked for.

COUPLINGS = Path(__file__).parents[1] / "goldens" / "couplings"


def coupling(name="reference-r1"):
    return avc.read_coupling(COUPLINGS / f"{name}.json")


def told(found, asked, hands):
    (one,) = unmodelled(found.problem.device, asked)
    return residual_speeds(found, hands, friction=False, device=one.device, effects=one.effects) < 1
