"""Devices that stand for declared ranges: every corner first, then devices within, the same every time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_set, linear_values
from avc_casadi.model.device import Device

MODE = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}


def device(mass: float, delay: float, mode: float, share: float) -> Device:
    return Device(
        mass_kg=mass,
        damping_ns_per_m=2.0,
        sample_time_s=1e-3,
        delay_samples=delay,
        resonance=MODE | {"frequency_hz": mode},
        coulomb_friction_n=0.2,
        range={
            "mass_kg": ((1 - share) * mass, (1 + share) * mass),
            "delay_samples": (delay, delay + share),
            "resonance": {"frequency_hz": ((1 - share) * mode, mode)},
            "coulomb_friction_n": (0.1, 0.3),
        },
    )


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(st.floats(0.05, 1.0), st.floats(0.01, 3), st.floats(60, 300), st.floats(0.05, 0.4), st.integers(0, 2**31))
def test_corners_come_first_and_the_rest_lies_within(mass, delay, mode, share, seed):
    whole = device(mass, delay, mode, share)
    found = device_set(whole, LINEAR_KEYS, draws=12, seed=seed)
    corners = device_corners(whole, LINEAR_KEYS)
    assert len(corners) == 8
    assert found[:8] == corners
    assert found == device_set(whole, LINEAR_KEYS, draws=12, seed=seed)
    ends = np.array([list(linear_values(one).values()) for one in corners])
    within = np.array([list(linear_values(one).values()) for one in found[8:]])
    assert within.shape == (12, ends.shape[1])
    assert np.all(within >= ends.min(axis=0))
    assert np.all(within <= ends.max(axis=0))
    assert all(one.coulomb_friction_n == whole.coulomb_friction_n for one in found)
    moved = ends.max(axis=0) > ends.min(axis=0)
    assert np.all(np.ptp(within, axis=0)[moved] > 0.3 * np.ptp(ends, axis=0)[moved])
