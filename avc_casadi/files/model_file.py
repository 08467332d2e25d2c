"""The mass felt at the tip of a MuJoCo model, MJCF or URDF: its range over poses and contact normals.

W = J M^-1 J' is the mobility of the tip in a pose. Along a normal n the mass is 1/(n' W n) where the tip is free to
yield sideways and n' W^-1 n where it is guided along n. Over all normals of the space that the tip moves in, the least
and the largest of both are the same: the inverse eigenvalues of W. Over poses they are sampled, then searched.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from avc_casadi._errors import InputError, MissingExtraError, UnsupportedError
from avc_casadi._util.arrays import FloatArray

MARGIN = 0.01
"""Share by which the range is wider than what was found."""
SINGULAR = 30.0
"""Poses whose heaviest direction is to the lightest so many times what it is in the best pose are left out."""
_POSES = 2000
"""Poses that are sampled."""
_SEARCHES = 6
"""Poses from which the least value is searched."""
_IMMOVABLE = 1e-9
"""Share of the largest mobility up to which the tip cannot move in a direction."""


@dataclass(frozen=True)
class TipMass:
    """What a hand moves at the tip: median and range of the mass, least damping; poses, and those left out."""

    mass_kg: float
    range_kg: tuple[float, float]
    damping_ns_per_m: float
    has_dry_friction: bool
    poses: int
    singular_poses: int


def tip_mass(path: Path, tip: str) -> TipMass:
    """Return the mass at a site, body or geom of a model, over all poses within the limits of its joints."""
    moved = _Tip(mujoco_model(path), tip)
    lowest_pose, highest_pose = moved.limits
    poses = np.random.default_rng(0).uniform(lowest_pose, highest_pose, size=(_POSES, len(lowest_pose)))
    masses = np.array([moved.masses(pose) for pose in poses])
    axes = int(np.isfinite(masses).sum(axis=1).max())
    ratio = masses[:, axes - 1] / masses[:, 0]
    largest_ratio = SINGULAR * ratio.min()
    regular = ratio <= largest_ratio

    def lightest_mass(pose: FloatArray) -> float:
        return float(moved.masses(pose)[0])

    def negative_heaviest_mass(pose: FloatArray) -> float:
        of_pose = moved.masses(pose)
        heaviest = of_pose[axes - 1]
        return -float(heaviest) if heaviest <= largest_ratio * of_pose[0] else np.inf

    lightest = moved.least(lightest_mass, poses)
    heaviest = -moved.least(negative_heaviest_mass, poses[regular])
    damped = moved.dampings.min() > 0
    return TipMass(
        mass_kg=float(np.median(masses[regular, :axes])),
        range_kg=((1 - MARGIN) * lightest, (1 + MARGIN) * heaviest),
        damping_ns_per_m=(1 - MARGIN) * moved.least(moved.damping, poses) if damped else 0.0,
        has_dry_friction=bool(moved.model.dof_frictionloss[moved.dofs].any()),
        poses=len(poses),
        singular_poses=int((~regular).sum()),
    )


def mujoco_library() -> Any:
    """Return the package MuJoCo."""
    try:
        import mujoco  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise MissingExtraError("a model in MJCF or URDF needs MuJoCo: pip install 'avc-casadi[model]'") from error
    return mujoco


def mujoco_model(path: Path) -> Any:
    """Return the model of a file; of a URDF no shapes, whose files often lie elsewhere, and every link by its name."""
    mujoco = mujoco_library()
    if not path.is_file():
        raise InputError.of(f"{str(path)!r} does not exist; give an MJCF or URDF model", key="--model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if b"<robot" in path.read_bytes():
            for shape in (*spec.geoms, *spec.meshes, *spec.materials, *spec.textures):
                spec.delete(shape)
            spec.compiler.fusestatic = False
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())[:300]
        raise InputError.of(f"{str(path)!r} cannot be loaded by MuJoCo: {reason}", key="--model") from error
    if model.neq:
        message = f"{str(path)!r} has {model.neq} equality constraints, which close loops or couple joints"
        raise UnsupportedError(f"{message}; allowed: a model without them; or use --mass instead", key="--model")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


@dataclass(frozen=True)
class _NamedPoint:
    """A site, body or geom of a model: its index among its kind, its body, and MuJoCo's function of its Jacobian."""

    name: str
    index: int
    body: int
    jacobian: Callable[..., None]


def _points(model: Any) -> list[_NamedPoint]:
    """Return every site, body and geom of a model, in this order."""
    mujoco = mujoco_library()
    sites = [
        _NamedPoint(model.site(index).name, index, model.site_bodyid[index], mujoco.mj_jacSite)
        for index in range(model.nsite)
    ]
    bodies = [_NamedPoint(model.body(index).name, index, index, mujoco.mj_jacBody) for index in range(model.nbody)]
    geoms = [
        _NamedPoint(model.geom(index).name, index, model.geom_bodyid[index], mujoco.mj_jacGeom)
        for index in range(model.ngeom)
    ]
    return [*sites, *bodies, *geoms]


def _point_named(model: Any, name: str) -> _NamedPoint:
    points = _points(model)
    point = next((point for point in points if point.name == name), None)
    if point is None:
        near = difflib.get_close_matches(name, [point.name for point in points], n=3, cutoff=0.5)
        hint = f"; near: {', '.join(near)}" if near else ""
        raise InputError.of(f"is {name!r}, no site, body or geom of the model{hint}", key="--tip")
    return point


class _Tip:
    """A site, body or geom of a model, and the joints of its mechanism.

    `limits` are the lowest and highest pose, each of shape (joints,), `dampings` of shape (dofs,).
    """

    def __init__(self, model: Any, name: str) -> None:
        """Find a part of a model by name and the joints that move it; refuse joints that neither turn nor slide."""
        mujoco = mujoco_library()
        self.model = model
        self.data = mujoco.MjData(model)
        self._point = _point_named(model, name)
        self.dofs = np.flatnonzero(model.dof_treeid == model.body_treeid[self._point.body])
        joints = np.unique(model.dof_jntid[self.dofs])
        if not self._columns(model.qpos0).any():
            raise InputError.of(f"is {name!r}, which no joint of the model moves; name a moving part", key="--tip")
        hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        odd = [model.joint(joint).name for joint in joints if model.jnt_type[joint] not in (hinge, slide)]
        if odd:
            message = f"the model's joints {', '.join(odd)} are neither hinges nor slides; use these types only"
            raise UnsupportedError(message, key="--model")
        endless = [joint for joint in joints if not model.jnt_limited[joint]]
        slides = [model.joint(joint).name for joint in endless if model.jnt_type[joint] == slide]
        if slides:
            raise InputError.of(f"has slides without limits: {', '.join(slides)}; give each its range", key="--model")
        ends = model.jnt_range.copy()
        # A hinge without limits turns once.
        ends[endless] = -np.pi, np.pi
        self.limits: tuple[FloatArray, FloatArray] = ends[joints, 0], ends[joints, 1]
        self._positions_of_joints = model.jnt_qposadr[joints]
        self.dampings: FloatArray = model.dof_damping[self.dofs]

    def _columns(self, positions: FloatArray) -> FloatArray:
        """Return the Jacobian of the tip's position, (3, joints of the model)."""
        mujoco = mujoco_library()
        self.data.qpos[:] = positions
        mujoco.mj_fwdPosition(self.model, self.data)
        columns = np.zeros((3, self.model.nv))
        self._point.jacobian(self.model, self.data, columns, None, self._point.index)
        return columns

    def _columns_in(self, pose: FloatArray) -> FloatArray:
        """Return the Jacobian in a pose of the tip's mechanism, the rest of the model at its reference."""
        positions = self.model.qpos0.copy()
        positions[self._positions_of_joints] = pose
        return self._columns(positions)

    def masses(self, pose: FloatArray) -> FloatArray:
        """Return the three principal masses at the tip, rising; infinite along what it cannot do.

        They are the inverse eigenvalues of the mobility W = J M^-1 J'.
        """
        columns = self._columns_in(pose)
        accelerations = np.zeros_like(columns)
        mujoco_library().mj_solveM(self.model, self.data, accelerations, columns)
        mobility = np.linalg.eigvalsh(accelerations @ columns.T)[::-1]
        movable = mobility > _IMMOVABLE * mobility[0]
        return np.where(movable, 1 / np.where(movable, mobility, 1.0), np.inf)

    def damping(self, pose: FloatArray) -> float:
        """Return the least damping along a normal: of all motions with that speed the one that loses least."""
        columns = self._columns_in(pose)[:, self.dofs]
        return float(1 / np.linalg.eigvalsh(columns / self.dampings @ columns.T)[-1])

    def least(self, value: Callable[[FloatArray], float], poses: FloatArray) -> float:
        """Return the least value over poses."""
        return least_over_poses(value, poses, self.limits)


def least_over_poses(
    value: Callable[[FloatArray], float], poses: FloatArray, limits: tuple[FloatArray, FloatArray]
) -> float:
    """Return the least value over poses: of the lowest among many, by a search from each within the limits."""
    lowest = np.argsort([value(pose) for pose in poses])[:_SEARCHES]
    bounds = list(zip(*limits, strict=True))
    results = [minimize(value, pose, method="Nelder-Mead", bounds=bounds) for pose in poses[lowest]]
    return min(float(result.fun) for result in results)
