"""Dry friction that turns a damped mass inside a sample leaves no error that a longer log would not shrink."""

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.1, 0.4, 1.7])
def test_what_is_left_is_the_rounding(delay):
    # A twelfth of the velocity decays in a sample: taken to change evenly it misses mass and friction by 3e-4.
    truth = Truth(mass=0.05, damping=4.0, coulomb=0.8, delay=delay, encoder=1e-7, spring=30.0)
    random = np.random.default_rng(4)
    wanted = multisine(random, 6.0, truth.period, 0.5, 300.0, 2.0)
    _, position, force = measured(truth, wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    for key, value in {
        "mass_kg": truth.mass,
        "damping_ns_per_m": truth.damping,
        "coulomb_friction_n": truth.coulomb,
    }.items():
        one = found.estimates[key]
        assert one.value == pytest.approx(value, rel=5e-5)
        assert one.low <= value <= one.high
    assert found.estimates["delay_samples"].value == pytest.approx(delay, abs=5e-5)
