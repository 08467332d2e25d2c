"""Inertia at the tip: the operational-space inertia L = (J M^-1 J')^-1, and the effective mass along a normal.

At a wall of normal n the effective mass is 1/(n' L^-1 n) with the tangent free; n' L n, which is more, with the tangent
held, as by a proxy with friction. A design for the two ends covers all between: the device of one axis has that range
of masses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.units import KG, MASS
from avc_casadi.arm.arm import evaluated
from avc_casadi.files.device_file import DeviceFile, Sources
from avc_casadi.model.device import Device

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm


_REACH, _SHRINK, _STILL = 0.2, 0.6, 1e-4
_ROUNDS = 24


def climb(
    value: Callable[[FloatArray], FloatArray], starts: FloatArray, *, probes: int = 24, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Maximise from several initial guesses in the unit box by random search; points without a number are avoided.

    Args:
        value: of points (m, k) to values (m,).
        starts: shape (s, k).
        probes: points tried about each iterate in a round.
        seed: of the probes.

    Returns:
        The final iterates, shape (s, k), and the values there.
    """
    random = np.random.default_rng(seed)
    at = np.clip(starts, 0.0, 1.0)
    top = _numbers(value(at))
    reach = np.full(len(at), _REACH)
    for _ in range(_ROUNDS):
        going = np.flatnonzero(reach > _STILL)
        if not going.size:
            break
        steps = random.standard_normal((len(going), probes, at.shape[1])) * reach[going, None, None]
        # Half of the probes change only a few of the coordinates.
        kept = random.random(steps.shape) < np.where(np.arange(probes) % 2, 1.0, 2 / at.shape[1])[:, None]
        near = np.clip(at[going, None] + steps * kept, 0.0, 1.0)
        values = _numbers(value(near.reshape(-1, at.shape[1]))).reshape(len(going), probes)
        best = values.argmax(axis=1)
        rows = np.arange(len(going))
        better = values[rows, best] > top[going]
        winners = going[better]
        at[winners], top[winners] = near[rows, best][better], values[rows, best][better]
        reach[going[~better]] *= _SHRINK
    return at, top


def _numbers(values: FloatArray) -> FloatArray:
    return np.where(np.isnan(values), -np.inf, values)


# A mobility smaller than this relative to the largest is that of a singular pose.
_SINGULAR = 1e-9
_STEPS, _NEWTON = 8, 5
_REACHED_M = 1e-9
_FINEST = 9
_STARTS = 4


def reached(arm: Arm, points_m: FloatArray, start: FloatArray | None = None) -> tuple[FloatArray, BoolArray]:
    """Return joint values of points of the tip, by Newton's method along the straight line from a start.

    Args:
        arm: the arm.
        points_m: shape (p, d).
        start: joint values to start from, shape (p, n); None is home.

    Returns:
        Joint values, shape (p, n), and whether an admissible pose reaches the point, shape (p,).
    """
    home = np.broadcast_to(arm.home, (len(points_m), arm.joints)) if start is None else start
    joints = np.array(home, dtype=np.float64)
    begin = evaluated(arm.tip, joints)[..., 0]
    with np.errstate(all="ignore"):
        for step in range(1, _STEPS + 1):
            target = begin + (points_m - begin) * (step / _STEPS)
            for _ in range(_NEWTON if step == _STEPS else 2):
                missing = target - evaluated(arm.tip, joints)[..., 0]
                jacobian = evaluated(arm.jacobian, joints)
                turned = jacobian.transpose(0, 2, 1)
                square = jacobian @ turned
                square = np.where(np.isfinite(square), square, 0.0) + 1e-15 * np.eye(square.shape[-1])
                joints = joints + (turned @ np.linalg.solve(square, missing[..., None]))[..., 0]
                joints = np.where(np.isfinite(joints), joints, home)
        found = np.abs(points_m - evaluated(arm.tip, joints)[..., 0]).max(axis=1) < _REACHED_M
    return joints, np.asarray(found & (evaluated(arm.allowed, joints)[..., 0] >= 0).all(axis=1))


def mobility(arm: Arm, joints: FloatArray) -> FloatArray:
    """Return J M^-1 J', the inverse of the operational-space inertia, shape (p, d, d), 1/kg, of joint values (p, n)."""
    jacobian = evaluated(arm.jacobian, joints)
    found = jacobian @ np.linalg.solve(evaluated(arm.inertia, joints), jacobian.transpose(0, 2, 1))
    return np.asarray((found + found.transpose(0, 2, 1)) / 2)


def operational_inertia(mobility_per_kg: FloatArray) -> FloatArray:
    """Return L, shape (p, d, d), kg, from its inverse; infinite along what a singular pose cannot move."""
    values, vectors = np.linalg.eigh(mobility_per_kg)
    stuck = values < _SINGULAR * values[..., -1:]
    masses = np.where(stuck, np.inf, 1 / np.where(stuck, 1.0, values))
    with np.errstate(invalid="ignore"):
        whole = np.einsum("...ij,...j,...kj->...ik", vectors, masses, vectors)
    return np.where(np.isnan(whole), np.inf, whole)


def effective_masses(mobility_per_kg: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the effective mass along normals, its tangent free and held, shape (p, m, 2), kg.

    Args:
        mobility_per_kg: shape (p, d, d).
        normals: of length 1, shape (m, d).
    """
    free = 1 / np.einsum("mi,pij,mj->pm", normals, mobility_per_kg, normals)
    values, vectors = np.linalg.eigh(mobility_per_kg)
    share = np.einsum("mi,pij->pmj", normals, vectors) ** 2
    stuck = (values < _SINGULAR * values[..., -1:])[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        held = np.where(stuck & (share > _SINGULAR), np.inf, share / np.where(stuck, 1.0, values[:, None, :]))
    return np.stack([free, held.sum(axis=-1)], axis=-1)


def unit(normal: FloatArray) -> FloatArray:
    """Return vectors of length 1 along those of the last axis."""
    # Against overflow of squares.
    normal = normal / np.abs(normal).max(axis=-1, keepdims=True)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def one_normal(arm: Arm, normal: Sequence[float]) -> FloatArray:
    """Return a normal of length 1, shape (1, d).

    Raises:
        InputError: it has another number of axes, or no direction.
    """
    found = np.asarray(normal, dtype=np.float64)
    if found.shape != (len(arm.axes),) or not np.isfinite(found).all() or not np.abs(found).max() > 0:
        given = ", ".join(f"{one:g}" for one in normal)
        raise InputError.of(f"is {given}; allowed: {len(arm.axes)} numbers, not all 0", key="normal")
    return unit(found)[None]


@dataclass(frozen=True)
class MassRange:
    """The effective mass over a part of the workspace, along some normals or any.

    Attributes:
        lightest_kg: smallest with the tangent free.
        heaviest_kg: largest with the tangent held.
        lightest_at_m: position of the tip, shape (d,).
        heaviest_at_m: position of the tip, shape (d,).
        poses: number of poses of the grid, before the search about the ends.
        out_of_reach: number of these that the mechanism does not reach.
    """

    lightest_kg: float
    heaviest_kg: float
    lightest_at_m: FloatArray
    heaviest_at_m: FloatArray
    poses: int
    out_of_reach: int


def mass_range(
    arm: Arm,
    normals: FloatArray | None = None,
    box_m: tuple[FloatArray, FloatArray] | None = None,
    per_axis: int = _FINEST,
) -> MassRange:
    """Return the effective mass over the workspace: a grid with the corners of the box, then a search from its ends.

    Args:
        arm: the arm.
        normals: of length 1, shape (m, d); None takes every direction.
        box_m: lowest and highest corner; None is the workspace.
        per_axis: points of the grid along each axis.

    Raises:
        InputError: no point of the box is reached.
    """
    low, high = arm.box_m if box_m is None else box_m
    points = grid(low, high, (per_axis,) * len(low))
    joints, found = reached(arm, points)
    if not found.any():
        raise InputError.of("is nowhere reached by the mechanism; give a box about the tip at home", key="workspace")
    ends = np.full((len(points), 2), np.nan)
    ends[found] = _ends(mobility(arm, joints[found]), normals)

    def at(side: int, sign: float) -> tuple[float, FloatArray]:
        def value(shares: FloatArray) -> FloatArray:
            own, there = reached(arm, low + (high - low) * shares)
            values = np.full(len(shares), np.nan)
            values[there] = sign * _ends(mobility(arm, own[there]), normals)[:, side]
            return values

        known = np.where(np.isnan(ends[:, side]), -np.inf, sign * ends[:, side])
        starts = (points[np.argsort(-known)[:_STARTS]] - low) / (high - low)
        where, top = climb(value, starts)
        best = int(np.argmax(top))
        return sign * float(top[best]), low + (high - low) * where[best]

    (light, light_at), (heavy, heavy_at) = at(0, -1.0), at(1, 1.0)
    return MassRange(light, heavy, light_at, heavy_at, len(points), int((~found).sum()))


def _ends(mobility_per_kg: FloatArray, normals: FloatArray | None) -> FloatArray:
    """Return the smallest free and the largest held mass of each pose, shape (p, 2)."""
    if normals is not None:
        masses = effective_masses(mobility_per_kg, normals)
        return np.stack([masses[..., 0].min(axis=1), masses[..., 1].max(axis=1)], axis=1)
    values = np.linalg.eigvalsh(mobility_per_kg)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.maximum(values[:, [-1, 0]], np.array([0.0, _SINGULAR * values.max()])))


def grid(low: FloatArray, high: FloatArray, counts: tuple[int, ...]) -> FloatArray:
    """Return a grid of points with the corners of a box, shape (p, d); one point along an axis is the middle."""
    sides = [
        np.linspace(a, b, count) if count > 1 else np.array([(a + b) / 2])
        for a, b, count in zip(low, high, counts, strict=True)
    ]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, len(low))


_DIGITS = 5
# Heavier than any tip; a singular pose is not designed for.
_HEAVIEST_KG = 1e3


def tip_device(arm: Arm, lightest_kg: float, heaviest_kg: float) -> Device:
    """Return the device of one axis, its mass between two ends; nominal is the geometric mean.

    Args:
        arm: the arm.
        lightest_kg: tangent free.
        heaviest_kg: tangent held.

    Raises:
        InputError: an end is not finite, which a singular pose has.
    """
    if not 0 < lightest_kg <= heaviest_kg < _HEAVIEST_KG:
        raise InputError.of(
            f"weighs {lightest_kg:.4g} to {heaviest_kg:.4g} {KG}, a singular pose; take another or a smaller workspace",
            key="workspace",
        )
    ends = tuple(float(f"{end:.{_DIGITS}g}") for end in (lightest_kg, heaviest_kg))
    tables = arm.file.device.model_dump(exclude_unset=True, exclude={"mass_kg"})
    nominal = float(f"{(lightest_kg * heaviest_kg) ** 0.5:.{_DIGITS}g}")
    ranges = {**tables.pop("range", {}), "mass_kg": (ends[0], ends[1])}
    return Device.model_validate({"mass_kg": min(max(nominal, ends[0]), ends[1]), **tables, "range": ranges})


def tip_device_file(arm: Arm, lightest_kg: float, heaviest_kg: float, where: str) -> DeviceFile:
    """Return that device as a device file, which a problem file names.

    Args:
        arm: the arm.
        lightest_kg: tangent free.
        heaviest_kg: tangent held.
        where: poses and normals of the ends, for title and source.
    """
    device, name = tip_device(arm, lightest_kg, heaviest_kg), arm.file.name or "the arm"
    stated = device.model_fields_set | device.range.model_fields_set
    told = {"grade": "assumed", "source": f"as the arm file of {name} states it"}
    weighed = {
        "grade": "computed",
        "source": f"effective {MASS} of {name}, {where}: 1/(n' L^-1 n) with the tangent free to n' L n with it held",
    }
    keys = list(Sources.model_fields)
    return DeviceFile.model_validate(
        {
            "name": "device",
            "title": f"{arm.file.title or name}: {where}",
            "device": device,
            "gaps": [key for key in keys if key not in stated],
            "sources": {key: weighed if key == "mass_kg" else told for key in keys if key in stated},
        }
    )
