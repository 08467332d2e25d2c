"""From an arm file to an arm."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.arm.arm import Arm, arm_of, evaluated, moving
from avc_casadi.files.arm_file import ArmFile, load_arm

if TYPE_CHECKING:
    from avc_casadi.files.arm_file import ArmFile, FiveBarLinks, GantryStages, PhantomLinks


def gantry(file: ArmFile, stages: GantryStages) -> Arm:
    """Return a gantry: x carries y, y carries z."""
    q = ca.SX.sym("q", 3)
    carried = [sum(stages.stage_mass_kg[axis:]) + stages.drive_mass_kg[axis] for axis in range(3)]
    return arm_of(file, q, ca.SX(q), ca.diag(ca.SX(carried)), ca.SX(0, 1))


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
    # The tip lies on the perpendicular bisector of the elbows, on the side away from the motors.
    room = b**2 - square / 4
    tip = (left + right) / 2 + ca.sqrt(room / square) * ca.vertcat(-apart[1], apart[0])
    inertia = moving(links.tip_mass_kg, tip, q)
    turning = links.motor_inertia_kgm2 + links.proximal_inertia_kgm2
    for motor, way, elbow in zip(motors, along, (left, right), strict=True):
        link = (tip - elbow) / b
        inertia += moving(links.proximal_mass_kg, motor + links.proximal_centre_m * way, q)
        inertia += moving(links.distal_mass_kg, elbow + links.distal_centre_m * link, q)
        # The rate of a unit vector equals its angular rate.
        inertia += moving(links.distal_inertia_kgm2, link, q)
    inertia += turning * ca.SX.eye(2)
    return arm_of(file, q, tip, inertia, ca.vertcat(room, q[0] - q[1]))


def phantom(file: ArmFile, links: PhantomLinks) -> Arm:
    """Return a Phantom: x forward, y to the left, z up.

    Args:
        file: of the arm.
        links: its lengths, masses and inertias.
    """
    q = ca.SX.sym("q", 3)
    q1, q2, q3 = q[0], q[1], q[2]
    l1, l2, l3 = links.upper_length_m, links.forearm_length_m, links.parallel_length_m
    ma, mc = links.forearm_mass_kg, links.parallel_mass_kg
    (axx, ayy, azz), (cxx, cyy, czz) = links.forearm_inertia_kgm2, links.parallel_inertia_kgm2
    (bxx, byy, bzz), (dxx, dyy, dzz) = links.upper_inertia_kgm2, links.back_inertia_kgm2
    reach = l1 * ca.cos(q2) + l2 * ca.sin(q3)
    tip = ca.vertcat(ca.cos(q1) * reach, ca.sin(q1) * reach, l1 * ca.sin(q2) - l2 * ca.cos(q3))
    still = 4 * (ayy + azz + byy + bzz + cyy + czz + dyy + dzz) + 8 * links.base_inertia_kgm2
    still += (4 * l1**2 + l2**2) * ma + (l1**2 + 4 * l3**2) * mc
    upper = 4 * (byy - bzz + cyy - czz) + l1**2 * (4 * ma + mc)
    fore = 4 * (ayy - azz + dyy - dzz) - l2**2 * ma - 4 * l3**2 * mc
    joined = l1 * (l2 * ma + l3 * mc)
    m11 = (still + upper * ca.cos(2 * q2) + fore * ca.cos(2 * q3)) / 8 + joined * ca.cos(q2) * ca.sin(q3)
    m22 = bxx + cxx + l1**2 * ma + l1**2 * mc / 4
    m23 = -joined * ca.sin(q2 - q3) / 2
    m33 = axx + dxx + l2**2 * ma / 4 + l3**2 * mc
    inertia = ca.blockcat([[m11, 0, 0], [0, m22, m23], [0, m23, m33]])
    low, high = map(math.radians, links.angle_between_deg)
    return arm_of(file, q, tip, inertia, ca.vertcat(q2 - q3 - low, high - (q2 - q3)))


def arm(source: str | Path | ArmFile) -> Arm:
    """Return an arm.

    Args:
        source: an arm file, its path, or a name of the catalogue of arms.

    Raises:
        InputError: with every fault of the file.
        MissingExtraError: a model file without the extra ``arms``.
        UnsupportedError: a model without inertias, or with unsupported joints.
    """
    file = source if isinstance(source, ArmFile) else load_arm(source)
    told = (file.name or "arm") if isinstance(source, ArmFile) else str(source)
    if file.phantom is not None:
        made = phantom(file, file.phantom)
    elif file.five_bar is not None:
        made = five_bar(file, file.five_bar)
    elif file.gantry is not None:
        made = gantry(file, file.gantry)
    else:
        from avc_casadi.arm.model_file import model_arm  # noqa: PLC0415 - adam takes seconds to load

        assert file.model is not None  # noqa: S101 - a rule of the file
        try:
            made = model_arm(file, file.model)
        except InputError as error:
            raise InputError([fault if fault.file else replace(fault, file=told) for fault in error.faults]) from error
    joints, axes = made.joints, len(made.axes)
    if len(file.home) != joints:
        raise InputError.of(f"has {len(file.home)} values; allowed: {joints}, one of each joint", file=told, key="home")
    if len(file.workspace.low_m) != axes:
        message = f"has {len(file.workspace.low_m)} numbers; allowed: {axes}, along {', '.join(made.axes)}"
        raise InputError.of(message, file=told, key="workspace.low_m")
    _check_home(made, told)
    return made


def _check_home(made: Arm, told: str) -> None:
    """Check that home is an admissible pose from which the tip can move along every axis.

    Raises:
        InputError: it is not.
    """
    home = made.home[None]
    stands = np.concatenate([evaluated(one, home).ravel() for one in (made.tip, made.allowed)])
    shown = ", ".join(f"{value:g}" for value in made.home)
    if not np.isfinite(stands).all() or evaluated(made.allowed, home).min(initial=0.0) < 0:
        message = f"is [{shown}], where the mechanism cannot stand; allowed: joint values within its reach and limits"
        raise InputError.of(message, file=told, key="home")
    if np.linalg.matrix_rank(evaluated(made.jacobian, home)[0]) < len(made.axes):
        message = f"is [{shown}], a singular pose: the tip cannot move along every axis there; allowed: another pose"
        raise InputError.of(message, file=told, key="home")
