"""A loop that swings between its force limits tells its delay, whether somebody holds the device or nobody does."""

import math

import numpy as np
import pytest

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device

PERIOD_S, STEPS, PARTS = 1e-3, 2000, 20
MASS_KG, DAMPING, RUBS_N, STEP_M, LIMIT_N = 0.1, 0.5, 0.1, 1e-5, 8.0


def swinging(stiffness, damping, delay, push_n=0.5, mass=MASS_KG):
    """Return the log of a mass that is pushed away from where a late spring and damper hold it; by hand.

    The velocity is the difference of the last two readings, the force is logged as the computer asks for it.
    """
    time = np.arange(STEPS) * PERIOD_S
    push = np.where(time > 0.3, push_n, 0.0)
    seen, asked = np.zeros(STEPS), np.zeros(STEPS + 20)
    x = v = 0.0
    part = PERIOD_S / PARTS
    for k in range(STEPS):
        seen[k] = STEP_M * math.floor(x / STEP_M + 0.5)
        rate = (seen[k] - seen[k - 1]) / PERIOD_S if k else 0.0
        asked[k] = min(max(-stiffness * seen[k] - damping * rate, -LIMIT_N), LIMIT_N)
        acts = asked[k - delay] if k >= delay else 0.0
        for _ in range(PARTS):
            force = acts + push[k] - DAMPING * v
            if v == 0.0 and abs(force) <= RUBS_N:
                continue
            rub = math.copysign(RUBS_N, v or force)
            after = v + part * (force - rub) / mass
            if v and after * v < 0:
                after = 0.0
            x += part * (v + after) / 2
            v = after
    return Columns("log", time, seen, asked[:STEPS])


@pytest.fixture
def device():
    return Device(
        mass_kg=MASS_KG,
        damping_ns_per_m=DAMPING,
        coulomb_friction_n=RUBS_N,
        sample_time_s=PERIOD_S,
        delay_samples=1,
        encoder_resolution_m=STEP_M,
        max_force_n=LIMIT_N,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("stiffness", "damping", "delay"), [(3000.0, 10.0, 6), (1500.0, 10.0, 10), (8000.0, 30.0, 3)])
def test_a_delay_is_named_with_its_number_where_nobody_holds_the_device(stiffness, damping, delay, device):
    log = swinging(stiffness, damping, delay)
    found = diagnose(log, device=device)
    assert found.cause == "delay"
    assert abs(found.measured.delay_samples - delay) < 0.03 * delay
    assert found.measured.hand is None
    assert 0.1 < found.oscillation.at_force_limit_share < 1
    assert any(f"with the force at its limit of {LIMIT_N:g} N, which bounds it" in line for line in found.evidence)


@pytest.mark.thorough
def test_a_delay_and_a_hand_that_is_missing_are_both_named(device):
    """With the declared delay the loop would swing still, let go."""
    found = diagnose(swinging(3000.0, 4.0, 6, push_n=1.0), device=device)
    assert found.verdict == "cannot tell"
    assert set(found.candidates) == {"delay", "let-go"}
    assert abs(found.measured.delay_samples - 6) < 0.2


@pytest.mark.thorough
@pytest.mark.parametrize("mass", [0.05, 0.1, 0.2])
def test_a_device_that_nobody_declared_is_not_taken_for_the_assumed_one(mass):
    found = diagnose(swinging(3000.0, 10.0, 6, mass=mass))
    assert found.cause == "delay"
    assert ", assumed 1, at which" in found.conclusion
    assert found.oscillation.largest_force_n == LIMIT_N
    assert found.oscillation.at_force_limit_share > 0.1
    assert abs(found.measured.delay_samples - 6) < 0.3
    moved = found.measured.device["mass_kg"] + found.measured.hand["mass_kg"]
    assert abs(moved - mass) < 0.1 * mass
    assert any("device and hand, which the log does not tell apart" in line for line in found.evidence)


@pytest.mark.thorough
def test_a_declared_limit_that_the_log_exceeds_is_told_and_is_no_limit_of_it(device):
    found = diagnose(swinging(3000.0, 10.0, 6), device=device.model_copy(update={"max_force_n": 3.0}))
    assert any("commands up to 8 N, and max_force_n declares 3 N" in note for note in found.notes)
    assert found.oscillation.largest_force_n == LIMIT_N
    assert not any("its limit of 3 N" in line for line in found.evidence)
    assert found.cause == "delay"
