"""Poses, normals and hands of an arm as points of a unit box, to be drawn and searched.

Coordinates: place of the tip; normal; share of the coupling that holds the tangent; damping of the device; then of the
hand the principal masses, dampings and stiffnesses, and the axes of each of the three. A hand in space is a symmetric
mass, damper and spring, each with principal values in the ranges of [hands] and axes of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.arm.contact import Contacts
from avc_casadi.arm.effective_mass import mobility, reached, unit
from avc_casadi.model.hands import hand_ranges

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm
    from avc_casadi.model.problem import Hands

# A normal of coordinates that are nearly 0 has no direction.
_SHORT = 0.1
# A pose that is nearly singular along a direction cannot move there; nothing is claimed of it.
_HEAVIEST_KG = 1e3


@dataclass(frozen=True)
class Drawn:
    """Contacts at points of the box.

    Attributes:
        contacts: of the points that stand for one, p of them.
        tip_m: places of the tip, shape (p, d).
        there: which of the points they are, shape (points,).
    """

    contacts: Contacts
    tip_m: FloatArray
    there: BoolArray


def coordinates(arm: Arm, *, held: bool) -> int:
    """Return the number of coordinates, of a hand that holds the device or of the device let go."""
    d = len(arm.axes)
    return 2 * d + 2 + (3 * d + 3 * _turns(d) if held else 0)


def drawn(arm: Arm, points: FloatArray, *, held: bool) -> Drawn:
    """Return the contacts at points of the unit box.

    Args:
        arm: workspace, device and hands.
        points: shape (p, coordinates).
        held: by a hand, or let go: the tangent of that is free or held, not in between.
    """
    d = len(arm.axes)
    low, high = arm.box_m
    tip = low + (high - low) * points[:, :d]
    toward = 2 * points[:, d : 2 * d] - 1
    joints, there = reached(arm, tip)
    there = there & (np.linalg.norm(toward, axis=1) > _SHORT)
    here = mobility(arm, joints[there])
    movable = np.linalg.eigvalsh(here)[:, 0] > 1 / _HEAVIEST_KG
    there[np.flatnonzero(there)[~movable]] = False
    at = points[there]
    share, damping = at[:, 2 * d], at[:, 2 * d + 1]
    ends = arm.file.device.range.damping_ns_per_m or (arm.file.device.damping_ns_per_m,) * 2
    hand = _hand(arm.file.hands, at[:, 2 * d + 2 :], d) if held else np.zeros((3, len(at), d, d))
    found = Contacts(
        here[movable],
        unit(toward[there]),
        share if held else np.round(share),
        ends[0] + (ends[1] - ends[0]) * damping,
        *hand,
    )
    return Drawn(found, tip[there], there)


def _turns(d: int) -> int:
    return d * (d - 1) // 2


def _hand(hands: Hands, points: FloatArray, d: int) -> FloatArray:
    """Return mass, damping and stiffness matrices, shape (3, p, d, d)."""
    ranges, found = hand_ranges(hands), []
    for kind in range(3):
        low, high = ranges[kind]
        principal = low + (high - low) * points[:, kind * d : (kind + 1) * d]
        begin = 3 * d + kind * _turns(d)
        axes = _rotation(np.pi * (2 * points[:, begin : begin + _turns(d)] - 1))
        found.append(np.einsum("pij,pj,pkj->pik", axes, principal, axes))
    return np.array(found)


def _rotation(vector: FloatArray) -> FloatArray:
    """Return rotations by angles (p, 1) in the plane or vectors (p, 3) in space, Rodrigues' formula."""
    p, turns = vector.shape
    d = 2 if turns == 1 else 3
    angle = np.linalg.norm(vector, axis=1)
    along = vector / np.where(angle > 0, angle, 1.0)[:, None]
    cross = np.zeros((p, d, d))
    if d == 2:
        cross[:, 1, 0], cross[:, 0, 1] = along[:, 0], -along[:, 0]
    else:
        cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0] = along.T
        cross = cross - cross.transpose(0, 2, 1)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(d) + sine * cross + (1 - cosine) * cross @ cross)
