"""A gain table between its rows, in double and single precision, and the fewest rows that serve for all."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from schedule_problems import figure5

from avc_casadi import InputError, solve
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.gains import Gains, GainTable, Status, fewest_rows, gains_at, interpolate, single_ln
from avc_casadi.paper.rows import gain_schedule
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


@pytest.mark.slow
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


def test_scene_takes_the_gains_of_the_device():
    gains = solve(load_problem("soft"), "exact")
    at = gains_at(gains, 7.3)
    b, k, contact = interpolate(GainTable.of(gains).rows, 7.3)
    assert (at.damping_ns_per_m, at.stiffness_n_per_m, at.contact_damping_ns_per_m) == (b, k, contact)


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


@pytest.mark.parametrize("tolerance", [0.0, 1e-3, 2e-2])
@pytest.mark.parametrize("seed", [1])
def test_no_smaller_choice_meets_the_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    frequency = np.geomspace(1.0, 450.0, 150)
    smooth = (
        100 * (1.5 + np.sin(np.outer(np.log(frequency), rng.uniform(0.5, 3.0, 3)))) * rng.choice([1.0, 0.0], (1, 3))
    )
    smooth[rng.integers(len(smooth), size=3)] *= 1.7
    table = np.column_stack([frequency, smooth + 1e-4 * rng.normal(size=smooth.shape) * (smooth > 0)])
    kept = fewest_rows(table, tolerance)
    guess = interpolate(table[kept], table[:, 0])
    size = np.where(table[:, 1:] == 0, np.maximum(table[:, 1:].max(axis=0), 1), table[:, 1:])
    assert (np.abs(guess - table[:, 1:]) <= tolerance * size * (1 + 1e-9) + 1e-12).all()
    assert len(kept) == fewest_by_trying_every_pair(table, tolerance)
