"""What may be claimed of a wall B + K/s rendered without coupling on the device as declared, at all its corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.certificate._at_rest import radius_limit
from avc_casadi.certificate._device_levels import stable_with_one_hand
from avc_casadi.certificate._every_case import Score
from avc_casadi.loop import LINEAR_KEYS, device_corners
from avc_casadi.passivity import (
    Fractions,
    RenderingSlack,
    SampledLoop,
    fractions,
    frequencies_hz,
    handle_port,
    worst_margin,
)
from avc_casadi.stability import whole_stability
from avc_casadi.support import FloatArray, IndexArray

if TYPE_CHECKING:
    from avc_casadi.loop import Hand
    from avc_casadi.problem import Device, Model


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
