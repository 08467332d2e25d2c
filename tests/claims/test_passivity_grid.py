"""The exact margin and a dense grid never disagree beyond the grid's own error, and the grid can miss a violation."""

import numpy as np
import pytest

from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, real_part, size_of_terms
from avc_casadi.paper.equations import SampleAngle, hold, spring_damper
from avc_casadi.paper.numbers import NUMPY

T = 1e-3
POINTS = 200_000


def random_rows(count, seed):
    rng = np.random.default_rng(seed)
    loop_values = 10 ** rng.uniform(-2, 2, count), 10 ** rng.uniform(-3, 3, count), 10 ** rng.uniform(0, 6, count)
    return loop_values, 10 ** rng.uniform(-3, 5, count), 10 ** rng.uniform(0, 6, count), rng.choice([0.0, 1, 50], count)


class Grid:
    """Impedances by complex arithmetic on equally spaced frequencies up to Nyquist."""

    def __init__(self, model, delay, points):
        self.frequency_hz = np.linspace(0, 0.5 / T, points + 1)[1:]
        angle = SampleAngle.at(NUMPY, self.frequency_hz, T)
        self.hold = np.asarray(hold(angle, model, delay))
        self.spring_c = np.asarray(spring_damper(angle, 0.0, 1.0, tustin=False))
        self.spring_e = np.asarray(spring_damper(angle, 0.0, 1.0, tustin=model == "paper"))

    def lowest(self, b_d, b_e, k_e, b, k, contact):
        coupling, wall = b + k * self.spring_c, b_e + k_e * self.spring_e
        return b_d + (self.hold * (contact + coupling * (wall / (coupling + wall)))).real.min()


def grid_error(loop, parts, contact, step):
    """Bound on |second derivative| step^2/2: the grid leaves out the limit of zero frequency."""
    n = loop.delay_samples + 2
    decay = np.where(parts.decaying > 0, 2 * n**2 * parts.decaying / parts.pole_gap**3, 0.0)
    return step**2 / 2 * (n**2 * (parts.direct + contact) + n**3 * parts.integral + decay)


@pytest.mark.thorough
@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize(("delay", "count"), [(0, 250), (1, 100), (3, 75), (20, 65), (100, 10)])
def test_exact_margin_and_grid_agree(model, delay, count):
    (b_d, b_e, k_e), b, k, contact = random_rows(count, seed=delay)
    loop = SampledLoop(b_d, b_e, k_e, T, delay, model)
    exact = worst_margin(loop, b, k, contact)
    parts = fractions(loop, b, k)
    size = size_of_terms(loop, parts, contact)
    grid = Grid(model, delay, POINTS)
    lowest = np.array([grid.lowest(*row) for row in zip(b_d, b_e, k_e, b, k, contact, strict=True)])
    rounding = 1e-10 * size
    assert (exact.margin_ns_per_m <= lowest + rounding).all()
    assert (lowest - exact.margin_ns_per_m <= grid_error(loop, parts, contact, np.pi / POINTS) + rounding).all()


@pytest.mark.parametrize(("delay", "points"), [(0, 200), (1, 2000), (20, 20_000)])
def test_grid_misses_a_violation(delay, points):
    (_, b_e, k_e), b, k, contact = random_rows(40, seed=7)
    loop = SampledLoop(0.0, b_e, k_e, T, delay, "paper")
    margin = worst_margin(loop, b, k, contact).margin_ns_per_m
    grid = Grid("paper", delay, points)
    lowest = np.array([grid.lowest(0.0, *row) for row in zip(b_e, k_e, b, k, contact, strict=True)])
    damping = -(margin + lowest) / 2  # device damping with which the grid sees a passive loop, and the truth is not
    missed = worst_margin(SampledLoop(damping, b_e, k_e, T, delay, "paper"), b, k, contact)
    tolerance = np.maximum(missed.tolerance_ns_per_m, 1e-9)
    shown = (lowest + damping > tolerance) & (missed.margin_ns_per_m < -tolerance)
    assert shown.sum() >= 5
    at = SampleAngle.at(NUMPY, np.maximum(missed.frequency_hz[shown], 1e-6), T)
    coupling = b[shown] + k[shown] * spring_damper(at, 0.0, 1.0, tustin=False)
    wall = b_e[shown] + k_e[shown] * spring_damper(at, 0.0, 1.0, tustin=True)
    witness = damping[shown] + (hold(at, "paper", delay) * (contact[shown] + coupling * wall / (coupling + wall))).real
    assert (witness < 0).all()
    assert not missed.passive[shown].any()


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 20])
def test_band_margin_is_the_lowest_of_the_band(model, delay):
    (b_d, b_e, k_e), b, k, contact = random_rows(200, seed=3)
    low = np.geomspace(0.5, 480, 200)
    loop = SampledLoop(b_d, b_e, k_e, T, delay, model)
    result = worst_margin(loop, b, k, contact, low, 4 * low)
    assert (result.frequency_hz >= low * (1 - 1e-12)).all()
    assert (result.frequency_hz <= np.minimum(4 * low, 500)).all()
    parts = fractions(loop, b, k)
    size = size_of_terms(loop, parts, contact)
    for share in np.linspace(0, 1, 400):
        at = low + share * (np.minimum(4 * low, 500) - low)
        assert (result.margin_ns_per_m <= real_part(loop, parts, contact, at) + 1e-12 * size).all()
