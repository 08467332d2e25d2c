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
    moved = _Tip(_model(path), tip)
    poses = np.random.default_rng(0).uniform(*moved.limits, size=(2000, len(moved.limits[0])))
    masses = np.array([moved.masses(pose) for pose in poses])
    axes = int(np.isfinite(masses).sum(axis=1).max())
    ratio = masses[:, axes - 1] / masses[:, 0]
    largest_ratio = SINGULAR * ratio.min()
    regular = ratio <= largest_ratio

    def heaviest(pose: FloatArray) -> float:
        found = moved.masses(pose)
        return -float(found[axes - 1]) if found[axes - 1] <= largest_ratio * found[0] else np.inf

    lightest = moved.least(lambda pose: float(moved.masses(pose)[0]), poses)
    return TipMass(
        float(np.median(masses[regular, :axes])),
        ((1 - MARGIN) * lightest, -(1 + MARGIN) * moved.least(heaviest, poses[regular])),
        (1 - MARGIN) * moved.least(moved.damping, poses) if moved.dampings.min() > 0 else 0.0,
        bool(moved.model.dof_frictionloss[moved.dofs].any()),
        len(poses),
        int((~regular).sum()),
    )


def _mujoco() -> Any:
    try:
        import mujoco  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise MissingExtraError("a model in MJCF or URDF needs MuJoCo: pip install 'avc-casadi[model]'") from error
    return mujoco


def _model(path: Path) -> Any:
    """Return the model of a file; of a URDF no shapes, whose files often lie elsewhere, and every link by its name."""
    mujoco = _mujoco()
    if not path.is_file():
        raise InputError.of(f"{str(path)!r} is no file; allowed: a model, MJCF or URDF", key="--model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if b"<robot" in path.read_bytes():
            for shape in (*spec.geoms, *spec.meshes, *spec.materials, *spec.textures):
                spec.delete(shape)
            spec.compiler.fusestatic = False
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        said = " ".join(str(error).split())[:300]
        raise InputError.of(f"{str(path)!r} is no model that MuJoCo loads: {said}", key="--model") from error
    if model.neq:
        message = f"{str(path)!r} has {model.neq} equality constraints, which close loops or couple joints"
        raise UnsupportedError(f"{message}; allowed: none, or --mass in place of --model", key="--model")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


class _Tip:
    """A site, body or geom of a model, and the joints of its mechanism."""

    def __init__(self, model: Any, name: str) -> None:
        mujoco = _mujoco()
        self.model, self.data = model, mujoco.MjData(model)
        places = {
            model.site: (model.nsite, model.site_bodyid, mujoco.mj_jacSite),
            model.body: (model.nbody, range(model.nbody), mujoco.mj_jacBody),
            model.geom: (model.ngeom, model.geom_bodyid, mujoco.mj_jacGeom),
        }
        named = [
            (kind(index).name, index, bodies[index], jacobian)
            for kind, (count, bodies, jacobian) in places.items()
            for index in range(count)
        ]
        found = next((one for one in named if one[0] == name), None)
        if found is None:
            near = difflib.get_close_matches(name, [one[0] for one in named], n=3, cutoff=0.5)
            hint = f"; near: {', '.join(near)}" if near else ""
            raise InputError.of(f"is {name!r}, no site, body or geom of the model{hint}", key="--tip")
        _, self._index, body, self._jacobian = found
        self.dofs = np.flatnonzero(model.dof_treeid == model.body_treeid[body])
        joints = np.unique(model.dof_jntid[self.dofs])
        if not self._columns(model.qpos0).any():
            raise InputError.of(f"is {name!r}, which no joint of the model moves; allowed: what moves", key="--tip")
        hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        odd = [model.joint(joint).name for joint in joints if model.jnt_type[joint] not in (hinge, slide)]
        if odd:
            message = f"the model's joints {', '.join(odd)} are neither hinges nor slides; allowed: these alone"
            raise UnsupportedError(message, key="--model")
        endless = [joint for joint in joints if not model.jnt_limited[joint]]
        if slides := [model.joint(joint).name for joint in endless if model.jnt_type[joint] == slide]:
            raise InputError.of(f"has slides without limits: {', '.join(slides)}; give each its range", key="--model")
        ends = model.jnt_range.copy()
        ends[endless] = -np.pi, np.pi
        self.limits: tuple[FloatArray, FloatArray] = ends[joints, 0], ends[joints, 1]
        self._places = model.jnt_qposadr[joints]
        self.dampings: FloatArray = model.dof_damping[self.dofs]

    def _columns(self, places: FloatArray) -> FloatArray:
        """Return the Jacobian of the tip's position, (3, joints of the model)."""
        mujoco = _mujoco()
        self.data.qpos[:] = places
        mujoco.mj_fwdPosition(self.model, self.data)
        columns = np.zeros((3, self.model.nv))
        self._jacobian(self.model, self.data, columns, None, self._index)
        return columns

    def _at(self, pose: FloatArray) -> FloatArray:
        whole = self.model.qpos0.copy()
        whole[self._places] = pose
        return self._columns(whole)

    def masses(self, pose: FloatArray) -> FloatArray:
        """Return the three principal masses at the tip, rising; infinite along what it cannot do."""
        columns = self._at(pose)
        accelerations = np.zeros_like(columns)
        _mujoco().mj_solveM(self.model, self.data, accelerations, columns)
        mobility = np.linalg.eigvalsh(accelerations @ columns.T)[::-1]
        movable = mobility > 1e-9 * mobility[0]  # in the other directions the tip cannot move
        return np.where(movable, 1 / np.where(movable, mobility, 1.0), np.inf)

    def damping(self, pose: FloatArray) -> float:
        """Return the least damping along a normal: of all motions with that speed the one that loses least."""
        columns = self._at(pose)[:, self.dofs]
        return float(1 / np.linalg.eigvalsh(columns / self.dampings @ columns.T)[-1])

    def least(self, value: Callable[[FloatArray], float], poses: FloatArray) -> float:
        """Return the least value over poses: of the lowest among many, by a search from each."""
        lowest = np.argsort([value(pose) for pose in poses])[:6]
        bounds = list(zip(*self.limits, strict=True))
        return min(float(minimize(value, poses[at], method="Nelder-Mead", bounds=bounds).fun) for at in lowest)
