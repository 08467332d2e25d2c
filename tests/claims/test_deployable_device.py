"""Deployment is judged on the device as declared: amplifier, resonance, side of the encoder and any delay.

Each radius is held against a loop written down here from first principles and discretised by scipy.
"""

import numpy as np
import pytest
from declared_device import MODE, growth, loop, random_device

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.coupling import Coupling
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.loops.walls import damping_range, loop_radius, stiffest_wall
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand, hand_corners, with_released

HANDS = Hand(np.array([0.05, 0.15, 0.3]), np.array([3.0, 8.0, 20.0]), np.array([200.0, 500.0, 800.0]))


def problem(stiffness=5e3, damping=0.5, **device):
    found = avc.load_problem("ve7").changed(
        environment={"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping}, frequency={"stop_hz": 240.0}
    )
    return found.changed(device=device) if device else found


@pytest.mark.parametrize("seed", range(20))
def test_the_radius_is_that_of_the_written_down_loop(seed):
    rng = np.random.default_rng(seed)
    case = problem(10 ** rng.uniform(2.5, 4), rng.uniform(0.1, 5), **random_device(rng))
    gains = 10 ** rng.uniform([-1, 2.5, -1], [1, 5, 1])
    wall = case.environment.damping_ns_per_m, case.environment.stiffness_n_per_m
    found = linear_stability(case.device, frozen_parts(case, *gains[:2]), gains[2], HANDS).radius[0]
    for index, radius in enumerate(found):
        hand = HANDS.values(index)
        assert radius == pytest.approx(growth(case.device, tuple(hand.values()), gains, wall), abs=1e-9)
    # A joint far stiffer than the wall is none: the rigid loop of the stiffest wall.
    rigid = loop_radius(case.device, HANDS, np.array([wall[1]]), np.array([wall[0] + gains[2]]))[0]
    for index, radius in enumerate(rigid):
        hand = tuple(HANDS.values(index).values())
        assert radius == pytest.approx(growth(case.device, hand, (0.0, 1e13, gains[2]), wall), abs=1e-7)


@pytest.mark.parametrize(
    "declared",
    [
        {"resonance": MODE, "encoder_at": "handle"},
        {"amplifier_bandwidth_hz": 15.0},
        {"amplifier_bandwidth_hz": 20.0, "amplifier_order": 2},
        {"delay_samples": 2.5},
    ],
    ids=["resonance", "lag", "current loop", "delay"],
)
def test_what_is_declared_can_refuse_a_coupling(declared):
    """Stable on the ideal device, unstable on the declared one, and the marched motion grows there too."""
    gains = Gains(0.0, 1e8, 25.0)
    ideal, real = problem(1.5e4, 1.5), problem(1.5e4, 1.5, **declared)
    assert avc.deployable(Coupling.constant(ideal, gains, "x")).passed
    verdict = avc.deployable(Coupling.constant(real, gains, "x"))
    assert not verdict.passed
    assert (
        not certify(real, avc.coupling.schedule_of(real, Coupling.constant(real, gains, "x").table, "x"))
        .levels["L5"]
        .passed
    )
    hands = hand_corners(real.hands)
    held = [tuple(hands.values(index).values()) for index in range(len(hands))]
    wall, ends = (1.5, 1.5e4), []
    for case in (ideal, real):
        matrices = [loop(case.device, hand, tuple(vars(gains).values()), wall) for hand in held]
        start = np.ones(len(matrices[0]))
        ends.append(max(np.abs(np.linalg.matrix_power(one, 3000) @ start)[0] for one in matrices))
    assert ends[0] < 1e-3
    assert ends[1] > 1e3


@pytest.mark.thorough
def test_the_simulated_loop_grows_where_the_radius_says_so():
    """On both sides of the limit: the scene with all that is declared, its wall never left."""
    device = {"resonance": MODE, "amplifier_bandwidth_hz": 300.0, "delay_samples": 0.5, "encoder_resolution_m": 0.0}
    case = problem(1e3, 0.0, **device, coulomb_friction_n=0.0, max_force_n=None)
    limit = stiffest_wall(case.device, with_released(hand_corners(case.hands)))
    middle = (limit.lowest_ns_per_m + limit.highest_ns_per_m) / 2
    hands = hand_corners(case.hands)
    for share, rests in ((0.9, True), (1.3, False)):
        stiff = case.changed(
            environment={"stiffness_n_per_m": share * limit.stiffness_n_per_m, "damping_ns_per_m": 0.0}
        )
        gains = Gains(0.0, 1e12, middle)
        claims = avc.deployable(Coupling.constant(stiff.changed(robustness={"disk_margin": 0.01}), gains, "x")).claims
        assert all(claim.passed for claim in claims) == rests
        held = stiff.changed(
            scene={"duration_s": 4.0, "motion": {"kind": "hold", "end_m": 0.02}, "effects": ()},
        )
        assert all(claim.radius < 1 for claim in claims) == rests
        stable = avc.simulate_batch(held, hands, gains).stable
        radius = loop_radius(stiff.device, hands, np.array([stiff.environment.stiffness_n_per_m]), np.array([middle]))[
            0
        ]
        clear = np.abs(radius - 1) > 2e-3
        assert clear.any()
        np.testing.assert_array_equal(stable[clear], radius[clear] < 1)


RANGES = {
    "mass_kg": [0.09, 0.12],
    "delay_samples": [0.5, 1.5],
    "amplifier_bandwidth_hz": [500.0, 2000.0],
    "resonance": {"frequency_hz": [120.0, 180.0], "damping_ratio": [0.02, 0.1]},
}


@pytest.mark.thorough
def test_every_corner_of_the_device_is_judged():
    device = {"mass_kg": 0.1, "delay_samples": 1, "amplifier_bandwidth_hz": 1000.0, "resonance": MODE}
    case = problem(2e3, 0.0, **device, range=RANGES)
    people = with_released(hand_corners(case.hands))
    corners = device_corners(case.device, LINEAR_KEYS)
    assert len(corners) == 32
    k, d = np.array([500.0, 2e3]), np.array([1.0, 3.0])
    alone = np.max([loop_radius(corner, people, k, d) for corner in corners], axis=0)
    np.testing.assert_allclose(loop_radius(case.device, people, k, d), alone, rtol=0, atol=1e-9)
    # The wall is the stiffest for all corners together, and its damping stands on the edge.
    limit = stiffest_wall(case.device, people)
    found = damping_range(case.device, people, 0.8 * limit.stiffness_n_per_m)
    edges = np.array([found.lowest_ns_per_m, found.highest_ns_per_m])
    at = np.full(2, 0.8 * limit.stiffness_n_per_m)
    assert loop_radius(case.device, people, at, edges).max(axis=1) == pytest.approx(1, abs=1e-8)
    assert limit.stiffness_n_per_m <= min(stiffest_wall(one, people).stiffness_n_per_m for one in corners[::7]) * 1.001
    # A coupling that the nominal device holds, and a corner does not: the corner is named.
    nominal = case.changed(device={"range": {key: None for key in RANGES if key != "resonance"}})
    nominal = nominal.changed(device={"range": {"resonance": dict.fromkeys(RANGES["resonance"])}})
    top = stiffest_wall(nominal.device, people)
    gains = Gains(0.0, 0.9 * top.stiffness_n_per_m, (top.lowest_ns_per_m + top.highest_ns_per_m) / 2)
    stiff = {"environment": {"stiffness_n_per_m": 1e9}, "robustness": {"disk_margin": 0.01}}
    assert avc.deployable(Coupling.constant(nominal.changed(**stiff), gains, "x")).passed
    verdict = avc.deployable(Coupling.constant(case.changed(**stiff), gains, "x"))
    assert not verdict.passed
    for told in ("mass_kg", "delay_samples", "amplifier_bandwidth_hz", "resonance.frequency_hz"):
        assert told in verdict.sentence


@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_a_free_device_with_a_resonance_keeps_its_place(damping):
    case = problem(0.0, 0.0, resonance=MODE, amplifier_bandwidth_hz=500.0, damping_ns_per_m=damping)
    claims = avc.deployable(Coupling.constant(case, Gains(0.0, 1e3), "x")).claims
    assert [claim.passed for claim in claims] == [True, True]
