"""Clip-last: the scene is a linear loop with F = max(0, y), from first principles; it has no orbit of the gated law.

The reference builds the loop from scipy's matrix exponential and the difference equations of the law, and shares no
code with the scene. The linear part is that of the frozen loops that certificates judge.
"""

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.model.effects import HandEffect, SaturationEffect, WallEffect
from avc_casadi.model.gains import Gains
from avc_casadi.model.scene import Press, Scene
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.scene import simulate

# Of the wall of figure 5, tuned as tests/test_table1_everybody_rests_at_the_stiff_wall.py does.
CONSTANT = Gains(287.40231141495383, 2913306.7219205513, 84.82101786072512)


def pressed(hand, contact, *, end_m=0.01, speed_m_per_s=0.07, duration_s=0.4, limit_n=None, **tables):
    mass, damping, stiffness = hand
    held = HandEffect(mass_kg=mass, damping_ns_per_m=damping, stiffness_n_per_m=stiffness)
    effects = (held, WallEffect(), *([] if limit_n is None else [SaturationEffect(force_n=limit_n)]))
    motion = Press(start_m=-0.01, end_m=end_m, speed_m_per_s=speed_m_per_s)
    scene = Scene(duration_s=duration_s, effects=effects, motion=motion)
    return avc.load_problem("ve7").changed(coupling={"contact": contact}, scene=scene, **tables)


class Law:
    """kappa, S, a and d of the law; the states e, the deflection of the coupling, and the x of the sample before."""

    def __init__(self, problem, gains, start_m):
        period, wall = problem.device.sample_time_s, problem.environment
        self.T, self.b_p = period, gains.contact_damping_ns_per_m
        self.kappa = gains.stiffness_n_per_m + gains.damping_ns_per_m / period
        kappa_e = wall.stiffness_n_per_m + wall.damping_ns_per_m / period
        self.S = self.kappa * kappa_e / (self.kappa + kappa_e)
        self.a = gains.damping_ns_per_m / (self.kappa * period)
        self.d = wall.damping_ns_per_m / (kappa_e * period)
        self.e, self.before = 0.0, start_m

    def linear(self, x):
        f = self.S * (x - self.a * self.e - self.d * (self.before - self.e))
        y = f + self.b_p * (x - self.before) / self.T
        self.e, self.before = self.a * self.e + f / self.kappa, x
        return y


def reference(problem, gains, hand, target_m, limit_n=np.inf):
    """Positions, velocities and forces: the mass on the hand's spring and damper under F, held for T."""
    device, (mass, damping, stiffness) = problem.device, hand
    m, b, t = device.mass_kg + mass, device.damping_ns_per_m + damping, device.sample_time_s
    rate = np.zeros((5, 5))  # x, v, F, target and its velocity
    rate[0, 1] = rate[3, 4] = 1.0
    rate[1] = [-stiffness / m, -b / m, -1 / m, stiffness / m, damping / m]
    step = expm(rate * t)
    aim = np.append(target_m, target_m[-1])
    x, v, law = target_m[0], 0.0, Law(problem, gains, target_m[0])
    out = []
    for now, then in itertools.pairwise(aim):
        force = min(max(law.linear(x), 0.0), limit_n)
        out.append((x, v, force))
        x, v = (step @ [x, v, force, now, (then - now) / t])[:2]
    return np.array(out).T


@pytest.mark.parametrize("seed", range(8))
def test_scene_is_the_law_of_first_principles(seed):
    rng = np.random.default_rng(seed)
    hand = tuple(rng.uniform((0.05, 3.0, 200.0), (0.3, 20.0, 800.0)))
    gains = CONSTANT if seed == 0 else Gains(rng.uniform(0, 300), 10 ** rng.uniform(3.5, 6.5), rng.uniform(0, 90))
    wall = {"damping_ns_per_m": rng.uniform(0, 15), "stiffness_n_per_m": 10 ** rng.uniform(3.3, 5)}
    limit = 6.0 if seed % 2 else None
    tables = {"environment": wall, "boundaries": {"upper": wall, "lower": wall}}
    problem = pressed(hand, "clip-last", limit_n=limit, **tables)
    run = simulate(problem, gains)
    expected = reference(problem, gains, hand, run.target_m, np.inf if limit is None else limit)
    assert expected[2].max() > 0.5
    assert (expected[2] == 0).any()
    before = (run.position_m < 0) & (run.force_n > 0)
    assert before.any() == ((expected[0] < 0) & (expected[2] > 0)).any()
    traces = (run.position_m, run.velocity_m_per_s, run.force_n)
    for mine, other, size in zip(traces, expected, (1, 1e3, 1e5), strict=True):
        assert np.abs(mine - other).max() < 1e-12 * size


@pytest.mark.parametrize("gains", [CONSTANT, Gains(200.0, 1e5), Gains(0.0, 4e5, 60.0)])
def test_linear_part_is_that_of_the_frozen_loops(gains):
    problem = pressed((0.1, 5.0, 400.0), "clip-last")
    run = simulate(problem, gains)
    part = ContactLaw.of(problem, *vars(gains).values()).rendering
    before, stretch = run.position_m[0], 0.0
    for x, force in zip(run.position_m, run.force_n, strict=True):
        given = np.array([x, before, stretch])
        assert force == pytest.approx(max(0.0, float(part.force[0] @ given)), abs=1e-8)
        before, stretch = x, float(part.state[0] @ given)
    assert run.force_n.max() > 1


LIGHT, PUSH_N = (0.05, 3.0, 200.0), 5.0
# Samples of a contact and of a flight, and the speed at the surface, that bounce for ever under the gated law.
BOUNCE, SPEED_M_PER_S = 8, 0.085


def step(contact):
    """One sample of the scene with the light hand, its target at rest, pressing with 5 N."""
    problem = pressed(LIGHT, contact, end_m=PUSH_N / LIGHT[2])
    compiled = compile_scene(problem, gains=CONSTANT)
    state = ca.SX.sym("state", len(compiled.states))
    aim, numbers = ca.DM([PUSH_N / LIGHT[2], 0.0]), ca.DM(compiled.parameter_values(CONSTANT)[0])
    return compiled, ca.Function("step", [state], [compiled.function(state, aim, numbers)[0]])


def orbits(contact, period, tries=40):
    """Find states that come back after so many samples, by Newton's method on the step itself, from many beginnings.

    Returns the states from which the device moves at all, and the largest multiplier of each.
    """
    compiled, one = step(contact)
    state = ca.SX.sym("state", len(compiled.states))
    after = state
    for _ in range(period):
        after = one(after)
    round_trip = ca.Function("round_trip", [state], [after, ca.jacobian(after, state)])
    rng = np.random.default_rng(period)
    names = compiled.states
    found = []
    for _ in range(tries):
        x, v = rng.uniform(-4e-4, 2e-4), rng.uniform(-0.3, 0.3)
        start = {
            "device_position_m": x,
            "device_velocity_m_per_s": v,
            "environment_deflection_before_m": max(x, 0.0) if contact == "gated" else x,
            "coupling_deflection_before_m": 0.0,
            "contact_position_before_m": x - 1e-3 * v,
        }
        guess = np.array([start[name] for name in names])
        for _ in range(30):
            end, slope = (value.full() for value in round_trip(guess))
            change = np.linalg.solve(np.eye(len(guess)) - slope, end.ravel() - guess)
            guess = guess + change
            if not np.abs(guess).max() < 1 or np.abs(change).max() < 1e-15:
                break
        end, slope = (value.full() for value in round_trip(guess))
        moves = np.abs(one(guess).full().ravel() - guess).max() > 1e-9
        if np.abs(end.ravel() - guess).max() < 1e-13 and moves:
            found.append((guess, np.abs(np.linalg.eigvals(slope)).max()))
    return found


def test_gated_law_has_an_orbit_of_one_bounce():
    found = orbits("gated", BOUNCE)
    assert found
    state, multiplier = found[0]
    _, one = step("gated")
    speeds, inside = [], []
    for _ in range(BOUNCE):
        inside.append(bool(state[0] > 0))
        speeds.append(abs(state[1]))
        state = one(state).full().ravel()
    assert max(speeds) == pytest.approx(SPEED_M_PER_S, rel=0.01)
    assert 0 < sum(inside) < BOUNCE
    assert multiplier > 2  # no simulation stays on it


@pytest.mark.slow
def test_clip_last_law_has_no_such_orbit():
    assert not any(orbits("clip-last", period) for period in range(2, 25))


def test_from_the_orbit_of_the_gated_law_clip_last_comes_to_rest():
    state = orbits("gated", BOUNCE)[0][0]
    compiled, one = step("clip-last")
    assert compiled.states[2] == "environment_deflection_before_m"
    for _ in range(2000):
        state = one(state).full().ravel()
    assert abs(state[1]) < 1e-9
    assert state[0] > 1e-5


@pytest.mark.parametrize("gains", [CONSTANT, Gains(40.0, 3e4)])
def test_springs_that_pull_hold_no_energy_for_the_hand(gains):
    """Out of contact the linear law stretches its springs without a force: the ledger knows nothing of that."""
    run = simulate(pressed((0.1, 20.0, 400.0), "clip-last"), gains)
    away = run.position_m < -1e-3
    assert away.any()
    assert run.ledger.stored_j[away].max() == 0
    assert run.ledger.stored_j.max() > 1e-6
    assert run.energy_generated_j < 1e-3 * run.ledger.stored_j.max()
