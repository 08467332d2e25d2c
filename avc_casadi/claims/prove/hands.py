"""Whether a frozen loop is stable with every hand of the ranges and every device of its own: proved, refuted or open.

Where F has no zero on the unit circle with any hand, the number of eigenvalues outside is the same with all of them.
With one hand the argument of F is tracked along the circle, cell by cell: over the upper half it grows by 2 pi where
all eigenvalues lie inside, and by pi less for each that does not.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import KG, MASS, N_PER_M, NS_PER_M
from avc_casadi.claims.passivity.sampled_loop import SampledLoop, fractions
from avc_casadi.claims.prove.frozen_loop import FrozenGains, FrozenLoop
from avc_casadi.claims.prove.interval import Interval
from avc_casadi.claims.prove.zero_exclusion import TOP, Cells, Piece, all_inside, exclude_zeros
from avc_casadi.claims.stability.declared_device import rigid, whole_stability
from avc_casadi.claims.stability.frozen_loop import MAX_DELAY_SAMPLES
from avc_casadi.claims.stability.worst_hand import worst_hands
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_with
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_ranges

if TYPE_CHECKING:
    from avc_casadi.claims.passivity.sampled_loop import Fractions
    from avc_casadi.model.problem import Problem

Outcome = Literal["proved", "refuted", "open"]
BUDGET = 40_000
"""Cells for one row of gains; a row 0.02 % below its limit takes some hundred."""
_REFUTED = 1 + 1e-9
"""Eigenvalues of these matrices are right to about 1e-12."""
_WITNESSES = 12
_NAMES = ("angle_rad", "mass_kg", "damping_ns_per_m", "stiffness_n_per_m", "delay_fraction")


@dataclass(frozen=True)
class HandsProof:
    """Proof or refutation for one row of gains with every hand and every device of the ranges.

    Attributes:
        outcome: proved: stable with all of them; refuted: unstable with the hand below; open: neither.
        gains: the row.
        pieces: the proof.
        hand: the hand with which the loop is unstable, or None.
        device: the device with it, or None.
        radius: spectral radius with them; not a number where there are none.
        left: the middle of an open cell, by name; empty where none is open.
        reason: why it is open, in a sentence; else empty.
        looked_at: cells that were evaluated.
        seconds: time taken, averaged over the rows that were proved together.
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
        """The result in one line."""
        if self.outcome == "proved":
            cells = sum(len(piece.cells) for piece in self.pieces)
            return f"proved: stable with every hand and device of the ranges ({cells} cells)"
        if self.outcome == "refuted" and self.hand is not None:
            held = f"{{:.6g}} {KG}, {{:.6g}} {NS_PER_M}, {{:.6g}} {N_PER_M}".format(*self.hand.values())
            return f"refuted by the hand {held}: spectral radius {self.radius:.8g}"
        return f"open: {self.reason}"

    def replays(self) -> bool:
        """Return whether the stored cells prove it, or the stored hand refutes it, without any search."""
        if self.outcome == "refuted":
            return self.hand is not None and self.device is not None and _radius(self, self.device) > 1
        return (
            self.outcome == "proved" and bool(self.pieces) and all(piece.replays(self.gains) for piece in self.pieces)
        )

    def document(self) -> dict[str, Any]:
        """Return JSON values; `from_document` reads them. Cells are stored as a tree of cuts."""
        kept = ("outcome", "hand", "radius", "left", "reason", "looked_at", "seconds")
        return {
            "schema": "avc-proof/1",
            "claim": "stable with every hand",
            "sentence": self.sentence(),
            **{name: plain(getattr(self, name)) for name in kept},
            "gains": self.gains.document(),
            "device": None if self.device is None else self.device.model_dump(mode="json"),
            "pieces": [piece.document(self.gains) for piece in self.pieces],
        }

    @classmethod
    def from_document(cls, found: Mapping[str, Any]) -> HandsProof:
        """Read the output of `document`; unverified before `replays`."""
        hand, device, radius, left = (found[name] for name in ("hand", "device", "radius", "left"))
        return cls(
            outcome=found["outcome"],
            gains=FrozenGains.from_document(found["gains"]),
            pieces=tuple(Piece.from_document(piece) for piece in found["pieces"]),
            hand=None if hand is None else {name: float(value) for name, value in hand.items()},
            device=None if device is None else Device.model_validate(device),
            radius=float("nan") if radius is None else float(radius),
            left=None if left is None else {name: float(value) for name, value in left.items()},
            reason=str(found["reason"]),
            looked_at=int(found["looked_at"]),
            seconds=float(found["seconds"]),
        )


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
        problem: device with its ranges of mass, damping and delay, wall, and ranges of the hands. The released device
            is excluded, whatever `let_go`: it is one loop, judged by its spectral radius.
        damping_ns_per_m: b, shape (n,); infinite is rigid.
        stiffness_n_per_m: k, shape (n,).
        contact_damping_ns_per_m: b_p, shape (n,).
        budget: largest number of evaluated cells for a row.
        progress: reported over the rows.

    Returns:
        n proofs. The enclosure does not cover amplifier and resonance: such devices stay open, unless an unstable hand
        is found.

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
    """Return the reason why the enclosure does not cover a device; empty where it does."""
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
    return "" if low[0] > 0 else f"no {MASS} moves with the lightest hand"


def _delays(device: Device) -> tuple[float, float]:
    delays = [one.delay_samples for one in device_corners(device, ("delay_samples",))]
    return min(delays), max(delays)


def moving_box(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the ranges of total moving mass, damping and stiffness, rounded outwards, (3,) each."""
    corners = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    hands = hand_ranges(problem.hands)
    own = [[one.mass_kg for one in corners], [one.damping_ns_per_m for one in corners], [0.0]]
    total = Interval.of([min(values) for values in own], [max(values) for values in own])
    total = total + Interval.of(hands[:, 0], hands[:, 1])
    return np.maximum(total.low, 0.0), total.high


def _stretches(problem: Problem) -> Iterator[tuple[int, float | None, float, float]]:
    """Return whole delay, fraction (None where it varies) and its ends, for each part of the range of the delay."""
    low, high = _delays(problem.device)
    if low == high:
        yield int(low), low - int(low), 0.0, 0.0
        return
    for whole in range(int(low), int(np.ceil(high))):
        yield whole, None, max(low - whole, 0.0), min(high - whole, 1.0)


def _refuted(problem: Problem, gains: FrozenGains, rows: IndexArray) -> dict[int, HandsProof]:
    """Return refutations of rows unstable with a hand of the ranges at a corner of the device, found by search."""
    found: dict[int, HandsProof] = {}
    parts = _parts(gains)
    inner = problem.hands.model_copy(update={"let_go": False})
    for device in device_corners(problem.device, LINEAR_KEYS):
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
    """Return the spectral radius of the loop, discretised exactly, with the hand of a refutation."""
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
            np.array([angle, *hand, *late]) for angle, hand, late in zip((0.0, TOP), (low, high), ends, strict=True)
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
                if all_inside(FrozenLoop(own, whole, fraction), line):
                    pieces[int(row)].append(piece)
                else:
                    reason = "the eigenvalues with one hand could not be counted"
                    found[int(row)] = HandsProof("open", own, reason=reason)
    for row in np.setdiff1d(rows, list(found)):
        own = gains.pick(np.array([row]))
        found[int(row)] = HandsProof("proved", own, tuple(pieces[int(row)]))
    return {row: replace(proof, looked_at=int(looked_at[row])) for row, proof in found.items()}


def _left_open(problem: Problem, gains: FrozenGains, left: Cells, whole: int, fraction: float | None) -> HandsProof:
    """Try the hands in the remaining cells; where the loop is stable with all of them the row is open."""
    smallest = np.argsort((left.high - left.low)[1:4].sum(axis=0), kind="stable")[:_WITNESSES]
    middles = 0.5 * (left.low + left.high)[:, smallest]
    hands = hand_ranges(problem.hands)
    devices = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    ends = [[one.mass_kg for one in devices], [one.damping_ns_per_m for one in devices]]
    for middle in middles.T:
        late = fraction if fraction is not None else middle[4]
        # The device takes the difference from the hand at the middle of its range.
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
