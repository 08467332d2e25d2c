"""The two plain simulators of a teleoperator, event by event and lane by lane, move alike: each checks the other."""

import math

import numpy as np
import pytest
from teleoperator_lanes import Lanes, SpringAndDampers
from teleoperator_simulator import run

HAND, GAINS, SAMPLES = (0.1, 5.0, 400.0), (800.0, 6.0, 2.0), 2000


def aim(time):
    return 0.01 * math.sin(9 * time) if time < 1 - 1e-9 else 0.0


@pytest.mark.parametrize(
    ("contact", "phase", "there", "back", "wall"),
    [
        (None, 0.0, 3.0, 2.0, False),
        ((2000.0, 4.0), 0.25, 0.0, 0.0, False),
        ("fixed", 0.5, 7.3, 1.0, False),
        (None, 0.75, 2.0, 2.5, True),
    ],
)
def test_simulators_of_a_teleoperator_agree(contact, phase, there, back, wall):
    one, period = np.ones(1), 1e-3
    spring = {None: math.inf if wall else 0.0, "fixed": math.inf}.get(contact, 2000.0)
    lanes = Lanes(
        (0.12 * one, 0.8 * one),
        (0.3 * one, 1.0 * one),
        period * one,
        1,
        tuple(value * one for value in HAND),
        (spring * one, (4.0 if spring == 2000.0 else 0.0) * one),
        one_sided=wall,
        delay=(there * one, back * one),
        phase=phase * one,
    )
    targets = np.array([[aim(period * k)] for k in range(SAMPLES)])
    lanes.run(SpringAndDampers(*(value * one for value in GAINS)), SAMPLES, targets)
    devices = (0.12, 0.8, period, 1), (0.3, 1.0, period, 1)
    found = run(
        *devices,
        GAINS,
        (SAMPLES - 1) * period,
        there * period,
        back * period,
        hand=HAND,
        contact=contact,
        wall=wall,
        phase=phase,
        target=aim,
    )
    count = min(SAMPLES, found.shape[1])
    assert np.abs(found[0]).max() > 1e-3
    assert np.abs(found[0, :count] - lanes.x[0, :count, 0]).max() < 1e-12
