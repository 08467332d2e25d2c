"""Closed forms without delay, and limits that no passive rendering passes, against the general search."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_optimum import mpmath_numbers

from avc_casadi.claims.worst_frequency import real_part, size_of_terms, worst_margin
from avc_casadi.loops.wall import SampledLoop, fractions
from avc_casadi.paper.equations import SampleAngle, coupling_impedance, environment_impedance, hold, series

T = 1e-3
damping = st.floats(-3, 4).map(lambda x: 10**x)
stiffness = st.floats(-1, 7).map(lambda x: 10**x)
maybe_damping = st.one_of(st.just(0.0), damping)
maybe_stiffness = st.one_of(st.just(0.0), stiffness)


@pytest.mark.slow
@given(damping, maybe_damping, maybe_stiffness, maybe_damping, maybe_stiffness, maybe_damping)
def test_sampled_data_worst_point_is_nyquist(b_d, b_e, k_e, b, k, contact):
    loop = SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data")
    found = worst_margin(loop, b, k, contact)
    a1, a2 = b + k * T / 2, b_e + k_e * T / 2
    series = a1 * a2 / (a1 + a2) if a1 + a2 > 0 else 0.0
    size = size_of_terms(loop, fractions(loop, b, k), contact)
    assert abs(found.margin_ns_per_m[0] - (b_d - contact - series)) <= 1e-13 * size


@given(damping, maybe_damping, stiffness, maybe_damping, stiffness, maybe_damping, st.floats(-5, 0), st.floats(-5, 0))
def test_sampled_data_worst_point_of_a_band_is_an_end(b_d, b_e, k_e, b, k, contact, low, high):
    low, high = sorted((500 * 10**low, 500 * 10**high))
    loop = SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data")
    parts = fractions(loop, b, k)
    ends = real_part(loop, parts, contact, np.array([low, high]))
    found = worst_margin(loop, b, k, contact, (low, high))
    assert abs(found.margin_ns_per_m[0] - ends.min()) <= 1e-13 * size_of_terms(loop, parts, contact)


@pytest.mark.slow
@given(st.integers(0, 6), maybe_damping, stiffness, maybe_damping, stiffness)
def test_no_passive_rendering_is_stiffer_than_the_limit(delay, b_e, k_e, b, k):
    lowest = worst_margin(SampledLoop(0.0, b_e, k_e, T, delay, "sampled-data"), b, k)
    needed = -lowest.margin_ns_per_m[0]  # the least device damping that makes the rendering passive
    assert lowest.dc_stiffness_n_per_m[0] <= 2 * needed / ((1 + delay) * T) * (1 + 1e-9)


@pytest.mark.parametrize("delay", [0, 1, 2, 20])
def test_pure_spring_needs_half_a_sample_and_the_delay(delay):
    stiff = 1000.0
    found = worst_margin(SampledLoop(0.0, 0.0, stiff, T, delay, "sampled-data"), np.inf, 1.0)
    assert -found.margin_ns_per_m[0] == pytest.approx(stiff * (1 + 2 * delay) * T / 2, rel=1e-12)


@pytest.mark.slow
@given(st.floats(0.01, 100), st.floats(-50, 50), stiffness)
def test_colgate_schenkel_condition_of_a_spring_and_damper(b_d, b_e, k_e):
    margin = worst_margin(SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data"), np.inf, 1.0).margin_ns_per_m[0]
    assert margin == pytest.approx(b_d - k_e * T / 2 - abs(b_e), abs=1e-12 * (b_d + k_e * T + abs(b_e)))


NUMBERS = mpmath_numbers(50)


def reference(model, delay, values, frequency_hz):
    b_d, b_e, k_e, b, k, contact = (NUMBERS.number(float(value)) for value in values)
    angle = SampleAngle.at(NUMBERS, frequency_hz, NUMBERS.number(T))
    wall = environment_impedance(angle, model, b_e, k_e)
    rendered = series(coupling_impedance(angle, b, k), wall, numbers=NUMBERS)
    return (b_d + hold(angle, model, delay) * (contact + rendered)).real


def rows(count, seed):
    rng = np.random.default_rng(seed)
    spans = [(-2, 2), (-3, 3), (-2, 7), (-3, 6), (-2, 8)]
    columns = [10 ** rng.uniform(*span, count) for span in spans]
    return np.array([*columns, rng.choice([0.0, 1, 50], count)])


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 2, 20])
def test_margin_to_rounding(model, delay):
    values = rows(40, delay)
    b_d, b_e, k_e, b, k, contact = values
    loop = SampledLoop(b_d, b_e, k_e, T, delay, model)
    found = worst_margin(loop, b, k, contact)
    size = size_of_terms(loop, fractions(loop, b, k), contact)
    for row in range(values.shape[1]):
        start, margin = found.frequency_hz[row], found.margin_ns_per_m[row]
        one = values[:, row]
        if start < 1e-6:  # the limit of zero frequency
            best = reference(model, delay, one, NUMBERS.number(1e-12))
        elif start > 500 - 1e-3:
            best = reference(model, delay, one, NUMBERS.number(500 - 1e-12))
        else:
            with mpmath.workdps(40):
                points = [NUMBERS.number(start * factor) for factor in (1 - 1e-5, 1 - 1e-6, 1, 1 + 1e-6, 1 + 1e-5)]
                best = min(reference(model, delay, one, p) for p in points if p < 500)
        assert float(abs(best - margin)) <= 1e-9 * size[row]
        assert margin <= float(best) + 1e-12 * size[row]
        at = NUMBERS.number(min(max(start, 1e-12), 500 - 1e-12))
        assert float(abs(reference(model, delay, one, at) - margin)) <= 1e-12 * size[row]


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 20])
def test_real_part_to_rounding_at_every_frequency(model, delay):
    values = rows(30, 11)
    b_d, b_e, k_e, b, k, contact = values
    frequency = np.geomspace(1e-4, 499.9999, 30)
    loop = SampledLoop(b_d, b_e, k_e, T, delay, model)
    parts = fractions(loop, b, k)
    value = real_part(loop, parts, contact, frequency)
    exact = [float(reference(model, delay, values[:, i], NUMBERS.number(frequency[i]))) for i in range(30)]
    assert np.max(np.abs(value - exact) / size_of_terms(loop, parts, contact)) < 1e-13


def random_rows(count, seed):
    rng = np.random.default_rng(seed)
    loop_values = 10 ** rng.uniform(-2, 2, count), 10 ** rng.uniform(-3, 3, count), 10 ** rng.uniform(0, 6, count)
    return loop_values, 10 ** rng.uniform(-3, 5, count), 10 ** rng.uniform(0, 6, count), rng.choice([0.0, 1, 50], count)


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 20])
def test_band_margin_is_the_lowest_of_the_band(model, delay):
    (b_d, b_e, k_e), b, k, contact = random_rows(200, seed=3)
    low = np.geomspace(0.5, 480, 200)
    loop = SampledLoop(b_d, b_e, k_e, T, delay, model)
    result = worst_margin(loop, b, k, contact, (low, 4 * low))
    assert (result.frequency_hz >= low * (1 - 1e-12)).all()
    assert (result.frequency_hz <= np.minimum(4 * low, 500)).all()
    parts = fractions(loop, b, k)
    size = size_of_terms(loop, parts, contact)
    for share in np.linspace(0, 1, 400):
        at = low + share * (np.minimum(4 * low, 500) - low)
        assert (result.margin_ns_per_m <= real_part(loop, parts, contact, at) + 1e-12 * size).all()


def random_loop(generator, delay, model):
    stiffness = float(np.exp(generator.uniform(np.log(10.0), np.log(1e5))))
    return SampledLoop(float(generator.uniform(0.1, 20)), float(generator.uniform(0, 30)), stiffness, T, delay, model)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["paper", "sampled-data"])
def test_no_grid_point_lies_below_the_worst_margin(model):
    generator = np.random.default_rng(1)
    rows, missed = 20, 0.0
    for _ in range(60):
        loop = random_loop(generator, int(generator.integers(55, 130)), model)
        b, k = np.exp(generator.uniform(-2, 6, rows)), np.exp(generator.uniform(0, 11, rows))
        contact = np.where(generator.random(rows) < 0.5, 0.0, generator.uniform(0, 20, rows))
        low = np.exp(generator.uniform(np.log(0.5), np.log(300.0), rows))
        high = np.minimum(low * np.exp(generator.uniform(0.01, 2.0, rows)), 0.5 / T)
        worst = worst_margin(loop, b, k, contact, (low, high))
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 8001)
        parts = fractions(loop, b, k).pick((slice(None), None))
        lowest = real_part(loop, parts, contact[:, None], grid).min(axis=1)
        missed = max(missed, float(np.max((worst.margin_ns_per_m - lowest) / (1 + np.abs(lowest)))))
        assert np.all((worst.frequency_hz >= low) & (worst.frequency_hz <= high))
    assert missed < 1e-9
