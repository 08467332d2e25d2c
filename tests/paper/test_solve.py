"""Every solver of the registry solves, stays quiet, and is believed only after its answer has been recomputed."""

import numpy as np
import pytest
from drawn_problems import drawn_problem

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.backends import SOLVERS
from avc_casadi.paper.cross_check import EXCESS_TOLERANCE, excess_error
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.nlp_gains import nlp_gains


def some_frequencies(name, *values):
    problem = avc.load_problem(name)
    return problem.changed(frequency=type(problem.frequency)(values_hz=values))


STIFF = some_frequencies("figure5", 1.0, 18.0, 60.0, 300.0)


@pytest.mark.parametrize("name", SOLVERS)
def test_it_solves_a_stiff_wall_without_a_word(name, capfd):
    schedule = solve(STIFF, "direct", solver=name)
    written = capfd.readouterr()
    assert written.out == ""
    assert written.err == ""
    assert schedule.solver == name
    exact = solve(STIFF, "exact")
    excess = schedule.magnitude_error - exact.magnitude_error
    assert "failed" not in schedule.status
    assert (excess <= EXCESS_TOLERANCE * np.abs(exact.target)).all()
    assert (schedule.real_part >= 0).all()
    assert any("cross-check with exact" in note for note in schedule.notes)


def test_a_tighter_tolerance_gives_a_smaller_error():
    problem = some_frequencies("figure5", 30.0, 60.0)
    loop = loop_at(problem, problem.frequencies_hz())
    optimum = exact_gains(problem, loop)

    def excess(tolerance):
        return np.nanmax(excess_error(loop, nlp_gains(problem, loop, "ipopt", tolerance), optimum))

    assert excess(1e-10) < 1e-8
    assert excess(1e-10) < excess(1e-2)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["ipopt", "sqpmethod"])
def test_random_problems_end_solved_or_failed_and_never_wrong(name):
    rng = np.random.default_rng(8)
    solved = 0
    for _ in range(12):
        problem = drawn_problem(rng, frequencies=2)
        schedule, exact = solve(problem, "direct", solver=name), solve(problem, "exact")
        for row, status in enumerate(schedule.status):
            assert (status == "infeasible") == (exact.status[row] == "infeasible")
            if schedule.status[row].has_gains:
                solved += 1
                excess = schedule.magnitude_error[row] - exact.magnitude_error[row]
                assert excess <= 2 * EXCESS_TOLERANCE * abs(exact.target[row])
                assert schedule.real_part[row] >= problem.stability.margin_ns_per_m
    assert solved >= 8
