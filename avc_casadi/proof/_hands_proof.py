"""Whether a frozen loop is stable with every hand of the ranges and every device of its own: proved, refuted or open.

Where F has no zero on the unit circle with any hand, the number of eigenvalues outside is the same with all of them.
With one hand the argument of F is followed along the circle, cell by cell: over the upper half it grows by 2 pi where
all eigenvalues lie inside, and by pi less for each that does not.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from avc_casadi.loop import Hand, device_corners, device_with, hand_ranges
from avc_casadi.passivity import SampledLoop, fractions
from avc_casadi.proof._frozen_loop import FrozenGains, FrozenLoop
from avc_casadi.proof._interval import Interval
from avc_casadi.proof._zero_exclusion import Cells, exclude_zeros, excludes
from avc_casadi.stability import MAX_DELAY_SAMPLES, rigid, whole_stability, worst_hands
from avc_casadi.support import SILENT, BoolArray, FloatArray, IndexArray, Progress

if TYPE_CHECKING:
    from avc_casadi.passivity import Fractions
    from avc_casadi.problem import Device, Problem

Outcome = Literal["proved", "refuted", "open"]
BUDGET = 40_000
"""Cells for one row of gains; a row 0.02 % below its limit takes some hundred."""
_REFUTED = 1 + 1e-9
"""Eigenvalues of these matrices are right to about 1e-12."""
_WITNESSES = 12
_CLEAR_TURN = 3.0
_TURN_TOLERANCE = 1e-3
_TOP = float(np.nextafter(np.pi, 4.0))
_NAMES = ("angle_rad", "mass_kg", "damping_ns_per_m", "stiffness_n_per_m", "delay_fraction")


@dataclass(frozen=True)
class Piece:
    """What was proved for delays between two whole numbers of samples; rows of cells as in `Enclosed` functions.

    Attributes:
        whole_delay: samples of delay, less the fraction.
        fraction: of the delay; None where it is a row of the cells.
        low: lower corner of the box, shape (v,): angle, rad; all mass that moves, kg; damping; stiffness; fraction.
        high: upper corner.
        cells: cells that fill the box, none of which holds a zero.
        member: cells along the unit circle at one point of the box.
    """

    whole_delay: int
    fraction: float | None
    low: FloatArray
    high: FloatArray
    cells: Cells
    member: Cells


@dataclass(frozen=True)
class HandsProof:
    """What is known of one row of gains with every hand and every device of the ranges.

    Attributes:
        outcome: proved: stable with all of them; refuted: unstable with the hand below; open: neither.
        gains: the row.
        pieces: the proof.
        hand: the hand that breaks the loop, or None.
        device: the device that it breaks it on, or None.
        radius: spectral radius with them; not a number where there are none.
        left: the middle of a cell that is left open, by name; empty where none is.
        reason: why it is open, in a sentence; else empty.
        looked_at: cells that were evaluated.
        seconds: time taken, of all rows that were proved together, divided by their number.
    """

    outcome: Outcome
    gains: FrozenGains
    pieces: tuple[Piece, ...] = ()
    hand: dict[str, float] | None = None
    device: Device | None = None
    radius: float = float("nan")
    left: dict[str, float] | None = None
    reason: str = ""
    looked_at: int = 0
    seconds: float = 0.0

    def sentence(self) -> str:
        """Say it in one line."""
        if self.outcome == "proved":
            cells = sum(len(piece.cells) for piece in self.pieces)
            return f"proved: stable with every hand and device of the ranges ({cells} cells)"
        if self.outcome == "refuted" and self.hand is not None:
            held = "{:.6g} kg, {:.6g} N.s/m, {:.6g} N/m".format(*self.hand.values())
            return f"refuted by the hand {held}: spectral radius {self.radius:.8g}"
        return f"open: {self.reason}"

    def replays(self) -> bool:
        """Whether the stored cells prove it, or the stored hand refutes it, once more and without any search."""
        if self.outcome == "refuted":
            return self.hand is not None and self.device is not None and _radius(self, self.device) > 1
        return self.outcome == "proved" and bool(self.pieces) and all(_replays(self.gains, one) for one in self.pieces)


def prove_hands(
    problem: Problem,
    damping_ns_per_m: FloatArray,
    stiffness_n_per_m: FloatArray,
    contact_damping_ns_per_m: FloatArray,
    *,
    budget: int = BUDGET,
    progress: Progress = SILENT,
) -> list[HandsProof]:
    """Prove or refute that frozen rows of gains are linearly stable with every hand of the ranges.

    Args:
        problem: device with its ranges of mass, damping and delay, wall, and ranges of the hands. The device let go is
            not among them, whatever `let_go` says: it is one loop, which its spectral radius judges.
        damping_ns_per_m: b, shape (n,); infinite is rigid.
        stiffness_n_per_m: k, shape (n,).
        contact_damping_ns_per_m: b_p, shape (n,).
        budget: cells that may be evaluated for a row.
        progress: told of the rows.

    Returns:
        n proofs. Amplifier and resonance are no part of the enclosure: such devices stay open, unless a hand is found.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    started = time.perf_counter()
    b, k, contact = (
        np.asarray(value, dtype=np.float64)
        for value in np.broadcast_arrays(*np.atleast_1d(damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m))
    )
    wall = problem.environment
    gains = FrozenGains(b, k, contact, wall.damping_ns_per_m, wall.stiffness_n_per_m, problem.device.sample_time_s)
    every = np.arange(len(b))
    progress.advance(0, len(b), "worst hands")
    found: dict[int, HandsProof] = _refuted(problem, gains, every)
    rest = np.setdiff1d(every, list(found))
    why = out_of_reach(problem)
    for row in rest if why else ():
        found[int(row)] = HandsProof("open", gains.pick(every[row : row + 1]), reason=why)
    drifting = rest[~gains.calls_back[rest]] if problem.hands.stiffness_n_per_m[0] == 0 and not why else rest[:0]
    for row in drifting:
        reason = "neither the wall nor the loosest hand calls the device back: an eigenvalue stands at 1"
        found[int(row)] = HandsProof("open", gains.pick(every[row : row + 1]), reason=reason)
    rest = np.setdiff1d(rest, list(found))
    if rest.size:
        found |= _proved(problem, gains, rest, budget, progress, len(b))
    each = (time.perf_counter() - started) / max(1, len(b))
    progress.advance(len(b), len(b), "every hand")
    return [replace(found[int(row)], seconds=each) for row in every]


def out_of_reach(problem: Problem) -> str:
    """Say why a device is none that the enclosure knows; empty where it is one."""
    device = problem.device
    if not rigid(device):
        parts = [
            name
            for name, there in (
                ("amplifier", device.amplifier_bandwidth_hz is not None),
                ("resonance", device.resonance is not None),
            )
            if there
        ]
        return f"the enclosure knows a rigid device with a delay, not {' and '.join(parts)}"
    if _delays(device)[1] > MAX_DELAY_SAMPLES:
        return f"more than {MAX_DELAY_SAMPLES} samples of delay"
    low, _ = moving_box(problem)
    return "" if low[0] > 0 else "no mass moves with the lightest hand"


def _delays(device: Device) -> tuple[float, float]:
    delays = [one.delay_samples for one in device_corners(device, ("delay_samples",))]
    return min(delays), max(delays)


def moving_box(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the ranges of all mass, damping and stiffness that move, rounded outwards, (3,) each."""
    corners = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    hands = hand_ranges(problem.hands)
    own = [[one.mass_kg for one in corners], [one.damping_ns_per_m for one in corners], [0.0]]
    total = Interval.of([min(values) for values in own], [max(values) for values in own])
    total = total + Interval.of(hands[:, 0], hands[:, 1])
    return np.maximum(total.low, 0.0), total.high


def _stretches(problem: Problem) -> Iterator[tuple[int, float | None, float, float]]:
    """Return whole delay, fraction (None where it varies) and its ends, for each stretch of the range of the delay."""
    low, high = _delays(problem.device)
    if low == high:
        yield int(low), low - int(low), 0.0, 0.0
        return
    for whole in range(int(low), int(np.ceil(high))):
        yield whole, None, max(low - whole, 0.0), min(high - whole, 1.0)


def _refuted(problem: Problem, gains: FrozenGains, rows: IndexArray) -> dict[int, HandsProof]:
    """Rows that a hand of the ranges breaks at a corner of the device, found by search."""
    found: dict[int, HandsProof] = {}
    parts = _parts(gains)
    keys = ("mass_kg", "damping_ns_per_m", "delay_samples", "amplifier_bandwidth_hz")
    inner = problem.hands.model_copy(update={"let_go": False})
    resonance = ("resonance.frequency_hz", "resonance.damping_ratio", "resonance.mass_ratio")
    for device in device_corners(problem.device, (*keys, *resonance)):
        if device.delay_samples > MAX_DELAY_SAMPLES:
            continue
        worst = worst_hands(device, parts, gains.contact_damping_ns_per_m, inner, enough=_REFUTED)
        for row in rows[worst.radius > _REFUTED]:
            if int(row) not in found or worst.radius[row] > found[int(row)].radius:
                own, radius = gains.pick(rows[row : row + 1]), float(worst.radius[row])
                hand = worst.hands.values(int(row))
                found[int(row)] = HandsProof("refuted", own, hand=hand, device=device, radius=radius)
    return found


def _parts(gains: FrozenGains) -> Fractions:
    wall = (gains.wall_damping_ns_per_m, gains.wall_stiffness_n_per_m)
    loop = SampledLoop(0.0, *wall, gains.sample_time_s, 0, "sampled-data")
    return fractions(loop, gains.damping_ns_per_m, gains.stiffness_n_per_m)


def _radius(proof: HandsProof, device: Device) -> float:
    """Spectral radius of the loop, discretised exactly, with the hand of a refutation."""
    hand = Hand(**proof.hand) if proof.hand is not None else Hand(0.0, 0.0, 0.0)
    return float(whole_stability(device, _parts(proof.gains), proof.gains.contact_damping_ns_per_m, hand).radius[0, 0])


def _proved(
    problem: Problem, gains: FrozenGains, rows: IndexArray, budget: int, progress: Progress, total: int
) -> dict[int, HandsProof]:
    pieces: dict[int, list[Piece]] = {int(row): [] for row in rows}
    looked_at = np.zeros(len(gains), dtype=np.intp)
    found: dict[int, HandsProof] = {}
    low, high = moving_box(problem)
    for whole, fraction, first, last in _stretches(problem):
        going = np.setdiff1d(rows, list(found))
        if not going.size:
            break
        loop = FrozenLoop(gains, whole, fraction)
        ends = ([first], [last]) if fraction is None else ([], [])
        low_corner, high_corner = (
            np.array([angle, *hand, *late]) for angle, hand, late in zip((0.0, _TOP), (low, high), ends, strict=True)
        )

        def worth(left: Cells) -> BoolArray:
            looked_at[:] += np.bincount(left.row, minlength=len(gains))
            progress.advance(total - len(np.unique(left.row)), total, "every hand")
            return np.asarray(looked_at[left.row] < budget)

        some = np.ones(len(going))
        boxes = Cells.boxes(low_corner[:, None] * some, high_corner[:, None] * some, going)
        search = exclude_zeros(loop, boxes, budget * len(going), worth)
        middle = np.clip(0.5 * low_corner + 0.5 * high_corner, low_corner, high_corner)
        point = np.where(np.arange(len(middle)) == 0, (low_corner, high_corner), middle)
        lines = Cells.boxes(point[0][:, None] * some, point[1][:, None] * some, going)
        along = exclude_zeros(loop, lines, budget * len(going), worth)
        for row in going:
            mine, line, left = (one.of_row(int(row)) for one in (search.excluded, along.excluded, search.open))
            own = gains.pick(np.array([row]))
            if len(left):
                found[int(row)] = _left_open(problem, own, left, whole, fraction)
            else:
                piece = Piece(whole, fraction, low_corner, high_corner, mine, line)
                if _all_inside(FrozenLoop(own, whole, fraction), line):
                    pieces[int(row)].append(piece)
                else:
                    reason = "the eigenvalues with one hand could not be counted"
                    found[int(row)] = HandsProof("open", own, reason=reason)
    for row in np.setdiff1d(rows, list(found)):
        own = gains.pick(np.array([row]))
        found[int(row)] = HandsProof("proved", own, tuple(pieces[int(row)]))
    return {row: replace(proof, looked_at=int(looked_at[row])) for row, proof in found.items()}


def _left_open(problem: Problem, gains: FrozenGains, left: Cells, whole: int, fraction: float | None) -> HandsProof:
    """Try the hands in the cells that are left; where none breaks the loop the row is open."""
    smallest = np.argsort((left.high - left.low)[1:4].sum(axis=0), kind="stable")[:_WITNESSES]
    middles = 0.5 * (left.low + left.high)[:, smallest]
    hands = hand_ranges(problem.hands)
    devices = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    ends = [[one.mass_kg for one in devices], [one.damping_ns_per_m for one in devices]]
    for middle in middles.T:
        late = fraction if fraction is not None else middle[4]
        # The device takes what lies beyond the hand of the middle of its range.
        own = [float(np.clip(middle[1 + i] - hands[i].mean(), min(ends[i]), max(ends[i]))) for i in range(2)]
        hand = [float(np.clip(value, *limits)) for value, limits in zip(middle[1:4] - [*own, 0.0], hands, strict=True)]
        values = {"mass_kg": own[0], "damping_ns_per_m": own[1], "delay_samples": whole + late}
        device = device_with(problem.device, values)
        names = dict(zip(_NAMES[1:4], hand, strict=True))
        proof = HandsProof("refuted", gains, hand=names, device=device)
        radius = _radius(proof, device)
        if radius > _REFUTED:
            return replace(proof, radius=radius)
    place = dict(zip(_NAMES, (float(value) for value in middles[:, 0]), strict=False))
    held = ", ".join(f"{value:.6g} {name}" for name, value in list(place.items())[1:4])
    reason = f"{len(left)} cells left when the budget was used up, one about {held} of all that moves"
    return HandsProof("open", gains, left=place, reason=reason)


def _all_inside(loop: FrozenLoop, line: Cells) -> bool:
    """Whether the argument of F grows by 2 pi along the cells: all eigenvalues lie inside the unit circle."""
    order = np.argsort(line.low[0], kind="stable")
    low, high = line.low[:, order], line.high[:, order]
    if not len(line) or low[0, 0] != 0.0 or high[0, -1] != _TOP or (low[0, 1:] != high[0, :-1]).any():
        return False
    points = np.concatenate([low, high[:, -1:]], axis=1)
    value = loop.at(points, np.zeros(points.shape[1], dtype=np.intp))
    number = value.real.middle + 1j * value.imag.middle
    # Both ends of a cell lie in one half plane: the argument between them is the principal one.
    turn = np.angle(number[1:] * np.conj(number[:-1]))
    whole = abs(float(turn.sum()) - 2 * np.pi) < _TURN_TOLERANCE
    return bool(np.isfinite(turn).all() and (np.abs(turn) < _CLEAR_TURN).all() and whole)


def _replays(gains: FrozenGains, piece: Piece) -> bool:
    loop = FrozenLoop(gains, piece.whole_delay, piece.fraction)
    cells, member = (replace(one, row=np.zeros(len(one), dtype=np.intp)) for one in (piece.cells, piece.member))
    inside = (member.low[1:] >= piece.low[1:, None]) & (member.high[1:] <= piece.high[1:, None])
    thin = member.low[1:] == member.high[1:]
    whole = piece.low[0] == 0.0 and piece.high[0] == _TOP
    return bool(
        whole
        and inside.all()
        and thin.all()
        and (member.low[1:] == member.low[1:, :1]).all()
        and fills(piece.low, piece.high, cells)
        and excludes(loop, cells).all()
        and excludes(loop, member).all()
        and _all_inside(loop, member)
    )


def fills(low: FloatArray, high: FloatArray, cells: Cells) -> bool:
    """Whether cells fill a box: by halving it as the search did, along any side that cuts no cell."""
    waiting = [(low, high, np.arange(len(cells)))]
    while waiting:
        first, last, some = waiting.pop()
        if not len(some):
            return False
        if len(some) == 1:
            one = int(some[0])
            if (cells.low[:, one] > first).any() or (cells.high[:, one] < last).any():
                return False
            continue
        middle = 0.5 * first + 0.5 * last
        below, above = cells.high[:, some] <= middle[:, None], cells.low[:, some] >= middle[:, None]
        clean = np.flatnonzero((below | above).all(axis=1) & (last > first))
        if not clean.size:
            return False
        side = int(clean[0])
        for half, upper in ((below[side], False), (above[side], True)):
            ends = first.copy(), last.copy()
            ends[0 if upper else 1][side] = middle[side]
            waiting.append((*ends, some[half]))
    return True
