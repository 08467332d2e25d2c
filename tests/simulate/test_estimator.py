"""The estimators on known signals: what each must stand, at rest, in steps, with harmonics, drift and an encoder."""

import numpy as np
import pytest
from studies.estimators.study import cramer_rao_hz

from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step

T = 1e-3
STEPS = {method: estimator_step(method, T) for method in ESTIMATORS}
ALL = pytest.mark.parametrize("method", ESTIMATORS)
ROBUST = pytest.mark.parametrize("method", ["spectral-peak", "fused"])


def estimate(method, position, step=None):
    found = (step or STEPS[method]).run(np.diff(position, prepend=position[0])[None] / T)
    return found["frequency_hz"], found["valid"] > 0


def clock(seconds):
    return np.arange(round(seconds / T)) * T


def tone(hz, seconds=4.0, phase=0.3):
    return 1e-3 * np.sin(2 * np.pi * hz * clock(seconds) + phase)


def late_error(method, position, hz):
    frequency, valid = estimate(method, position)
    last = slice(len(position) // 2, None)
    assert valid[last].mean() > 0.99
    return np.abs(frequency[last][valid[last]] / hz - 1).max()


@ALL
def test_never_a_number_at_rest(method):
    rng = np.random.default_rng(0)
    flicker = 2e-6 * (rng.random(4000) < 0.3)
    frequency, valid = estimate(method, flicker)
    assert not valid.any()
    assert not frequency.any()


@ALL
@pytest.mark.parametrize("hz", [1.0, 3.0, 12.0, 50.0])
def test_tones_over_the_range(method, hz):
    position = tone(hz, 8.0 if hz < 2 else 4.0)
    frequency, valid = estimate(method, position)
    last = slice(len(position) // 2, None)
    assert valid[last].mean() > 0.99
    assert frequency[last].mean() == pytest.approx(hz, rel=0.01)


@pytest.mark.parametrize(("method", "seconds"), [("zero-crossing", 0.5), ("spectral-peak", 0.7), ("fused", 0.55)])
@pytest.mark.parametrize("pair", [(3.0, 12.0), (12.0, 3.0)])
def test_steps_settle(method, seconds, pair):
    for phase in (0.0, 1.0, 2.0):
        truth = np.where(clock(6.0) < 3.0, *pair)
        position = 1e-3 * np.sin(2 * np.pi * T * np.cumsum(truth) + phase)
        frequency, valid = estimate(method, position)
        settled = slice(round((3.0 + seconds) / T), None)
        assert valid[settled].all()
        assert np.abs(frequency[settled] / pair[1] - 1).max() < 0.1


@ROBUST
def test_third_harmonic_of_thirty_percent_whatever_its_phase(method):
    for phase in np.arange(6) * np.pi / 3:
        position = tone(3.0, 6.0) + 0.3 * tone(9.0, 6.0, phase)
        assert late_error(method, position, 3.0) < 0.05


@ALL
def test_encoder_of_twenty_micrometres(method):
    assert late_error(method, 2e-5 * np.round(tone(3.0, 6.0) / 2e-5), 3.0) < 0.05


@ALL
def test_noise_stays_above_the_cramer_rao_bound_and_within_two_percent(method):
    position = tone(3.0, 12.0) + np.random.default_rng(1).normal(0, 1e-5, 12000)
    frequency, valid = estimate(method, position)
    spread = np.std(frequency[4000:][valid[4000:]])
    # No estimator that forgets within 2 s beats the bound of 2 s; one that did would have seen the answer.
    assert cramer_rao_hz(1e-3, 1e-5, 2.0, T) < spread < 0.02 * 3.0
