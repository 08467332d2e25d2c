"""Where no damping holds the softest wall that is looked for, there is none: that wall is no answer."""

import math

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.loops.walls import damping_range, loop_radius, softest_wall_n_per_m, stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.recommendation.sensitivity import what_would_help


@pytest.fixture(scope="module")
def too_late():
    """A light device whose force is 40 ms late, in a hand of a few grams."""
    return avc.load_problem("figure5").changed(
        device={"mass_kg": 5e-3, "damping_ns_per_m": 0.0, "delay_samples": 8, "sample_time_s": 5e-3},
        frequency={"stop_hz": 80.0},
        hands={"mass_kg": (5e-3, 0.02), "damping_ns_per_m": (0.0, 0.1), "stiffness_n_per_m": (50.0, 300.0)},
    )


@pytest.mark.thorough
def test_a_device_that_holds_nothing_has_no_stiffest_wall(too_late):
    people = with_released(hand_corners(too_late.hands))
    found = stiffest_wall(too_late.device, people)
    assert found.stiffness_n_per_m == 0
    assert math.isnan(found.lowest_ns_per_m)
    softest = softest_wall_n_per_m(too_late.device)
    assert softest == 1.0
    damping = np.linspace(0.0, 10.0, 201)
    radius = loop_radius(too_late.device, people, np.full(len(damping), softest), damping)
    assert (radius >= 1).any(axis=1).all()
    assert math.isnan(damping_range(too_late.device, people, softest).lowest_ns_per_m)


@pytest.mark.thorough
def test_what_helps_nothing_is_told_as_nothing(too_late):
    helps = what_would_help(too_late, hand_corners(too_late.hands))
    walls = {one.change: one.stiffest_wall_n_per_m for one in helps}
    assert walls["half the sample time"] == 0
    assert walls["no delay"] > 1
    assert helps[0].change == "no delay"


@pytest.mark.thorough
def test_the_search_of_laws_ends_where_not_even_a_softer_wall_is_held(too_late):
    found = avc.solve(too_late.changed(environment={"stiffness_n_per_m": 1e4, "damping_ns_per_m": 0.0}), "robust")
    assert not found.usable.any()
    assert "no law is found that holds every hand" in found.reason[0]
