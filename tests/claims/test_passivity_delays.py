"""Beyond the delays whose stationary points are roots, a scan finds the worst margin of a band: brute force agrees."""

import numpy as np
import pytest

from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, real_part

T = 1e-3


def random_loop(generator, delay, model):
    stiffness = float(np.exp(generator.uniform(np.log(10.0), np.log(1e5))))
    return SampledLoop(float(generator.uniform(0.1, 20)), float(generator.uniform(0, 30)), stiffness, T, delay, model)


@pytest.mark.thorough
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
        worst = worst_margin(loop, b, k, contact, low, high)
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 8001)
        parts = fractions(loop, b, k).pick((slice(None), None))
        lowest = real_part(loop, parts, contact[:, None], grid).min(axis=1)
        missed = max(missed, float(np.max((worst.margin_ns_per_m - lowest) / (1 + np.abs(lowest)))))
        assert np.all((worst.frequency_hz >= low) & (worst.frequency_hz <= high))
    assert missed < 1e-9
