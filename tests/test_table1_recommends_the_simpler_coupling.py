"""The default of a device follows from its friction and encoder; constant gains win where they are as good."""

import pytest

import avc_casadi as avc
from avc_casadi.study import recommend


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
