"""The CasADi NLP is the paper's (11)-(12), also after its scaling, and a wrong gain is caught."""

import casadi as ca
import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.backends import DEFAULT_SOLVER
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.nlp import KKT_TOLERANCE, coupling_nlp, nlp_parameters, optimality
from avc_casadi.paper.nlp_solver import nlp_solvers
from avc_casadi.paper.rows import best_candidate
from tests.drawn_problems import drawn_problem


def evaluated(problem, gains, expressions):
    """Values of CasADi expressions of the NLP at (b, k, b_p), each (n,)."""
    nlp = coupling_nlp()
    loop = loop_at(problem, problem.frequencies_hz())
    function = ca.Function("f", [nlp.gains, nlp.parameters], [ca.vertcat(*expressions)]).map(len(gains[0]))
    return loop, np.array(function(np.array(gains), nlp_parameters(problem, loop)))


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


def test_objective_is_11_and_constraint_is_12():
    nlp = coupling_nlp()
    for problem, gains in cases():
        loop, (objective, constraint) = evaluated(problem, gains, [nlp.objective, nlp.constraint])
        z = loop.perceived(*gains)
        scale = np.abs(loop.target) + np.abs(z)
        terms = np.abs(loop.device) + np.abs(loop.hold * (z - loop.device)) + problem.stability.margin_ns_per_m
        assert np.all(np.abs(objective - (np.abs(loop.target) - np.abs(z)) ** 2) <= 1e-12 * scale**2)
        assert np.all(np.abs(constraint - (z.real - problem.stability.margin_ns_per_m)) <= 1e-12 * (terms + scale))


def test_objective_depends_on_b_and_k_and_nothing_stands_between():
    """(11) in the symbols b and k: its gradient is -2 (|Z_ds| - |Z|) d|Z|/d(b, k)."""
    nlp = coupling_nlp()
    problem = avc.load_problem("figure5")
    n = len(problem.frequencies_hz())
    b, k, step = np.full(n, 50.0), np.full(n, 2e4), 1e-5
    loop, (slope_b, slope_k, _) = evaluated(problem, (b, k, np.zeros(n)), [ca.gradient(nlp.objective, nlp.gains)])

    def goal(b, k):
        return (np.abs(loop.target) - np.abs(loop.perceived(b, k))) ** 2

    by_b = (goal(b * (1 + step), k) - goal(b * (1 - step), k)) / (2 * step * b)
    by_k = (goal(b, k * (1 + step)) - goal(b, k * (1 - step))) / (2 * step * k)
    np.testing.assert_allclose(slope_b, by_b, rtol=1e-4, atol=1e-6 * np.abs(slope_b).max())
    np.testing.assert_allclose(slope_k, by_k, rtol=1e-4, atol=1e-6 * np.abs(slope_k).max())


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


@pytest.mark.parametrize("name", ["figure5", "damped", "ve5"])
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


def test_a_violation_and_a_gain_outside_the_box_are_measured():
    problem = avc.load_problem("figure5")
    loop = loop_at(problem, problem.frequencies_hz())
    n = len(loop.target)
    rigid = optimality(problem, loop, (np.full(n, 1e4), np.full(n, 1e7), np.zeros(n)))
    expected = np.maximum(0.0, -loop.perceived(1e4, 1e7).real)
    np.testing.assert_allclose(rigid.violation_ns_per_m, expected, rtol=1e-9)
    assert expected.max() > 10
    outside = optimality(problem, loop, (np.full(n, 2e4), np.full(n, 1e3), np.zeros(n)))
    assert np.all(np.isinf(outside.violation_ns_per_m))
    assert not outside.acceptable().any()


def test_kkt_residual_vanishes_only_at_stationary_points():
    """Along a path through the optimum the residual is smallest at the optimum."""
    problem = avc.load_problem("figure5")
    loop = loop_at(problem, problem.frequencies_hz())
    schedule = solve(problem, "direct")
    row = int(np.argmax(schedule.magnitude_error))
    assert schedule.magnitude_error[row] > 1e-3
    n = len(loop.target)
    residuals = []
    for factor in (0.8, 0.95, 1.0, 1.05, 1.2):
        b, k = schedule.damping_ns_per_m[row] * factor, schedule.stiffness_n_per_m[row]
        residuals.append(optimality(problem, loop, (np.full(n, b), np.full(n, k), np.zeros(n))).kkt_residual[row])
    assert residuals[2] <= KKT_TOLERANCE
    assert min(residuals[0], residuals[1], residuals[3], residuals[4]) > KKT_TOLERANCE


def one_frequency(margin=0.0):
    problem = avc.load_problem("figure5")
    frequency = type(problem.frequency)(values_hz=(20.0,))
    stability = problem.stability.model_copy(update={"margin_ns_per_m": margin})
    problem = problem.model_copy(update={"frequency": frequency, "stability": stability})
    return problem, loop_at(problem, problem.frequencies_hz())


def pick(problem, loop, candidates):
    columns = [np.array(column, dtype=float)[:, None] for column in zip(*candidates, strict=True)]
    chosen = best_candidate(problem, loop, *columns)
    return tuple(float(gain[0]) for gain in chosen)


def test_ties_are_broken_by_distance_then_contact_damping_then_stiffness_then_damping():
    problem = avc.load_problem("hard/free-space")
    problem = problem.model_copy(
        update={
            "frequency": type(problem.frequency)(values_hz=(20.0,)),
            "coupling": type(problem.coupling)(structure="damped", contact_damping_ns_per_m=(0.0, 1e3)),
        }
    )
    loop = loop_at(problem, problem.frequencies_hz())
    # In free space the coupling is not felt: all gains tie in error and distance, contact damping alone does not.
    assert pick(problem, loop, [(1, 2, 0), (3, 1, 0), (2, 1, 0)]) == (2, 1, 0)
    assert pick(problem, loop, [(0, 0, 1e-20), (9, 9, 0)]) == (9, 9, 0)
    assert pick(problem, loop, [(0, 0, 5), (9, 9, 0)]) == (9, 9, 0)


def test_magnitude_comes_before_distance_and_feasibility_before_all():
    problem, loop = one_frequency()
    direct = solve(problem, "direct")
    best = (float(direct.damping_ns_per_m[0]), float(direct.stiffness_n_per_m[0]), 0.0)
    rigid = (1e4, 1e7, 0.0)
    assert loop.perceived(*rigid).real[0] < 0, "not passive"
    near = (best[0] * 1.001, best[1], 0.0)
    assert pick(problem, loop, [rigid, near, best]) == best
    assert np.isnan(pick(problem, loop, [rigid, (2e4, 1.0, 0.0)])).all(), "not passive, outside the box"


def test_of_two_points_of_equal_magnitude_the_nearer_wins():
    problem, loop = one_frequency()
    radius = float(np.abs(loop.target)[0])
    # |Z| = |Z_h_ds| is a curve: follow it over the stiffness by halving the damping's interval.
    curve = []
    for k in np.geomspace(3e4, 3e6, 9):
        low, high = 0.0, 1e4
        size = [float(np.abs(loop.perceived(b, k))[0]) - radius for b in (low, high)]
        if size[0] * size[1] > 0:
            continue
        for _ in range(200):
            middle = (low + high) / 2
            value = float(np.abs(loop.perceived(middle, k))[0]) - radius
            low, high = (middle, high) if value * size[0] > 0 else (low, middle)
        if loop.perceived(low, k).real[0] >= 0:
            curve.append((low, float(k), 0.0))
    assert len(curve) >= 2
    distances = [float(np.abs(loop.perceived(b, k) - loop.target)[0]) for b, k, _ in curve]
    assert pick(problem, loop, curve) == curve[int(np.argmin(distances))]
    direct = solve(problem, "direct")
    assert np.abs(direct.impedance - direct.target)[0] <= min(distances) * (1 + 1e-12)
