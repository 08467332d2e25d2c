"""The worst hand may stand inside the box of hands: searches, certificates, designs and proofs against brute force."""

from dataclasses import replace

import numpy as np
import pytest
from boxes_of_hands import FIGURE5, INSIDE, brute_force, edges, random_gains, random_problem

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.claims.prove.hands import prove_hands
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.claims.stability.frozen_loop import frozen_parts
from avc_casadi.claims.stability.scope import scope_slack
from avc_casadi.claims.stability.worst_hand import worst_hands
from avc_casadi.model.hands import hand_ranges, hand_set

BROKEN = 562.19, 0.0


def schedule_of(problem, b, k, contact=0.0):
    table = avc.solve(problem.changed(stability={"scope": "pointwise"}), "exact")
    n = len(table.frequency_hz)
    gains = {"damping_ns_per_m": b, "stiffness_n_per_m": k, "contact_damping_ns_per_m": contact}
    return replace(table, **{name: np.full(n, value) for name, value in gains.items()})


def test_a_hand_inside_the_box_breaks_what_corners_and_draws_pass():
    known = whole_stability(INSIDE.device, frozen_parts(INSIDE, *BROKEN), 0.0, hand_set(INSIDE.hands))
    assert known.radius.max() < 1
    worst = worst_hands(INSIDE.device, frozen_parts(INSIDE, *BROKEN), 0.0, INSIDE.hands)
    assert worst.radius[0] == pytest.approx(1.00102, abs=2e-5)
    assert worst.radius[0] >= brute_force(INSIDE, *(np.array([gain]) for gain in BROKEN), 0.0, 25)[0]
    assert worst.hands.values(0)["mass_kg"] == pytest.approx(0.111, abs=2e-3)
    assert scope_slack(INSIDE, 3.3, *BROKEN).slack[0] < 0


def test_the_certificate_shows_that_hand_and_the_proof_stores_it():
    level = certify(INSIDE, schedule_of(INSIDE, *BROKEN)).levels["L5"]
    assert not level.passed
    assert (level.passed, level.outcome) == (False, "")
    assert level.detail["worst_hand"]["mass_kg"] == pytest.approx(0.111, abs=2e-3)
    (proof,) = prove_hands(INSIDE, *BROKEN, 0.0)
    assert proof.outcome == "refuted"
    assert proof.replays()
    ranges = hand_ranges(INSIDE.hands)
    assert all(low <= value <= high for value, (low, high) in zip(proof.hand.values(), ranges, strict=True))


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["direct", "schedule"])
def test_designs_with_scope_hands_hold_the_whole_box(method):
    table = avc.solve(INSIDE, method)
    gains = table.damping_ns_per_m, table.stiffness_n_per_m, table.contact_damping_ns_per_m
    assert table.usable.all()
    assert np.all(brute_force(INSIDE, *gains, points=21) < 1)
    proofs = prove_hands(INSIDE, *gains)
    assert all(proof.outcome != "refuted" for proof in proofs)


@pytest.mark.thorough
def test_the_search_finds_what_a_lattice_finds():
    generator = np.random.default_rng(5)
    for _ in range(12):
        problem, gains = random_problem(generator), random_gains(generator, 15)
        found = worst_hands(problem.device, frozen_parts(problem, *gains[:2]), gains[2], problem.hands)
        assert np.all(found.radius >= brute_force(problem, *gains) - 1e-6)


@pytest.mark.thorough
def test_no_proof_is_contradicted_and_no_refutation_fails_to_replay():
    generator = np.random.default_rng(11)
    outcomes = []
    for _ in range(3):
        problem = random_problem(generator)
        b, _, contact = random_gains(generator, 6)
        k = edges(problem, b, contact, points=3) * np.array([0.5, 0.9, 0.99, 0.999, 1.001, 1.1])
        radius = brute_force(problem, b, k, contact, points=11)
        for proof, largest in zip(prove_hands(problem, b, k, contact), radius, strict=True):
            outcomes.append(proof.outcome)
            assert proof.outcome != "proved" or largest < 1
            assert proof.outcome == "open" or proof.replays()
            assert proof.outcome != "open" or proof.reason
    assert outcomes.count("proved") > 6
    assert outcomes.count("refuted") > 2


@pytest.mark.thorough
def test_ranges_of_the_device_are_part_of_the_box():
    wide = FIGURE5.changed(
        device={"range": {"delay_samples": (0.0, 1.3), "mass_kg": (0.08, 0.12), "damping_ns_per_m": (1.0, 3.0)}}
    )
    for k, outcome in ((2e3, "proved"), (5e4, "refuted")):
        (proof,) = prove_hands(wide, 50.0, k, 0.0)
        assert proof.outcome == outcome
        assert proof.replays()
    assert [piece.whole_delay for piece in prove_hands(wide, 50.0, 2e3, 0.0)[0].pieces] == [0, 1]


def test_what_cannot_be_enclosed_stays_open_by_name():
    shaky = FIGURE5.changed(device={"amplifier_bandwidth_hz": 500.0})
    (proof,) = prove_hands(shaky, 10.0, 1e3, 0.0)
    assert proof.outcome == "open"
    assert "amplifier" in proof.reason
    floating = FIGURE5.changed(hands={"stiffness_n_per_m": (0.0, 800.0)})
    (proof,) = prove_hands(floating, 10.0, 0.0, 0.0)
    assert proof.outcome == "open"
    assert "calls the device back" in proof.reason
    (proof,) = prove_hands(FIGURE5, 100.0, 89_000.0, 0.0, budget=20)
    assert proof.outcome == "open"
    assert "budget" in proof.reason


@pytest.mark.thorough
def test_certify_proves_a_whole_table():
    level = certify(FIGURE5, schedule_of(FIGURE5, 100.0, 5e4), prove=True).levels["L5"]
    assert level.passed
    assert level.outcome == "proved"
    assert set(level.detail["proof"]["row_outcome"]) == {"proved"}
    assert level.claim.startswith("Proved")
