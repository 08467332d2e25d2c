"""The simulated operators: two fixed populations of hands, drawn anew for each seed.

Set A is uniform in mass, damping and stiffness of a hand that moves with the device. Set B is a hand on a stylus with
five parameters, within the ranges that Fu and Cavusoglu (2012) measured on 15 subjects; logarithms are uniform, which
puts the means near the measured ones. A fingertip is assumed, uniform.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.hands import FINGERTIP, STYLUS_RANGES, Hand, StylusHand, hand_corners, hand_ranges, joined
from avc_casadi.model.problem import Hands

Population = Literal["A", "B", "fingertip"]
GRIPS: dict[str, Population] = {"stylus": "B", "fingertip": "fingertip"}
"""Grips other than [hands], with the population of each."""
# Streams of random numbers of a seed.
_TRAINING = 1
_TEST = 2
_STYLUS = 4
_LOOSE = (1.0, 0.15, 0.35)
"""Shares of the ranges of mass, damping and stiffness from which loose grips are drawn."""
# Hands drawn with one seed. The first block has the seed itself, all others one spawned from it, so that any hand among
# millions is drawn without those before.
BLOCK = 10_000


def draw_population(population: Population, count: int, seed: int, *, first: int = 0) -> Hand | StylusHand:
    """Draw hands of a population."""
    if population != "B":
        return draw_hands(Hands() if population == "A" else FINGERTIP, count, seed, first=first)
    low, high = np.log(np.array(list(STYLUS_RANGES.values()))).T
    values = np.exp(low + (high - low) * _uniform([seed, _STYLUS], first, count, len(low)))
    return StylusHand(**dict(zip(STYLUS_RANGES, values.T, strict=True)))


def draw_hands(hands: Hands, count: int, seed: int, *, first: int = 0, training: bool = False) -> Hand:
    """Draw hands uniformly within the ranges of a problem; training hands are none of the others."""
    low, high = hand_ranges(hands).T
    stream = _TRAINING if training else _TEST
    return Hand(*(low + (high - low) * _uniform([seed, stream], first, count, len(low))).T)


def _uniform(entropy: list[int], first: int, count: int, columns: int) -> FloatArray:
    """Return a block of rows of an unbounded table, uniform in [0, 1), (count, columns), from the row `first` on.

    Any block of a seed has the same rows, however it is cut.
    """
    if entropy[0] < 0:
        raise InputError.of(f"is {entropy[0]}; allowed: 0 or more", key="seed")
    rows = [np.empty((0, columns))]
    for block in range(first // BLOCK, -(-(first + count) // BLOCK)):
        seed = np.random.SeedSequence(entropy, spawn_key=(block,) if block else ())
        last = min(BLOCK, first + count - block * BLOCK)
        rows.append(np.random.default_rng(seed).random((last, columns))[max(0, first - block * BLOCK) :])
    return np.concatenate(rows)


def loose_grips(hands: Hands, count: int, seed: int) -> Hand:
    """Draw loose grips, which encoder quantisation keeps moving longest: little damping and stiffness, any mass."""
    low, high = hand_ranges(hands).T
    random = np.random.default_rng([seed, _TRAINING])
    return Hand(*(low + (high - low) * np.array(_LOOSE) * random.random((count, len(low)))).T)


def people_of(hands: Hands, count: int, seed: int = 0) -> Hand:
    """Draw hands from a problem's own set, its corners first."""
    corners = hand_corners(hands)
    return joined(corners, draw_hands(hands, max(0, count - len(corners)), seed)).pick(slice(0, count))
