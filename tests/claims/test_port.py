"""Passivity at the engine's port: against energy over time, Llewellyn's condition and random implicit tools."""

import math

import numpy as np
import pytest
from engine_simulator import EngineSimulator
from quick import first
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.engine_port import engine_port as judge_port
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import hand_corners

MASS, DAMPING, T, DELAY = 0.12, 0.8, 1e-3, 1
DEVICE = f"[device]\nmass_kg = {MASS}\ndamping_ns_per_m = {DAMPING}\ndelay_samples = {DELAY}\n"
# A pair that level L4 passes, and with which an explicit mass of 0.2 kg grows at 200 Hz.
PAIR = ToolGains(615.7, 0.2317)


def problem(simulation):
    return avc.parse_problem(f"{DEVICE}[simulation]\n{simulation}")


def stated(ratio, integrator="implicit", exchange="ahead", mass=0.2, clock="own"):
    return problem(
        f'tool_mass_kg = {mass}\nstep_s = {ratio * T!r}\nintegrator = "{integrator}"\nexchange = "{exchange}"\n'
        f'clock = "{clock}"'
    )


def engine_port(one, gains):
    return judge_port(one.device, one.hands, one.simulation, gains)


def energy_taken(gains, velocities, ratio, hand, told, held_force, between=False):
    """Energy that a driven tool gives coupling, device and hand, step by step, by a plain recursion.

    A step between two samples has the device's position of the sample before it.
    """
    m, b = MASS + hand["mass_kg"], DAMPING + hand["damping_ns_per_m"]
    rate = np.array([[0, 1, 0], [-hand["stiffness_n_per_m"] / m, -b / m, -1 / m], [0, 0, 0]])
    step = expm(rate * T)[:2]
    k, d, t_s = gains.stiffness_n_per_m, gains.damping_ns_per_m, ratio * T
    x = v = last = older = place = total = 0.0
    under_way, queue = [0.0] * DELAY, [0.0 if held_force else (0.0, 0.0)] * (told + 1)
    for velocity in velocities:
        place += t_s * velocity
        seen, before = (last, older) if between else (x, last)
        force = k * (seen - place) + d * ((seen - before) / T - velocity)
        total -= force * velocity * t_s
        queue = [*queue[1:], force if held_force else (place, velocity)]
        for _ in range(ratio):
            known = queue[0]
            asked = known if held_force else k * (x - known[0]) + d * ((x - last) / T - known[1])
            under_way.append(asked)
            last, older = x, last
            x, v = step @ np.array([x, v, under_way.pop(0)])
    return total


def mean_power(gains, velocities, ratio, *how, **more):
    """Mean power of the second half of a motion over the mean square of its velocity."""
    half = len(velocities) // 2
    whole = energy_taken(gains, velocities, ratio, *how, **more)
    first = energy_taken(gains, velocities[:half], ratio, *how, **more)
    return (whole - first) / (half * ratio * T) / np.mean(velocities[half:] ** 2)


@pytest.mark.parametrize(
    ("gains", "ratio", "exchange", "told"),
    first(
        [
            (PAIR, 5, "on-time", 1),
            (ToolGains(300.0, 0.3), 1, "ahead", 0),
            (PAIR, 5, "ahead", 0),
            (ToolGains(300.0, 0.3), 5, "on-time", 1),
            (ToolGains(1000.0, 2.0), 2, "on-time", 1),
            (ToolGains(0.0, 0.1), 2, "ahead", 0),
            (ToolGains(0.0, 60.0), 5, "on-time", 1),
        ],
        2,
    ),
)
def test_margin_is_the_energy_that_a_driven_tool_loses(gains, ratio, exchange, told):
    """Driven at one frequency the mean power is Re G |v|^2/2; a negative one gives out energy without end."""
    phases = {"device": (False,), "own": (False, True)}
    for clock, steps_between in phases.items():
        found = engine_port(stated(ratio, exchange=exchange, clock=clock), gains)
        velocities = np.cos(2 * np.pi * found.frequency_hz * ratio * T * np.arange(20000))
        mean = min(
            mean_power(gains, velocities, ratio, found.hand, told, held_force=False, between=between)
            for between in steps_between
        )
        assert mean == pytest.approx(found.margin_ns_per_m, rel=0.02)
        assert found.passive == (mean >= 0)


@pytest.mark.slow
def test_no_random_motion_of_the_tool_takes_energy_out_of_a_passive_port():
    random = np.random.default_rng(0)
    corners = hand_corners(stated(5).hands)
    hands = [corners.values(row) for row in range(len(corners))]
    for exchange, told, held_force in (("ahead", 0, False), ("on-time", 1, False), ("late", 2, False)):
        gains = ToolGains(100.0, 0.2)
        assert engine_port(stated(5, exchange=exchange), gains).passive
        for hand in hands[:4]:
            for _ in range(5):
                velocities = np.convolve(random.standard_normal(600), np.ones(random.integers(1, 60)), "same")
                for between in (False, True):
                    assert energy_taken(gains, velocities, 5, hand, told, held_force, between) >= 0


def test_port_of_a_held_force_is_that_of_a_plain_recursion():
    gains, ratio = ToolGains(100.0, 0.2, 0.0), 5
    found = engine_port(stated(ratio, "semi-implicit", "held-force"), gains)
    assert found.frequency_hz == pytest.approx(100, rel=1e-3)
    velocities = np.cos(np.pi * np.arange(2000))
    mean = min(mean_power(gains, velocities, ratio, found.hand, 0, True, between) for between in (False, True))
    assert mean == pytest.approx(found.margin_ns_per_m, rel=1e-3)


@pytest.mark.slow
def test_llewellyn_at_the_rate_of_the_device_implies_a_passive_port():
    """Two derivations: any hand at once in closed form, and each hand of a box multiplied out."""
    random, passed = np.random.default_rng(1), 0
    for _ in range(60):
        gains = ToolGains(float(10 ** random.uniform(1, 3.3)), float(10 ** random.uniform(-2, 0.5)))
        found = engine_port(stated(1, clock="device"), gains)
        assert engine_port(stated(1), gains).any_hand is None  # a step between samples reads the device late
        assert found.any_hand is not None
        if found.any_hand:
            passed += 1
            assert found.passive
    assert 10 < passed < 60


@pytest.mark.slow
def test_passive_engines_stay_stable_where_an_explicit_mass_grows():
    """Brown and Colgate: an engine is passive at the port where it solves its tool with the coupling's force."""
    assert engine_port(stated(5, clock="device"), PAIR).passive
    random = np.random.default_rng(2)
    kick, quiet = 0.1, []
    for _ in range(12):
        tool = (float(10 ** random.uniform(-2, 1)), float(random.choice([0.0, 1.0])))
        contact = (float(10 ** random.uniform(1, 7)), float(10 ** random.uniform(-2, 3)))
        simulator = EngineSimulator(
            (MASS, DAMPING, T, DELAY), (0.05, 0.5, 50.0), tool, 5 * T, "implicit", "ahead", contact=contact
        )
        device, _ = simulator.run(*gains_of(PAIR), 20000, kick=kick)
        quiet.append(np.abs(device[-500:]).max() < 0.3 * np.abs(device[:500]).max())
    assert all(quiet)
    explicit = EngineSimulator((MASS, DAMPING, T, DELAY), (0.0, 0.0, 0.0), (0.2, 0.0), 5 * T)
    device, tool = explicit.run(*gains_of(PAIR), 4000, kick=kick, force=math.inf)
    apart = np.abs(device - tool)
    assert apart[-300:].max() > 10 * apart[:300].max()
    assert not engine_port(stated(5, "semi-implicit", "on-time"), PAIR).engine_is_implicit


def gains_of(gains):
    return gains.stiffness_n_per_m, gains.damping_ns_per_m
