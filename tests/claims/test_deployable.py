"""Deployable: linearly stable with every hand and let go, over the device's corners, at the rows and between them.

Each verdict is held against a loop that is marched here sample by sample, with mechanics discretised by scipy.
"""

from itertools import product

import numpy as np
import pytest
import scipy.linalg

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling, schedule_of
from avc_casadi.model.gains import Gains, GainTable

THIN = {"disk_margin": 0.01}


def growth(mass, damping, stiffness, gains, wall, time, delay):
    """Factor a sample by which the frozen loop grows: mechanics by scipy, force from the joint between two springs."""
    b, k, b_p = gains
    b_e, k_e = wall
    step = scipy.linalg.expm(
        np.array([[0, time, 0], [-stiffness / mass * time, -damping / mass * time, time / mass], [0, 0, 0]])
    )
    size = 4 + delay

    def tick(state):
        x, v, before, joint_before = state[:4]
        lead, wall_lead = b + k * time, b_e + k_e * time
        joint = (lead * x - b * before + (b + b_e) * joint_before) / (lead + wall_lead)
        force = k_e * joint + b_e * (joint - joint_before) / time + b_p * (x - before) / time
        line = [force, *state[4:]]
        acting = line[-1] if delay else force
        moved = step @ np.array([x, v, -acting])
        return np.array([moved[0], moved[1], x, joint, *line[:delay]])

    matrix = np.stack([tick(row) for row in np.eye(size)], axis=1)
    return np.abs(np.linalg.eigvals(matrix)).max()


def judged_here(coupling):
    """The largest growth over the corners of hands and device, and let go, at the rows and halfway between them."""
    problem = coupling.problem
    device, hands, wall = problem.device, problem.hands, problem.environment
    rows = coupling.table.frequency_hz
    at = np.unique(np.concatenate([rows, np.sqrt(rows[:-1] * rows[1:])]))
    worst = {"hands": 0.0, "let-go": 0.0}
    held = list(product(hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m))
    for gains in coupling.table(at).T:
        for mass, damping in product(
            device.range.mass_kg or (device.mass_kg,), device.range.damping_ns_per_m or (device.damping_ns_per_m,)
        ):
            for m, b, k in [*held, (0.0, 0.0, 0.0)]:
                found = growth(
                    mass + m,
                    damping + b,
                    k,
                    gains,
                    (wall.damping_ns_per_m, wall.stiffness_n_per_m),
                    device.sample_time_s,
                    device.delay_samples,
                )
                name = "hands" if m else "let-go"
                worst[name] = max(worst[name], found)
    return worst


def random_coupling(rng):
    problem = avc.load_problem("ve4").changed(
        device={
            "mass_kg": 10 ** rng.uniform(-1.5, 0),
            "damping_ns_per_m": 10 ** rng.uniform(-1, 1),
            "sample_time_s": 10 ** rng.uniform(-3.6, -2.7),
            "delay_samples": int(rng.integers(0, 3)),
        },
        environment={"stiffness_n_per_m": 10 ** rng.uniform(2.5, 5), "damping_ns_per_m": 10 ** rng.uniform(-1, 1)},
        frequency={"stop_hz": 60.0},
    )
    if rng.random() < 0.3:
        mass, damping = problem.device.mass_kg, problem.device.damping_ns_per_m
        problem = problem.changed(
            device={"range": {"mass_kg": [0.7 * mass, 1.2 * mass], "damping_ns_per_m": [0.5 * damping, damping]}}
        )
    gains = 10 ** rng.uniform([-1, 2.5, -1], [2, 6, 2])
    if rng.random() < 0.5:
        return Coupling.constant(problem, Gains(*gains.tolist()), "drawn")
    rows = np.array([[1.0, *gains], [8.0, *(gains * 10 ** rng.uniform(-0.5, 0.5, 3))]])
    table = GainTable(rows)
    return Coupling(problem, schedule_of(problem, table, "drawn"), table)


@pytest.mark.thorough
def test_the_verdict_is_that_of_a_loop_marched_by_other_code():
    rng = np.random.default_rng(7)
    verdicts = []
    for _ in range(120):
        coupling = random_coupling(rng)
        worst = judged_here(coupling)
        verdict = avc.deployable(coupling)
        claims = [claim for claim in verdict.claims if claim.name != "disk-margin"]
        for claim in claims:
            own = worst[claim.name]
            if abs(own - 1) > 1e-6:
                # More hands and more points between the rows are judged there: what fails here must fail there.
                assert not (claim.passed and own > 1), (claim, own)
                if coupling.table.constant:
                    assert claim.radius >= own - 1e-9
                    assert claim.radius == pytest.approx(own, abs=5e-3)
        verdicts.append(all(claim.passed for claim in claims))
    assert 20 < sum(verdicts) < 100


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


@pytest.mark.parametrize("device", [{}, {"amplifier_bandwidth_hz": 500.0}], ids=["rigid", "amplifier"])
@pytest.mark.parametrize("let_go", [False, True])
def test_a_wall_without_a_spring_is_judged_alike_by_the_level_and_for_deployment(device, let_go):
    """Nothing calls a free device back: a place that is kept is no instability; a damper that feeds motion is one."""
    damper = {"stiffness_n_per_m": 0.0, "damping_ns_per_m": 5.0}
    problem = avc.load_problem("figure5").changed(
        device=device,
        environment=damper,
        boundaries={"upper": damper, "lower": damper | {"damping_ns_per_m": 4.0}},
        hands={"let_go": let_go},
    )
    for contact, rests in ((0.0, True), (900.0, False)):
        coupling = Coupling.constant(problem, Gains(1.0, 100.0, contact), "x")
        hands, released = avc.deployable(coupling).claims
        level = avc.certify(problem, coupling.schedule).levels["L5"]
        assert (hands.passed, released.passed) == (rests, rests)
        assert (level.passed, level.detail["released_pass"]) == (rests, rests)
        assert (level.margin_ns_per_m >= 0) == rests


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
