"""The estimators on known signals: what each must stand, at rest, in steps, with harmonics, drift and an encoder."""

import numpy as np
import pytest
from studies.estimators.study import cramer_rao_hz

from avc_casadi import UnsupportedError
from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step
from avc_casadi.simulation.runtime.signal import EstimatorSettings

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
def test_undefined_again_within_a_second_of_stopping(method):
    moving = tone(3.0)
    stopped = np.concatenate([moving, np.full(2000, moving[-1])])
    frequency, valid = estimate(method, stopped)
    assert valid[3900]
    assert not valid[len(moving) + 700 :].any()
    assert not frequency[~valid].any()


@ALL
@pytest.mark.parametrize("hz", [1.0, 3.0, 12.0, 50.0])
def test_tones_over_the_range(method, hz):
    position = tone(hz, 8.0 if hz < 2 else 4.0)
    frequency, valid = estimate(method, position)
    last = slice(len(position) // 2, None)
    assert valid[last].mean() > 0.99
    assert frequency[last].mean() == pytest.approx(hz, rel=0.01)


@ALL
def test_at_the_ends_of_the_range_it_is_bounded_and_beyond_them_no_wrong_number(method):
    for hz in (0.2, 90.0, 240.0):
        frequency, valid = estimate(method, 3e-3 / hz * tone(hz, 6.0) / 1e-3)
        assert np.all(np.isfinite(frequency))
        assert frequency.max() <= 100.0 or abs(frequency[valid].mean() / hz - 1) < 0.05
        assert np.all(frequency[valid] > 0)


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


def test_third_harmonic_breaks_the_zero_crossings_and_they_say_that_they_are_irregular():
    position = tone(3.0, 6.0) + 0.3 * tone(9.0, 6.0, 0.9)
    found = STEPS["zero-crossing"].run(np.diff(position, prepend=position[0])[None] / T)
    assert np.abs(found["frequency_hz"][3000:] / 3 - 1).max() > 0.5
    assert not found["regular"][3000:].any()


@ROBUST
def test_drift_of_five_millimetres_at_a_third_of_a_hertz(method):
    assert late_error(method, tone(3.0, 8.0) + 5 * tone(0.3, 8.0), 3.0) < 0.02


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


def test_bound_is_that_of_the_fisher_information():
    n, hz, phase = 3000, 7.0, 0.4
    time = np.arange(n) * T
    angle = 2 * np.pi * hz * time + phase
    slopes = np.array([np.sin(angle), 1e-3 * np.cos(angle), 1e-3 * np.cos(angle) * 2 * np.pi * time]) / 1e-5
    bound = np.sqrt(np.linalg.inv(slopes @ slopes.T)[2, 2])
    assert cramer_rao_hz(1e-3, 1e-5, n * T, T) == pytest.approx(bound, rel=0.01)


@ALL
@pytest.mark.parametrize("sample_time", [1e-5, 2e-4, 0.02, 0.1])
def test_other_sampling_rates_stay_finite(method, sample_time):
    hz = min(3.0, 0.05 / sample_time)
    ticks = round(min(20000, 30 / hz / sample_time))
    velocity = 0.02 * np.cos(2 * np.pi * hz * np.arange(ticks) * sample_time)
    found = estimator_step(method, sample_time).run(velocity[None])
    assert np.all(np.isfinite(found["frequency_hz"]))
    assert np.all(found["frequency_hz"][found["valid"] == 0] == 0)


@ALL
def test_absurd_velocities_leave_it_finite_and_it_recovers(method):
    velocity = np.diff(tone(5.0, 12.0), prepend=0.0) / T
    velocity[2000:2200] = 1e30 * (-1.0) ** np.arange(200)
    found = STEPS[method].run(velocity[None])
    assert np.all(np.isfinite(found["frequency_hz"]))
    assert found["frequency_hz"][-500:].mean() == pytest.approx(5.0, rel=0.02)


def test_unknown_methods_and_impossible_settings_are_refused():
    with pytest.raises(UnsupportedError, match="fused"):
        estimator_step("fft", T)
    with pytest.raises(ValueError, match="low_hz"):
        EstimatorSettings(low_hz=10.0, high_hz=5.0)
    with pytest.raises(ValueError, match="fastest_m_per_s"):
        EstimatorSettings(floor_m_per_s=6.0)


def test_an_oscillator_that_finds_nothing_to_lock_to_gives_no_number():
    """Velocity without a frequency, white from sample to sample, whatever its size."""
    for size in (3e-5, 2e-4):
        aimless = np.cumsum(np.random.default_rng(3).normal(0, size, 6000))
        _, valid = estimate("adaptive-notch", aimless)
        assert valid[1000:].mean() < 0.05


@pytest.mark.parametrize("hz", [37.3, 47.9])
def test_crossings_are_timed_between_samples(hz):
    """A half period of 10.4 samples: whole samples alone would be wrong by some per cent."""
    assert late_error("zero-crossing", tone(hz), hz) < 0.005


@pytest.mark.parametrize("method", ["zero-crossing", "fused"])
def test_while_no_crossing_comes_the_estimate_falls_with_the_time_that_has_passed(method):
    moving = tone(12.0, 2.0)
    stopped = np.concatenate([moving, np.full(1000, moving[-1])])
    frequency, valid = estimate(method, stopped)
    passed = np.arange(60, 500)
    assert valid[len(moving) + passed].any()
    assert (frequency[len(moving) + passed] <= 1 / (T * passed)).all()


@ALL
def test_steps_of_a_coarse_encoder_at_rest_are_no_motion(method):
    """An encoder of 50 um between two counts, 20 times a second: more than the usual floor, and yet nobody moves."""
    resolution = 5e-5
    flicker = resolution * (tone(20.0, 6.0) > 0)
    step = estimator_step(method, T, EstimatorSettings.for_encoder(resolution, T))
    assert not estimate(method, flicker, step)[1].any()
    assert estimate(method, flicker)[1].any()
    assert estimate(method, 5 * flicker, step)[1].any()


@ALL
def test_a_handle_that_turns_is_estimated_as_its_rim_that_moves(method):
    """A knob of 20 mm turned at up to 60 rad/s, and one that rests but for a tenth of what a hand does."""
    resolution = 1e-4
    knob = estimator_step(method, T, EstimatorSettings.for_encoder(resolution, T, 0.02))
    turned = 60.0 / (2 * np.pi * 4.0) * np.sin(2 * np.pi * 4.0 * clock(6.0))
    frequency, valid = estimate(method, np.round(turned / resolution) * resolution, knob)
    assert valid[3000:].all()
    assert frequency[3000:] == pytest.approx(4.0, rel=0.03)
    assert not estimate(method, 0.1 / (2 * np.pi * 4.0) * np.sin(2 * np.pi * 4.0 * clock(6.0)), knob)[1][3000:].any()


@ALL
@pytest.mark.parametrize("radius", [2.0**-6, 0.5])
def test_the_unit_of_the_position_changes_no_estimate(method, radius):
    """At a radius that is a power of two, not a bit."""
    rim = np.cumsum(np.random.default_rng(4).normal(0, 2e-5, 3000)) + tone(7.0, 3.0)
    turns = estimator_step(method, T, EstimatorSettings.for_encoder(2e-5 / radius, T, radius))
    moves = estimator_step(method, T, EstimatorSettings.for_encoder(2e-5, T))
    for one, other in zip(estimate(method, rim / radius, turns), estimate(method, rim, moves), strict=True):
        assert np.array_equal(one, other)
