"""Stable stretches of stiffness by boundary curves against eigenvalues of loops that are put together in the test."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_wall import spectral_radius

import avc_casadi as avc
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.loops.stable_walls import stable_walls
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_set


def decades(low, high):
    return st.floats(low, high).map(lambda power: 10.0**power)


@st.composite
def loops(draw):
    """A device of any kind, a few hands, and the poles of a velocity filter, real or not."""
    period = draw(decades(-3.5, -1.5))
    table = {
        "mass_kg": draw(decades(-2.5, 0.7)),
        "damping_ns_per_m": draw(st.one_of(st.just(0.0), decades(-3, 1))),
        "sample_time_s": period,
        "delay_samples": draw(st.sampled_from([0, 1, 2, 5, 12, 0.3, 1.7])),
    }
    if draw(st.booleans()):
        table["resonance"] = {
            "frequency_hz": draw(decades(0.5, math.log10(0.45 / period))),
            "damping_ratio": draw(decades(-2.5, -0.3)),
            "mass_ratio": draw(st.floats(0.02, 0.95)),
        }
        table["encoder_at"] = draw(st.sampled_from(["motor", "handle"]))
    if draw(st.booleans()):
        table["amplifier_bandwidth_hz"] = draw(decades(1, 3.3))
        table["amplifier_order"] = draw(st.sampled_from([1, 2]))
    held = st.tuples(decades(-2.5, 0), decades(-1, 1.5), decades(0, 3))
    hands = draw(st.lists(st.one_of(held, st.just((0.0, 0.0, 0.0))), min_size=1, max_size=3))
    radius = decades(-2, 0.5).map(lambda rate: math.exp(-rate))
    turned = st.tuples(radius, st.floats(0.0, 1.0)).map(lambda of: (-2 * of[0] * math.cos(of[1]), of[0] ** 2))
    poles = draw(st.one_of(st.just((0.0, 0.0)), radius.map(lambda share: (-share, 0.0)), turned))
    return Device.model_validate(table), hands, poles


def worst(device, hands, damping, stiffness, poles=(0.0, 0.0)):
    return max(spectral_radius(device, hand, damping, stiffness, poles) for hand in hands)


def check(device, hands, poles, damping, more):
    """Every interval ends where the radius is 1; within it and without the radius says the same."""
    found = stable_walls([device], Hand(*np.array(hands).T), np.array([damping]), poles)
    ends = np.concatenate([found.lowest_n_per_m[0], found.largest_n_per_m[0]])
    ends = ends[np.isfinite(ends) & (ends > 0)]
    for stiffness in np.concatenate([ends * (1 - 1e-5), ends * (1 + 1e-5), ends / 2, more]):
        radius = worst(device, hands, damping, stiffness, poles)
        if abs(radius - 1) > 1e-9:
            assert (radius < 1) == found.holds(stiffness)[0]
    return found


@settings(max_examples=40, deadline=None)
@given(loops(), decades(-4, 0.2), st.booleans(), st.lists(decades(-6, 1), min_size=3, max_size=3))
def test_walls_are_stable_where_every_eigenvalue_lies_inside(case, share_of_most, damped, stiffnesses):
    device, hands, poles = case
    most = 2 * (device.mass_kg + max(hand[0] for hand in hands)) / device.sample_time_s
    check(device, hands, poles, damped * most * share_of_most, most / device.sample_time_s * np.array(stiffnesses))


SLOW = [(0.2, 0.5, 0.025, 1), (0.2, 0.5, 0.01, 1), (0.1, 1.0, 0.01, 2), (0.072, 0.005, 0.001, 0)]


SCALES = [(1, 1, 1), (1.3, 1, 1), (1, 2, 1), (1, 1, 0.7)]
# Each device as published, and each change on one of them; the others take longer.
CASES = [
    pytest.param(given, scale, marks=() if row in {0, place} else pytest.mark.slow)
    for row, scale in enumerate(SCALES)
    for place, given in enumerate(SLOW)
]


@pytest.mark.parametrize(("given", "scale"), CASES)
def test_slow_and_barely_damped_devices_have_their_edge(given, scale):
    mass, damping, period = (value * by for value, by in zip(given[:3], scale, strict=True))
    problem = avc.parse_problem(
        f"[device]\nmass_kg = {mass}\ndamping_ns_per_m = {damping}\nsample_time_s = {period}\n"
        f"delay_samples = {given[3]}\n[environment]\nstiffness_n_per_m = 5.0\ndamping_ns_per_m = 0.0\n",
        name="p",
    )
    region = zwidth(problem)
    hands = list(zip(*vars(hand_set(problem.hands)).values(), strict=True))
    for curve, held in zip(region.curves[-2:], ([(0.0, 0.0, 0.0)], hands), strict=True):
        assert curve.holds_target == (worst(problem.device, held, 0.0, 5.0) < 1)
        rows = np.flatnonzero(np.isfinite(curve.stiffness_n_per_m))
        for row in rows[[0, len(rows) // 2, -1]]:
            edge, b = curve.stiffness_n_per_m[row], region.damping_ns_per_m[row]
            assert worst(problem.device, held, b, edge * (1 - 1e-6)) < 1
            assert worst(problem.device, held, b, edge * (1 + 1e-6)) > 1
    released = region.curves[-2].stiffness_n_per_m[0]
    # The linear rule of Gil and Hulin, for a device that nobody holds and without damping of the wall.
    assert released == pytest.approx(damping / ((0.5 + given[3]) * period), rel=0.1)


def test_a_stiffer_wall_may_be_stable_again():
    resonance = {"frequency_hz": 14.6, "damping_ratio": 0.0395, "mass_ratio": 0.78}
    device = Device.model_validate({"mass_kg": 0.827, "damping_ns_per_m": 0.019, "resonance": resonance})
    hand = (0.0056, 0.1123, 780.1751)
    found = check(device, [hand], (0.0, 0.0), 0.0, np.geomspace(10.0, 1e4, 25))
    assert np.isfinite(found.largest_n_per_m).sum() == 2
    assert found.first_n_per_m[0] < 500 < found.lowest_n_per_m[0, 1] < 1000 < found.largest_n_per_m[0, 1]
    assert not found.holds(500.0)[0]
    assert worst(device, [hand], 0.0, 500.0) > 1 > worst(device, [hand], 0.0, 1000.0)
