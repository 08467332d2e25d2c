"""A stored proof is checked by other code: cells that fill the box exactly, values by mpmath; no tampered one holds."""

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from boxes_of_hands import FIGURE5
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.claims.prove.hands import prove_hands
from avc_casadi.claims.prove.zero_exclusion import cells_of, cover_of

GAINS = 60.0, 2e3, 2.0


def proof_of(delay):
    (proof,) = prove_hands(FIGURE5.changed(device={"delay_samples": delay}), *GAINS)
    assert proof.outcome == "proved"
    return proof


@pytest.fixture(scope="module", params=[0, 1, 0.4])
def proof(request):
    return proof_of(request.param)


def characteristic(gains, delay, point):
    """z^(2 - n) det(z I - A) of the loop with all mass, damping and stiffness of a point, by mpmath alone."""
    angle, mass, damping, stiffness = (mpmath.mpf(float(value)) for value in point[:4])
    t = mpmath.mpf(gains.sample_time_s)
    rate = mpmath.matrix([[0, 1, 0], [-stiffness / mass, -damping / mass, -1 / mass], [0, 0, 0]])
    whole, size = int(delay), 4 + int(np.ceil(delay))
    late = mpmath.mpf(delay) - whole
    step, after = mpmath.expm(rate * t), mpmath.expm(rate * (1 - late) * t)
    new = [after[0, 2], after[1, 2]]
    old = [step[0, 2] - new[0], step[1, 2] - new[1]]
    b, k, contact = (
        mpmath.mpf(float(value[0]))
        for value in (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    )
    b_e, k_e = mpmath.mpf(gains.wall_damping_ns_per_m), mpmath.mpf(gains.wall_stiffness_n_per_m)
    lead, wall = b + k * t, b_e + k_e * t
    # x, v, x before, joint before, forces under way; the joint between coupling and wall carries no mass.
    joint = [lead / (lead + wall), -b / (lead + wall), (b + b_e) / (lead + wall)]
    force = [wall / t * joint[0] + contact / t, wall / t * joint[1] - contact / t, wall / t * joint[2] - b_e / t]
    loop = mpmath.zeros(size)
    for i in range(2):
        loop[i, 0], loop[i, 1] = step[i, 0], step[i, 1]
    loop[2, 0] = 1
    for column, index in enumerate((0, 2, 3)):
        loop[3, index] = joint[column]
        if size > 4:
            loop[4, index] = force[column]
    for row in range(5, size):
        loop[row, row - 1] = 1
    for i in range(2):
        for column, index in enumerate((0, 2, 3)):
            if whole == 0:
                loop[i, index] += new[i] * force[column]
        if whole > 0:
            loop[i, 3 + whole] += new[i]
        if late:
            loop[i, 4 + whole] += old[i]
    z = mpmath.expj(angle)
    return z ** (2 - size) * mpmath.det(z * mpmath.eye(size) - loop)


def volume(low, high):
    total = Fraction(1)
    for one, other in zip(low, high, strict=True):
        total *= Fraction(float(other)) - Fraction(float(one))
    return total


def test_cells_fill_the_box_exactly(proof):
    for piece in proof.pieces:
        low, high = piece.cells.low, piece.cells.high
        assert np.all((low >= piece.low[:, None]) & (high <= piece.high[:, None]))
        whole = sum(volume(low[:, i], high[:, i]) for i in range(len(piece.cells)))
        # Nothing overlaps, so that equal volumes leave no gap.
        for i in range(len(piece.cells)):
            apart = (high[:, i : i + 1] <= low[:, i + 1 :]) | (low[:, i : i + 1] >= high[:, i + 1 :])
            assert apart.any(axis=0).all()
        assert whole == volume(piece.low, piece.high)


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(0, 40))
def test_cells_and_the_cuts_that_make_them_are_one_thing(seed, sides, halvings):
    random = np.random.default_rng(seed)
    box = np.sort(random.normal(size=(2, sides)), axis=0)
    boxes = [tuple(box)]
    for _ in range(halvings):
        low, high = boxes.pop(int(random.integers(len(boxes))))
        side = int(random.integers(sides))
        below, above = high.copy(), low.copy()
        below[side] = above[side] = 0.5 * low[side] + 0.5 * high[side]
        boxes += [(low, below), (above, high)]
    low, high = (np.array(ends).T for ends in zip(*boxes, strict=True))
    found = cover_of(*box, low, high)
    again = cells_of(*box, found.cuts)
    np.testing.assert_array_equal(again, (low[:, found.order], high[:, found.order]))
    one = int(random.integers(len(boxes)))
    if len(boxes) > 1:
        assert cover_of(*box, np.delete(low, one, axis=1), np.delete(high, one, axis=1)) is None
    high[0, one] -= 0.1 * (high[0, one] - low[0, one])
    assert cover_of(*box, low, high) is None
    for cuts in (found.cuts + ".", found.cuts[:-1], found.cuts.replace(".", "x", 1), "9" + found.cuts):
        with pytest.raises(ValueError, match="cut"):
            cells_of(*box, cuts)


def test_values_lie_in_the_half_plane_of_their_cell(proof):
    generator = np.random.default_rng(2)
    for piece in proof.pieces:
        delay = piece.whole_delay + piece.fraction
        for i in generator.choice(len(piece.cells), 30):
            share = generator.choice([0.0, 1.0, generator.random()], 4)
            point = piece.cells.low[:, i] + share * (piece.cells.high[:, i] - piece.cells.low[:, i])
            point = np.clip(point, piece.cells.low[:, i], piece.cells.high[:, i])
            value = complex(characteristic(proof.gains, delay, point))
            assert (value * np.conj(piece.cells.direction[i])).real > 0


@pytest.mark.thorough
def test_the_member_is_stable(proof):
    (piece,) = proof.pieces
    points = np.linspace(0.0, np.pi, 150)
    hand = piece.member.low[1:, 0]
    values = [complex(characteristic(proof.gains, piece.whole_delay + piece.fraction, [a, *hand])) for a in points]
    turn = np.angle(np.array(values[1:]) / np.array(values[:-1]))
    assert turn.sum() == pytest.approx(2 * np.pi, abs=1e-6)


def with_cells(proof, **changed):
    (piece,) = proof.pieces
    return replace(proof, pieces=(replace(piece, cells=replace(piece.cells, **changed)),))


@pytest.mark.thorough
def test_tampered_proofs_are_refused(proof):
    assert proof.replays()
    generator = np.random.default_rng(7)
    (piece,) = proof.pieces
    cells = piece.cells
    for _ in range(6):
        i, side = int(generator.integers(len(cells))), int(generator.integers(4))
        keep = np.arange(len(cells)) != i
        assert not with_cells(
            proof,
            low=cells.low[:, keep],
            high=cells.high[:, keep],
            direction=cells.direction[keep],
            row=cells.row[keep],
        ).replays()
        turned = cells.direction.copy()
        turned[i] *= -1
        assert not with_cells(proof, direction=turned).replays()
        smaller = cells.high.copy()
        smaller[side, i] -= 0.3 * (smaller[side, i] - cells.low[side, i])
        assert not with_cells(proof, high=smaller).replays()
    higher = piece.high.copy()
    higher[1] *= 1.2
    assert not replace(proof, pieces=(replace(piece, high=higher),)).replays()
    assert not replace(proof, pieces=()).replays()
    stiffer = replace(proof.gains, stiffness_n_per_m=proof.gains.stiffness_n_per_m * 40)
    assert not replace(proof, gains=stiffer).replays()
    later = replace(piece, whole_delay=piece.whole_delay + 12)
    assert not replace(proof, pieces=(later,)).replays()


def test_an_unstable_member_is_not_taken_for_a_stable_one():
    proof = proof_of(0)
    (piece,) = proof.pieces
    half = piece.member.pick(piece.member.low[0] < 1.0)
    assert not replace(proof, pieces=(replace(piece, member=half),)).replays()
