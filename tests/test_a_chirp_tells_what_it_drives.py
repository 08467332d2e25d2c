"""A chirp is at each frequency for a moment, and all of it can be foretold: neither hides anything of the device."""

import numpy as np
import pytest
from measured_device import Truth, measured

from avc_casadi.identification.closed_loop import feeds_back
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record

SECONDS, PERIOD = 12.0, 2.5e-4


def chirp(low_hz=1.0, high_hz=300.0, sweeps=2, rms=1.0):
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    length = SECONDS / sweeps
    rate = np.log(high_hz / low_hz) / length
    return rms * np.sqrt(2) * np.sin(2 * np.pi * low_hz / rate * np.expm1(rate * (t % length)))


@pytest.mark.thorough
def test_a_resonance_behind_a_slow_amplifier_is_told():
    """Each alone explains so little beside the other's lack that neither was sure; the delay stood for both."""
    truth = Truth(
        mass=0.1332, damping=3.6, coulomb=0.19, delay=2.0, bandwidth=118.0, encoder=1.8e-6, period=PERIOD,
        resonance=66.7, ratio=0.0955, share=0.33,
    )  # fmt: skip
    _, position, force = measured(truth, chirp(rms=0.8), np.random.default_rng(1))
    found = identify([Record("log", PERIOD, position, force)])
    true = {"mass_kg": truth.mass, "delay_samples": 2.0, "amplifier_bandwidth_hz": 118.0, "coulomb_friction_n": 0.19}
    true |= {"resonance.frequency_hz": 66.7, "resonance.damping_ratio": 0.0955}
    for key, value in true.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high, key
    assert found.estimates["mass_kg"].value == pytest.approx(truth.mass, rel=2e-3)
    assert not found.feedback


@pytest.fixture
def random():
    return np.random.default_rng(7)


def test_what_a_poor_model_leaves_over_of_a_chirp_is_no_feedback(random):
    force = np.round(chirp(), 4)
    # As a structure that the model lacks would leave it: the force, late and filtered, beside noise.
    left_over = 1e-6 * (np.convolve(force, [0.5, 1.0, 0.3])[: force.size] + 0.3 * random.standard_normal(force.size))
    record = Record("log", PERIOD, np.zeros(force.size), force)
    assert not feeds_back([record], [left_over])


@pytest.mark.parametrize("of_itself", [0.0, 1.0])
def test_a_force_that_follows_what_nobody_foresaw_is_feedback(random, of_itself):
    error = 1e-6 * random.standard_normal(round(SECONDS / PERIOD))
    wall = 2000.0 * np.convolve(error, [1.0, 0.5])[: error.size]
    record = Record("log", PERIOD, np.zeros(error.size), of_itself * chirp() + np.roll(wall, 2))
    assert feeds_back([record], [error])
