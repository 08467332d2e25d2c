"""The CasADi NLP is the paper's (11)-(12), also after its scaling, and a wrong gain is caught."""

import re

import numpy as np
import pytest
from drawn_problems import drawn_problem
from quick import first

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.direct import EXCESS_TOLERANCE
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.nlp import nlp_parameters, optimality
from avc_casadi.paper.nlp_solver import DEFAULT_SOLVER, SOLVERS, nlp_solvers


def cases(count=40):
    rng = np.random.default_rng(3)
    for _ in range(count):
        problem = drawn_problem(rng)
        n = len(problem.frequencies_hz())
        sample_time = problem.device.sample_time_s
        gains = [10 ** rng.uniform(-3, 5, n), 10 ** rng.uniform(-4, 4, n) / sample_time, 10 ** rng.uniform(-3, 3, n)]
        if problem.coupling.structure == "series":
            gains[2][:] = 0.0
        yield problem, gains


@pytest.mark.parametrize("name", [DEFAULT_SOLVER, "ipopt"])
def test_what_nlpsol_minimises_is_11_and_its_constraint_12(name):
    """What nlpsol was given, taken out of it again, in shares t/(1 + t) of each gain and with no scaling."""
    oracle = nlp_solvers(name, 1e-10, contact=True).error.oracle()
    unscaled = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]
    for problem, gains in cases(10):
        loop = loop_at(problem, problem.frequencies_hz())
        parameters = nlp_parameters(problem, loop)
        z = loop.perceived(*gains)
        share = np.array(gains) / (1 + np.array(gains))
        for row, expected in enumerate((np.abs(loop.target) - np.abs(z)) ** 2):
            values = oracle(x=share[:, row], p=[*parameters[:, row], *unscaled])
            # Shares near 1 lose the digits of large gains.
            scale, lost = abs(loop.target[row]) + abs(z[row]), 1e-13 * (1 + max(gain[row] for gain in gains))
            assert abs(float(values["f"]) - expected) <= (1e-12 + lost) * scale**2
            terms = scale + abs(loop.device[row]) + abs(gains[2][row]) + problem.stability.margin_ns_per_m
            inside = z[row].real - problem.stability.margin_ns_per_m
            assert abs(float(values["g"]) - inside) <= (1e-12 + lost) * terms


@pytest.mark.parametrize("name", first(["figure5", "damped", "ve5"]))
def test_the_optimum_passes_and_a_wrong_gain_is_caught(name):
    problem = avc.load_problem(name)
    loop = loop_at(problem, problem.frequencies_hz())
    schedule = solve(problem, "direct")
    gains = [schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m]
    quality = optimality(problem, loop, gains)
    assert np.all(quality.acceptable())
    assert np.all(quality.violation_ns_per_m == 0)
    for moved, factor in ((0, 1.5), (0, 0.6), (1, 1.3), (1, 0.7)):
        wrong = list(gains)
        wrong[moved] = np.where(gains[moved] == 0, 5.0, gains[moved] * factor)
        z = loop.perceived(*wrong)
        error = np.abs(np.abs(z) - np.abs(loop.target))
        worse = (error > schedule.magnitude_error + 1e-3 * np.abs(loop.target)) | (z.real < -1e-6)
        box = problem.coupling
        outside = (wrong[0] > box.damping_ns_per_m[1]) | (wrong[1] > box.stiffness_n_per_m[1])
        assert (worse | outside).any()
        caught = np.logical_not(optimality(problem, loop, wrong).acceptable())
        assert np.all(caught[worse | outside]), (moved, factor)


# Where no gains are admissible the message names the constraint and a relaxation that is enough and not too much.


def relaxed(problem, *, device=0.0, margin=0.0):
    damping = problem.device.damping_ns_per_m + device
    lowered = problem.stability.margin_ns_per_m - margin
    return problem.changed(device={"damping_ns_per_m": damping}, stability={"margin_ns_per_m": lowered})


def missing(reason):
    return float(re.search(r"missed by ([\d.e+-]+\d)", reason)[1])


@pytest.mark.slow
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


# Every solver of the registry solves, stays quiet, and is believed only after its answer has been recomputed.


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
