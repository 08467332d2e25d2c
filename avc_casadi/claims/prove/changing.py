"""Changing gains in sustained contact: rows of a table that follow one another; proved, refuted by a pattern, or open.

The claim is of the loop clipped last, with rigid mechanics and a whole delay, while the device stays in contact: then
it is linear, and its state decays geometrically to the equilibrium of the hand, or stays bounded while a change of
stiffness moves that equilibrium. Rows themselves are judged; `proof_levels.rows_and_between` adds rows that cover what
is between others.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import KG, N_PER_M, NS_PER_M
from avc_casadi.claims.prove.contraction import ChangingLoop, NormedCell, covers, normed_cells, shrinks
from avc_casadi.claims.prove.hands import Outcome, moving_box, out_of_reach
from avc_casadi.claims.prove.interval import Interval
from avc_casadi.claims.prove.joint_radius import JointRadius, growth, joint_spectral_radius
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_with, linear_values
from avc_casadi.model.hands import Hand, hand_corners

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.model.problem import Problem

Order = Literal["any", "neighbours"]
"""Which row may follow: any, or the same and its neighbours (one row a sample)."""
MOST_CELLS = 200
"""Largest number of cells of hands in a proof."""
_REFUTED = 1 + 1e-9
_ROUGH = {"longest": 6, "most_products": 400}
_WORDS = {"any": "in any order", "neighbours": "by one row a sample at most"}


@dataclass(frozen=True)
class Changing:
    """Proof or refutation for gains that change.

    Attributes:
        outcome: proved: every allowed order decays with every hand of the ranges; refuted: the pattern below grows with
            the hand below; open: neither.
        sentence: the same in words.
        order: which row may follow.
        gains: b, k and b_p of the rows, shape (3, rows).
        low: lower bound of the joint spectral radius: the growth of the pattern with the hand.
        high: upper bound with that hand, the worst of the corners.
        pattern: indices of the rows in the order in which they act, repeated.
        hand: the worst corner of the hands, by name.
        device: the worst corner of the device, by key.
        cells: cells of hands with their norms; they fill the ranges if proved.
        seconds: time taken.
    """

    outcome: Outcome
    sentence: str
    order: Order
    gains: FloatArray
    low: float
    high: float
    pattern: tuple[int, ...]
    hand: dict[str, float]
    device: dict[str, float]
    cells: tuple[NormedCell, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Changing) and {**self.document(), "seconds": 0} == {**other.document(), "seconds": 0}

    __hash__ = None  # type: ignore[assignment]

    def replays(self, problem: Problem) -> bool:
        """Return whether the stored cells prove it, or the stored pattern refutes it, without any search."""
        if self.outcome == "refuted":
            inside = all(
                low <= self.hand[name] <= high
                for name, (low, high) in ((name, getattr(problem.hands, name)) for name in self.hand)
            )
            return inside and _allowed(self.pattern, self.follows) and self.growth(problem) > _REFUTED
        if self.outcome != "proved" or out_of_reach(problem) or not float(problem.device.delay_samples).is_integer():
            return False
        loop = ChangingLoop.of(problem, self.gains)
        return covers(list(self.cells), *_box(problem)) and all(
            shrinks(loop, self.follows, cell) for cell in self.cells
        )

    def growth(self, problem: Problem) -> float:
        """Return the growth of the pattern per sample with the stored hand and device."""
        device = device_with(problem.device, self.device)
        matrices = _matrices(problem.changed(device=device), self.gains, Hand(**self.hand))
        return growth(matrices, self.pattern)

    @property
    def follows(self) -> BoolArray:
        """Return whether the second of two rows may follow the first, shape (rows, rows)."""
        return _follows(self.order, self.gains.shape[1])

    def document(self) -> dict[str, Any]:
        """Return JSON values; an infinite gain is null. `from_document` reads them."""
        return {
            "schema": "avc-proof/1",
            "claim": "changing gains",
            **{name: plain(value) for name, value in vars(self).items() if name not in ("cells", "pattern")},
            "pattern": list(self.pattern),
            "cells": [plain(vars(cell)) for cell in self.cells],
        }

    @classmethod
    def from_document(cls, found: Mapping[str, Any]) -> Changing:
        """Read the output of `document`; unverified before `replays`."""
        gains = [[np.inf if gain is None else float(gain) for gain in row] for row in found["gains"]]
        return cls(
            outcome=found["outcome"],
            sentence=found["sentence"],
            order=found["order"],
            gains=np.array(gains),
            low=float(found["low"]),
            high=float(found["high"]),
            pattern=tuple(int(row) for row in found["pattern"]),
            hand={name: float(value) for name, value in found["hand"].items()},
            device={name: float(value) for name, value in found["device"].items()},
            cells=tuple(
                NormedCell(*(np.array(cell[name], dtype=np.float64) for name in ("low", "high", "roots")))
                for cell in found["cells"]
            ),
            seconds=float(found["seconds"]),
        )


def prove_changes(
    problem: Problem,
    gains: FloatArray,
    order: Order = "any",
    *,
    most_cells: int = MOST_CELLS,
    progress: Progress = SILENT,
) -> Changing:
    """Prove that rows of gains may follow one another in sustained contact, refute it by a pattern, or leave it open.

    Args:
        problem: device with its ranges, wall, ranges of the hands.
        gains: b, k and b_p of the rows, shape (3, rows); infinite is rigid.
        order: which row may follow.
        most_cells: largest number of cells of hands in a proof; with 0 none is tried.
        progress: reported over corners and cells.

    Raises:
        MissingExtraError: nothing refutes it, and clarabel, needed for a proof, is not installed.
        KeyboardInterrupt: Ctrl-C.
    """
    began = time.perf_counter()
    follows = _follows(order, gains.shape[1])
    why = _lacking(problem)
    corners, hands = device_corners(problem.device, LINEAR_KEYS), hand_corners(problem.hands)
    worst, worst_device, worst_hand = JointRadius(-1.0, np.inf, (0,), 0), corners[0], hands.values(0)
    for number, corner in enumerate(corners):
        progress.advance(number, len(corners), "patterns of rows")
        for row in range(0 if why else len(hands)):
            hand = hands.values(row)
            rough = joint_spectral_radius(
                _matrices(problem.changed(device=corner), gains, Hand(**hand)), follows, **_ROUGH
            )
            if rough.low > worst.low:
                worst, worst_device, worst_hand = rough, corner, hand
    if not why:
        matrices = _matrices(problem.changed(device=worst_device), gains, Hand(**worst_hand))
        fine = joint_spectral_radius(matrices, follows)
        best = max(worst, fine, key=lambda one: one.low)
        worst = JointRadius(best.low, min(worst.high, fine.high), best.pattern, worst.products + fine.products)

    def told(outcome: Outcome, sentence: str, cells: tuple[NormedCell, ...] = ()) -> Changing:
        seconds = time.perf_counter() - began
        bounds = (worst.low, worst.high, worst.pattern, worst_hand, linear_values(worst_device))
        return Changing(outcome, sentence, order, gains, *bounds, cells, seconds)

    words = _WORDS[order]
    if why:
        return told("open", why)
    if worst.low > _REFUTED:
        held = f"{{:.4g}} {KG}, {{:.4g}} {NS_PER_M}, {{:.4g}} {N_PER_M}".format(*worst_hand.values())
        return told(
            "refuted",
            f"rows that change {words}: the pattern {worst.pattern} repeated grows by {worst.low:.6g} a sample in kept "
            f"contact with the hand {held}",
        )
    bounds = f"joint spectral radius between {worst.low:.6g} and {worst.high:.6g} with the worst corner of the hands"
    loop = ChangingLoop.of(problem, gains)
    cells = normed_cells(loop, follows, *_box(problem), most_cells, progress) if most_cells else None
    if cells is not None:
        sentence = (
            f"rows may change {words}, with every hand of the box, in kept contact ({len(cells)} cells; {bounds})"
        )
        return told("proved", sentence, tuple(cells))
    tried = (
        f"no proof for the whole box in {most_cells} cells" if most_cells else "no proof for the whole box was sought"
    )
    return told("open", f"rows that change {words}: {bounds}; {tried}")


def _lacking(problem: Problem) -> str:
    """Return the reason why the proof does not cover a loop; empty where it does."""
    device = problem.device
    delays = {one.delay_samples for one in device_corners(device, ("delay_samples",))}
    if reason := out_of_reach(problem):
        return reason
    if len(delays) > 1 or not float(device.delay_samples).is_integer():
        return "the proof for changing gains knows whole, certain samples of delay"
    return "" if problem.environment.stiffness_n_per_m > 0 else "the wall has no spring to call the device back"


def _box(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the corners of all hands and devices in the coordinates of cells, rounded outwards."""
    low, high = moving_box(problem)
    lightness = 1.0 / Interval.of(low[0], high[0])
    return np.array([lightness.low, *low[1:]]), np.array([lightness.high, *high[1:]])


def _matrices(problem: Problem, gains: FloatArray, hand: Hand) -> FloatArray:
    """Return the matrix of every row with one hand, shape (rows, s, s)."""
    loop, device = ChangingLoop.of(problem, gains), problem.device
    moving = (
        1 / (device.mass_kg + float(np.ravel(hand.mass_kg)[0])),
        device.damping_ns_per_m + float(np.ravel(hand.damping_ns_per_m)[0]),
        float(np.ravel(hand.stiffness_n_per_m)[0]),
    )
    return np.asarray(loop.at(np.array(moving)[:, None])[0])


def _follows(order: Order, rows: int) -> BoolArray:
    apart = np.abs(np.arange(rows)[:, None] - np.arange(rows))
    return np.asarray(apart <= (rows if order == "any" else 1))


def _allowed(pattern: tuple[int, ...], follows: BoolArray) -> bool:
    inside = bool(pattern) and all(0 <= row < len(follows) for row in pattern)
    return inside and all(follows[row, after] for row, after in zip(pattern, pattern[1:] + pattern[:1], strict=True))
