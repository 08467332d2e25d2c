"""The simulated people: two fixed populations of hands, drawn anew for each seed.

Set A is uniform in mass, damping and stiffness of a hand that moves with the device. Set B is a hand on a stylus with
five parameters, within the ranges that Fu and Cavusoglu (2012) measured on 15 subjects; logarithms are uniform, which
puts the means near the measured ones. The arm of van Beek et al. (Sci Rep 5:18004, one trial) stands beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from avc_casadi.problem import Hands
from avc_casadi.scene.effects import Hand, StylusHand

Population = Literal["A", "B", "arm"]
Split = Literal["training", "test"]

# Lowest and highest of 15 subjects.
STYLUS_RANGES: dict[str, tuple[float, float]] = {
    "mass_kg": (0.016, 0.57),
    "grip_damping_ns_per_m": (0.3, 4.6),
    "grip_stiffness_n_per_m": (228.0, 1043.0),
    "arm_damping_ns_per_m": (3.7, 27.6),
    "arm_stiffness_n_per_m": (63.0, 533.0),
}
ARM = Hand(0.554, 6.45, 135.0)
_STREAMS: dict[tuple[Population, Split], int] = {
    ("A", "training"): 1,
    ("A", "test"): 2,
    ("B", "training"): 3,
    ("B", "test"): 4,
}


@dataclass(frozen=True)
class Subjects:
    """Simulated people.

    Attributes:
        population: A, B or arm.
        effect: their hands; every number is an array of shape (n,).
    """

    population: Population
    effect: Hand | StylusHand

    def __len__(self) -> int:
        return len(np.atleast_1d(np.asarray(self.effect.mass_kg)))

    def pick(self, rows: slice | NDArray[np.intp]) -> Subjects:
        """Take some of them."""
        chosen = {item.name: np.atleast_1d(getattr(self.effect, item.name))[rows] for item in fields(self.effect)}
        return Subjects(self.population, type(self.effect)(**chosen))

    def values(self, row: int) -> dict[str, float]:
        """Return the numbers of one person."""
        return {item.name: float(np.atleast_1d(getattr(self.effect, item.name))[row]) for item in fields(self.effect)}


def draw_subjects(population: Population, count: int, seed: int, split: Split = "test") -> Subjects:
    """Draw a population; those drawn for training are never those drawn for a test.

    Args:
        population: A or B; the arm is one person.
        count: number of people.
        seed: seed of the draw; the first of many are the same people as a few.
        split: which stream of the seed.
    """
    if population == "arm":
        return Subjects(
            "arm", Hand(*(np.array([value]) for value in (ARM.mass_kg, ARM.damping_ns_per_m, ARM.stiffness_n_per_m)))
        )
    random = np.random.default_rng([seed, _STREAMS[population, split]])
    if population == "A":
        uniform = random.random((count, 3))
        ranges = Hands()
        ends = np.array([ranges.mass_kg, ranges.damping_ns_per_m, ranges.stiffness_n_per_m])
        return Subjects("A", Hand(*(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * uniform).T))
    low, high = np.log(np.array(list(STYLUS_RANGES.values()))).T
    drawn = np.exp(low + (high - low) * random.random((count, len(low))))
    return Subjects("B", StylusHand(**dict(zip(STYLUS_RANGES, drawn.T, strict=True))))


def subjects_of(hands: Hands, count: int, seed: int = 0) -> Subjects:
    """Draw people from a problem's own set of hands, its corners among them.

    Args:
        hands: ranges of mass, damping and stiffness.
        count: number of people; the corners come first.
        seed: of the draw.
    """
    corners = extreme_subjects(hands)
    low, high = np.array([hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m]).T
    drawn = low + (high - low) * np.random.default_rng([seed, 5]).random((max(0, count - len(corners)), 3))
    extremes = np.stack([np.asarray(value) for value in vars(corners.effect).values()], axis=1)
    return Subjects("A", Hand(*np.concatenate([extremes, drawn])[:count].T))


def extreme_subjects(hands: Hands) -> Subjects:
    """Return every corner of a problem's set of hands."""
    ends = sorted(set(product(hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m)))
    return Subjects("A", Hand(*np.array(ends).T))


def with_let_go(subjects: Subjects) -> Subjects:
    """Add the device without any hand."""
    values = [np.append(np.atleast_1d(np.asarray(value)), 0.0) for value in vars(subjects.effect).values()]
    return Subjects(subjects.population, type(subjects.effect)(*values))
