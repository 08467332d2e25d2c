"""A design keeps the problem that was solved, and tells its gains and why in three lines."""

import math

import pytest
from studies.designs import COUPLINGS, design

import avc_casadi as avc
from avc_casadi.model.gains import Gains


@pytest.mark.thorough
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


@pytest.mark.thorough
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


def test_a_method_that_refuses_is_a_design_without_gains():
    problem = avc.load_problem("hard/undamped-device")
    with pytest.raises(avc.UnsupportedError) as refusal:
        avc.solve(problem, "static")
    refused = design(problem, "static")
    assert refused.gains is None
    assert refused.reason == str(refusal.value)
    assert str(refused).splitlines()[1:] == ["no gains", refused.reason]
