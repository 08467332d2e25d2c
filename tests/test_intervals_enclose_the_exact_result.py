"""Interval arithmetic on arrays encloses what rational arithmetic and mpmath find, and does so tightly."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.claims.prove.interval import ComplexInterval, Interval, cosine, sine

ENDS = st.floats(-1e150, 1e150, allow_nan=False).map(lambda x: x if abs(x) > 1e-150 else 0.0)
MODEST = st.floats(-50.0, 50.0).map(lambda x: x if abs(x) > 1e-150 else 0.0)
SHARE = st.floats(0.0, 1.0)


@st.composite
def interval(draw, ends=ENDS):
    low, high = sorted((draw(ends), draw(ends)))
    if draw(st.booleans()):
        high = low if draw(st.booleans()) else float(np.nextafter(low, np.inf))
    return Interval.of([low], [high])


def inside(one, share):
    """A rational number of the interval: an end, or one between them."""
    low, high = Fraction(float(one.low[0])), Fraction(float(one.high[0]))
    return low + Fraction(share) * (high - low)


def encloses(result, exact):
    return (
        not math.isnan(result.low[0])
        and (math.isinf(result.low[0]) or Fraction(float(result.low[0])) <= exact)
        and (math.isinf(result.high[0]) or exact <= Fraction(float(result.high[0])))
    )


@pytest.mark.thorough
@given(interval(), interval(), SHARE, SHARE)
@settings(max_examples=300)
def test_sums_products_and_quotients_are_enclosed(a, b, s, t):
    x, y = inside(a, s), inside(b, t)
    assert encloses(a + b, x + y)
    assert encloses(a - b, x - y)
    assert encloses(a * b, x * y)
    assert encloses(-a, -x)
    assert encloses(abs(a), abs(x))
    assert encloses(a.square(), x * x)
    assert encloses(a.hull(b), x)
    assert encloses(a.hull(b), y)
    assert encloses(a.clip(-1e300, 1e300), x)
    if b.low[0] > 0 or b.high[0] < 0:
        assert encloses(a / b, x / y)
    else:
        assert np.isnan((a / b).low).all()
        assert np.isnan((a / b).high).all()


@given(interval(), ENDS, SHARE)
def test_plain_numbers_count_as_exact(a, number, s):
    x, y = inside(a, s), Fraction(number)
    for one, exact in ((a + number, x + y), (number + a, x + y), (a - number, x - y), (number - a, y - x)):
        assert encloses(one, exact)
    assert encloses(number * a, x * y)
    assert encloses(np.array([number]) * a, x * y)
    if number:
        assert encloses(a / number, x / y)
    if a.low[0] > 0:
        assert encloses(number / a, y / x)


@pytest.mark.thorough
@given(interval(), interval())
@settings(max_examples=300)
def test_no_end_is_more_than_some_units_away_from_the_best(a, b):
    corners = [Fraction(float(x)) * Fraction(float(y)) for x in (a.low[0], a.high[0]) for y in (b.low[0], b.high[0])]
    product = a * b
    for end, best in ((product.low[0], min(corners)), (product.high[0], max(corners))):
        assert abs(Fraction(float(end)) - best) <= 3 * Fraction(2) ** -52 * abs(best) + Fraction(2) ** -1021


@given(st.floats(0.0, 1e200), SHARE)
def test_square_roots_are_enclosed(number, share):
    one = Interval.of([number * share], [number])
    root = one.sqrt()
    assert Fraction(float(root.low[0])) ** 2 <= Fraction(float(one.low[0]))
    assert Fraction(float(root.high[0])) ** 2 >= Fraction(float(one.high[0]))
    assert np.isnan(Interval.of([-1.0], [1.0]).sqrt().low).all()


@pytest.mark.thorough
@given(interval(st.floats(-1e4, 1e4)), SHARE)
@settings(max_examples=400)
def test_sine_and_cosine_are_enclosed(angle, share):
    with mpmath.workdps(60):
        x = inside(angle, share)
        number = mpmath.mpf(x.numerator) / x.denominator
        for enclosure, exact in ((sine(angle), mpmath.sin(number)), (cosine(angle), mpmath.cos(number))):
            assert mpmath.mpf(float(enclosure.low[0])) <= exact + mpmath.mpf(10) ** -50
            assert exact <= mpmath.mpf(float(enclosure.high[0])) + mpmath.mpf(10) ** -50


@pytest.mark.thorough
@given(st.lists(st.tuples(st.floats(-7.0, 7.0), st.floats(0.0, 8.0)), min_size=1, max_size=20))
def test_sine_and_cosine_of_ranges_are_those_of_mpmath(drawn):
    low, width = np.array(drawn).T
    angle = Interval.of(low, low + width)
    for enclosure, reference in ((sine(angle), mpmath.iv.sin), (cosine(angle), mpmath.iv.cos)):
        for i, (a, b) in enumerate(zip(angle.low, angle.high, strict=True)):
            exact = reference(mpmath.iv.mpf([float(a), float(b)]))
            assert float(enclosure.low[i]) == pytest.approx(float(exact.a), abs=1e-14)
            assert float(enclosure.high[i]) == pytest.approx(float(exact.b), abs=1e-14)


def test_extrema_of_sine_and_cosine_are_not_missed():
    turns = np.arange(-400, 401)
    for shift, function in ((0.0, cosine), (0.5, sine)):
        near = (turns + shift) * np.pi
        around = function(Interval.of(near - 1e-9, near + 1e-9))
        assert np.all(np.where(turns % 2 == 0, around.high == 1.0, around.low == -1.0))


@pytest.mark.thorough
@given(interval(MODEST), interval(MODEST), interval(MODEST), interval(MODEST), SHARE, SHARE, SHARE, SHARE)
@settings(max_examples=150)
def test_complex_rectangles_enclose(a, b, c, d, s, t, u, v):
    w, x, y, z = inside(a, s), inside(b, t), inside(c, u), inside(d, v)
    one, other = ComplexInterval(a, b), ComplexInterval(c, d)
    for result, real, imag in (
        (one + other, w + y, x + z),
        (one - other, w - y, x - z),
        (2.0 - one, 2 - w, -x),
        (one * other, w * y - x * z, w * z + x * y),
        (one * c, w * y, x * y),
        (c * one, w * y, x * y),
        (c - one, y - w, -x),
        (one.conj(), w, -x),
        (one.square(), w * w - x * x, 2 * w * x),
    ):
        assert encloses(result.real, real)
        assert encloses(result.imag, imag)
    assert encloses(one.abs2(), w * w + x * x)


def test_sums_enclose_exact_ones():
    generator = np.random.default_rng(3)
    left = generator.normal(size=(40, 3, 4))
    total = Interval.of(left).sum(axis=1)
    assert total.shape == (40, 4)
    assert np.all(total.width < 1e-13)
    assert np.all(total.width > 0)
    for row in range(40):
        exact = sum(Fraction(float(value)) for value in left[row, :, 2])
        assert Fraction(float(total.low[row, 2])) <= exact <= Fraction(float(total.high[row, 2]))


def test_what_is_not_known_stays_unknown():
    lost = Interval.of([np.nan, np.nan, 1.0], [np.nan, 1.0, np.nan])
    two = Interval.of([2.0, 2.0, 2.0])
    for result in (lost * two, two * lost, lost * lost, lost / two, abs(lost), lost.square(), lost.hull(-two)):
        assert not np.any((result.low > 0) & (result.high < np.inf))
        assert not np.any((result.high < 0) & (result.low > -np.inf))
    for result in (sine(lost), cosine(lost), lost + lost, lost - two, two - lost, lost.clip(-9.0, 9.0)):
        assert np.all(np.isnan(result.low) | np.isnan(result.high))
    overflown = Interval.of([1e200], [2e200]) * Interval.of([1e200], [2e200])
    assert np.isnan(overflown.low).all() or overflown.low[0] <= 1e308


def test_enclosures_survive_numbers_that_underflow():
    tiny = Interval.of([5e-324, 1e-310, 1e-200], [1e-320, 1e-305, 1e-190])
    square = tiny.square()
    assert np.all(square.low == 0.0) or np.all(square.low <= 1e-400)
    assert np.all(square.high > 0)
    product = tiny * -tiny
    assert np.all(product.low < 0)
    assert np.all(product.high >= 0)
