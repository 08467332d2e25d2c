"""A gain table between its rows, in double and single precision, and the fewest rows that serve for all."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from schedule_problems import figure5

from avc_casadi import InputError, solve
from avc_casadi.claims.thinning import reduce_rows
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.gains import Gains, GainTable, gains_at, interpolate, single_ln
from avc_casadi.model.schedule import Status
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.rendered import gain_schedule
from avc_hardware.link.table import lookup


@st.composite
def tables(draw):
    frequency = sorted(draw(st.sets(st.floats(2**-7, 2**14, width=32), min_size=1, max_size=12)))
    gains = st.floats(0, 2**23, width=32)
    return np.array([[f, draw(gains), draw(gains), draw(gains)] for f in frequency])


@given(tables(), st.lists(st.floats(0.001, 2e4), min_size=1, max_size=20))
def test_linear_in_ln_frequency_and_held_beyond_the_ends(rows, frequencies):
    found = interpolate(rows, frequencies)
    for column in range(3):
        expected = np.interp(np.log(frequencies), np.log(rows[:, 0]), rows[:, 1 + column])
        np.testing.assert_allclose(found[:, column], expected, rtol=1e-9, atol=1e-9 * (1 + rows[:, 1 + column].max()))


@pytest.mark.thorough
@given(tables(), st.lists(st.floats(2**-10, 2**15, width=32), min_size=1, max_size=20))
def test_single_precision_is_the_device_and_near_double(rows, frequencies):
    single = interpolate(rows.astype(np.float32), frequencies, single_ln)
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, lookup(rows.astype(np.float32), frequencies))
    # Between rows whose frequencies differ in the last bits alone, single precision knows no position.
    if len(rows) == 1 or np.diff(np.log(rows[:, 0])).min() > 1e-2:
        wide = interpolate(rows, frequencies)
        assert (np.abs(single - wide) <= 1e-3 * (1 + rows[:, 1:].max(axis=0))).all()


@given(st.floats(2**-100, 2**100, width=32))
def test_single_logarithm(x):
    assert float(single_ln(x)) == pytest.approx(np.log(np.float64(np.float32(x))), rel=1e-6, abs=2e-7)


def test_undefined_frequency_takes_the_first_row():
    rows = np.array([[1.0, 2.0, 3.0, 4.0], [2.0, 5.0, 6.0, 7.0]])
    np.testing.assert_array_equal(interpolate(rows, np.nan), rows[0, 1:])


def test_scene_takes_the_gains_of_the_device():
    gains = solve(load_problem("soft"), "exact")
    at = gains_at(gains, 7.3)
    b, k, contact = interpolate(GainTable.of(gains).rows, 7.3)
    assert (at.damping_ns_per_m, at.stiffness_n_per_m, at.contact_damping_ns_per_m) == (b, k, contact)


def deviation(problem, rows, kept):
    """Largest relative deviation of Z_h at the dropped rows, and whether Re Z_h stays at the margin there."""
    kept = list(kept)
    loop = loop_at(problem, rows[:, 0])
    gains = [np.interp(np.log(rows[:, 0]), np.log(rows[kept, 0]), rows[kept, column]) for column in (1, 2, 3)]
    z, own = loop.perceived(*gains), loop.perceived(*rows.T[1:])
    margin = np.minimum(own.real, problem.stability.margin_ns_per_m)
    dropped = np.setdiff1d(np.arange(len(rows)), kept)
    return (np.abs(z - own) / np.abs(own)).max(), bool((z.real >= margin)[dropped].all())


@pytest.mark.parametrize("name", ["figure5", "soft", "damper"])
def test_choice_is_the_best_of_all_subsets(name):
    problem = figure5(points=10) if name == "figure5" else load_problem(name).changed(frequency={"points": 10})
    gains = solve(problem, "schedule")
    rows = GainTable.of(gains).rows
    best = {}
    for count in range(2, 11):
        for middle in itertools.combinations(range(1, 9), count - 2):
            error, passive = deviation(problem, rows, (0, *middle, 9))
            if passive:
                best[count] = min(error, best.get(count, np.inf))
    for count in best:
        found = reduce_rows(GainTable.of(gains), problem, rows=count)
        assert len(found.table.rows) <= count
        assert found.error == pytest.approx(min(best[c] for c in best if c <= count), abs=1e-12)
        assert found.error == pytest.approx(deviation(problem, rows, found.kept)[0], abs=1e-12)
    tolerance = 0.02
    fewest = min(count for count in best if best[count] <= tolerance)
    found = reduce_rows(GainTable.of(gains), problem, tolerance=tolerance)
    assert len(found.table.rows) == fewest
    assert found.error == pytest.approx(best[fewest], abs=1e-12)


def test_rows_between_which_a_gain_would_fall_below_the_margin_are_not_neighbours():
    """Pointwise optima stand on the margin: the nearest tables are active between their rows, and are left."""
    problem = figure5(points=8)
    table = GainTable.of(solve(problem, "exact"))
    best = {True: {}, False: {}}
    for count in range(2, 8):
        for middle in itertools.combinations(range(1, 7), count - 2):
            error, passive = deviation(problem, table.rows, (0, *middle, 7))
            best[passive][count] = min(error, best[passive].get(count, np.inf))
    refused = 0
    for count in best[True]:
        found = reduce_rows(table, problem, rows=count)
        assert deviation(problem, table.rows, found.kept)[1]
        assert found.error == pytest.approx(min(best[True][c] for c in best[True] if c <= count), abs=1e-12)
        refused += best[False].get(count, np.inf) < 0.9 * found.error
    assert refused >= 3
    with pytest.raises(InputError, match="no table of 2 rows keeps Re Z_h at the margin"):
        reduce_rows(table, problem, rows=2)


def test_rows_that_are_below_the_margin_themselves_do_not_forbid_a_table():
    """Gains made without a margin, a problem that asks for one: where a row is below it, the same gain is no worse."""
    strict = figure5(points=9, stability={"margin_ns_per_m": 5.0})
    frequency = strict.frequencies_hz()
    rows = np.array([[f, 1.0, 8e3, 0.0] for f in frequency])
    assert (loop_at(strict, frequency).perceived(*rows.T[1:]).real < 5.0).all()
    np.testing.assert_array_equal(reduce_rows(GainTable(rows), strict, rows=2).kept, [0, 8])


def test_gains_at_a_frequency_need_both_rows_about_it_and_rest_is_the_lowest():
    problem = figure5(points=4)
    status = (Status.SOLVED, Status.SOLVED, Status.INFEASIBLE, Status.SOLVED)
    gains = tuple(np.array([1.0, 2.0, 3.0, 4.0]) * scale for scale in (1.0, 100.0, 0.0))
    schedule = gain_schedule(problem, "file", gains, status)
    assert gains_at(schedule) == Gains(1.0, 100.0)
    low, high = problem.frequencies_hz()[:2]
    between = gains_at(schedule, float(np.sqrt(low * high)))
    assert (between.damping_ns_per_m, between.stiffness_n_per_m) == pytest.approx((1.5, 150.0))
    for refused in problem.frequencies_hz()[2] * np.array([0.99, 1.0, 1.01]):
        with pytest.raises(InputError, match="has no gains"):
            gains_at(schedule, refused)


def test_of_equally_near_tables_the_shortest_is_taken():
    frequency = np.geomspace(1, 256, 9)
    rows = np.array([[f, 10.0 * i, 1000.0 - 100.0 * i, 0.0] for i, f in enumerate(frequency)])
    constant = np.array([[f, 10.0, 1000.0, 0.0] for f in frequency])
    np.testing.assert_array_equal(reduce_rows(GainTable(constant), rows=7).kept, [0, 8])
    straight = reduce_rows(GainTable(rows), tolerance=1e-12)
    np.testing.assert_array_equal(straight.kept, [0, 8])


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_tolerance_holds_on_long_tables_too(tolerance):
    gains = solve(figure5(points=900), "schedule")
    found = reduce_rows(GainTable.of(gains), figure5(points=900), tolerance=tolerance)
    assert found.error <= tolerance
    assert found.single_error <= tolerance + 1e-4
    assert len(found.table.rows) < 200
    assert found.kept[0] == 0
    assert found.kept[-1] == 899


def fewest_by_trying_every_pair(rows, tolerance):
    """Number of rows of the shortest path, where each pair of rows is tried against all rows between them."""
    x, gains = np.log(rows[:, 0]), rows[:, 1:]
    size = np.where(gains == 0, np.maximum(gains.max(axis=0), 1.0), gains)
    steps = np.full(len(rows), len(rows))
    steps[0] = 0
    for last in range(1, len(rows)):
        for first in range(last):
            share = ((x[first + 1 : last] - x[first]) / (x[last] - x[first]))[:, None]
            guess = (1 - share) * gains[first] + share * gains[last]
            if (np.abs(guess - gains[first + 1 : last]) <= tolerance * size[first + 1 : last]).all():
                steps[last] = min(steps[last], steps[first] + 1)
    return int(steps[-1]) + 1


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-3, 2e-2])
@pytest.mark.parametrize("seed", [1, 2])
def test_of_a_long_table_no_smaller_choice_meets_the_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    frequency = np.geomspace(1.0, 450.0, 300)
    smooth = (
        100 * (1.5 + np.sin(np.outer(np.log(frequency), rng.uniform(0.5, 3.0, 3)))) * rng.choice([1.0, 0.0], (1, 3))
    )
    smooth[rng.integers(300, size=3)] *= 1.7
    table = GainTable(np.column_stack([frequency, smooth + 1e-4 * rng.normal(size=smooth.shape) * (smooth > 0)]))
    found = reduce_rows(table, tolerance=tolerance)
    assert found.error <= tolerance * (1 + 1e-9)
    assert len(found.kept) == fewest_by_trying_every_pair(table.rows, tolerance)


def test_without_a_problem_the_gains_are_measured():
    gains = solve(figure5(points=60), "schedule")
    found = reduce_rows(GainTable.of(gains), tolerance=0.05)
    rows = GainTable.of(gains).rows
    guess = interpolate(found.table.rows, rows[:, 0])
    size = np.where(rows[:, 1:] == 0, np.maximum(rows[:, 1:].max(axis=0), 1), rows[:, 1:])
    assert (np.abs(guess - rows[:, 1:]) / size).max() == pytest.approx(found.error)
    assert found.error <= 0.05
    assert len(found.table.rows) < 60


def test_all_rows_and_one_row():
    gains = solve(figure5(points=12), "schedule")
    assert len(reduce_rows(GainTable.of(gains), tolerance=0.0).table) <= 12
    assert reduce_rows(GainTable.of(gains), rows=40).error == 0
    np.testing.assert_array_equal(reduce_rows(GainTable.of(gains), rows=1).kept, [0])


@pytest.mark.parametrize("options", [{}, {"rows": 3, "tolerance": 0.1}, {"rows": 0}, {"tolerance": -1.0}])
def test_refusals(options):
    gains = solve(figure5(points=5), "exact")
    with pytest.raises(InputError):
        reduce_rows(GainTable.of(gains), **options)


def test_table_without_gains_is_refused():
    problem = load_problem("hard/infeasible-box")
    with pytest.raises(InputError, match="no row with gains"):
        GainTable.of(solve(problem, "exact"))
