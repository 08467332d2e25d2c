"""Changes are checked on the loop in contact; where a swing flies for most of its time, the diagnosis says so."""

import math

import pytest
from buzzing_device import Buzzing, logged

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device

LATE = Buzzing(
    mass=0.12, damping=0.8, encoder=1e-5, limit=20.0, stiffness=800.0, hand_mass=0.15, hand_damping=5.0, end=0.001
)
DEVICE = Device(
    mass_kg=0.12,
    damping_ns_per_m=0.8,
    sample_time_s=1e-3,
    delay_samples=1,
    encoder_resolution_m=1e-5,
    max_force_n=20.0,
)


def told(**changed):
    columns = logged(Buzzing(**{**vars(LATE), **changed}), 2.5)
    return diagnose(Columns("log", *columns), device=DEVICE)


@pytest.mark.thorough
def test_a_bounce_is_told_beside_its_cures():
    found = told(damper=200.0, keep=math.exp(-2 * math.pi * 40.0 * LATE.period))
    assert found.oscillation.contact_share < 0.2
    assert found.cures
    assert "it bounces" in found.notes[-1]


@pytest.mark.thorough
@pytest.mark.parametrize("two_sided", [0.0, 1.0])
def test_a_swing_that_stays_in_contact_is_no_bounce(two_sided):
    found = told(stiffness=3000.0, damper=5.0, delay=6.0, two_sided=two_sided, end=0.02)
    assert found.oscillation.contact_share > 1 / 3
    assert found.cures
    assert not any("bounces" in note for note in found.notes)
