"""Clip-last: the scene is a linear loop with F = max(0, y), from first principles; it has no orbit of the gated law.

The reference builds the loop from scipy's matrix exponential and the difference equations of the law, and shares no
code with the scene. The linear part is that of the frozen loops that certificates judge.
"""

import itertools

import numpy as np
import pytest
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.model.effects import HandEffect, SaturationEffect, WallEffect
from avc_casadi.model.gains import Gains
from avc_casadi.model.scene import Press, Scene
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
    law = ContactLaw.of(problem, *vars(gains).values()).state_space
    # The position before, and what the decaying part keeps.
    state = np.array([run.position_m[0], 0.0])[: law.states]
    for x, force in zip(run.position_m, run.force_n, strict=True):
        assert force == pytest.approx(max(0.0, float(law.c[0] @ state + law.d[0, 0] * x)), abs=1e-8)
        state = law.a @ state + law.b[:, 0] * x
    assert run.force_n.max() > 1


@pytest.mark.parametrize("gains", [CONSTANT, Gains(40.0, 3e4)])
def test_springs_that_pull_hold_no_energy_for_the_hand(gains):
    """Out of contact the linear law stretches its springs without a force: the ledger knows nothing of that."""
    run = simulate(pressed((0.1, 20.0, 400.0), "clip-last"), gains)
    away = run.position_m < -1e-3
    assert away.any()
    assert run.ledger.stored_j[away].max() == 0
    assert run.ledger.stored_j.max() > 1e-6
    assert run.energy_generated_j < 1e-3 * run.ledger.stored_j.max()
