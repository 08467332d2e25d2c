"""`direct`, CasADi's NLP from several starts, is at the optimum of `exact`, 50 digits and brute force, or says no."""

import numpy as np
import pytest
from drawn_problems import drawn_problem
from reference_optimum import series_error
from walled import has_wall

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.cross_check import EXCESS_TOLERANCE
from avc_casadi.paper.loop import loop_at


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
@pytest.mark.parametrize("name", [entry.name for entry in avc.catalogue() if has_wall(entry.name)])
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


def test_it_is_the_optimum_of_50_digits():
    rng = np.random.default_rng(2)
    compared = 0
    for _ in range(12):
        problem = drawn_problem(rng, frequencies=2, structure="series")
        direct = solve(problem, "direct")
        for row in np.flatnonzero(direct.usable):
            compared += 1
            excess = direct.magnitude_error[row] - float(series_error(problem, float(direct.frequency_hz[row])))
            assert abs(excess) <= 1e-8 * np.abs(direct.target[row]), problem
    assert compared > 12


@pytest.mark.parametrize("name", ["figure5", "damped", "hard/undamped-device", "hard/massless"])
def test_no_point_of_a_dense_grid_is_better(name):
    problem = pointwise(avc.load_problem(name)).changed(frequency={"points": 12})
    direct, loop = solve(problem, "direct"), loop_at(problem, problem.frequencies_hz())
    box = problem.coupling
    b, k, p = (
        np.array([0.0, *np.geomspace(1e-6 * ends[1], ends[1], points)]) if ends[1] else np.zeros(1)
        for ends, points in (
            (box.damping_ns_per_m, 150),
            (box.stiffness_n_per_m, 150),
            (box.contact_damping_ns_per_m, 12),
        )
    )
    z = loop.perceived(*(grid[..., None] for grid in np.meshgrid(b, k, p, indexing="ij")))
    error = np.where(z.real >= problem.stability.margin_ns_per_m, np.abs(np.abs(z) - np.abs(loop.target)), np.inf)
    best = error.min(axis=(0, 1, 2))
    assert np.all(direct.magnitude_error <= best + 1e-9 * np.abs(loop.target))


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
