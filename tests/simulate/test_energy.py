"""The energy ledger: what a held force passes, what springs hold, what sampling creates."""

import math

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import NO_COUPLING, Gains

FREE = """
[device]
mass_kg = 0.1
damping_ns_per_m = {b_d}
[environment]
damping_ns_per_m = {{b_e}}
stiffness_n_per_m = {{k_e}}
"""
SPRING = ['kind = "environment"\nstiffness_n_per_m = 900.0\ndamping_ns_per_m = 0.0']
RELEASED = 'kind = "hold"\nend_m = -0.002\n'
STIFF = 'kind = "hand"', 'kind = "wall"'


def test_a_held_spring_creates_half_k_dx_squared_at_every_step():
    run = simulate(scene_problem(SPRING, motion=RELEASED), NO_COUPLING)
    step = np.diff(run.position_m)
    created = np.diff(run.ledger.stored_j) - np.diff(run.ledger.absorbed_j)
    assert created.max() > 1e-9
    np.testing.assert_allclose(created, 900.0 * step**2 / 2, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(-np.diff(run.ledger.dissipated_j), created, rtol=1e-9, atol=1e-16)


def test_the_energy_that_passes_is_the_kinetic_energy_of_an_undamped_device():
    problem = scene_problem(SPRING, motion=RELEASED, head=FREE.format(b_d=0.0), scene="duration_s = 0.5\n")
    run = simulate(problem, NO_COUPLING)
    kinetic = 0.05 * run.velocity_m_per_s**2
    assert kinetic.max() > 1e-4
    np.testing.assert_allclose(-run.ledger.absorbed_j, kinetic, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("gains", [Gains(5.0, 2000.0), Gains(math.inf, math.inf, 20.0), Gains(20.0, 1e5)])
def test_a_two_sided_spring_and_damper_below_the_passive_limit_never_give_energy_that_they_had_not(gains):
    # b_d > KT/2 + B holds for the device; the virtual side alone is passive only with its own damping.
    problem = scene_problem(STIFF, b_e=20.0, k_e=500.0)
    run = simulate(problem, gains)
    assert run.ledger.absorbed_j.max() > 1e-4
    assert run.energy_generated_j < 1e-3 * run.ledger.absorbed_j.max()
