"""Models of hands that hold the device, one or many, and the sets given by a problem's ranges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from itertools import product
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import quantity
from avc_casadi.model.plant import TARGET, Plant
from avc_casadi.model.problem import Hands

END_STOP_N_PER_M = 1e8  # of what holds a device at the end of its travel: beyond any coupling


class _Held:
    """Common base of both hand models: every value is one hand's, or an array of shape (n,) for n hands."""

    mass_kg: float | FloatArray

    def __len__(self) -> int:
        return int(np.size(self.mass_kg))

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            np.array_equal(value, vars(other)[name]) for name, value in vars(self).items()
        )

    __hash__ = None  # type: ignore[assignment]

    def pick(self, rows: slice | NDArray[np.intp]) -> Self:
        """Return a subset of the hands."""
        return type(self)(**{name: np.atleast_1d(value)[rows] for name, value in vars(self).items()})

    def at_handle(self, metres_per_unit: float) -> Self:
        """Return the hands in a device's units, for a hand displacement per unit of its position."""
        return type(self)(**{name: value * metres_per_unit**2 for name, value in vars(self).items()})

    def values(self, row: int) -> dict[str, float]:
        """Return the values of one hand, by name."""
        return {name: float(np.atleast_1d(value)[row]) for name, value in vars(self).items()}


@dataclass(frozen=True, eq=False)
class Hand(_Held):
    """A mass that moves with the device, spring and damper to the target."""

    mass_kg: float | FloatArray
    damping_ns_per_m: float | FloatArray
    stiffness_n_per_m: float | FloatArray

    def mechanics(self, plant: Plant) -> None:
        """Add the mass to the body that the hand holds, and join that to the target."""
        plant.add_mass(plant.grip, self.mass_kg)
        plant.join(plant.grip, TARGET, self.stiffness_n_per_m, self.damping_ns_per_m)


@dataclass(frozen=True, eq=False)
class StylusHand(_Held):
    """Tip -(k1, b1)- mass of the hand -(k2, b2)- target (Fu and Cavusoglu 2012)."""

    mass_kg: float | FloatArray
    grip_damping_ns_per_m: float | FloatArray
    grip_stiffness_n_per_m: float | FloatArray
    arm_damping_ns_per_m: float | FloatArray
    arm_stiffness_n_per_m: float | FloatArray

    def mechanics(self, plant: Plant) -> None:
        """Add the hand as a body between the device and the target."""
        plant.add_mass("hand", self.mass_kg)
        plant.join(plant.grip, "hand", self.grip_stiffness_n_per_m, self.grip_damping_ns_per_m)
        plant.join("hand", TARGET, self.arm_stiffness_n_per_m, self.arm_damping_ns_per_m)


def hand_text(values: Mapping[str, float], unit: Callable[[str], str]) -> str:
    """Return one hand by mass, damping and stiffness: "a hand of 300 g, 3.00 N.s/m, 800 N/m"."""
    quantities = zip(values.values(), ("kg", "N.s/m", "N/m"), strict=True)
    return f"a hand of {', '.join(quantity(value, unit(linear)) for value, linear in quantities)}"


def hand_ranges(hands: Hands) -> FloatArray:
    """Return the ranges of mass, damping and stiffness, rows of [lowest, highest], shape (3, 2)."""
    return np.array([getattr(hands, item.name) for item in fields(Hand)], dtype=np.float64)


def hand_corners(hands: Hands) -> Hand:
    """Return each corner of the ranges, light, loose and soft first; before them the released device, if included."""
    corners = set(product(*hand_ranges(hands).tolist()))
    if hands.let_go:
        corners.add((0.0, 0.0, 0.0))
    return Hand(*np.array(sorted(corners)).T)


def hand_set(hands: Hands, *, draws: int = 24, seed: int = 0) -> Hand:
    """Return all corners of the ranges, then uniform draws within them."""
    low, high = hand_ranges(hands).T
    drawn = low + (high - low) * np.random.default_rng(seed).random((draws, len(low)))
    corners = hand_corners(hands)
    values = np.column_stack([corners.mass_kg, corners.damping_ns_per_m, corners.stiffness_n_per_m])
    return Hand(*np.concatenate([values, drawn]).T)


def joined(hands: Hand, more: Hand) -> Hand:
    """Return the union of two sets of hands."""
    return Hand(
        mass_kg=np.append(hands.mass_kg, more.mass_kg),
        damping_ns_per_m=np.append(hands.damping_ns_per_m, more.damping_ns_per_m),
        stiffness_n_per_m=np.append(hands.stiffness_n_per_m, more.stiffness_n_per_m),
    )


def with_released(hands: Hand) -> Hand:
    """Return hands with the released device added."""
    return joined(hands, released_hand())


def with_stops(hands: Hand, mass_kg: float) -> Hand:
    """Return hands with the device at its end stop added, without a swing of its own, and the released device."""
    stop = Hand(0.0, 2 * (END_STOP_N_PER_M * mass_kg) ** 0.5, END_STOP_N_PER_M)
    return joined(joined(hands, stop), released_hand())


def released_hand() -> Hand:
    """Return the absent hand of a released device."""
    return Hand(0.0, 0.0, 0.0)


STYLUS_RANGES: dict[str, tuple[float, float]] = {
    "mass_kg": (0.016, 0.57),
    "grip_damping_ns_per_m": (0.3, 4.6),
    "grip_stiffness_n_per_m": (228.0, 1043.0),
    "arm_damping_ns_per_m": (3.7, 27.6),
    "arm_stiffness_n_per_m": (63.0, 533.0),
}
"""Lowest and highest of the 15 subjects of Fu and Cavusoglu (2012)."""

FINGERTIP = Hands(mass_kg=(0.02, 0.1), damping_ns_per_m=(1.0, 5.0), stiffness_n_per_m=(100.0, 500.0))
"""One finger that touches the handle: assumed, lighter and less damped than a hand that holds it."""
