"""What may be claimed of a wall B + K/s rendered without coupling on the device as declared, at all its corners."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.claims.certificate import radius_limit
from avc_casadi.claims.levels import stable_with_one_hand
from avc_casadi.claims.passivity.handle_port import handle_port
from avc_casadi.claims.passivity.sampled_loop import Fractions, SampledLoop, fractions
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.claims.passivity.worst_port import RenderingSlack, frequencies_hz
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.model.corners import LINEAR_KEYS, device_corners

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Model


Score = Callable[[IndexArray, FloatArray, FloatArray], FloatArray]
"""Of some cases, for walls of (B, K): above 0 where a wall meets the claim in a case, shape (walls, cases)."""

_BISECTIONS = 40
# Where all cases are looked at: the edge that was found, and some walls below it.
_SHARES = (0.1, 0.5, 1.0)


def largest_stiffness(
    damping: FloatArray, scan: FloatArray, meets: Callable[[FloatArray, FloatArray], BoolArray]
) -> FloatArray:
    """Upper end of the first stretch of stiffnesses that meet a claim, found on a scan and bisected, shape (n,)."""
    met = np.zeros((len(damping), len(scan)), dtype=bool)
    going_on = np.arange(len(damping))
    for column, stiffness in enumerate(scan):
        met[going_on, column] = meets(damping[going_on], np.full(len(going_on), stiffness))
        going_on = np.flatnonzero(met[:, column] | ~met[:, :column].any(axis=1))
        if not going_on.size:
            break
    first = np.argmax(met, axis=1)
    after = np.arange(len(scan))[None, :] > first[:, None]
    leaves = after & ~met
    last = np.where(leaves.any(axis=1), np.argmax(leaves, axis=1) - 1, len(scan) - 1)
    inside, outside = scan[last], scan[np.minimum(last + 1, len(scan) - 1)]
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        fits = meets(damping, middle)
        inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
    return np.asarray(np.where(met.any(axis=1), inside, np.nan))


def largest_in_every_case(damping: FloatArray, scan: FloatArray, cases: int, score: Score) -> FloatArray:
    """Find the same for a claim that must hold in all cases.

    Few cases decide. All are looked at on the edge that these give and at some walls below it; what fails there joins
    them, until nothing fails.

    Args:
        damping: B, shape (n,).
        scan: stiffnesses, ascending, shape (m,).
        cases: how many there are.
        score: of some of them.
    """
    every = np.arange(cases)
    some = np.array([scan[0], scan[len(scan) // 2], scan[-1]])
    middle = damping[[0, len(damping) // 2, -1]]
    deciding = set(np.argmin(score(every, middle, some), axis=1).tolist())
    while True:
        chosen = np.array(sorted(deciding))

        def meets(b: FloatArray, k: FloatArray, chosen: IndexArray = chosen) -> BoolArray:
            return np.asarray((score(chosen, b, k) > 0).all(axis=1))

        found = largest_stiffness(damping, scan, meets)
        if len(deciding) == cases:
            return found
        there = np.flatnonzero(np.isfinite(found))
        b = np.repeat(damping[there], len(_SHARES))
        k = (found[there][:, None] * np.array(_SHARES)).ravel()
        whole = score(every, b, k)
        failing = (whole <= 0).any(axis=1) & meets(b, k)
        if not failing.any():
            return found
        deciding |= set(np.argmin(whole[failing], axis=1).tolist())


@dataclass(frozen=True)
class WallClaim:
    """One claim, in as many cases as it must hold in.

    Attributes:
        key: short name.
        claim: in words.
        cases: how many.
        score: of some cases, for walls.
    """

    key: str
    claim: str
    cases: int
    score: Score

    def holds(self, damping_ns_per_m: float, stiffness_n_per_m: float) -> bool:
        """Whether a wall meets the claim in all cases."""
        wall = np.array([damping_ns_per_m]), np.array([stiffness_n_per_m])
        return bool((self.score(np.arange(self.cases), *wall) > 0).all())


def _wall(device: Device, damping: FloatArray, stiffness: FloatArray, model: Model = "sampled-data") -> Fractions:
    loop = SampledLoop(device.damping_ns_per_m, damping, stiffness, device.sample_time_s, 0, model)
    return fractions(loop, np.inf, 1.0)


def passive_ideal(device: Device, model: Model, more_delay: int = 0) -> tuple[int, Score]:
    """Passivity of a rigid device with an ideal amplifier and whole delays, exact: cases are the ends of the ranges."""
    corners = device_corners(device, ("damping_ns_per_m", "delay_samples"))

    def score(cases: IndexArray, damping: FloatArray, stiffness: FloatArray) -> FloatArray:
        columns = []
        for corner in (corners[case] for case in cases):
            time, delay = corner.sample_time_s, int(corner.delay_samples) + more_delay
            loop = SampledLoop(corner.damping_ns_per_m, damping, stiffness, time, delay, model)
            columns.append(np.where(worst_margin(loop, np.inf, 1.0).passive, 1.0, -1.0))
        return np.stack(columns, axis=1)

    return len(corners), score


def passive_declared(device: Device) -> tuple[int, Score]:
    """Passivity of any device, as L3 has it, by a scan of frequencies: cases are the corners."""
    corners = device_corners(device, LINEAR_KEYS)
    ports = [handle_port(corner, frequencies_hz(corner)) for corner in corners]

    def score(cases: IndexArray, damping: FloatArray, stiffness: FloatArray) -> FloatArray:
        parts, nothing = _wall(device, damping, stiffness), np.zeros(len(damping))
        slack, rows = RenderingSlack(parts, nothing), np.arange(len(damping))
        columns = []
        for case in cases:
            left, near = slack(ports[case], rows)
            held = stable_with_one_hand([corners[case]], parts, nothing)
            # Its own rounding makes a wall on the edge passive.
            columns.append(np.where(held, np.where((left >= -near).all(axis=1), 1.0, left.min(axis=1)), -np.inf))
        return np.stack(columns, axis=1)

    return len(corners), score


def stable(device: Device, hands: Hand) -> tuple[int, Score]:
    """Linear stability with hands, as L5 has it: cases are corners of the device with hands."""
    corners = device_corners(device, LINEAR_KEYS)

    def score(cases: IndexArray, damping: FloatArray, stiffness: FloatArray) -> FloatArray:
        parts = _wall(device, damping, stiffness)
        left = np.empty((len(damping), len(cases)))
        corner, hand = np.divmod(cases, len(hands))
        for one in np.unique(corner):
            own = corner == one
            held = hands.pick(hand[own])
            radius = whole_stability(corners[one], parts, 0.0, held).radius
            left[:, own] = radius_limit(device, parts, held) - radius
        return left

    return len(corners) * len(hands), score
