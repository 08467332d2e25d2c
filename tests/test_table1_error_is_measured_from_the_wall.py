"""The complex error against the physical wall, and the goal that makes up for sampling."""

import numpy as np
import pytest
from studies.error_curve import error_curve

import avc_casadi as avc
from avc_casadi.design.tuning import physical_wall
from avc_casadi.model.gains import Gains
from avc_casadi.paper.loop import loop_at

PROBLEM = avc.load_problem("ve7")
LOW_HZ = np.array([0.5, 1.0, 2.0])


def rigid(contact_damping):
    return Gains(np.inf, np.inf, contact_damping)


def test_sampling_takes_half_a_period_of_stiffness_from_the_damping():
    half = PROBLEM.environment.stiffness_n_per_m * PROBLEM.device.sample_time_s / 2
    reactance = PROBLEM.environment.stiffness_n_per_m / (2 * np.pi * LOW_HZ)
    for damper in (0.0, half, 2 * half):
        curve = error_curve(PROBLEM, rigid(damper), LOW_HZ)
        # What is left is of second order in omega T.
        assert curve.physical == pytest.approx(np.abs(damper - half) / reactance, abs=1e-4)
        assert curve.sampled == pytest.approx(damper / reactance, rel=1e-2, abs=1e-9)


def test_the_goal_is_the_physical_wall_up_to_second_order():
    stated = physical_wall(PROBLEM)
    stated = stated.changed(stability={"model": "sampled-data"})
    wall = PROBLEM.environment
    errors = []
    for frequency in (np.array([5.0]), np.array([10.0])):
        loop = loop_at(stated, frequency)
        real = wall.damping_ns_per_m + wall.stiffness_n_per_m / (2j * np.pi * frequency)
        errors.append(np.abs(loop.hold * loop.desired - real)[0] / np.abs(real)[0])
    assert errors[1] / errors[0] == pytest.approx(4, rel=0.05)
    assert errors[1] < 2.5e-3


def test_within_counts_from_the_lowest_frequency():
    curve = error_curve(PROBLEM, rigid(80.0))
    limit = curve.within_hz(curve.physical)
    at = curve.frequency_hz
    assert np.all(curve.physical[at <= limit] <= 0.1)
    assert curve.physical[np.searchsorted(at, limit) + 1] > 0.1
    assert curve.within_hz(curve.physical, 1e-6) == 0
    assert curve.within_hz(np.zeros_like(at)) == at[-1]
    assert curve.within_hz(np.where(at == at[5], np.nan, 0.0)) == at[4]


def test_a_softer_rendered_wall_is_judged_by_the_one_that_should_be_felt():
    wall = PROBLEM.environment
    softer = PROBLEM.model_copy(update={"environment": wall.model_copy(update={"stiffness_n_per_m": 0.8e5})})
    assert error_curve(softer, rigid(40.0), LOW_HZ).physical[0] < 1e-3
    assert error_curve(softer, rigid(40.0), LOW_HZ, wall).physical[0] == pytest.approx(0.2, abs=1e-3)
