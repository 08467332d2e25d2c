"""Where no gains are admissible the message names the constraint and a relaxation that is enough and not too much."""

import re

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from tests.drawn_problems import drawn_problem


def relaxed(problem, *, device=0.0, margin=0.0):
    damping = problem.device.damping_ns_per_m + device
    lowered = problem.stability.margin_ns_per_m - margin
    return problem.changed(device={"damping_ns_per_m": damping}, stability={"margin_ns_per_m": lowered})


def missing(reason):
    return float(re.search(r"missed by ([\d.e+-]+\d)", reason)[1])


@pytest.mark.parametrize("method", ["direct", "exact"])
def test_the_catalogue_case_becomes_feasible_by_what_the_message_says(method):
    problem = avc.load_problem("hard/infeasible-box")
    schedule = solve(problem, method)
    assert set(schedule.status) == {"infeasible"}
    assert np.isnan(schedule.damping_ns_per_m).all()
    assert all("stability.margin_ns_per_m" in reason for reason in schedule.reason)
    assert all("lower the margin" not in reason for reason in schedule.reason), "it is 0 already"
    needed = max(missing(reason) for reason in schedule.reason)
    enough = solve(relaxed(problem, device=needed), method)
    assert "infeasible" not in enough.status
    assert "infeasible" in solve(relaxed(problem, device=0.99 * needed), method).status


@pytest.mark.thorough
def test_random_problems_become_feasible_by_just_that_relaxation():
    rng = np.random.default_rng(23)
    tried = margins = 0
    while tried < 40:
        problem = drawn_problem(rng, frequencies=1)
        schedule = solve(problem, "exact")
        if schedule.status != ("infeasible",):
            continue
        tried += 1
        gap = missing(schedule.reason[0])
        # Rounding of Z_h: what is missing may be far below it.
        scale = np.abs(schedule.target[0]) * 1e-11
        assert solve(relaxed(problem, device=gap + scale), "exact").status[0] != "infeasible", problem
        if 0.01 * gap > scale:
            assert solve(relaxed(problem, device=0.99 * gap), "exact").status == ("infeasible",), problem
        if "lower the margin" in schedule.reason[0]:
            margins += 1
            assert solve(relaxed(problem, margin=gap), "direct").status[0] != "infeasible", problem
            assert solve(relaxed(problem, margin=0.99 * gap), "direct").status == ("infeasible",), problem
    assert margins
