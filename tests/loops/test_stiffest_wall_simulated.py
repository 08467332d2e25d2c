"""The stiffest wall is one that simulated hands rest at."""

import pytest

import avc_casadi as avc
from avc_casadi.recommendation.stiffest import stiffest
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import draw_hands


@pytest.mark.thorough
def test_hands_that_had_no_part_in_it_rest_at_the_stiffest_wall():
    problem = avc.load_problem("reference-r2").changed(device={"encoder_resolution_m": 1e-5, "max_force_n": 8.0})
    found = stiffest(problem, hands=16)
    wall = found["stiffest_wall_n_per_m"]
    assert found["at_rest_without_friction"] == found["at_rest"] == found["hands"]
    assert found["confirmed"]["at_rest_without_friction"] == found["confirmed"]["hands"]
    before = problem.changed(environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0})
    best = avc.recommend(before, hands=16)
    assert best.trial.stiffness > 0.7 * wall
    fresh = try_coupling(best.coupling, draw_hands(problem.hands, 60, 77), 77)
    assert fresh.stable_without_friction.mean() > 0.9


@pytest.mark.thorough
def test_a_device_that_nothing_holds_has_none():
    found = stiffest(avc.load_problem("hard/massless"), hands=3)
    assert found["stiffest_wall_n_per_m"] is None
