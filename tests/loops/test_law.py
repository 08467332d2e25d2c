"""A law is what its blocks are: transfer functions added and multiplied, and a step in time."""

import numpy as np
import pytest
from hardware_bench import believer

from avc_casadi.model.law import Law
from avc_casadi.model.law_pieces import Damper, Window, compiled

PERIOD_S = 1e-3
Z = np.exp(2j * np.pi * np.geomspace(1e-3, 0.5, 40))


def random_law(seed, states=3):
    draw = np.random.default_rng(seed)
    matrix = draw.normal(size=(states, states))
    matrix *= 0.9 / np.abs(np.linalg.eigvals(matrix)).max()
    b, c, d = draw.normal(size=(states, 1)), draw.normal(size=(1, states)), draw.normal(size=(1, 1))
    return Law(matrix, b, c, d, PERIOD_S)


def force_in_time(law, position):
    state, forces = np.zeros(law.states), []
    for value in position:
        forces.append(law.c[0] @ state + law.d[0, 0] * value)
        state = law.a @ state + law.b[:, 0] * value
    return np.array(forces)


@pytest.mark.parametrize("seed", range(5))
def test_parallel_and_series_add_and_multiply_transfer_functions(seed):
    first, second = random_law(seed), random_law(seed + 100, 2)
    np.testing.assert_allclose((first + second).transfer(Z), first.transfer(Z) + second.transfer(Z), rtol=1e-9)
    np.testing.assert_allclose(first.then(second).transfer(Z), first.transfer(Z) * second.transfer(Z), rtol=1e-9)
    np.testing.assert_allclose(first.times(3.0).transfer(Z), 3 * first.transfer(Z), rtol=1e-12)


def test_a_spring_damper_is_its_formula_in_z():
    k, b, pole = 800.0, 4.0, 0.6
    law = Law.spring_damper(k, b, PERIOD_S, pole)
    expected = k + b * (1 - 1 / Z) / PERIOD_S * (1 - pole) / (1 - pole / Z)
    np.testing.assert_allclose(law.transfer(Z), expected, rtol=1e-12)
    rows = Law.spring_damper(np.array([0.0, k]), np.array([2 * b, b]), PERIOD_S, pole)
    np.testing.assert_allclose(rows.pick(1).transfer(Z), expected, rtol=1e-12)
    np.testing.assert_allclose(rows.transfer(Z[:, None])[:, 1], expected, rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_transfer_is_that_of_the_whole_pencil(seed):
    chain = Law.fraction([1.0, *[0.0] * 6, -1.0], [1.0, *[0.0] * 7], PERIOD_S)
    law = random_law(seed, 4).then(chain).then(Law.low_pass(0.7, PERIOD_S)) + random_law(seed + 10, 2).then(chain)
    factors = np.array([0.5, -2.0, 3.0])
    pencil = Z[:, None, None] * np.eye(law.states) - law.a
    states = np.linalg.solve(pencil, np.broadcast_to(law.b, (len(Z), law.states, 1)).astype(complex))
    expected = (law.c @ states)[:, 0, 0] + law.d[0, 0]
    np.testing.assert_allclose(law.transfer(Z), expected, rtol=1e-10)
    np.testing.assert_allclose(law.times(factors).transfer(Z[:, None]), expected[:, None] * factors, rtol=1e-10)


@pytest.mark.parametrize(
    "slopes", [{}, {"dead_zone": 0.3}, {"force_limit": 0.4}, {"dead_zone": 0.2, "force_limit": 0.7}]
)
def test_behind_an_observer_it_steps_as_the_equations_of_the_observer(slopes):
    """The sample that `StateFeedback` writes down, its dead zone and its force limit as gains."""
    observer, inner = believer(2), Law.spring_damper(500.0, 0.4, PERIOD_S, 0.5)
    whole = inner.behind(observer).at_slopes(**slopes)
    passes, left = slopes.get("dead_zone", 1.0), slopes.get("force_limit", 1.0)
    position = np.random.default_rng(1).normal(size=60)
    a, push = np.array(observer.state), np.array(observer.force_m_per_n)
    gain, weight = np.array(observer.innovation), np.array(observer.feedback)
    estimate, state, expected = np.zeros(observer.states), np.zeros(inner.states), []
    for value in position:
        estimate = estimate + gain * passes * (value - estimate[observer.measures])
        seen = weight @ estimate
        force = left * (inner.c[0] @ state + inner.d[0, 0] * seen)
        state = inner.a @ state + inner.b[:, 0] * seen
        estimate = a @ estimate + push * force
        expected.append(force)
    np.testing.assert_allclose(force_in_time(whole, position), expected, rtol=1e-9, atol=1e-9)


def test_sectors_stay_those_of_their_law_in_a_sum_and_in_series():
    behind, more = Law.gain(500.0, PERIOD_S).behind(believer(2)), random_law(3)
    summed = (behind + more).at_slopes(dead_zone=0.3).transfer(Z)
    np.testing.assert_allclose(summed, behind.at_slopes(dead_zone=0.3).transfer(Z) + more.transfer(Z), rtol=1e-9)
    filtered = behind.then(more).at_slopes(force_limit=0.3).transfer(Z)
    np.testing.assert_allclose(filtered, behind.at_slopes(force_limit=0.3).transfer(Z) * more.transfer(Z), rtol=1e-9)


def test_a_slope_of_a_sector_that_the_law_has_not_is_refused():
    with pytest.raises(ValueError, match="no sector force_limit"):
        random_law(0).at_slopes(force_limit=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_noise_gain_is_the_root_of_the_sum_of_squares_of_the_response_to_a_sample(seed):
    law = random_law(seed)
    response = force_in_time(law, np.append(1.0, np.zeros(2000)))
    assert law.noise_gain() == pytest.approx(np.sqrt((response**2).sum()), rel=1e-9)


@pytest.mark.parametrize("samples", [1, 40, 256])
def test_the_noise_gain_of_a_long_window_is_that_of_its_two_ends(samples):
    """b (x(n) - x(n - N))/(N T) of white noise has the rms b sqrt(2)/(N T)."""
    law = compiled((Damper(3.0, Window(samples)),), (), 1e-3)
    assert law.noise_gain() == pytest.approx(3.0 * np.sqrt(2) / (samples * 1e-3))


@pytest.mark.parametrize("pole", [0.5, 1 - 1e-8])
def test_the_noise_gain_of_a_slow_pole_counts_all_terms(pole):
    law = Law.low_pass(pole, 1e-3)
    assert law.noise_gain() == pytest.approx(np.sqrt((1 - pole) / (1 + pole)))


def test_a_law_rests_where_its_states_stay():
    law = random_law(4)
    np.testing.assert_allclose(law.a @ law.rest + law.b[:, 0], law.rest, atol=1e-12)
    integral = Law(np.eye(1), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), PERIOD_S)
    assert not integral.rest.any()
