"""Three slides at right angles, each carrying the next."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from avc_casadi.arm._arm import Arm, arm_of

if TYPE_CHECKING:
    from avc_casadi.problem import ArmFile, GantryStages


def gantry(file: ArmFile, stages: GantryStages) -> Arm:
    """Return a gantry: x carries y, y carries z.

    Args:
        file: of the arm.
        stages: its masses.
    """
    q = ca.SX.sym("q", 3)
    carried = [sum(stages.stage_mass_kg[axis:]) + stages.drive_mass_kg[axis] for axis in range(3)]
    return arm_of(file, q, ca.SX(q), ca.diag(ca.SX(carried)), ca.SX(0, 1))
