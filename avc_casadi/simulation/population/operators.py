"""The simulated people: two fixed populations of hands, drawn anew for each seed.

Set A is uniform in mass, damping and stiffness of a hand that moves with the device. Set B is a hand on a stylus with
five parameters, within the ranges that Fu and Cavusoglu (2012) measured on 15 subjects; logarithms are uniform, which
puts the means near the measured ones. A fingertip is assumed, uniform. The arm of van Beek et al. (Sci Rep 5:18004, one
trial) stands beside them.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.hands import FINGERTIP, STYLUS_RANGES, Hand, StylusHand, hand_corners, hand_ranges, stylus_corners
from avc_casadi.model.problem import Hands

Population = Literal["A", "B", "arm", "fingertip"]
HOLDING: dict[str, Population] = {"stylus": "B", "fingertip": "fingertip"}
"""How a device may be held otherwise than [hands] says, and who holds it so."""
Split = Literal["training", "test"]

ARM = Hand(0.554, 6.45, 135.0)
# Where in the ranges of mass, damping and stiffness loose hands lie, as shares.
_LOOSE = np.array([1.0, 0.15, 0.35])
_STREAMS: dict[tuple[Population, Split], int] = {
    ("A", "training"): 1,
    ("A", "test"): 2,
    ("B", "training"): 3,
    ("B", "test"): 4,
}


# People who are drawn with one seed. The first so many have the seed itself, all others one that is spawned from it, so
# that anybody among millions is drawn without those before.
BLOCK = 10_000


def draw_subjects(
    population: Population, count: int, seed: int, split: Split = "test", *, first: int = 0
) -> Hand | StylusHand:
    """Draw a population; those drawn for training are never those drawn for a test.

    Args:
        population: A, B or fingertip; the arm is one person.
        count: number of people.
        seed: seed of the draw; the first of many are the same people as a few.
        split: which stream of the seed.
        first: how many of the same draw come before them.
    """
    if population == "arm":
        return ARM
    if population in ("A", "fingertip"):
        return draw_hands(Hands() if population == "A" else FINGERTIP, count, seed, split, first=first)
    low, high = np.log(np.array(list(STYLUS_RANGES.values()))).T
    drawn = np.exp(low + (high - low) * _uniform([seed, _STREAMS[population, split]], first, count, len(low)))
    return StylusHand(**dict(zip(STYLUS_RANGES, drawn.T, strict=True)))


def draw_hands(hands: Hands, count: int, seed: int, split: Split = "test", *, first: int = 0) -> Hand:
    """Draw people uniformly within the ranges of a problem's hands, as set A within the default ones.

    Args:
        hands: ranges of mass, damping and stiffness.
        count: number of people.
        seed: as in `draw_subjects`.
        split: as in `draw_subjects`.
        first: as in `draw_subjects`.
    """
    low, high = hand_ranges(hands).T
    return Hand(*(low + (high - low) * _uniform([seed, _STREAMS["A", split]], first, count, len(low))).T)


def _uniform(entropy: list[int], first: int, count: int, columns: int) -> FloatArray:
    """Draw some rows of an endless table, uniform in [0, 1)."""
    if entropy[0] < 0:
        raise InputError.of(f"is {entropy[0]}; allowed: 0 or more", key="seed")
    rows = [np.empty((0, columns))]
    for block in range(first // BLOCK, -(-(first + count) // BLOCK)):
        seed = np.random.SeedSequence(entropy, spawn_key=(block,) if block else ())
        last = min(BLOCK, first + count - block * BLOCK)
        rows.append(np.random.default_rng(seed).random((last, columns))[max(0, first - block * BLOCK) :])
    return np.concatenate(rows)


def loose_hands(hands: Hands, count: int, seed: int) -> Hand:
    """Draw people who hold on loosely: nearly the least damping and a low stiffness, any mass.

    In their hands the step of an encoder keeps a device going that comes to rest with everybody else.

    Args:
        hands: ranges of mass, damping and stiffness.
        count: number of people.
        seed: as in `draw_subjects`, of the training split.
    """
    low, high = hand_ranges(hands).T
    random = np.random.default_rng([seed, _STREAMS["A", "training"]])
    return Hand(*(low + (high - low) * _LOOSE * random.random((count, len(low)))).T)


def people_of(hands: Hands, count: int, seed: int = 0) -> Hand:
    """Draw people from a problem's own set of hands, its corners first.

    Args:
        hands: ranges of mass, damping and stiffness.
        count: number of people.
        seed: of the draw.
    """
    corners = hand_corners(hands)
    drawn = draw_hands(hands, max(0, count - len(corners)), seed)
    both = (np.append(np.atleast_1d(getattr(corners, name)), value) for name, value in vars(drawn).items())
    return Hand(*both).pick(slice(0, count))


def corner_subjects(population: Population) -> Hand | StylusHand:
    """Every corner of the ranges of a population: the extreme people."""
    if population == "A":
        return hand_corners(Hands())
    return hand_corners(FINGERTIP) if population == "fingertip" else stylus_corners()
