"""A margin in scope hands is damping that the device may lose: the same verdicts as for a device without it."""

from dataclasses import replace

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi import parse_problem, solve
from avc_casadi.claims.scope import scope_slack
from avc_casadi.design.constant.static_tuned import tune_static
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.model.hands import hand_set

ROWS = np.array([1.0, 20.0, 100.0, 400.0])
GAINS = np.array([0.1, 5.0, 40.0, 200.0]), np.array([500.0, 2e3, 8e3, 5e4]), np.array([0.0, 5.0, 0.0, 20.0])


def problem(b_d, margin, delay=0):
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\ndelay_samples={delay}\n"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        f'[stability]\nmodel="sampled-data"\nscope="hands"\nmargin_ns_per_m={margin}\n'
        '[coupling]\nstructure="series"\ndamping_ns_per_m=[0.0, 1e3]\nstiffness_n_per_m=[0.0, 1e6]\n'
        "[frequency]\nstart_hz=2.0\nstop_hz=200.0\npoints=5\n"
    )


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("margin", [0.5, 2.0])
def test_scope_of_frozen_rows(margin, delay):
    robbed = scope_slack(problem(2.0 - margin, 0.0, delay), ROWS, *GAINS)
    asked = scope_slack(problem(2.0, margin, delay), ROWS, *GAINS)
    np.testing.assert_allclose(asked.slack, robbed.slack, rtol=0, atol=1e-12)
    free = scope_slack(problem(2.0, 0.0, delay), ROWS, *GAINS)
    assert (free.slack - asked.slack > 1e-5).all()


@pytest.mark.thorough
def test_gains_that_keep_it():
    margin, case = 1.5, problem(2.0, 1.5)
    gains = solve(case, "schedule")
    assert gains.usable.all()
    found = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    robbed = problem(2.0 - margin, 0.0)
    radius = linear_stability(robbed.device, frozen_parts(robbed, *found[:2]), found[2], hand_set(robbed.hands)).radius
    assert (radius.max(axis=1) < 1).all()
    # Gains that need not keep it do not: the margin decides here.
    bold = solve(problem(2.0, 0.0), "schedule")
    radius = linear_stability(
        robbed.device,
        frozen_parts(robbed, bold.damping_ns_per_m, bold.stiffness_n_per_m),
        bold.contact_damping_ns_per_m,
        hand_set(robbed.hands),
    ).radius
    assert (radius.max(axis=1) > 1).any()


def reserve(case, b, k):
    """Damping that every hand may lose before one of them becomes unstable: device and hand share theirs."""
    hands, parts = hand_set(case.hands), frozen_parts(case, b, k)
    low, high = 0.0, 60.0
    for _ in range(40):
        middle = (low + high) / 2
        robbed = replace(hands, damping_ns_per_m=hands.damping_ns_per_m - middle)
        stable = (linear_stability(case.device, parts, 0.0, robbed).radius < 1).all()
        low, high = (middle, high) if stable else (low, middle)
    return low


@pytest.mark.thorough
def test_tuned_constant_gains_keep_it_in_reserve():
    """The one pair of a box is taken with a margin just below its reserve and refused just above."""
    b, k = 20.0, 1.2e4
    case = scene_problem(('kind = "hand"', 'kind = "wall"'), scene="duration_s = 1.0\n").changed(
        coupling={"damping_ns_per_m": (b, b), "stiffness_n_per_m": (k, k)}, frequency={"points": 5}
    )
    spare = reserve(case, b, k)
    assert 0 < spare < 60
    assert tune_static(case.changed(stability={"margin_ns_per_m": 0.98 * spare})).gains is not None
    assert tune_static(case.changed(stability={"margin_ns_per_m": 1.02 * spare})).gains is None
