"""Each file of the catalogue has the property for which it is there."""

import itertools

import mpmath
import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.paper.equations import loop_at

LADDER = ["ve2", "ve3", "ve4", "ve5", "ve6", "ve7"]


def loop_of(name):
    problem = avc.load_problem(name)
    return problem, loop_at(problem, problem.frequencies_hz())


@pytest.mark.parametrize("entry", avc.catalogue(), ids=lambda entry: entry.name)
def test_every_entry_loads_and_says_what_it_is(entry):
    problem = avc.load_problem(entry.name)
    assert problem == avc.load_problem(entry.path)
    assert problem.name == entry.name
    assert avc.catalogue_path(entry.name) == entry.path
    assert problem.title == entry.title != ""
    assert problem.source == entry.source
    assert "assumed" in problem.source
    assert problem.source.startswith("Hard case: ") == entry.name.startswith("hard/")
    frequency = problem.frequencies_hz()
    assert np.all(np.diff(frequency) > 0)
    assert np.all(frequency * problem.device.sample_time_s < 0.5)


def test_figure5_is_the_wall_of_the_paper():
    wall = avc.load_problem("figure5").environment
    assert (wall.damping_ns_per_m, wall.stiffness_n_per_m) == (10.0, 1e5)
    assert avc.load_problem("damped").environment == wall
    assert avc.load_problem("ve7").environment == wall


def test_the_ladder_rises_and_crosses_what_a_hand_holds():
    walls = [avc.load_problem(name) for name in LADDER]
    stiffness = [wall.environment.stiffness_n_per_m for wall in walls]
    assert all(1.2 < upper / lower < 5 for lower, upper in itertools.pairwise(stiffness))
    # Without delay a hand with damping b_h holds about 2 (b_d + b_h)/T.
    lowest, highest = (
        2 * (walls[0].device.damping_ns_per_m + damping) / walls[0].device.sample_time_s
        for damping in walls[0].hands.damping_ns_per_m
    )
    assert stiffness[1] < lowest < stiffness[2] < highest < stiffness[3]


def test_the_case_boundary_is_met_from_both_sides_to_rounding():
    problem, loop = loop_of("hard/case-boundary")
    with mpmath.workdps(50):
        period, damping = mpmath.mpf(problem.device.sample_time_s), problem.device.damping_ns_per_m
        upper, lower = problem.boundaries.upper, problem.boundaries.lower
        desired_b = (mpmath.mpf(upper.damping_ns_per_m) + lower.damping_ns_per_m) / 2
        desired_k = (mpmath.mpf(upper.stiffness_n_per_m) + lower.stiffness_n_per_m) / 2
        real = [
            damping + mpmath.cos(mpmath.pi * f * period) ** 2 * (desired_b - desired_k * period / 2)
            for f in problem.frequencies_hz()
        ]
    assert min(real) < -1e-6
    assert max(real) > 1e-6
    assert sum(-1e-15 < value < -3e-16 for value in real) == 2
    assert sum(3e-16 < value < 1e-15 for value in real) == 2
    assert sum(abs(value) < 1e-20 for value in real) == 1
    np.testing.assert_allclose(loop.target.real, np.array(real, dtype=float), atol=5e-15)
