"""Whether a row stands on the gain box depends on its gains, not on how near to a bound its solver dares to go."""

import numpy as np
import pytest

from avc_casadi import load_problem, solve


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ["ipopt", "sqpmethod"])
def test_equal_gains_have_equal_status_whoever_found_them(solver):
    problem = load_problem("figure5")
    problem = problem.changed(frequency={"points": 40})
    root, found = solve(problem, "direct"), solve(problem, "direct", solver=solver)
    (_, most_b), (_, most_k) = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
    equal = np.abs(root.damping_ns_per_m - found.damping_ns_per_m) <= 1e-7 * most_b
    equal &= np.abs(root.stiffness_n_per_m - found.stiffness_n_per_m) <= 1e-7 * most_k
    assert equal.sum() > 20
    active = np.array([status == "active-bound" for status in root.status])
    assert (equal & active).sum() > 5
    assert (equal & ~active).sum() > 5
    for row in np.flatnonzero(equal):
        assert found.status[row] == root.status[row]
