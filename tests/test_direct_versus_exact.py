"""`direct` reaches the global optimum at every frequency; it and `exact` search the edges by different means."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from tests.drawn_problems import drawn_problem


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


@pytest.mark.parametrize("name", [entry.name for entry in avc.catalogue()])
def test_every_frequency_of_the_catalogue_within_1e_8(name):
    """Absolute, in N.s/m."""
    agree(avc.load_problem(name), error_within=lambda _: 1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_random_problems_have_no_local_minimum(seed):
    rng = np.random.default_rng(seed)
    usable = 0
    for _ in range(100):
        # Eight decades of impedance: the error is relative to the goal.
        usable += agree(drawn_problem(rng), error_within=lambda radius: 1e-9 * radius)
    assert usable > 200


@pytest.mark.parametrize("name", ["figure5", "damped", "ve4", "hard/long-delay"])
def test_it_is_never_farther_than_a_feasible_closed_form(name):
    problem = avc.load_problem(name)
    direct, closed = solve(problem, "direct"), solve(problem, "closed-form")
    both = direct.usable & closed.usable
    assert np.all(direct.magnitude_error[both] <= closed.magnitude_error[both] + 1e-12 * np.abs(direct.target[both]))


def test_one_frequency_alone_gives_what_it_gives_among_many():
    problem = avc.load_problem("figure5")
    together = solve(problem, "direct")
    for row in (0, 77, 199):
        alone = problem.model_copy(
            update={"frequency": type(problem.frequency)(values_hz=(float(together.frequency_hz[row]),))}
        )
        one = solve(alone, "direct")
        assert one.rows == 1
        assert one.damping_ns_per_m[0] == together.damping_ns_per_m[row]
        assert one.stiffness_n_per_m[0] == together.stiffness_n_per_m[row]
