"""Where no gains are admissible the message names the constraint and a relaxation that is enough and not too much."""

import re

import numpy as np
import pytest
from drawn_problems import drawn_problem

from avc_casadi.design.methods import solve


def relaxed(problem, *, device=0.0, margin=0.0):
    damping = problem.device.damping_ns_per_m + device
    lowered = problem.stability.margin_ns_per_m - margin
    return problem.changed(device={"damping_ns_per_m": damping}, stability={"margin_ns_per_m": lowered})


def missing(reason):
    return float(re.search(r"missed by ([\d.e+-]+\d)", reason)[1])


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
