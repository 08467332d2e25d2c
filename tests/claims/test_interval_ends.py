"""Ends of stable intervals: a value that is typed as it is printed is stable, and an end at 0 says what 0 is."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi._util.open_end import AboveZero
from avc_casadi._util.units import LINEAR
from avc_casadi.model.control_law import LawNumber
from avc_casadi.present.row import Value, beyond_limit, largest_value, stable_ends
from avc_casadi.present.rows.pieces import number_limits

DEVICE = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = {drag}\ndelay_samples = {late}\ncoulomb_friction_n = 0.2\n[law]\n"
LAWS = [
    "stiffness_n_per_m = 200.0\ndamping_ns_per_m = 1.0\nintegral_n_per_m_s = 50.0",
    "stiffness_n_per_m = 200.0\ndamping_ns_per_m = 1.0\nrate_divider = 2",
    "stiffness_n_per_m = 200.0\ndamping_ns_per_m = 1.0\ndead_zone_m = 0.001",
    "damping_ns_per_m = 1.0\nlocal_damping_ns_per_m = 0.5\nfilters = [{kind = 'low-pass', cutoff_hz = 30.0}]",
    "damping_ns_per_m = 1e-3\nvelocity = {kind = 'window', samples = 3}",
    "local_damping_ns_per_m = 2.0\nfriction_compensation = {force_n = 0.01, velocity_m_per_s = 0.02}",
    "virtual_mass_kg = -0.02\nstiffness_n_per_m = 500.0\ndamping_ns_per_m = 4.0",
    "damping_ns_per_m = 0.7",
    "stiffness_n_per_m = 150.0\ndamping_ns_per_m = 2.0",
]


def judged(law, late, drag):
    return avc.certify_law(avc.parse_problem(DEVICE.format(late=late, drag=drag) + law))


@pytest.mark.parametrize(
    ("law", "late", "drag"), first(zip(LAWS[::-1], itertools.cycle((0, 1)), itertools.cycle((0.0, 0.3))), 2)
)
def test_each_end_is_a_value_with_which_the_law_is_stable(law, late, drag):
    result = judged(law, late, drag)
    problem = result.problem
    intervals = result.intervals or {"damping_ns_per_m": result.damping_range_ns_per_m}
    numbers = {number.key: number for number in problem.law.numbers(1e-3)}
    assert intervals
    for key, ends in intervals.items():
        printed = [value for value in stable_ends(ends, "number")[1:] if isinstance(value, Value)]
        for end in {*ends, *(value.printed for value in printed)}:
            if math.isinf(end):
                continue
            whole = numbers[key].whole
            law_at_end = problem.law.with_number(numbers[key].path, int(end) if whole else float(end))
            assert avc.certify_law(problem.changed(law=law_at_end)).stable, (key, end)
        if isinstance(ends[0], AboveZero):
            with pytest.raises(avc.InputError, match="at least one other than 0"):
                problem.changed(law=problem.law.with_number(numbers[key].path, 0.0).model_dump())


def test_a_law_of_one_gain_has_an_open_end_at_0_and_a_small_gain_has_the_same_limit():
    """Before, a scan of four decades above 1e-6 N.s/m met no limit, and the row said that there is none."""
    law = "damping_ns_per_m = {}\nvelocity = {{kind = 'window', samples = 3}}"
    intervals = [judged(law.format(damping), 0, 0.0).intervals["damping_ns_per_m"] for damping in (1e-6, 1.0)]
    for low, high in intervals:
        assert isinstance(low, AboveZero)
        assert high == pytest.approx(102.94362, rel=1e-6)
    text = str(number_limits({"damping_ns_per_m": intervals[1]})[0])
    assert "above" in text


RESONANT = """
[device]
mass_kg = 5.5
damping_ns_per_m = 11.0
delay_samples = 1
resonance = {frequency_hz = 40.0, damping_ratio = 0.03, mass_ratio = 0.3}
encoder_at = "handle"
[hands]
mass_kg = [0.3, 2.0]
[law]
stiffness_n_per_m = 1000.0
damping_ns_per_m = 110.0
"""


@pytest.mark.slow
def test_a_spring_that_is_too_soft_is_below_an_interval_with_two_ends():
    """Before, the largest spring alone was told of a motor whose damper needs a stiff one beside it."""
    problem = avc.parse_problem(RESONANT)
    result = avc.certify_law(problem, remedies=False)
    ends = result.lowest_stiffness_n_per_m, result.largest_stiffness_n_per_m
    low, high = (end.printed for end in stable_ends(ends, "stiffness"))
    assert 1000.0 < low < high
    for spring, stable in ((low, True), (0.98 * low, False), (high, True), (1.02 * high, False)):
        assert avc.certify_law(problem, k=spring, b=110.0, remedies=False, limits=False).stable is stable


@given(
    st.floats(1e-6, 1e6),
    st.sampled_from([1e-9, 1e-6, 1e-3, 0.3]),
    st.sampled_from(["stiffness", "damping", "mass", "number"]),
    st.booleans(),
)
def test_a_limit_differs_from_the_value_that_is_beyond_it_and_is_good_as_printed(value, share, of, is_lower):
    limit = value * (1 + share) if is_lower else value / (1 + share)
    beyond, at_limit = beyond_limit(value, limit, of, is_lower=is_lower)
    rounding = 1e-9 * limit
    assert at_limit.printed >= limit - rounding if is_lower else at_limit.printed <= limit + rounding
    assert beyond.text(LINEAR) != at_limit.text(LINEAR) or share < 1e-8


@pytest.mark.parametrize("damper", first([10.0, 25.9]))
def test_the_largest_spring_as_it_is_printed_is_stable(damper):
    wall = "[environment]\nstiffness_n_per_m = 1e4\ndamping_ns_per_m = 5.0\n"
    problem = avc.parse_problem(DEVICE.format(late=1, drag=1.0).replace("[law]\n", wall))
    largest = avc.certify_law(problem, k=100.0, b=damper).largest_stiffness_n_per_m
    assert avc.certify_law(problem, k=largest_value(largest, "stiffness").printed, b=damper).stable
    assert not avc.certify_law(problem, k=1.01 * largest, b=damper).stable


@pytest.mark.parametrize(
    ("ends", "printed"),
    [
        ((0.0123456, 29.96), (0.0124, 29.9)),
        ((-0.0123456, 1234.5), (-0.0123, 1230.0)),
        ((0.0, math.inf), (0.0, math.inf)),
        ((-12.34, -0.0199999), (-12.3, -0.02)),
        ((2.0, 2.5), (2.0, 2.5)),
        ((0.3, 1e-9 * round(0.7e9)), (0.3, 0.7)),
    ],
)
def test_ends_are_rounded_into_their_interval(ends, printed):
    low, high = stable_ends(ends, "number")
    assert (low.printed, high.printed) == pytest.approx(printed, rel=1e-12)


def test_an_end_above_0_is_printed_as_one():
    low, high = stable_ends((AboveZero(1e-7), 3.0), "damping")
    assert low == ("above", Value(0.0, "damping"))
    assert high.text(LINEAR) == "3.00 N.s/m"
    assert LawNumber(("b",), 1.0).sole is False
