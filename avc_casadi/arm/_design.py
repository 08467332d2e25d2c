"""Gains for every contact normal in every region: designed along one axis, held together by the coupled loop.

Along each direction the device is one of one axis whose mass is that of the region and of all normals near the
direction, its tangent free to held. Its stiffest wall with every hand and let go, at every corner of the ranges, lies
at the tip of a wedge of stiffness and damping; the gains are a share of that tip. Along the surface they are those
for any direction. Then all are softened, if need be, until the coupled loop has a reserve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.arm._coupled import CoupledCertificate, coupled_certificate
from avc_casadi.arm._effective import mass_range
from avc_casadi.arm._gains import DirectedGains, directions_of, normals_near
from avc_casadi.arm._tip_device import tip_device
from avc_casadi.loop import hand_corners, with_let_go
from avc_casadi.stability import stiffest_wall
from avc_casadi.support import SILENT, FloatArray, Progress

if TYPE_CHECKING:
    from avc_casadi.arm._arm import Arm

SHARE = 0.8
"""Of the stiffest wall along one axis."""
RESERVE = 1.1
"""Factor of all gains up to which the coupled loop is found stable."""
_NORMALS = 400
_PER_AXIS = 5
_ROUNDS = 3
# What the search may find less than before on softer gains.
_SLACK = 1.01


@dataclass(frozen=True)
class ArmDesign:
    """Gains of an arm with what they were made from.

    Attributes:
        gains: the gains.
        per_axis: the same before the coupled loop was asked.
        per_axis_factor: margin of the coupled loop with these.
        lightest_kg: along each direction in each region, shape as the stiffness.
        heaviest_kg: along each direction.
        certificate: of the gains.
    """

    gains: DirectedGains
    per_axis: DirectedGains
    per_axis_factor: float
    lightest_kg: FloatArray
    heaviest_kg: FloatArray
    certificate: CoupledCertificate


def design_arm(
    arm: Arm,
    regions: tuple[int, ...] | None = None,
    *,
    one: bool = False,
    points: int = 3000,
    seed: int = 0,
    progress: Progress = SILENT,
) -> ArmDesign:
    """Design the gains of an arm.

    Args:
        arm: workspace, device with its ranges, hands.
        regions: parts of the workspace along each axis; None is one.
        one: one coupling for all normals in place of one for each direction.
        points: drawn for each corner of the device by the coupled certificate.
        seed: of what is drawn.
        progress: told of the directions and corners.

    Raises:
        InputError: a region that the mechanism does not reach, or a singular one.
        UnsupportedError: the device has a resonance, or no gains keep the reserve.
    """
    directions = directions_of(len(arm.axes), one=one)
    near = [None] if one else normals_near(directions, _NORMALS)
    low, high = arm.box_m
    shape = (1,) * len(arm.axes) if regions is None else regions
    cells = int(np.prod(shape))
    empty = np.zeros((cells, len(directions)))
    start = DirectedGains(low, high, shape, directions, empty, empty, np.zeros(cells), np.zeros(cells))
    subjects = with_let_go(hand_corners(arm.file.hands))
    lightest, heaviest, stiffness, damping = (np.zeros((cells, len(near) + 1)) for _ in range(4))
    for region, box in enumerate(start.boxes()):
        for column, normals in enumerate([*near, None]):
            if one and column:
                masses = lightest[region, 0], heaviest[region, 0]
            else:
                found = mass_range(arm, normals, box, _PER_AXIS)
                masses = found.lightest_kg, found.heaviest_kg
            lightest[region, column], heaviest[region, column] = masses
            wall = stiffest_wall(tip_device(arm, *masses), subjects)
            stiffness[region, column] = SHARE * wall.stiffness_n_per_m
            damping[region, column] = SHARE * (wall.lowest_ns_per_m + wall.highest_ns_per_m) / 2
            progress.advance(region * (len(near) + 1) + column + 1, cells * (len(near) + 1), "directions")
    per_axis = DirectedGains(
        low, high, shape, directions, stiffness[:, :-1], damping[:, :-1], stiffness[:, -1], damping[:, -1]
    )
    certificate = coupled_certificate(arm, per_axis, points=points, seed=seed, progress=progress)
    gains, alone = per_axis, certificate.worst.factor
    for _ in range(_ROUNDS):
        if certificate.stable and certificate.worst.factor >= RESERVE:
            return ArmDesign(gains, per_axis, alone, lightest[:, :-1], heaviest[:, :-1], certificate)
        gains = gains.times(min(1.0, certificate.worst.factor / (RESERVE * _SLACK)))
        certificate = coupled_certificate(arm, gains, points=points, seed=seed, progress=progress)
    raise UnsupportedError(
        f"no gains with a reserve of {RESERVE:g} were found in the coupled loop: it ends at a factor of "
        f"{certificate.worst.factor:.3g}; give more damping or a smaller workspace",
        key="workspace",
    )
