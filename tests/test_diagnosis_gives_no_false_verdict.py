"""Logs that a rule of thumb takes for a fault, beside neighbours that have it."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import declared_of
from buzzing_device import Buzzing, logged

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.limit_cycle import goes_back
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.record import Columns

T = 1e-3

PRESS = Buzzing(
    mass=0.12, damping=0.8, friction=0.1, encoder=2e-5, limit=8.0, stiffness=4000.0, damper=5.5,
    hand_mass=0.08, hand_damping=4.0, hand_stiffness=300.0, start=0.0, speed=0.02, end=0.006,
)  # fmt: skip


def found_of(loop, seconds=2.0):
    return diagnose(Columns("log", *logged(loop, seconds)), device=declared_of(replace(loop, delay=1.0)))


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"friction": 0.05, "stiffness": 6000.0, "damper": 9.0},
        {"friction": 0.02, "stiffness": 4000.0, "damper": 10.0, "keep": 0.9},
        {"keep": 0.8, "stiffness": 3000.0, "damper": 8.0, "speed": 0.012},
    ],
)
@pytest.mark.parametrize("seconds", [0.4, 2.0])
def test_a_press_over_friction_and_encoder_steps_is_nothing_wrong(changed, seconds):
    """The device goes on from step to step and rests in contact, or the log ends."""
    assert found_of(replace(PRESS, **changed), seconds).verdict == "nothing wrong"


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [4.0, 6.0])
def test_the_same_press_of_a_late_loop_that_friction_does_not_hold_is_a_delay(delay):
    found = found_of(replace(PRESS, delay=delay, friction=0.02))
    assert found.cause == "delay"
    assert abs(found.measured.delay_samples - delay) < 0.3


@pytest.mark.parametrize(("back", "goes"), [(0, False), (1, True), (2, True)])
def test_an_oscillation_goes_back_in_every_cycle(back, goes):
    """Three steps on in every cycle of 40 ms, after as many back as are told."""
    step, cycles = 2e-5, 20
    one = np.concatenate([np.full(20, -back), np.full(20, 3)])
    counts = np.concatenate([one + 3 * cycle for cycle in range(cycles)])
    time = T * np.arange(counts.size)
    log, _ = log_of(Columns("log", time, step * counts, -1.0 - 4000 * step * counts))
    assert goes_back(log, 0, counts.size, 25.0) == goes
