"""A device that a hand brings to rest in a wall, so that most of the log stands still, is told as that."""

import warnings

import numpy as np
import pytest
from buzzing_device import Buzzing, logged

from avc_casadi import InputError
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record

PRESSED = Buzzing(mass=0.15, damping=1.0, friction=0.2, encoder=2e-5, stiffness=1500.0, damper=5.0, end=0.003)


def record_of(seconds, moving_s=None, **changed):
    loop = Buzzing(**{**PRESSED.__dict__, **changed})
    time, position, force = logged(loop, seconds)
    assert np.ptp(position[-round(0.5 / loop.period) :]) == 0
    if moving_s is not None:
        still = time >= moving_s
        position[still], force[still] = position[~still][-1], force[~still][-1]
    return Record("pressed", loop.period, position, force)


@pytest.mark.parametrize("seconds", [3.0, 12.0])
def test_motion_in_the_first_part_only_is_refused_by_what_is_asked_for(seconds):
    with pytest.raises(InputError, match=r"stand still after; allowed: motion that goes on \(a multisine"):
        identify([record_of(seconds, moving_s=0.09 * min(seconds, 10.0))])


@pytest.mark.thorough
@pytest.mark.parametrize("start", [-0.04, -0.08, -0.15])
def test_a_log_that_stands_still_for_the_most_part_is_answered(start):
    """Most stretches are predicted exactly there, by every model."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = identify([record_of(6.0, start=start)])
    assert any("closed loop" in note for note in found.notes)
