"""A planar five-bar, also called pantograph: two arms of two links that meet at the tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from avc_casadi.arm._arm import Arm, arm_of, moving

if TYPE_CHECKING:
    from avc_casadi.problem import ArmFile, FiveBarLinks


def five_bar(file: ArmFile, links: FiveBarLinks) -> Arm:
    """Return a five-bar in the plane: x to the right, y away from the motors, angles from x; the left arm comes first.

    Args:
        file: of the arm.
        links: its lengths, masses and inertias.
    """
    q = ca.SX.sym("q", 2)
    a, b, half = links.proximal_length_m, links.distal_length_m, links.base_distance_m / 2
    motors = (ca.vertcat(-half, 0), ca.vertcat(half, 0))
    along = [ca.vertcat(ca.cos(q[arm]), ca.sin(q[arm])) for arm in (0, 1)]
    left, right = (motor + a * way for motor, way in zip(motors, along, strict=True))
    apart = right - left
    square = ca.dot(apart, apart)
    # The tip stands above the middle of the elbows, on the side away from the motors.
    room = b**2 - square / 4
    tip = (left + right) / 2 + ca.sqrt(room / square) * ca.vertcat(-apart[1], apart[0])
    inertia = moving(links.tip_mass_kg, tip, q)
    turning = links.motor_inertia_kgm2 + links.proximal_inertia_kgm2
    for motor, way, elbow in zip(motors, along, (left, right), strict=True):
        link = (tip - elbow) / b
        inertia += moving(links.proximal_mass_kg, motor + links.proximal_centre_m * way, q)
        inertia += moving(links.distal_mass_kg, elbow + links.distal_centre_m * link, q)
        # A unit vector moves as fast as it turns.
        inertia += moving(links.distal_inertia_kgm2, link, q)
    inertia += turning * ca.SX.eye(2)
    return arm_of(file, q, tip, inertia, ca.vertcat(room, q[0] - q[1]))
