"""The K-B region: closed forms, sampling theorems of the field, and the order of the claims."""

from functools import cache

import numpy as np
import pytest
from declared_device import MODE, growth

import avc_casadi as avc
from avc_casadi import parse_problem
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.model.corners import device_corners
from avc_casadi.model.hands import hand_corners

T = 1e-3


def problem(b_d=2.0, delay=0, structure="series", extra=""):
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\nsample_time_s={T}\ndelay_samples={delay}\n{extra}"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        f"[coupling]\nstructure='{structure}'\n"
        f"contact_damping_ns_per_m=[0.0, {100.0 if structure == 'damped' else 0.0}]\n"
        "[boundaries.upper]\ndamping_ns_per_m=9.0\nstiffness_n_per_m=0.9e5\n"
        "[boundaries.lower]\ndamping_ns_per_m=7.0\nstiffness_n_per_m=0.7e5\n"
        "[frequency]\nstart_hz=1.0\nstop_hz=100.0\npoints=5\n"
    )


@cache
def region_of(b_d=2.0, delay=0, extra=""):
    return zwidth(problem(b_d, delay, extra=extra))


FRICTION = "coulomb_friction_n=0.2\nencoder_resolution_m=2e-6\n"


def curves(region):
    return {curve.key: curve.stiffness_n_per_m for curve in region.curves}


@pytest.mark.slow
def test_passive_regions_without_delay_are_the_closed_forms():
    region = region_of()
    found, b = curves(region), region.damping_ns_per_m
    np.testing.assert_allclose(found["passive-paper"], 2 * (2.0 + b) / T, rtol=1e-6)
    expected = np.where(b < 2.0, 2 * (2.0 - b) / T, np.nan)  # Colgate and Schenkel: b_d > KT/2 + |B|
    np.testing.assert_allclose(found["passive-sampled-data"], expected, rtol=1e-6)
    assert found["passive-delayed"][0] == pytest.approx(2 * 2.0 / (3 * T), rel=1e-6)
    assert region.passive_limit_n_per_m == pytest.approx(2 * 2.0 / T)


@pytest.mark.slow
def test_passive_walls_are_stable_and_the_papers_region_is_not():
    region = region_of()
    found = curves(region)
    for name in ("stable-released", "stable-hands"):
        inside = np.isfinite(found["passive-sampled-data"])
        assert (found["passive-sampled-data"][inside] <= found[name][inside] * (1 + 1e-6)).all()
    beyond = found["passive-paper"] > 1.1 * np.nan_to_num(found["stable-hands"])
    assert beyond.any()  # walls that the paper's hold calls passive and that no hand of the set keeps stable


@pytest.mark.slow
def test_encoder_and_friction_bound():
    assert region_of().encoder_limit_n_per_m is None
    assert region_of(extra=FRICTION).encoder_limit_n_per_m == pytest.approx(2 * 0.2 / 2e-6)
    absent = region_of(extra=f"{FRICTION}range = {{ coulomb_friction_n = [0.0, 0.3] }}\n")
    assert not any("friction" in key for key in absent.used)


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
def zwidth_device_problem(name):
    bare = avc.parse_problem(
        "[device]\nmass_kg=0.1\ndamping_ns_per_m=2.0\n[environment]\ndamping_ns_per_m=1.0\nstiffness_n_per_m=3e3\n",
        name="p",
    )
    return bare.changed(device=CASES[name], hands=HANDS)


@cache
def region(name):
    return zwidth(zwidth_device_problem(name))


def curve(name, key):
    return {one.key: one.stiffness_n_per_m for one in region(name).curves}[key]


def test_a_corner_of_a_device_has_an_end_of_the_range_of_its_resonance():
    corners = device_corners(zwidth_device_problem("resonance").device)
    assert {one.resonance.frequency_hz for one in corners} == {100.0, 200.0}


def worst_growth(case, hands, damping, stiffness):
    """Spectral radius of a wall behind a joint that is far stiffer, at the worst corner."""
    return max(
        growth(corner, hand, (0.0, 1e13, 0.0), (damping, stiffness))
        for corner in device_corners(case.device)
        for hand in hands
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "key"), [("mass", "stable-hands"), ("resonance", "stable-released"), ("all", "stable-hands")]
)
def test_the_edge_of_the_stable_walls_is_that_of_the_worst_corner(name, key):
    case, found = zwidth_device_problem(name), curve(name, key)
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
