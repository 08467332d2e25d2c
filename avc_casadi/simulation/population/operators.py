"""The simulated operators: two fixed populations of hands, drawn anew for each seed.

Set A is uniform in mass, damping and stiffness of a hand that moves with the device. Set B is a hand on a stylus with
five parameters, within the ranges that Fu and Cavusoglu (2012) measured on 15 subjects; logarithms are uniform, which
puts the means near the measured ones. A fingertip is assumed, uniform. The arm of van Beek et al. (Sci Rep 5:18004, one
trial) is added.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.hands import FINGERTIP, STYLUS_RANGES, Hand, StylusHand, hand_corners, hand_ranges, stylus_corners
from avc_casadi.model.problem import Hands

Population = Literal["A", "B", "arm", "fingertip"]
GRIPS: dict[str, Population] = {"stylus": "B", "fingertip": "fingertip"}
"""Grips other than [hands], with the population of each."""
Split = Literal["training", "test"]

ARM = Hand(0.554, 6.45, 135.0)
# Loose grips, as shares of the ranges of mass, damping and stiffness.
_LOOSE = np.array([1.0, 0.15, 0.35])
_STREAMS: dict[tuple[Population, Split], int] = {
    ("A", "training"): 1,
    ("A", "test"): 2,
    ("B", "training"): 3,
    ("B", "test"): 4,
}


# Hands drawn with one seed. The first block has the seed itself, all others one spawned from it, so that any hand among
# millions is drawn without those before.
BLOCK = 10_000


def draw_population(
    population: Population, count: int, seed: int, split: Split = "test", *, first: int = 0
) -> Hand | StylusHand:
    """Draw hands of a population; the training and test streams are disjoint."""
    if population == "arm":
        return ARM
    if population in ("A", "fingertip"):
        return draw_hands(Hands() if population == "A" else FINGERTIP, count, seed, split, first=first)
    low, high = np.log(np.array(list(STYLUS_RANGES.values()))).T
    drawn = np.exp(low + (high - low) * _uniform([seed, _STREAMS[population, split]], first, count, len(low)))
    return StylusHand(**dict(zip(STYLUS_RANGES, drawn.T, strict=True)))


def draw_hands(hands: Hands, count: int, seed: int, split: Split = "test", *, first: int = 0) -> Hand:
    """Draw hands uniformly within the ranges of a problem's hands, as set A within the default ones."""
    low, high = hand_ranges(hands).T
    return Hand(*(low + (high - low) * _uniform([seed, _STREAMS["A", split]], first, count, len(low))).T)


def _uniform(entropy: list[int], first: int, count: int, columns: int) -> FloatArray:
    """Draw a block of rows of an unbounded table, uniform in [0, 1)."""
    if entropy[0] < 0:
        raise InputError.of(f"is {entropy[0]}; allowed: 0 or more", key="seed")
    rows = [np.empty((0, columns))]
    for block in range(first // BLOCK, -(-(first + count) // BLOCK)):
        seed = np.random.SeedSequence(entropy, spawn_key=(block,) if block else ())
        last = min(BLOCK, first + count - block * BLOCK)
        rows.append(np.random.default_rng(seed).random((last, columns))[max(0, first - block * BLOCK) :])
    return np.concatenate(rows)


def loose_grips(hands: Hands, count: int, seed: int) -> Hand:
    """Draw loose grips: nearly the least damping and a low stiffness, any mass.

    With these, encoder quantisation sustains oscillations that settle with all other hands.
    """
    low, high = hand_ranges(hands).T
    random = np.random.default_rng([seed, _STREAMS["A", "training"]])
    return Hand(*(low + (high - low) * _LOOSE * random.random((count, len(low)))).T)


def people_of(hands: Hands, count: int, seed: int = 0) -> Hand:
    """Draw hands from a problem's own set, its corners first."""
    corners = hand_corners(hands)
    drawn = draw_hands(hands, max(0, count - len(corners)), seed)
    both = (np.append(np.atleast_1d(getattr(corners, name)), value) for name, value in vars(drawn).items())
    return Hand(*both).pick(slice(0, count))


def corner_subjects(population: Population) -> Hand | StylusHand:
    """Return every corner of the ranges of a population."""
    if population == "A":
        return hand_corners(Hands())
    return hand_corners(FINGERTIP) if population == "fingertip" else stylus_corners()
