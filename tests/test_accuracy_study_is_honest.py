"""The accuracy study finds the errors that are there: of loose tolerances, of short tables, of coarse grids."""

import json

import numpy as np
import pytest
from studies.accuracy.figure import draw_accuracy
from studies.accuracy.grids import grid_misses
from studies.accuracy.interpolations import linear, nearest, pchip
from studies.accuracy.solvers import reference_errors
from studies.accuracy.study import study_accuracy
from studies.accuracy.tables import table_errors

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.backends import DEFAULT_SOLVER
from avc_casadi.present.figures.layout import save_figure


def fewer(name, points):
    problem = avc.load_problem(name)
    return problem.changed(frequency={"points": points})


@pytest.fixture(scope="module")
def study():
    return study_accuracy(fewer("figure5", 12), tolerances=(1e-2, 1e-10), solvers=("sqpmethod", "fatrop"))


def entry(study, **wanted):
    (found,) = [cost for cost in study.solvers if all(getattr(cost, key) == value for key, value in wanted.items())]
    return found


def test_own_methods_are_at_rounding_and_a_loose_solver_is_not(study):
    assert study.reference == "50 digits (mpmath)"
    for wanted in ({"method": "exact"}, {"solver": DEFAULT_SOLVER}):
        cost = entry(study, **wanted)
        assert cost.largest_excess_error < 1e-12
        assert cost.optimal_share == cost.solved_share == 1
    loose, tight = (entry(study, solver="sqpmethod", tolerance=tolerance) for tolerance in (1e-2, 1e-10))
    assert loose.largest_excess_error > 1e-6
    assert loose.optimal_share < 1
    assert loose.solved_share < 1
    assert tight.largest_excess_error < 1e-8
    assert tight.optimal_share == 1


def test_the_closed_form_is_never_called_optimal_where_it_violates_its_bounds(study):
    closed = entry(study, method="closed-form")
    assert closed.optimal_share <= closed.solved_share == 0


def test_pareto_front_and_default_are_marked(study):
    best = [cost for cost, front in zip(study.solvers, study.pareto(), strict=True) if front]
    assert entry(study, method="exact") in best
    assert entry(study, solver="sqpmethod", tolerance=1e-2) not in best
    for one in best:
        for other in study.solvers:
            assert not (
                other.seconds_per_frequency < one.seconds_per_frequency
                and (other.largest_excess_error or np.inf) < one.largest_excess_error
            )
    assert [cost.solver for cost in study.solvers if cost.default] == [DEFAULT_SOLVER]


def test_the_document_is_plain_json_with_the_promised_keys(study):
    document = json.loads(json.dumps(study.document(), allow_nan=False))
    assert set(document) >= {"solvers", "tables", "grids", "scenes"}
    assert set(document["solvers"][0]) >= {
        "method", "solver", "tolerance", "seconds_per_frequency", "excess_error", "optimal_share", "solved_share",
    }  # fmt: skip
    assert set(document["tables"][0]) >= {"rows", "interpolation", "precision", "max_error"}
    assert set(document["grids"][0]) >= {"points", "missed_violation"}
    assert set(document["scenes"][0]) >= {"scene", "integrator", "substeps", "error", "seconds"}


def test_the_figure_draws_failures_with_open_markers(study, tmp_path):
    figure = draw_accuracy(study)
    markers = [line for line in figure.subfigs[0].axes[0].get_lines() if line.get_linestyle() == "None"]
    faces = {line.get_markerfacecolor() for line in markers}
    assert "white" in faces
    assert len(faces) > 1
    save_figure(figure, tmp_path / "accuracy.png")
    assert (tmp_path / "accuracy.png").stat().st_size > 10_000


def test_reference_is_exact_where_50_digits_are_not_to_be_had():
    problem = fewer("damped", 5)
    reference = reference_errors(problem, problem.frequencies_hz())
    assert reference.source.startswith("method exact")
    np.testing.assert_allclose(reference.error_ns_per_m, solve(problem, "exact").magnitude_error, rtol=1e-12)


def test_longer_tables_err_less_and_single_precision_sets_a_floor():
    tables = table_errors(fewer("ve4", 50), rows=(10, 100, 1000))

    def error(rows, interpolation, precision):
        (found,) = [t for t in tables if (t.rows, t.interpolation, t.precision) == (rows, interpolation, precision)]
        return found.median_error

    for name in ("linear", "pchip", "nearest"):
        assert error(10, name, "float64") > error(100, name, "float64") > error(1000, name, "float64")
    assert error(1000, "pchip", "float64") < error(1000, "linear", "float64") < error(1000, "nearest", "float64")
    assert error(1000, "pchip", "float32") > 3 * error(1000, "pchip", "float64")
    assert error(10, "linear", "float32") == pytest.approx(error(10, "linear", "float64"), rel=1e-2)


def test_finer_grids_miss_less_and_none_finds_more_than_there_is():
    misses = grid_misses(avc.load_problem("figure5"), points=(5, 50, 500))
    violations = [miss.missed_violation for miss in misses]
    assert violations[0] > violations[1] > violations[2] >= 0
    assert misses[0].missed_rows > misses[2].missed_rows
    assert all(miss.missed_rows <= miss.rows for miss in misses)


def test_a_problem_without_gains_or_with_one_frequency_has_no_tables():
    problem = avc.load_problem("hard/infeasible-box")
    assert table_errors(problem, rows=(10,)) == []
    assert grid_misses(problem, points=(10,)) == []
    single = problem.changed(frequency=type(problem.frequency)(values_hz=(3.0,)))
    assert table_errors(single, rows=(10,)) == []


@pytest.mark.parametrize("interpolation", [linear, nearest, pchip])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_interpolations_pass_through_the_rows_and_stay_between_them(interpolation, kind):
    rng = np.random.default_rng(2)
    frequency = np.geomspace(1.0, 400.0, 15)
    rows = np.column_stack((frequency, rng.uniform(0, 1e3, (15, 3)))).astype(kind)
    epsilon = 50 * np.finfo(kind).eps
    at_rows = interpolation(rows, rows[:, 0])
    np.testing.assert_allclose(at_rows, rows[:, 1:], rtol=epsilon, atol=1e3 * epsilon)
    at = np.geomspace(1.0, 400.0, 999).astype(kind)
    between = interpolation(rows, at)
    assert between.dtype == kind
    low = np.clip(np.searchsorted(rows[:, 0], at, side="right") - 1, 0, 13)
    floor, ceiling = np.minimum(rows[low, 1:], rows[low + 1, 1:]), np.maximum(rows[low, 1:], rows[low + 1, 1:])
    inside = slice(1, -1)
    assert np.all(between[inside] >= floor[inside] - 1e3 * epsilon)
    assert np.all(between[inside] <= ceiling[inside] + 1e3 * epsilon)


def test_pchip_is_cubic_where_the_data_is_smooth():
    """Halving the distance of the rows divides its error by about eight or more."""

    def error(count):
        frequency = np.geomspace(1.0, 100.0, count)
        rows = np.column_stack((frequency, *[np.exp(np.log(frequency) / 2)] * 3))
        at = np.geomspace(2.0, 50.0, 1001)
        return np.abs(pchip(rows, at)[:, 0] - np.sqrt(at)).max()

    assert error(40) < error(20) / 6
