"""Deployable: linearly stable with every hand and let go, over the device's corners, at the rows and between them.

Each verdict is held against a loop that is marched here sample by sample, with mechanics discretised by scipy.
"""

import numpy as np
import pytest
from boxes_of_hands import loop_radius
from declared_device import MODE, growth, loop, random_device
from quick import first

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling, schedule_of
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, stiffest_wall
from avc_casadi.loops.wall import frozen_law, linear_stability
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.hands import Hand, hand_corners, with_released

THIN = {"disk_margin": 0.01}


def test_a_corner_of_the_device_decides():
    problem = avc.load_problem("ve7").changed(robustness=THIN)
    gains = Gains(20.0, 1.7e5, 76.0)
    assert avc.deployable(Coupling.constant(problem, gains, "x")).passed
    light = problem.changed(device={"range": {"mass_kg": [0.05, 0.12]}})
    verdict = avc.deployable(Coupling.constant(light, gains, "x"))
    assert not verdict.passed
    assert "device mass_kg 0.05" in verdict.sentence


def test_let_go_fails_where_every_hand_holds():
    problem = avc.load_problem("ve7")
    verdict = avc.deployable(Coupling.constant(problem, Gains(28.27, 2.826e6, 84.91), "x"))
    assert [(claim.name, claim.passed) for claim in verdict.claims] == [("hands", True), ("let-go", False)]
    assert "released" in verdict.sentence
    assert "recommend" in verdict.advice


def test_two_stable_rows_may_be_unstable_between():
    """Stiff with a large damper, and soft with none: on the straight line between them the damper goes first."""
    problem = avc.load_problem("ve7").changed(frequency={"start_hz": 1.0, "stop_hz": 50.0}, robustness=THIN)
    stiff, soft = [0.0, 5e6, 60.0], [0.0, 2e3, 0.0]
    wall = problem.changed(environment={"stiffness_n_per_m": 6e4})
    rows = np.array([[1.0, *stiff], [50.0, *soft]])

    def verdict(table):
        return avc.deployable(Coupling(wall, schedule_of(wall, table, "x"), table))

    assert verdict(GainTable(rows[:1])).passed
    assert verdict(GainTable(rows[1:])).passed
    assert not verdict(GainTable(rows)).passed


def test_three_rows_that_are_stable_may_be_unstable_between_the_last_two():
    """Stiff with a large damper at two rows, which nothing changes between, and soft with none at the third."""
    problem = avc.load_problem("ve7").changed(frequency={"start_hz": 1.0, "stop_hz": 49.0}, robustness=THIN)
    stiff, soft = [0.0, 5e6, 60.0], [0.0, 2e3, 0.0]
    wall = problem.changed(environment={"stiffness_n_per_m": 6e4})
    rows = np.array([[1.0, *stiff], [7.0, *stiff], [49.0, *soft]])

    def verdict(table):
        return avc.deployable(Coupling(wall, schedule_of(wall, table, "x"), table))

    assert verdict(GainTable(rows[:2])).passed
    assert verdict(GainTable(rows[2:])).passed
    held, _ = verdict(GainTable(rows)).claims
    assert not held.passed
    assert 7.0 < held.frequency_hz < 49.0


@pytest.mark.slow
def test_a_coupling_of_a_small_disk_margin_is_asked_for_by_name(tmp_path, capsys):
    problem = avc.parse_problem(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"
        "[environment]\nstiffness_n_per_m = 3000.0\ndamping_ns_per_m = 0.0\n"
    )
    marks = []
    for contact, asked in ((5.0, {}), (5.0, THIN), (12.0, {})):
        coupling = Coupling.constant(problem.changed(robustness=asked), Gains(0.0, 1e9, contact), "x")
        own = avc.certify_law(problem, k=3000.0, b=contact, remedies=False)
        found = avc.deployable(coupling)
        assert found.disk_margin == pytest.approx(own.disk_margin, rel=1e-3)
        assert found.passed == (found.disk_margin >= (0.01 if asked else 0.15))
        avc.write_coupling(coupling, tmp_path / "c.json")
        main(["certify", str(tmp_path / "c.json")])
        marks.append(capsys.readouterr().out.split("Deployable")[0].split()[-1])
    assert marks == ["✗", "!", "✓"]


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
    found = linear_stability(case.device, frozen_law(case, *gains), HANDS).radius[0]
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
    first(
        [
            {"resonance": MODE, "encoder_at": "handle"},
            {"amplifier_bandwidth_hz": 15.0},
            {"amplifier_bandwidth_hz": 20.0, "amplifier_order": 2},
            {"delay_samples": 2.5},
        ]
    ),
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


RANGES = {
    "mass_kg": [0.09, 0.12],
    "delay_samples": [0.5, 1.5],
    "amplifier_bandwidth_hz": [500.0, 2000.0],
    "resonance": {"frequency_hz": [120.0, 180.0], "damping_ratio": [0.02, 0.1]},
}


@pytest.mark.slow
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
    limit = stiffest_wall(PlantFamily.of(case))
    found = damping_range(PlantFamily.of(case), 0.8 * limit.stiffness_n_per_m)
    edges = np.array([found.lowest_ns_per_m, found.highest_ns_per_m])
    at = np.full(2, 0.8 * limit.stiffness_n_per_m)
    assert loop_radius(case.device, people, at, edges).max(axis=1) == pytest.approx(1, abs=1e-8)
    limits = [stiffest_wall(PlantFamily.between(one, case.hands)).stiffness_n_per_m for one in corners[::7]]
    assert limit.stiffness_n_per_m <= min(limits) * 1.001
    # A coupling that the nominal device holds, and a corner does not: the corner is named.
    nominal = case.changed(device={"range": {key: None for key in RANGES if key != "resonance"}})
    nominal = nominal.changed(device={"range": {"resonance": dict.fromkeys(RANGES["resonance"])}})
    top = stiffest_wall(PlantFamily.of(nominal))
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
