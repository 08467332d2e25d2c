"""`avc accuracy` finds the errors that are there: its optimum is that of 50 digits, and a loose tolerance misses it."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.design.comparison.accuracy import solver_costs
from avc_casadi.paper.nlp_solver import DEFAULT_SOLVER


def fewer(points):
    return avc.load_problem("figure5").changed(frequency={"points": points})


@pytest.fixture(scope="module")
def costs():
    return solver_costs(fewer(12), tolerances=(1e-2, 1e-10), solvers=("sqpmethod",))


def entry(costs, **wanted):
    (found,) = [cost for cost in costs if all(getattr(cost, key) == value for key, value in wanted.items())]
    return found


def test_own_methods_are_at_rounding_and_a_loose_solver_is_not(costs):
    for wanted in ({"method": "exact"}, {"solver": DEFAULT_SOLVER}):
        cost = entry(costs, **wanted)
        assert cost.largest_excess_error < 1e-12
        assert cost.optimal_share == cost.solved_share == 1
    loose, tight = (entry(costs, solver="sqpmethod", tolerance=tolerance) for tolerance in (1e-2, 1e-10))
    assert loose.largest_excess_error > 1e-6
    assert loose.solved_share < 1
    assert tight.largest_excess_error < 1e-8
    assert tight.optimal_share == 1


def test_the_closed_form_is_never_called_optimal_where_it_violates_its_bounds(costs):
    closed = entry(costs, method="closed-form")
    assert closed.optimal_share <= closed.solved_share == 0


@pytest.mark.slow
def test_the_command_answers_and_draws(capsys, tmp_path):
    assert main(["accuracy", "figure5", "--plot", str(tmp_path / "accuracy.png"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {cost["method"] for cost in document["solvers"]} == {"closed-form", "exact", "direct"}
    assert all(cost["seconds_per_frequency"] > 0 for cost in document["solvers"])
    assert (tmp_path / "accuracy.png").stat().st_size > 10_000
