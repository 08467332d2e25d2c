"""Llewellyn's condition (4) to (6): published and closed-form values, and a dense grid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.loops.wall import SampledLoop

T = 1e-3


def loop(model, delay=0, b_d=1.0):
    return SampledLoop(b_d, 0.0, 0.0, T, delay, model)


def is_largest(case, b, k, within):
    inside, outside = llewellyn_margin(case, b, np.array([k - within, k + within]))[0]
    return inside >= 0 > outside


LIGHT = [(ratio, 4 + 4 * (1 + ratio) ** 0.5, 1e-9) for ratio in (0, 0.1, 0.3, 0.5)]  # decided at low frequency
PRINTED = [(1, 9.330, 6e-5), (1.175, 9.3505, 6e-5), (4, 6.804, 8e-5), (7, 1.922, 3e-4)]


@pytest.mark.parametrize(("ratio", "expected", "within"), LIGHT + PRINTED)
def test_largest_stiffness_with_the_printed_hold(ratio, expected, within):
    assert is_largest(loop("paper"), ratio, expected / T, within * expected / T)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.floats(1e-3, 1e3), st.floats(0, 1))
def test_sampled_data_hold_allows_twice_the_difference_over_the_sample_time(b_d, share):
    allowed = 2 * (b_d - share * b_d) / T
    case = loop("sampled-data", b_d=b_d)
    assert allowed == 0 or is_largest(case, share * b_d, allowed, min(1e-9 * b_d / T, allowed))


@pytest.mark.parametrize("model", first(["paper", "sampled-data"]))
@pytest.mark.parametrize("delay", first([0, 2, 20]))
def test_margin_is_the_lowest_of_a_dense_grid(model, delay):
    rng = np.random.default_rng(delay)
    b, k, contact = 10 ** rng.uniform(-3, 2, 60), 10 ** rng.uniform(0, 5, 60), rng.choice([0.0, 3.0], 60)
    margin, _ = llewellyn_margin(loop(model, delay), b, k, contact)
    phi = np.linspace(0, np.pi / 2, 100_001)[1:]
    amplitude = np.cos(phi) if model == "paper" else 1.0
    lag = (2 * delay + (1 if model == "paper" else 2)) * phi
    for row in range(60):
        coupling = b[row] + k[row] * T / 2 * (1 - 1j / np.tan(phi))
        needed = amplitude * 2 * np.sin(lag / 2) ** 2 / (2 * (1 / coupling).real)
        lowest = (1 + contact[row] * amplitude * np.cos(lag) - needed).min()
        size = 1 + contact[row] + b[row] + k[row] * T + abs(lowest)
        assert margin[row] <= lowest + 1e-9 * size
        assert lowest - margin[row] <= 1e-7 * (delay + 1) ** 3 * size
