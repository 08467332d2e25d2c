"""Sets of hands: mass, damper and spring to a resting point, rigidly in parallel with the device."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Hands


@dataclass(frozen=True)
class HandSet:
    """Hands to try, each array of shape (h,).

    Attributes:
        mass_kg: m_h.
        damping_ns_per_m: b_h.
        stiffness_n_per_m: k_h.
        corners: how many of them, the first ones, are corners of the range; the others are drawn.
        seed: seed of the draws.
    """

    mass_kg: FloatArray
    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    corners: int
    seed: int

    def __len__(self) -> int:
        return len(self.mass_kg)

    def pick(self, index: int) -> HandSet:
        """Take one hand."""
        one = slice(index, index + 1)
        return HandSet(self.mass_kg[one], self.damping_ns_per_m[one], self.stiffness_n_per_m[one], 1, self.seed)


def hand_set(hands: Hands, *, draws: int = 24, seed: int = 0) -> HandSet:
    """All corners of the ranges, the device let go where it belongs to the set, and uniform draws.

    Args:
        hands: ranges of mass, damping and stiffness.
        draws: hands drawn beside the corners.
        seed: seed of the draws.
    """
    ranges = (hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m)
    released = {(0.0, 0.0, 0.0)} if hands.let_go else set()
    corners = np.array(sorted(set(product(*ranges)) | released), dtype=np.float64)
    low, high = np.array(ranges).T
    drawn = low + (high - low) * np.random.default_rng(seed).random((draws, 3))
    values = np.concatenate([corners, drawn])
    return HandSet(values[:, 0], values[:, 1], values[:, 2], len(corners), seed)


def no_hand() -> HandSet:
    """Return the device left alone."""
    nothing = np.zeros(1)
    return HandSet(nothing, nothing, nothing, 1, 0)
