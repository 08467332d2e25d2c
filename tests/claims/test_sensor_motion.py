"""What noise and wrong readings of a sensor move in a closed loop, against one that is written out a second time."""

import math

import numpy as np
import pytest
from admittance_loop import PlainDevice, after_wrong_readings
from quick import first

import avc_casadi as avc
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.claims.sensor_motion import SensorLoops, velocity_noise
from avc_casadi.model.hands import Hand

CARRIED = ((0.0, 0.0, 0.0), (2.0, 20.0, 800.0), (0.5, 10.0, 5100.0), (0.0, 5.0, 5000.0))
"""Mass, damper and spring at the handle: released, in a hand, pressed, on a contact."""
LAWS = (
    {"mass_kg": 12.0, "damping_ns_per_m": 300.0, "cutoff_hz": 40.0},
    {"mass_kg": 2.0, "damping_ns_per_m": 250.0, "cutoff_hz": None, "stiffness_n_per_m": 90.0},
)
DEVICES = ({}, {"delay_samples": 0.6, "drive_order": 2, "drive_damping_ratio": 0.6})


def cobot(law, device):
    return avc.load_admittance("admittance/cobot").changed(law={"admittance": law}, device=device)


def loops_of(problem, carried):
    hand = Hand(*(np.array([value]) for value in carried))
    law = problem.law.admittance.law(problem.device.sample_time_s)
    return SensorLoops.around([(problem.device, hand)], law)


def plain(problem, carried):
    return PlainDevice.of(problem, **dict(zip(("hand_kg", "hand_damping", "hand_n_per_m"), carried, strict=True)))


@pytest.mark.parametrize("device", first(DEVICES))
@pytest.mark.parametrize("law", first(LAWS))
@pytest.mark.parametrize("carried", CARRIED)
def test_the_rms_speed_of_noise_is_the_sum_over_the_response_to_one_wrong_reading(law, device, carried):
    problem = cobot(law, device)
    response = after_wrong_readings(plain(problem, carried), [1.0], 8000)
    expected = math.sqrt((response[:, [0, 2, 3]] ** 2).sum(axis=0).max())
    assert loops_of(problem, carried).speed_rms() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("device", first(DEVICES))
@pytest.mark.parametrize("law", first(LAWS))
@pytest.mark.parametrize("carried", CARRIED)
def test_wrong_readings_in_a_row_move_no_farther_than_each_may(law, device, carried):
    problem, plan = cobot(law, device), np.random.default_rng(5)
    each_m = loops_of(problem, carried).motion_m_per_n(24)
    for count in (1, 2, 5, 16):
        for wrong_n in (np.ones(count), plan.uniform(-1.0, 1.0, count)):
            way = np.abs(after_wrong_readings(plain(problem, carried), wrong_n, 3000, replaced=True)[:, 1]).max()
            assert way <= 1.02 * each_m * np.abs(wrong_n).sum()
    alone = np.abs(after_wrong_readings(plain(problem, carried), [1.0], 3000)[:, 1]).max()
    assert each_m >= 0.98 * alone


@pytest.mark.slow
def test_the_judged_noise_is_that_of_the_worst_hand_or_contact():
    problem = cobot(LAWS[0], {})
    pairs = HandleAnalysis(problem).pairs
    law, device = problem.law.admittance, problem.device
    by_pair = [velocity_noise(law, device, [pair]) for pair in pairs]
    assert velocity_noise(law, device, pairs) == pytest.approx(max(by_pair))
    assert avc.certify_admittance(problem, remedies=False, limits=False).noise_m_per_s >= max(by_pair) * (1 - 1e-9)


def test_noise_of_an_unstable_law_has_no_bound():
    problem = cobot({"mass_kg": 0.05, "damping_ns_per_m": 1.0}, {})
    assert loops_of(problem, CARRIED[2]).speed_rms() == math.inf
    assert loops_of(problem, CARRIED[2]).motion_m_per_n(4) == math.inf
