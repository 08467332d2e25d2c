"""`direct`, CasADi's NLP from several starts, is at the optimum of `exact`, 50 digits and brute force, or says no."""

import numpy as np
import pytest
from drawn_problems import drawn_problem, walled

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.direct import EXCESS_TOLERANCE


def pointwise(problem):
    """`exact` solves (11)-(12) frequency by frequency; so does `direct` with the scope pointwise."""
    return problem.changed(stability={"scope": "pointwise"})


def agree(problem, *, error_within):
    problem = pointwise(problem)
    direct, exact = solve(problem, "direct"), solve(problem, "exact")
    assert direct.status == exact.status, problem
    use = exact.usable
    excess = np.abs(direct.magnitude_error - exact.magnitude_error)
    assert np.all(excess[use] <= error_within(np.abs(exact.target[use]))), problem
    distance = np.abs(direct.impedance - direct.target) - np.abs(exact.impedance - exact.target)
    assert np.all(np.abs(distance[use]) <= 1e-7 * np.abs(exact.target[use])), problem
    return int(use.sum())


@pytest.mark.slow
@pytest.mark.parametrize("name", walled())
def test_every_frequency_of_the_catalogue_within_1e_8(name):
    """Absolute, in N.s/m."""
    agree(avc.load_problem(name), error_within=lambda _: 1e-8)


@pytest.mark.slow
def test_300_random_problems_end_at_the_optimum_or_say_that_they_do_not():
    rng = np.random.default_rng(0)
    usable = failed = 0
    for _ in range(300):
        # Eight decades of impedance: the error is relative to the goal.
        problem = drawn_problem(rng, frequencies=3)
        direct, exact = solve(problem, "direct"), solve(problem, "exact")
        bad = np.array([status == "failed" for status in direct.status])
        assert np.all((direct.usable == exact.usable) | bad), problem
        assert all(reason for reason, said in zip(direct.reason, bad, strict=True) if said)
        use = direct.usable
        radius = np.fmax(np.abs(exact.target), 1e-6 * np.abs(exact.impedance))
        assert np.all((direct.magnitude_error - exact.magnitude_error)[use] <= EXCESS_TOLERANCE * radius[use]), problem
        assert np.all(direct.real_part[use] >= problem.stability.margin_ns_per_m), problem
        usable, failed = usable + int(use.sum()), failed + int(bad.sum())
    assert usable > 600
    assert failed <= 0.01 * usable
