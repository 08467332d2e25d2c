"""The worst point of a range may lie inside it: hands, devices, contacts and clocks, against plain simulations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from engine_simulator import EngineSimulator
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_wall import spectral_radius
from teleoperator_simulator import run

import avc_casadi as avc
from avc_casadi.claims.hands import worst_case_over_hands
from avc_casadi.design.virtual_tool import CouplingSearch, Scale, ToolSearch
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.follower import FollowerLoops, link_clocks
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.search import worst_point
from avc_casadi.loops.wall import frozen_law
from avc_casadi.model.corners import device_corners, device_with
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import hand_corners

DEVICE = "[device]\nmass_kg = {}\ndamping_ns_per_m = {}\ndelay_samples = 1\nmax_force_n = 20.0\n"


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 5), st.integers(0, 10**6))
def test_a_summit_inside_a_box_is_found(sides, seed):
    random = np.random.default_rng(seed)
    summit, width = random.uniform(0.1, 0.9, (sides, 1)), random.uniform(0.25, 0.6, (sides, 1))

    def leading(places):
        return np.exp(-(((places - summit) / width) ** 2).sum(axis=0)) * np.exp(0.3j)

    place, value = worst_point(leading, sides)
    assert abs(value[0]) == pytest.approx(1.0, abs=1e-4)
    assert place == pytest.approx(summit, abs=0.02)


def growth(hand, tool_kg, step_s, gains):
    """Return the growth a step of the engine with a late implicit one, from the second half of a long run."""
    steps = 500
    simulator = EngineSimulator(
        (0.08, 0.3, 1e-3, 1), hand, (tool_kg, 0.0), step_s, integrator="implicit", exchange="late"
    )
    samples = round(steps * step_s / 1e-3)
    moved = simulator.run(gains.stiffness_n_per_m, gains.damping_ns_per_m, samples, kick=1e-3, force=np.inf)
    size = (np.diff(moved, axis=-1) ** 2).sum(axis=0)
    first, last = size[samples // 2 : 3 * samples // 4].sum(), size[3 * samples // 4 :].sum()
    return (last / first) ** (1 / (steps / 2))


@pytest.mark.slow
@pytest.mark.parametrize(("tool_kg", "step_s"), [(0.05, 0.01), (0.1, 0.016)])
def test_no_hand_inside_breaks_a_coupling_to_an_engine(tool_kg, step_s):
    text = f"{DEVICE.format(0.08, 0.3)}[simulation]\ntool_mass_kg = {tool_kg}\nstep_s = {step_s}\n"
    stated = avc.parse_problem(f'{text}clock = "device"\nintegrator = "implicit"\nexchange = "late"\n')
    limit = ToolSearch(stated).stiffest()
    hands = [(m, 3.0, k) for m in np.geomspace(0.05, 0.3, 7) for k in (200.0, 800.0)]
    assert max(growth(hand, tool_kg, step_s, limit.times(0.98)) for hand in hands) < 1
    above = limit.times(1.1)
    loops = ToolLoops(stated)
    assert not loops.stable_over_ranges(above)
    radius, case = loops.radius(above)
    assert growth(tuple(case.hand.values()), tool_kg, step_s, above) == pytest.approx(radius, abs=2e-3)


def test_a_hand_inside_refutes_what_corners_pass():
    stated = avc.parse_problem(
        f"{DEVICE.format(0.08, 0.3)}[simulation]\ntool_mass_kg = 0.05\nstep_s = 0.01\n"
        'clock = "device"\nintegrator = "implicit"\nexchange = "late"\n'
    )
    loops, gains = ToolLoops(stated), ToolGains(1.35 * 1229.0, 1.35 * 30.65)
    assert loops.stable(gains)
    assert not loops.stable_over_ranges(gains)
    radius, case = loops.radius(gains)
    assert case.hand["mass_kg"] == pytest.approx(0.0759, abs=1e-3)
    assert growth((0.0759, 3.0, 200.0), 0.05, 0.01, gains) == pytest.approx(radius, abs=1e-3)
    assert radius == pytest.approx(1.00306, abs=2e-5)


@pytest.mark.parametrize("wall_n_per_m", [6000.0, pytest.param(12000.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mode_hz", [(30.0, 400.0), pytest.param((100.0, 500.0), marks=pytest.mark.slow)])
def test_no_device_inside_breaks_a_wall(wall_n_per_m, mode_hz):
    stated = avc.parse_problem(
        f"{DEVICE.format(0.12, 0.5)}[device.resonance]\nfrequency_hz = 200.0\ndamping_ratio = 0.01\nmass_ratio = 0.3\n"
        f"[device.range.resonance]\nfrequency_hz = [{mode_hz[0]}, {mode_hz[1]}]\n"
        f"[environment]\nstiffness_n_per_m = {wall_n_per_m}\ndamping_ns_per_m = 0.0\n"
    )
    rigid, dampers = 1e8, np.array([0.3, 1.0, 2.0, 4.0, 6.0])
    law = frozen_law(stated, np.zeros(5), np.full(5, rigid), dampers)
    family = PlantFamily.of(stated)
    told = [case.radius for case in worst_case_over_hands(family, law)]
    free = [case.radius for case in worst_case_over_hands(family.released, law, draws=0)]
    stiffness = 1 / (1 / wall_n_per_m + 1 / rigid)
    devices = [
        *device_corners(stated.device),
        *(device_with(stated.device, {"resonance.frequency_hz": hz}) for hz in np.geomspace(*mode_hz, 40).tolist()),
    ]
    hands = np.array(list(vars(hand_corners(stated.hands)).values())).T
    for row, damper in enumerate(dampers):
        held = np.array([[spectral_radius(one, hand, damper, stiffness) for hand in hands] for one in devices])
        alone = np.array([spectral_radius(one, (0.0, 0.0, 0.0), damper, stiffness) for one in devices])
        # What is unstable at a corner is not searched further.
        assert told[row] >= min(held.max(), 1.0) - 1e-7
        assert free[row] >= min(alone.max(), 1.0) - 1e-7


def teleoperator(delay_s):
    return avc.parse_problem(
        f"{DEVICE.format(0.12, 0.8)}[follower]\nmass_kg = 0.3\ndamping_ns_per_m = 1.0\ndelay_samples = 1\n"
        f"max_force_n = 20.0\ndelay_s = {delay_s}\ncontact_damping_ns_per_m = 0.5\n"
    )


def settles(gains, contact_n_per_m, delay_s):
    """Return whether a kick of the released leader dies away, the follower on a contact."""
    k, b = gains.stiffness_n_per_m, gains.damping_ns_per_m
    ends, contact = ((0.12, 0.8, 1e-3, 1), (0.3, 1.0, 1e-3, 1)), (contact_n_per_m, 0.5)
    moved = run(*ends, (k, b, 0.0), 3.0, delay_s, delay_s, contact=contact, kick=1e-6)
    size = (np.diff(moved, axis=-1) ** 2).sum(axis=0)
    return size[-500:].sum() < size[1000:1500].sum()


@pytest.mark.slow
def test_a_contact_inside_refutes_what_some_contacts_pass():
    loops, gains = FollowerLoops(teleoperator(5e-3)), ToolGains(673.1, 2.143)
    assert loops.stable(gains)
    assert not loops.stable_over_ranges(gains)
    case = loops.radius(gains)[1]
    assert case.environment_n_per_m == pytest.approx(1660.0, rel=0.02)
    assert not settles(gains, 1660.0, 5e-3)


@pytest.mark.slow
def test_no_contact_inside_breaks_a_teleoperator():
    delay_s = 3e-3
    stated = teleoperator(delay_s)
    limit = CouplingSearch(FollowerLoops(stated), Scale.of(stated, 2 * delay_s)).stiffest()
    assert all(settles(limit.times(0.97), contact, delay_s) for contact in np.geomspace(300.0, 4e3, 24))


@settings(max_examples=40, deadline=None)
@given(
    ratio=st.sampled_from([1.0, 2.0, 0.5, 1.5, 4 / 3]),
    there=st.floats(0.0, 6.0),
    back=st.floats(0.0, 6.0),
    phase=st.floats(0.0, 0.999),
)
def test_every_phase_of_two_clocks_is_among_the_patterns(ratio, there, back, phase):
    known = link_clocks(1e-3, ratio * 1e-3, there * 1e-3, back * 1e-3)
    numerator = next(count for count in range(1, 9) if abs(count / ratio - round(count / ratio)) < 1e-9)
    late = phase / round(numerator / ratio)

    def newest(time, first, period):
        return math.floor((time - first) / period + 1e-9)

    leader = tuple(newest(k, late, ratio) - newest(k - back, late, ratio) for k in range(numerator))
    times = [late + k * ratio for k in range(round(numerator / ratio))]
    follower = tuple(newest(time, 0.0, 1.0) - newest(time - there, 0.0, 1.0) for time in times)
    assert (leader, follower) in {(one.leader_sees, one.follower_sees) for one in known}
