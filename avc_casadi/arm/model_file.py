"""An arm from a URDF or MJCF: MuJoCo reads it, adam-robotics writes its equations (extra ``arms``)."""

from __future__ import annotations

import io
import re
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi._errors import Fault, InputError, MissingExtraError, UnsupportedError
from avc_casadi._util.files import read_text
from avc_casadi._util.units import A_MASS, KG, MASS
from avc_casadi.arm.arm import Arm, arm_of
from avc_casadi.arm.model_size import MOST_BYTES, parsed

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.files.arm_file import ArmFile, ModelFile

# Equations of more joints take minutes.
_MOST_JOINTS = 30
_MOST_KG = 1e6
_PREFIX = "arm/"
_SLIDES, _TURNS = ("prismatic",), ("revolute", "continuous")
# In place of a principal moment of inertia of 0, of a point mass, which MuJoCo refuses.
_POINT_KGM2 = 1e-12


@dataclass(frozen=True)
class _Described:
    """A model in adam's form, the tip's name in it, and the inertia of the rotors at each joint, by name."""

    description: Any
    tip: str
    rotors: dict[str, float]


def model_arm(file: ArmFile, model: ModelFile) -> Arm:
    """Return the arm of a model file with a fixed base.

    Args:
        file: of the arm.
        model: path of the model, and its tip.

    Raises:
        InputError: the file cannot be read, is no model, or has no such tip.
        MissingExtraError: the extra ``arms`` is not installed.
        UnsupportedError: moving parts have no inertia, or the mechanism is not a chain of simple joints.
    """
    text = _text(model)
    described = _described(model, text)
    if len(described.rotors) > _MOST_JOINTS:
        raise InputError.of(
            f"has {len(described.rotors)} joints that move; allowed: at most {_MOST_JOINTS}",
            file=model.file,
            key="model.file",
        )
    algorithms = _algorithms(described)
    # Joints beyond the tip count too, fixed at home: their masses are carried.
    q = ca.SX.sym("q", algorithms.NDoF)
    if len(file.home) != algorithms.NDoF:
        names = ", ".join(algorithms.model.actuated_joints)
        raise InputError.of(f"has {len(file.home)} values; allowed: one of each joint: {names}", key="home")
    if algorithms.NDoF < 3:
        raise UnsupportedError(f"{model.file}: {algorithms.NDoF} joints move no tip along three axes", key="model.file")
    still = np.eye(4)
    inertia = algorithms.crba(still, q)[0].array[6:, 6:]
    tip = algorithms.forward_kinematics(described.tip, still, q).array[:3, 3]
    joints = [algorithms.model.joints[name] for name in algorithms.model.actuated_joints]
    rotors = ca.diag(ca.SX([described.rotors.get(joint.name, 0.0) for joint in joints]))
    ends = [(q[i] - joint.limit.lower, joint.limit.upper - q[i]) for i, joint in enumerate(joints)]
    bounds = [end for pair in ends for end in pair if np.isfinite(float(ca.substitute(end, q, ca.SX(file.home))))]
    return arm_of(file, q, tip, inertia + rotors, ca.vertcat(*bounds) if bounds else ca.SX(0, 1))


def _text(model: ModelFile) -> str:
    try:
        return read_text(model.file, MOST_BYTES, "give a URDF or an MJCF")
    except InputError as error:
        raise InputError([replace(fault, key="model.file") for fault in error.faults]) from error


def _adam() -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import adam.casadi  # noqa: PLC0415 - an extra
            import adam.casadi.casadi_like  # noqa: PLC0415
            import adam.core  # noqa: PLC0415
            import adam.model  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("models in URDF and MJCF need adam-robotics: pip install 'avc-casadi[arms]'") from error
    return adam


def _mujoco() -> Any:
    try:
        import mujoco  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise MissingExtraError("models in URDF and MJCF need mujoco: pip install 'avc-casadi[arms]'") from error
    return mujoco


def _algorithms(described: _Described) -> Any:
    """Return adam's algorithms for a model; the direction of sliding joints, wrong in adam 0.5, is corrected."""
    adam = _adam()
    with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        maths = adam.casadi.casadi_like.SpatialMath()
        factory = adam.model.build_model_factory(description=described.description, math=maths)
        names = [joint.name for joint in factory.get_joints() if joint.type in (*_TURNS, *_SLIDES)]
        model = adam.model.Model.build(factory=factory, joints_name_list=names)
    for joint in model.joints.values():
        if joint.type in _SLIDES:
            joint.motion_subspace = partial(_sliding, maths, joint.axis)
    if described.tip not in {*model.links, *model.frames}:
        known = ", ".join(sorted(name.removeprefix(_PREFIX) for name in (*model.links, *model.frames)))
        raise InputError.of(f"is {described.tip.removeprefix(_PREFIX)!r}; allowed: {known}", key="model.tip")
    return adam.core.RBDAlgorithms(model=model, math=maths)


def _sliding(maths: Any, axis: Any) -> Any:
    zero = maths.zeros(1)
    return maths.vertcat(axis[0], axis[1], axis[2], zero, zero, zero)


def _described(model: ModelFile, text: str) -> _Described:
    root = parsed(text, model.file)
    urdf = root.tag == "robot"
    if urdf:
        _check_urdf(model, root)
    mujoco = _mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            own = mujoco.MjSpec.from_string(text) if urdf else mujoco.MjSpec.from_file(model.file)
            if urdf:
                ends = [body.name for body in own.worldbody.bodies]
                if len(ends) > 1:
                    said = f"has {len(ends)} links that are no child of a joint ({', '.join(ends)})"
                    raise InputError.of(f"{said}; allowed: one, the base", file=model.file, key="model.file")
                for drawn in (*own.geoms, *own.meshes, *own.materials, *own.textures):
                    own.delete(drawn)
                own.compiler.fusestatic, own.compiler.boundinertia = False, _POINT_KGM2
            _refuse_massless(model, [body.name for body in own.bodies if list(body.joints) and not _carries(body)])
            whole = mujoco.MjSpec()
            whole.compiler.inertiafromgeom = own.compiler.inertiafromgeom
            whole.compiler.boundinertia = own.compiler.boundinertia
            # adam takes the first body as floating, without a joint of its own.
            base = whole.worldbody.add_body(name="base", mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
            whole.attach(own, frame=base.add_frame(), prefix=_PREFIX)
            compiled = whole.compile()
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        kind, said = "URDF" if urdf else "MJCF", " ".join(str(error).replace(_PREFIX, "").split())
        raise InputError.of(f"is no {kind} that MuJoCo takes: {said}", file=model.file, key="model.file") from error
    _refuse_what_adam_lacks(model, compiled)
    names = [compiled.joint(i).name for i in range(compiled.njnt)]
    rotors = {name: float(compiled.dof_armature[i]) for i, name in enumerate(names)}
    return _Described(compiled, f"{_PREFIX}{model.tip}", rotors)


def _check_urdf(model: ModelFile, root: ET.Element) -> None:
    """Refuse what MuJoCo misreads silently, or reports without a name."""
    joints = root.findall("joint")
    other = [
        f"{joint.get('name')} ({'mimic' if joint.find('mimic') is not None else joint.get('type')})"
        for joint in joints
        if joint.get("type") not in (*_TURNS, *_SLIDES, "fixed") or joint.find("mimic") is not None
    ]
    if other:
        raise UnsupportedError(
            f"{model.file}: joints that are neither hinges nor slides of their own: {', '.join(other)}",
            key="model.file",
        )
    names = Counter((one.tag, one.get("name", "")) for one in (*root.findall("link"), *joints))
    wrong = [f"has {count} {kind}s of the name {name!r}" for (kind, name), count in names.items() if count > 1]
    wrong += [
        f"{one.tag} {key} is {value!r}; allowed: finite numbers"
        for one in root.iter()
        for key, value in one.items()
        if key not in ("name", "link", "filename") and re.search(r"\b(nan|inf|infinity)\b", value, re.IGNORECASE)
    ]
    wrong += [
        f"joint {joint.get('name')}: limit goes from {limit.get('lower', '0')} to {limit.get('upper', '0')}; allowed: "
        "an upper end above the lower one"
        for joint in joints
        if joint.get("type") in ("prismatic", "revolute")
        and (limit := joint.find("limit")) is not None
        and limit.get("lower", "0") == limit.get("upper", "0")
    ]
    if wrong:
        raise InputError([Fault(model.file, None, "model.file", one) for one in wrong])


def _refuse_massless(model: ModelFile, names: list[str]) -> None:
    """Refuse moving parts without inertia."""
    if names:
        raise UnsupportedError(
            f"{model.file}: no inertia is given for what moves: {', '.join(names)}; such models are made for drawing. "
            f"Give {MASS} and inertia of every link that moves, from CAD or from a scale",
            key="model.file",
        )


def _carries(body: Any) -> bool:
    """Return whether a body, or one fixed to it, has mass and inertia or geometry from which they follow."""
    return bool(
        (body.explicitinertial and body.mass > 0)
        or list(body.geoms)
        or any(_carries(child) for child in body.bodies if not list(child.joints))
    )


def _refuse_what_adam_lacks(model: ModelFile, compiled: Any) -> None:
    """Refuse by name what adam would omit from its equations silently."""
    hinge, slide = 3, 2  # mjtJoint
    wrong = []
    for i in range(compiled.nbody):
        name = compiled.body(i).name.removeprefix(_PREFIX)
        if compiled.body_jntnum[i] > 1:
            wrong.append(f"{name} has {compiled.body_jntnum[i]} joints of its own")
    for i in range(compiled.njnt):
        name = compiled.joint(i).name.removeprefix(_PREFIX)
        if compiled.jnt_type[i] not in (hinge, slide):
            wrong.append(f"{name} is neither a hinge nor a slide")
        if _apart(compiled.jnt_pos[i]):
            wrong.append(f"{name} stands beside the origin of its body")
    heaviest = float(np.abs(compiled.body_mass).max(initial=0.0))
    if not max(heaviest, float(np.abs(compiled.body_inertia).max(initial=0.0))) <= _MOST_KG:
        wrong.append(f"{A_MASS} of {heaviest:.3g} {KG}, or an inertia as large; allowed: at most {_MOST_KG:g} {KG}")
    placed = (compiled.body_pos, compiled.body_ipos, compiled.body_quat, compiled.jnt_axis, compiled.jnt_range)
    turns = np.linalg.norm(compiled.body_quat, axis=1)
    if not all(np.isfinite(one).all() for one in placed) or np.abs(turns - 1).max(initial=0.0) > 0.1:
        wrong.append("positions, angles or ranges that are no finite numbers")
    if compiled.neq:
        wrong.append(f"{compiled.neq} equality constraints close loops or couple joints")
    if wrong:
        raise UnsupportedError(f"{model.file}: {'; '.join(wrong)}", key="model.file")


def _apart(position: FloatArray) -> bool:
    return bool(np.abs(position).max() > 1e-12)
