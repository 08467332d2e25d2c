"""An arm as CasADi functions: position of its tip, Jacobian, and joint-space inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray

if TYPE_CHECKING:
    from avc_casadi.files.arm_file import ArmFile

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Arm:
    """A mechanism of n joints that moves a tip along d axes, d 2 or 3; gravity is compensated.

    Attributes:
        file: its arm file.
        tip: CasADi function of the joint values (n,): position of the tip, m, shape (d,).
        jacobian: of the joint values: J, shape (d, n).
        inertia: of the joint values: M, shape (n, n).
        acceleration: of joint values, rates and joint forces: second derivative of the joint values.
        allowed: of the joint values: numbers that are all >= 0 in admissible poses.
    """

    file: ArmFile
    tip: ca.Function
    jacobian: ca.Function
    inertia: ca.Function
    acceleration: ca.Function
    allowed: ca.Function

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes of the tip."""
        return AXES[: self.tip.size1_out(0)]

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.tip.size1_in(0))

    @property
    def home(self) -> FloatArray:
        """Joint values at home, shape (n,)."""
        return np.array(self.file.home)

    @property
    def home_tip_m(self) -> FloatArray:
        """Position of the tip at home, shape (d,)."""
        return evaluated(self.tip, self.home[None])[0, :, 0]

    @property
    def box_m(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner of the workspace in the arm's own coordinates, shape (d,) each."""
        home = self.home_tip_m
        return home + np.array(self.file.workspace.low_m), home + np.array(self.file.workspace.high_m)


def arm_of(file: ArmFile, joint: Any, tip: Any, inertia: Any, allowed: Any) -> Arm:
    """Return an arm from expressions.

    Args:
        file: the arm file.
        joint: symbols of the joint values, SX of shape (n, 1).
        tip: position of the tip, m.
        inertia: M.
        allowed: numbers that are >= 0 in admissible poses.
    """
    rate, force = ca.SX.sym("v", joint.numel()), ca.SX.sym("tau", joint.numel())
    jacobian = ca.jacobian(tip, joint)
    momentum = ca.mtimes(inertia, rate)
    # Lagrange: M a + d(M v)/dq v - 1/2 d(v'M v)/dq = tau.
    apparent = ca.mtimes(ca.jacobian(momentum, joint), rate) - ca.gradient(ca.dot(rate, momentum), joint) / 2
    return Arm(
        file,
        ca.Function("tip", [joint], [tip], ["q"], ["x"]),
        ca.Function("jacobian", [joint], [jacobian], ["q"], ["J"]),
        ca.Function("inertia", [joint], [inertia], ["q"], ["M"]),
        ca.Function(
            "acceleration", [joint, rate, force], [ca.solve(inertia, force - apparent)], ["q", "v", "tau"], ["a"]
        ),
        ca.Function("allowed", [joint], [allowed], ["q"], ["g"]),
    )


def moving(mass_kg: float, centre: Any, joint: Any) -> Any:
    """Return the joint-space inertia of a mass at a point moved by the joints."""
    moves = ca.jacobian(centre, joint)
    return mass_kg * ca.mtimes(moves.T, moves)


def evaluated(function: ca.Function, joints: FloatArray) -> FloatArray:
    """Evaluate a function of the joint values at p poses.

    Args:
        function: with an output of shape (r, c).
        joints: shape (p, n).

    Returns:
        Shape (p, r, c).
    """
    r, c = function.size_out(0)
    flat = np.asarray(function(ca.DM(joints.T)), dtype=np.float64) if len(joints) else np.zeros((r, 0))
    return np.ascontiguousarray(flat.reshape(r, len(joints), c).transpose(1, 0, 2))
