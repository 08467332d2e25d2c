"""The Phantom in the closed form of Cavusoglu, Feygin and Tendick (IEEE Trans. Robotics and Automation 18(4), 2002)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import casadi as ca

from avc_casadi.arm._arm import Arm, arm_of

if TYPE_CHECKING:
    from avc_casadi.problem import ArmFile, PhantomLinks


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
