"""The default of a device follows from its friction and encoder; constant gains win where they are as good."""

import pytest

import avc_casadi as avc
from avc_casadi.study import design, recommend


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
