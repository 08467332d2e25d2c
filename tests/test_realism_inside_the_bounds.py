"""Realism: what counts as inside, and the errors that methods minimise."""

import numpy as np
import pytest

from avc_casadi import parse_problem
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import judge_realism, relative_errors

CASE = parse_problem(
    "[device]\nmass_kg=0.1\ndamping_ns_per_m=2.0\n[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
    "[boundaries.upper]\ndamping_ns_per_m=11.0\nstiffness_n_per_m=1.1e5\n"
    "[boundaries.lower]\ndamping_ns_per_m=7.0\nstiffness_n_per_m=0.8e5\n"
    "[realism]\njnd=0.08\n[frequency]\nstart_hz=1.0\nstop_hz=10.0\npoints=20\n"
)


def target():
    return np.asarray(loop_at(CASE, CASE.frequencies_hz()).target)


def test_the_desired_impedance_is_inside_both():
    result = judge_realism(CASE, target())
    assert result.inside_bounds.all()
    assert result.inside_jnd.all()
    assert result.share_inside_jnd == result.share_inside_bounds == 1.0


def test_bounds_do_not_see_phase_and_the_difference_does():
    result = judge_realism(CASE, target() * np.exp(0.5j))
    assert result.inside_bounds.all()
    assert not result.inside_jnd.any()


def test_bounds_are_the_impedances_of_u_and_l():
    for bound in (CASE.boundaries.upper, CASE.boundaries.lower):
        rendered = CASE.changed(boundaries={"upper": bound, "lower": bound})
        z = np.asarray(loop_at(rendered, CASE.frequencies_hz()).target)
        outwards = 1.001 if bound is CASE.boundaries.upper else 0.999
        assert judge_realism(CASE, z).inside_bounds.all()
        assert not judge_realism(CASE, outwards * z).inside_bounds.any()


@pytest.mark.parametrize("rounding", [1 - 1e-9, 1 + 1e-9])
def test_what_a_solver_leaves_of_bounds_that_coincide_is_inside(rounding):
    same = CASE.changed(boundaries={"upper": CASE.boundaries.upper, "lower": CASE.boundaries.upper})
    z = np.asarray(loop_at(same, same.frequencies_hz()).target)
    assert judge_realism(same, rounding * z).inside_bounds.all()


def test_errors_by_objective():
    z, goal = np.array([3 + 4j, 4 + 3j, 10 + 0j]), np.array([5 + 0j, 5j, 10 + 0j])
    np.testing.assert_allclose(relative_errors(z, goal), [0, 0, 0])
    complex_ = relative_errors(z, goal, "complex")
    np.testing.assert_allclose(complex_, np.abs(z - goal) / np.abs(goal))
    np.testing.assert_allclose(relative_errors(z, goal, "perceptual", 0.1), np.maximum(complex_ / 0.1 - 1, 0))
