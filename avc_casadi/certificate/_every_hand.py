"""The worst hand of each row over the ranges of hands and the corners of the device: found by search, not proved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.certificate._at_rest import radius_limit
from avc_casadi.loop import LINEAR_KEYS, Hand, device_corners, hand_corners, hand_set
from avc_casadi.stability import worst_hands
from avc_casadi.support import SILENT, BoolArray, FloatArray, IndexArray, Progress

if TYPE_CHECKING:
    from avc_casadi.passivity import Fractions
    from avc_casadi.problem import Device, Problem


@dataclass(frozen=True)
class EveryHand:
    """The worst of all hands and device corners that were looked at, for each of n rows.

    Attributes:
        stable: whether the row is stable with all of them, shape (n,).
        radius: largest spectral radius, shape (n,).
        frequency_hz: frequency of that eigenvalue, shape (n,).
        hands: the hand that it stands with, n of them.
        corner: its corner of the device, shape (n,).
        devices: the corners.
        looked_at: hands that every row was tried with before the search.
    """

    stable: BoolArray
    radius: FloatArray
    frequency_hz: FloatArray
    hands: Hand
    corner: IndexArray
    devices: list[Device]
    looked_at: int


def every_hand(
    problem: Problem, parts: Fractions, contact: FloatArray, *, draws: int, seed: int, progress: Progress = SILENT
) -> EveryHand:
    """Look for the worst hand of each row.

    A row that is unstable with one of the first hands is searched no further, but for the worst of all rows.

    Args:
        problem: device with its ranges, and hands.
        parts: partial fractions of n renderings.
        contact: b_p, shape (n,).
        draws: hands drawn beside the corners.
        seed: seed of the draws.
        progress: told of the rows.

    Raises:
        UnsupportedError: more than `MAX_DELAY_SAMPLES` samples of delay.
    """
    devices = device_corners(problem.device, LINEAR_KEYS)
    first = hand_set(problem.hands, draws=draws, seed=seed)
    limits = radius_limit(problem.device, parts, first)
    stable = np.ones(len(contact), dtype=bool)
    found = []
    for device in devices:
        one = worst_hands(device, parts, contact, problem.hands, draws=draws, seed=seed, enough=1.0, progress=progress)
        own = _own_limit(problem.device, parts, one.hands)
        stable &= (one.known.radius < limits).all(axis=1) & (one.radius < own)
        found.append(one)
    radii = np.array([one.radius for one in found])
    corner = radii.argmax(axis=0)
    pick = corner, np.arange(radii.shape[1])
    radius, frequency = radii[pick], np.array([one.frequency_hz for one in found])[pick]
    places = np.array([list(vars(one.hands).values()) for one in found])[corner, :, pick[1]].T
    if radius.size and radius.max() >= 1.0:
        row = slice(int(radius.argmax()), int(radius.argmax()) + 1)
        last = worst_hands(
            devices[corner[row][0]], parts.pick(row), contact[row], problem.hands, draws=draws, seed=seed
        )
        radius[row], frequency[row] = last.radius, last.frequency_hz
        places[:, row] = np.array(list(vars(last.hands).values()))
    return EveryHand(stable, radius, frequency, Hand(*places), corner, devices, len(first))


def looked_at(problem: Problem, draws: int, seed: int) -> str:
    """Say which hands a verdict rests on."""
    corners = len(hand_corners(problem.hands))
    return f"{corners} corners, {draws} draws (seed {seed}) and a search of the ranges of the hands"


def _own_limit(device: Device, parts: Fractions, hands: Hand) -> FloatArray:
    """Return what the radius of each row must stay below with a hand of its own, shape (n,)."""
    held = np.asarray(hands.stiffness_n_per_m) > 0
    one_each = Hand(np.zeros(2), np.zeros(2), np.array([0.0, 1.0]))
    free, back = radius_limit(device, parts, one_each).T
    return np.asarray(np.where(held, back, free))
