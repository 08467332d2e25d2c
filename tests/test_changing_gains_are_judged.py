"""Rows of gains that follow one another: bounds hold against brute force, patterns replay in a simulator of its own,
proofs are checked by other code, and tampered ones are rejected."""

import dataclasses
import itertools
import json
import sys

import numpy as np
import pytest
from clip_last_simulator import Simulator
from declared_device import growth
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import nnls

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.claims.proof_levels import gain_corners, rows_and_between
from avc_casadi.claims.prove.changing import Changing, prove_changes
from avc_casadi.claims.prove.joint_radius import joint_spectral_radius
from avc_casadi.claims.stability.frozen_loop import joint_rendering
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains, GainTable

INF = np.inf
SPRING = avc.load_problem("figure5").changed(environment={"damping_ns_per_m": 0.0})
SOFT = SPRING.changed(
    environment={"stiffness_n_per_m": 2e3},
    hands={"mass_kg": [0.1, 0.102], "damping_ns_per_m": [10.0, 10.4], "stiffness_n_per_m": [300.0, 330.0]},
)


def dampers(*values):
    return np.array([[INF] * len(values), [INF] * len(values), values])


def brute_force(matrices, longest, follows):
    """Largest growth of closed words, and largest norm of words of the last length, each by one matrix."""
    low, high = 0.0, 0.0
    for length in range(1, longest + 1):
        for word in itertools.product(range(len(matrices)), repeat=length):
            if not all(follows[a, b] for a, b in itertools.pairwise(word)):
                continue
            found = np.eye(matrices.shape[-1])
            for number in word:
                found = matrices[number] @ found
            if follows[word[-1], word[0]]:
                low = max(low, np.abs(np.linalg.eigvals(found)).max() ** (1 / length))
            if length == longest:
                high = max(high, np.linalg.norm(found, 2) ** (1 / length))
    return low, high


@pytest.mark.thorough
@pytest.mark.parametrize("neighbours", [False, True])
def test_bounds_hold_against_all_products_of_random_systems(neighbours):
    random = np.random.default_rng(3)
    tight = 0
    for _ in range(12):
        count, size = int(random.integers(2, 4)), int(random.integers(2, 4))
        matrices = random.normal(size=(count, size, size))
        apart = np.abs(np.arange(count)[:, None] - np.arange(count))
        follows = apart <= (1 if neighbours else count)
        found = joint_spectral_radius(matrices, follows, accuracy=1e-2, longest=10, most_products=400)
        low, high = brute_force(matrices, 6, follows)
        assert found.low <= high * (1 + 1e-9)
        assert low <= found.high * (1 + 1e-9)
        assert found.low >= low * (1 - 0.02)
        assert all(follows[a, b] for a, b in zip(found.pattern, found.pattern[1:] + found.pattern[:1], strict=True))
        tight += found.high <= 1.1 * found.low
    assert tight >= 8


def test_known_radii_are_met():
    both = np.array([[[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 1.0]]])
    found = joint_spectral_radius(both)
    assert found.low == pytest.approx((1 + 5**0.5) / 2, rel=1e-12)
    assert set(found.pattern) == {0, 1}
    assert found.high >= found.low
    turned = np.array([[[0.0, -0.5], [0.5, 0.0]], [[0.6, 0.0], [0.0, -0.6]]])
    found = joint_spectral_radius(turned, accuracy=1e-6)
    assert (found.low, found.high) == (pytest.approx(0.6), pytest.approx(0.6, abs=2e-6))


@pytest.fixture(scope="module")
def refuted():
    return prove_changes(SPRING, dampers(92.0, 110.0), most_cells=0)


@pytest.mark.thorough
def test_rows_that_are_stable_each_diverge_by_a_pattern(refuted):
    assert refuted.outcome == "refuted"
    assert refuted.pattern == (0, 0, 1)
    assert 1.004 < refuted.low <= refuted.high < 1.008
    assert refuted.replays(SPRING)
    for row in (92.0, 110.0):
        alone = prove_changes(SPRING, dampers(row, row), most_cells=0)
        assert alone.high < 1


@pytest.mark.thorough
def test_nearer_rows_do_not_and_their_bounds_are_tight():
    found = prove_changes(SPRING, dampers(95.0, 105.0), most_cells=0)
    assert found.outcome == "open"
    assert 0.994 < found.low <= found.high < 0.9956
    assert "no proof for the whole box was sought" in found.sentence


@pytest.mark.thorough
def test_near_rows_may_jump_with_every_hand_of_the_box():
    pytest.importorskip("clarabel")
    found = prove_changes(SPRING, dampers(95.0, 105.0))
    assert found.outcome == "proved", found.sentence
    assert found.replays(SPRING)


@pytest.mark.thorough
def test_the_pattern_grows_in_a_simulator_of_its_own(refuted):
    """Pressed far into the wall, the distance from rest grows as it is told."""
    hand = {name: np.array([value]) for name, value in refuted.hand.items()}
    wall = SPRING.environment.stiffness_n_per_m
    gains = {"b": INF, "k": INF, "b_p": 0.0, "b_e": 0.0, "k_e": wall}
    depth = 0.1
    target = depth * (1 + wall / hand["stiffness_n_per_m"])
    simulator = Simulator(SPRING.device.model_dump() | {"max_force_n": None}, gains, hand, target)
    simulator.start(np.array([depth * (1 + 1e-9)]), np.array([0.0]), before=np.array([depth]))
    turns, sizes = 900, []
    for _ in range(turns):
        for row in refuted.pattern:
            gains["b_p"] = refuted.gains[2, row]
            position, _, force = simulator.step()
            assert force[0] > 0
        sizes.append(abs(position[0] - depth))
    samples = (turns - 300) * len(refuted.pattern)
    grown = (np.max(sizes[-20:]) / np.max(sizes[280:300])) ** (1 / samples)
    assert grown == pytest.approx(refuted.low, abs=2e-4)


@pytest.fixture(scope="module")
def proved():
    pytest.importorskip("clarabel")
    return prove_changes(SOFT, dampers(5.0, 9.0, 7.0), most_cells=40)


def matrix_of(mass, damping, stiffness, contact, wall):
    """The loop by its equations: x, v T, the x before; a rigid coupling and no damper in the wall."""
    t = SOFT.device.sample_time_s
    rate = np.array([[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 1 / mass], [0.0, 0.0, 0.0]])
    step = expm(rate * t)
    scale = np.diag([1.0, t, 1.0])
    step = scale @ step @ np.linalg.inv(scale)
    force = np.array([wall + contact / t, 0.0, -contact / t])
    found = np.zeros((3, 3))
    found[:2, :2] = step[:2, :2]
    found[:2] -= np.outer(step[:2, 2], force)
    found[2, 0] = 1.0
    return found


@pytest.mark.thorough
def test_a_proof_is_accepted_by_other_code(proved):
    assert proved.outcome == "proved", proved.sentence
    again = Changing.from_document(json.loads(json.dumps(proved.document(), allow_nan=False)))
    assert again == proved
    assert again.replays(SOFT)
    random = np.random.default_rng(0)
    hands, device = SOFT.hands, SOFT.device
    low = np.array([hands.mass_kg[0] + device.mass_kg, hands.damping_ns_per_m[0] + device.damping_ns_per_m, 300.0])
    high = np.array([hands.mass_kg[1] + device.mass_kg, hands.damping_ns_per_m[1] + device.damping_ns_per_m, 330.0])
    for share in [*itertools.product((0.0, 1.0), repeat=3), *random.uniform(size=(20, 3))]:
        hand = low + np.array(share) * (high - low)
        point = np.array([1 / hand[0], *hand[1:]])
        inside = [c for c in again.cells if (c.low <= point + 1e-9).all() and (point <= c.high + 1e-9).all()]
        assert inside
        # The joint of a rigid coupling is read by nothing: its column is empty, and the rest is a loop of three.
        wall = SOFT.environment.stiffness_n_per_m
        for before, after in itertools.product(range(3), repeat=2):
            moved = matrix_of(*hand, again.gains[2, before], wall)
            own, other = (cell_norm(inside[0].roots[row]) for row in (before, after))
            change = own - moved.T @ other @ moved
            assert np.linalg.eigvalsh(change).min() > 0


def cell_norm(root):
    """P of the three states, with the joint where it is best."""
    whole = root.T @ root
    return whole[:3, :3] - np.outer(whole[:3, 3], whole[3, :3]) / whole[3, 3]


@pytest.mark.thorough
def test_tampered_proofs_are_rejected(proved, refuted):
    random = np.random.default_rng(1)
    cells = proved.cells
    changed = [
        {"cells": cells[1:]},
        {"cells": (dataclasses.replace(cells[0], high=0.5 * (cells[0].low + cells[0].high)), *cells[1:])},
        {"gains": dampers(5.0, 300.0, 7.0)},
        {"gains": dampers(5.0, -9.0, 7.0)},
        {"outcome": "open"},
    ]
    for _ in range(40):
        roots = cells[0].roots.copy()
        roots[int(random.integers(3))] *= random.uniform(3, 100) ** random.choice([-1, 1])
        changed.append({"cells": (dataclasses.replace(cells[0], roots=roots), *cells[1:])})
    believed = [deed for deed in changed if dataclasses.replace(proved, **deed).replays(SOFT)]
    assert not believed
    lighter = SOFT.changed(hands={"mass_kg": [0.05, 0.102]})
    assert not proved.replays(lighter)
    assert not dataclasses.replace(refuted, pattern=(0,)).replays(SPRING)
    assert not dataclasses.replace(refuted, order="neighbours", gains=dampers(92, 100, 110), pattern=(0, 0, 2)).replays(
        SPRING
    )


def entries(problem, gains):
    """All that the gains enter, a column for each row of gains."""
    found = joint_rendering(problem, *gains)
    return np.hstack([found.force, found.state]).T


def least_distance(corners, point):
    """How far a point is from the convex hull of some corners, as a share of the largest entry."""
    scale = np.abs(corners).max(axis=1, keepdims=True) + 1e-12
    weight = 1e3  # of the sum of the shares, beside entries of order 1
    shares, left = nnls(
        np.vstack([corners / scale, weight * np.ones(corners.shape[1])]), [*(point / scale[:, 0]), weight]
    )
    return left / max(shares.max(), 1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_what_is_between_is_a_mixture_of_what_is_proved(seed):
    """All gains of a box are mixtures of its corners, and the way between two rows of these and the crossed ones."""
    random = np.random.default_rng(seed)
    problem = SPRING.changed(environment={"damping_ns_per_m": float(random.choice([0.0, random.uniform(1, 200)]))})
    rows = np.exp(random.uniform(np.log([[1.0], [100.0], [0.5]]), np.log([[1e4], [1e7], [200.0]]), (3, 3)))
    rows[2] *= random.integers(2)
    inside = rows.min(axis=1) + random.uniform(size=3) * (rows.max(axis=1) - rows.min(axis=1))
    assert least_distance(entries(problem, gain_corners(rows)), entries(problem, inside[:, None])[:, 0]) < 1e-8
    share = random.uniform()
    way = (1 - share) * rows[:, 1] + share * rows[:, 2]
    some = entries(problem, rows_and_between(rows[:, 1:]))
    assert some.shape[1] == (4 if rows[2].any() else 2)
    assert least_distance(some, entries(problem, way[:, None])[:, 0]) < 1e-8
    # The rows alone do not hold it where both kinds of gains change, and no corner may be left out.
    if rows[2].any():
        assert least_distance(some[:, :2], entries(problem, way[:, None])[:, 0]) > 1e-9


@pytest.mark.thorough
def test_gains_that_wander_in_a_box_that_is_proved_come_to_rest():
    """In a simulator of its own, pressed into the wall: b, k and b_p drawn anew at every sample."""
    pytest.importorskip("clarabel")
    rows = np.array([[5.0, 8.0], [2e4, 3e4], [5.0, 9.0]])
    corners = gain_corners(rows)
    assert corners.shape == (3, 8)
    assert prove_changes(SOFT, corners).outcome == "proved"
    random = np.random.default_rng(3)
    corner = {name: max(getattr(SOFT.hands, name)) for name in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")}
    wall, depth = SOFT.environment.stiffness_n_per_m, 0.05
    gains = {"b": 5.0, "k": 2e4, "b_p": 5.0, "b_e": 0.0, "k_e": wall}
    # The place of rest moves with k. What is between two motions under the same gains does not know of it.
    hand = {name: np.full(2, value) for name, value in corner.items()}
    simulator = Simulator(SOFT.device.model_dump() | {"max_force_n": None}, gains, hand, np.full(2, 8 * depth))
    simulator.start(np.full(2, depth), np.array([0.0, 0.01]), tool=np.full(2, depth * 2e4 / (2e4 + wall)))
    apart = []
    for _ in range(3000):
        gains["b"], gains["k"], gains["b_p"] = (float(random.uniform(*row)) for row in rows)
        position, _, force = simulator.step()
        assert (force > 0).all()
        apart.append(abs(position[1] - position[0]))
    assert max(apart[-300:]) < 1e-3 * max(apart[:300])


@pytest.mark.thorough
def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(avc.MissingExtraError, match=r"avc-casadi\[proof\]"):
        prove_changes(SOFT, dampers(5.0, 9.0))


def test_what_the_proof_does_not_know_is_open_by_name():
    late = SOFT.changed(device={"delay_samples": 0.4})
    assert "whole" in prove_changes(late, dampers(5.0, 9.0)).sentence
    resonant = {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}
    assert "resonance" in prove_changes(SOFT.changed(device={"resonance": resonant}), dampers(5.0, 9.0)).sentence


@pytest.mark.parametrize("contact", ["clip-last", "gated"])
@pytest.mark.parametrize(("wall", "damper", "holds"), [(2e3, 20.0, True), (2e3, 450.0, False), (1e5, 0.0, False)])
def test_constant_gains_of_an_unstable_loop_prove_no_changes(contact, wall, damper, holds):
    case = SOFT.changed(coupling={"contact": contact}, environment={"stiffness_n_per_m": wall})
    assert (growth(case.device, (0.1, 10.0, 300.0), (1e3, 1e6, damper), (0.0, wall)) < 1) == holds
    level = certify(case, Coupling.constant(case, Gains(1e3, 1e6, damper), "by hand"), prove=True).levels["L8"]
    assert (level.outcome, level.passed) == (("proved", True) if holds else ("refuted", False))
    assert ("no gains change" if holds else "unstable in contact") in level.claim


@pytest.mark.thorough
def test_the_level_is_there_when_it_is_asked_for():
    gains = Gains(20.0, 8e3, 0.0)
    constant = Coupling.constant(SOFT, gains, "by hand")
    level = certify(SOFT, constant, prove=True).levels["L8"]
    assert (level.outcome, level.claim) == ("proved", "no gains change")
    table = GainTable(np.array([[1.0, 1e3, 1e7, 92.0], [10.0, 1e3, 1e7, 118.0]]))
    level = certify(SPRING, dataclasses.replace(constant, table=table), prove=True).levels["L8"]
    assert level.outcome == "refuted"
    assert "pattern" in level.claim
    first = Changing.from_document(json.loads(json.dumps(level.detail))["proofs"][0])
    assert first.replays(SPRING)
