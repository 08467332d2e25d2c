"""The K-B region of the device as declared: its edges stand at the worst corner, and what it leaves out is named."""

from functools import cache

import numpy as np
import pytest
from declared_device import MODE, growth, lowest_eigenvalue

import avc_casadi as avc
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.model.corners import device_corners
from avc_casadi.model.hands import hand_corners

CASES = {
    "mass": {"range": {"mass_kg": (0.05, 0.3)}},
    "damping and delay": {"range": {"damping_ns_per_m": (1.0, 4.0), "delay_samples": (0, 2)}},
    "amplifier": {"amplifier_bandwidth_hz": 300.0, "amplifier_order": 2, "range": {"mass_kg": (0.05, 0.3)}},
    "resonance": {"resonance": MODE, "range": {"resonance": {"frequency_hz": (100.0, 200.0)}}},
    "all": {
        "resonance": MODE,
        "encoder_at": "handle",
        "amplifier_bandwidth_hz": 700.0,
        "delay_samples": 0.5,
        "range": {"mass_kg": (0.05, 0.2), "delay_samples": (0.5, 1.5)},
    },
}
HANDS = {"mass_kg": (0.05, 0.3), "damping_ns_per_m": (3.0, 20.0), "stiffness_n_per_m": (200.0, 800.0)}


@cache
def problem(name):
    bare = avc.parse_problem(
        "[device]\nmass_kg=0.1\ndamping_ns_per_m=2.0\n[environment]\ndamping_ns_per_m=1.0\nstiffness_n_per_m=3e3\n",
        name="p",
    )
    return bare.changed(device=CASES[name], hands=HANDS)


@cache
def region(name):
    return zwidth(problem(name))


def curve(name, key):
    return {one.key: one.stiffness_n_per_m for one in region(name).curves}[key]


def worst_growth(case, hands, damping, stiffness):
    """Spectral radius of a wall behind a joint that is far stiffer, at the worst corner."""
    return max(
        growth(corner, hand, (0.0, 1e13, 0.0), (damping, stiffness))
        for corner in device_corners(case.device)
        for hand in hands
    )


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("key", ["stable-hands", "stable-released"])
def test_the_edge_of_the_stable_walls_is_that_of_the_worst_corner(name, key):
    case, found = problem(name), curve(name, key)
    corners = hand_corners(case.hands)
    hands = [(0.0, 0.0, 0.0)]
    if key == "stable-hands":
        hands = [tuple(corners.values(index).values()) for index in range(len(corners))]
    rows = np.flatnonzero(np.isfinite(found))[:: max(1, np.count_nonzero(np.isfinite(found)) // 4)]
    assert len(rows) > 3
    for row in rows:
        damping = region(name).damping_ns_per_m[row]
        for share in (0.3, 0.8, 0.999):
            assert worst_growth(case, hands, damping, share * found[row]) < 1
        # Hands between the corners may be worse: the edge is then below that of the corners.
        if key == "stable-released":
            assert worst_growth(case, hands, damping, 1.001 * found[row]) > 1


@pytest.mark.thorough
def test_a_light_device_takes_the_walls_that_only_the_nominal_one_holds():
    case = avc.load_problem("figure5").changed(device={"range": {"mass_kg": (0.05, 0.2)}})
    vague = zwidth(case)
    exact = zwidth("figure5")
    row = int(np.nanargmax(exact.curves[-1].stiffness_n_per_m))
    damping, stiffness = exact.damping_ns_per_m[row], exact.curves[-1].stiffness_n_per_m[row]
    light = case.changed(device={"mass_kg": 0.05, "range": {"mass_kg": None}}).device
    hand = (0.05, 3.0, 200.0)
    assert growth(light, hand, (0.0, 1e13, 0.0), (damping, stiffness)) > 1.1
    allowed = np.interp(damping, vague.damping_ns_per_m, np.nan_to_num(vague.curves[-1].stiffness_n_per_m))
    assert allowed < 0.8 * stiffness
    assert (vague.corners, exact.corners) == (2, 1)


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_the_edge_of_the_passive_walls_is_where_the_handle_loses_its_damping(name):
    case, found = problem(name), curve(name, "passive-sampled-data")
    time = case.device.sample_time_s
    rows = np.flatnonzero(np.isfinite(found))
    for row in rows[[0, len(rows) // 2]]:
        damping = region(name).damping_ns_per_m[row]
        for factor, passive in ((0.98, True), (1.03, False)):
            lowest = np.inf
            for corner in device_corners(case.device):
                for turns in np.concatenate([np.geomspace(1e-3, 0.1, 25), np.linspace(0.11, 0.5, 25)]):
                    rate = (1 - np.exp(-2j * np.pi * turns)) / time
                    impedance = damping + factor * found[row] / rate
                    lowest = min(lowest, lowest_eigenvalue(corner, impedance, turns, 60)[0])
            assert (lowest > -2e-3) == passive


@pytest.mark.thorough
def test_every_passive_wall_is_stable():
    for name in CASES:
        passive = curve(name, "passive-sampled-data")
        inside = np.isfinite(passive)
        for key in ("stable-hands", "stable-released"):
            assert (passive[inside] <= curve(name, key)[inside] * (1 + 1e-4)).all()


@pytest.mark.thorough
@pytest.mark.parametrize(("stiffness", "met"), [(1e3, True), (3e4, False)])
def test_the_wanted_wall_meets_what_its_curve_says(stiffness, met):
    found = zwidth(problem("mass").changed(environment={"stiffness_n_per_m": stiffness}))
    assert [one.wanted for one in found.curves] == [met] * len(found.curves)
