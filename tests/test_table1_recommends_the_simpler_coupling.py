"""The default of a device follows from its friction and encoder; constant gains win where they are as good."""

import math

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Gains
from avc_casadi.recommend import COUPLINGS, design, recommend


def declared(**device):
    problem = avc.load_problem("ve7")
    return problem.model_copy(update={"device": problem.device.model_copy(update=device)})


def test_a_fine_device_needs_nothing_but_constant_gains():
    found = recommend(declared(encoder_resolution_m=0.0, coulomb_friction_n=0.0), people=16)
    assert found.design.coupling == "static-tuned"
    assert found.claim == "asymptotic"
    assert found.conditions.observer_mass_kg is None
    assert found.stable == found.people == 16
    assert found.reason.startswith("constant gains: 0 of 16")


def test_a_coarse_encoder_calls_for_the_observer():
    found = recommend(declared(encoder_resolution_m=20e-6), people=16)
    assert found.claim == "asymptotic"
    assert found.conditions.friction_n == 0
    assert found.conditions.observer_mass_kg == pytest.approx(0.15)


def test_nothing_is_promised_that_does_not_hold():
    found = recommend(declared(encoder_resolution_m=1e-3, coulomb_friction_n=0.0), people=8)
    assert found.claim == "none"
    assert found.stable < found.people
    assert found.reason.endswith(str(found.people - found.stable))


def test_a_candidate_that_refuses_leaves_the_choice_to_the_others():
    problem = avc.load_problem("hard/undamped-device")
    with pytest.raises(avc.UnsupportedError) as refusal:
        avc.solve(problem, "static")
    refused = design(problem, "static-sampled")
    assert refused.gains is None
    assert refused.reason == str(refusal.value)
    found = recommend(problem, people=4)
    assert found.design.coupling == "static-tuned"
    assert found.stable == found.people


def test_without_any_candidate_the_error_names_each_and_why():
    problem = avc.load_problem("hard/undamped-device")
    device = problem.device.model_copy(update={"delay_samples": 5})
    wall = problem.environment.model_copy(update={"stiffness_n_per_m": 1e6})
    # Gains that are stiff whatever is chosen, behind five samples of delay.
    box = {"damping_ns_per_m": (1e4, 1e5), "stiffness_n_per_m": (1e6, 1e7)}
    coupling = problem.coupling.model_copy(update=box)
    stiff = problem.model_copy(update={"device": device, "environment": wall, "coupling": coupling})
    with pytest.raises(avc.UnsupportedError, match="no candidate has gains") as refusal:
        recommend(stiff, people=4)
    for words in ("static-tuned: scope", "schedule: scope", "static-sampled: static needs", "[coupling]"):
        assert words in str(refusal.value)


def test_a_design_holds_the_problem_that_was_solved():
    problem = avc.load_problem("ve7")
    found = design(problem, "static-tuned")
    low, high = found.problem.coupling.contact_damping_ns_per_m
    assert found.problem.coupling.structure == "damped"
    assert low < found.gains.contact_damping_ns_per_m <= high
    again = avc.solve(found.problem, found.schedule.method)
    assert again.contact_damping_ns_per_m == pytest.approx(found.schedule.contact_damping_ns_per_m, rel=1e-9)
    assert (found.problem.device, found.problem.environment) == (problem.device, problem.environment)
    assert design(problem, "static-sampled").problem.stability.model == "sampled-data"


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_design_is_told_in_three_lines(coupling):
    found = design(avc.load_problem("ve7"), coupling)
    what, gains, why = str(found).splitlines()
    assert coupling in what
    assert why
    given = found.gains
    numbers = [f"{value:.4g}" for value in vars(given).values() if math.isfinite(value) and value > 0]
    assert all(value in gains for value in numbers)
    assert gains.startswith("rigid") == given.rigid
    assert ("scheduled" in gains) == (not isinstance(found.in_force, Gains))
    assert "array" not in repr(found)


def test_a_recommendation_and_a_refusal_are_told_in_three_lines():
    found = recommend(declared(encoder_resolution_m=20e-6), people=8)
    what, gains, why = str(found).splitlines()
    assert "observer of 0.15 kg" in what
    assert f"{found.stable} of {found.people}" in what
    assert f"b_p = {found.design.gains.contact_damping_ns_per_m:.4g} N.s/m" in gains
    assert why == found.reason
    refused = design(avc.load_problem("hard/undamped-device"), "static")
    assert str(refused).splitlines()[1:] == ["no gains", refused.reason]
