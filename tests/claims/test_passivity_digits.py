"""The exact margin against 50 digits: the equations in mpmath, minimised from the reported frequency."""

import mpmath
import numpy as np
import pytest

from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, real_part, size_of_terms
from avc_casadi.paper.equations import SampleAngle, coupling_impedance, environment_impedance, hold, series
from avc_casadi.paper.numbers import mpmath_numbers

NUMBERS = mpmath_numbers(50)
T = 1e-3


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
