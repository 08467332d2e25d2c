"""States of the schedule and gains are each other's, and the ends of the box are met to the last bit."""

import numpy as np

from avc_casadi.design.schedule.states import States

STATES = States(np.array([0.5, 20.0, 2.0]), np.array([3.0, 0.0, 1.0]), np.array([1e3, 1e6, 150.0]))


def test_ends_are_the_ends():
    for at, gains in ((STATES.low, STATES.least), (STATES.high, STATES.most)):
        for near in (at, at + 1e-6 * np.sign(STATES.low + STATES.high - 2 * at)):
            np.testing.assert_array_equal(np.array(STATES.gains(near)), gains)


def test_there_and_back():
    rng = np.random.default_rng(0)
    gains = STATES.least[:, None] + rng.uniform(0.01, 0.99, (3, 50)) * (STATES.most - STATES.least)[:, None]
    np.testing.assert_allclose(np.array(STATES.gains(STATES.states(tuple(gains)))), gains, rtol=1e-12)
    pair = States(STATES.floors[:2], STATES.least[:2], STATES.most[:2])
    assert not np.any(pair.gains(pair.states(tuple(gains)))[2])
