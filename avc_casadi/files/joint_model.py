"""A joint of a MuJoCo model, MJCF or URDF, as the file of a joint that an engine moves.

M is the inertia matrix of a pose, i the joint. Its inertia is M_ii where all other joints stand still and
1/(M^-1)_ii where they are free to yield; the model's armature is in both. Over poses the range is from the least of the
second to the largest of the first.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.units import MotionKind, units_for
from avc_casadi.files.model_file import MARGIN, least_over_poses, mujoco_library, mujoco_model
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.files.toml import toml_value
from avc_casadi.model.ends import ToolIntegrator
from avc_casadi.model.problem import Problem

_POSES = 500
"""Poses that are sampled."""


@dataclass(frozen=True)
class ModelledJoint:
    """A joint of a model.

    Attributes:
        name: its name in the model.
        motion: whether it slides or turns.
        range_kg: least and largest mass or inertia over poses.
        damping_ns_per_m: of the joint itself.
        step_s: of the model.
        integrator: of the model.
        kp: stiffness of the actuators on the joint; 0 without one.
        kd: damping of the actuators on the joint; 0 without one.
        poses: that were sampled.
        states_step: whether the file states its step; of a URDF the engine's usual one is assumed.
    """

    name: str
    motion: MotionKind
    range_kg: tuple[float, float]
    damping_ns_per_m: float
    step_s: float
    integrator: ToolIntegrator
    kp: float
    kd: float
    poses: int
    states_step: bool

    def text(self) -> str:
        """Return the text of a problem file."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        """Yield the lines of the problem file of a joint: mass over its poses, damping, step, integrator, law."""
        units = units_for(self.motion)
        low, high = self.range_kg
        mass = f"[{float(f'{low:.4g}')}, {float(f'{high:.4g}')}]"
        assumed = "" if self.states_step else "  # assumed: the model states none"
        yield f"# Written by `avc new`: joint {self.name} of a model, which an engine moves."
        yield ""
        yield "[simulation]"
        yield f"{units.key('tool_mass_kg')} = {mass}  # over poses, armature included"
        if self.damping_ns_per_m:
            yield f"{units.key('tool_damping_ns_per_m')} = {toml_value(self.damping_ns_per_m)}"
        yield f"step_s = {toml_value(self.step_s)}{assumed}"
        yield f'integrator = "{self.integrator}"'
        if self.kp or self.kd:
            yield ""
            yield "[law]  # of the actuators of the model"
            yield f"{units.key('stiffness_n_per_m')} = {toml_value(self.kp)}"
            yield f"{units.key('damping_ns_per_m')} = {toml_value(self.kd)}"

    def problem(self, file: Path) -> Problem:
        """Return the problem of the file, by the common reader."""
        return parse_problem(self.text(), file=str(file), name=file.stem, folder=file.parent)


def modelled_joint(path: Path, name: str) -> ModelledJoint:
    """Return a joint of a model: its inertia over all poses, and what the model says of step and actuators."""
    mujoco = mujoco_library()
    model = mujoco_model(path)
    joint = _joint_named(model, name)
    kind = int(model.jnt_type[joint])
    hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    if kind not in (hinge, slide):
        raise UnsupportedError(
            f"joint {name!r} is neither a hinge nor a slide; choose a hinge or slide joint", key="--joint"
        )
    poses = _Poses(model, joint)
    sampled = poses.sampled()
    least = least_over_poses(poses.yielding_kg, sampled, poses.limits)
    largest = -least_over_poses(poses.negative_held_kg, sampled, poses.limits)
    kp, kd = _actuators(model, joint)
    return ModelledJoint(
        name=name,
        motion="rotary" if kind == hinge else "linear",
        range_kg=((1 - MARGIN) * least, (1 + MARGIN) * largest),
        damping_ns_per_m=float(np.ravel(model.dof_damping[model.jnt_dofadr[joint]])[0]),
        step_s=float(model.opt.timestep),
        integrator=_integrator(model),
        kp=kp,
        kd=kd,
        poses=len(sampled),
        states_step=b"<robot" not in path.read_bytes(),
    )


def _joint_named(model: Any, name: str) -> int:
    names = [model.joint(index).name for index in range(model.njnt)]
    if name not in names:
        near = difflib.get_close_matches(name, names, n=3, cutoff=0.5) or names[:5]
        raise InputError.of(f"is {name!r}, no joint of the model; near: {', '.join(near)}", key="--joint")
    return names.index(name)


def _integrator(model: Any) -> ToolIntegrator:
    """Return the integrator of a model: its implicit ones solve for the damper of an actuator."""
    kinds = mujoco_library().mjtIntegrator
    names: dict[int, ToolIntegrator] = {
        int(kinds.mjINT_EULER): "semi-implicit",
        int(kinds.mjINT_RK4): "exact",
        int(kinds.mjINT_IMPLICIT): "implicit-damping",
        int(kinds.mjINT_IMPLICITFAST): "implicit-damping",
    }
    return names[int(model.opt.integrator)]


def _actuators(model: Any, joint: int) -> tuple[float, float]:
    """Return kp and kd of the actuators on a joint, from their bias -kp q - kd v times the square of the gear."""
    on_joint = int(mujoco_library().mjtTrn.mjTRN_JOINT)
    kp = kd = 0.0
    for index in range(model.nu):
        if int(model.actuator_trntype[index]) == on_joint and int(model.actuator_trnid[index, 0]) == joint:
            gear = float(model.actuator_gear[index, 0])
            kp -= gear**2 * float(model.actuator_biasprm[index, 1])
            kd -= gear**2 * float(model.actuator_biasprm[index, 2])
    return max(kp, 0.0), max(kd, 0.0)


class _Poses:
    """The poses of the mechanism of a joint, and its inertia in each.

    `limits` are the lowest and highest pose of the hinges and slides, each of shape (joints,); what floats stays where
    the model puts it, as no inertia depends on that.
    """

    def __init__(self, model: Any, joint: int) -> None:
        """Find the joints that move with one and the ranges of their poses; refuse other slides without limits."""
        mujoco = mujoco_library()
        self.model = model
        self.data = mujoco.MjData(model)
        self.dof = int(model.jnt_dofadr[joint])
        tree = model.dof_treeid[self.dof]
        hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        moving = [
            index
            for index in range(model.njnt)
            if model.dof_treeid[model.jnt_dofadr[index]] == tree and model.jnt_type[index] in (hinge, slide)
        ]
        endless = [index for index in moving if not model.jnt_limited[index]]
        if slides := [
            model.joint(index).name for index in endless if model.jnt_type[index] == slide and index != joint
        ]:
            raise InputError.of(f"has slides without limits: {', '.join(slides)}; give each a range", key="--model")
        ends = model.jnt_range.copy()
        # A hinge without limits turns once; a slide without limits of its own changes no inertia of itself.
        ends[endless] = -np.pi, np.pi
        self.limits: tuple[FloatArray, FloatArray] = ends[moving, 0], ends[moving, 1]
        self._positions = model.jnt_qposadr[moving]

    def sampled(self) -> FloatArray:
        """Return poses within the limits."""
        low, high = self.limits
        return np.random.default_rng(0).uniform(low, high, size=(_POSES, len(low)))

    def _unit_at(self, pose: FloatArray) -> FloatArray:
        """Bring the model into a pose; return the unit vector of the joint."""
        mujoco = mujoco_library()
        self.data.qpos[:] = self.model.qpos0
        self.data.qpos[self._positions] = pose
        mujoco.mj_fwdPosition(self.model, self.data)
        unit = np.zeros((1, self.model.nv))
        unit[0, self.dof] = 1.0
        return unit

    def yielding_kg(self, pose: FloatArray) -> float:
        """Return the inertia where all other joints are free to yield."""
        unit = self._unit_at(pose)
        moved = np.zeros_like(unit)
        mujoco_library().mj_solveM(self.model, self.data, moved, unit)
        return float(1 / moved[0, self.dof])

    def negative_held_kg(self, pose: FloatArray) -> float:
        """Return the inertia where all other joints stand still, below 0."""
        unit = self._unit_at(pose)[0]
        force = np.zeros_like(unit)
        mujoco_library().mj_mulM(self.model, self.data, force, unit)
        return -float(force[self.dof])
