"""The stiffest wall of one axis at many poses and along many normals: spring and damper, every hand and released."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.checkpoint import Chunked
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.arm.effective_mass import effective_masses, grid, mobility, reached, tip_device
from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands

# Masses are rounded outwards to these ratios, so that poses share a search: a wall is never overestimated.
_RATIO = 1.03
# Fewer searches take less time than starting processes.
_FEW = 60
_AT_ONCE = 8


@dataclass(frozen=True)
class WorkspaceMap:
    """The stiffest wall over the workspace.

    Attributes:
        counts: points of the grid along each axis.
        points_m: positions of the tip, shape (p, d).
        there: whether the mechanism reaches them, shape (p,).
        labels: of the normals; the last is any direction.
        free_kg: effective mass with the tangent free, shape (p, normals).
        held_kg: with the tangent held.
        stiffness_n_per_m: stiffest wall that is stable with every hand at both ends, shape (p, normals); not a number
            where the mechanism does not reach.
        searches: number of walls searched for, shared by poses with nearly the same masses.
    """

    counts: tuple[int, ...]
    points_m: FloatArray
    there: BoolArray
    labels: tuple[str, ...]
    free_kg: FloatArray
    held_kg: FloatArray
    stiffness_n_per_m: FloatArray
    searches: int


def workspace_map(
    arm: Arm,
    poses: int = 1000,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> WorkspaceMap:
    """Return the map of the stiffest wall over the workspace, along each axis and in the worst direction.

    Args:
        arm: the arm.
        poses: at least so many on a regular grid.
        workers: processes; more than one start the script anew, so that it needs a main guard.
        progress: reported over the searches.
        executor: runs the searches instead, as for `Chunked.run`.
    """
    low, high = arm.box_m
    counts = _counts(high - low, poses)
    points = grid(low, high, counts)
    joints, there = reached(arm, points)
    here = mobility(arm, joints[there])
    values = np.linalg.eigvalsh(here)
    any_way = np.stack([1 / values[:, -1], 1 / values[:, 0]], axis=-1)
    masses = np.full((len(points), len(arm.axes) + 1, 2), np.nan)
    masses[there] = np.concatenate([effective_masses(here, np.eye(len(arm.axes))), any_way[:, None]], axis=1)
    walls, searches = stiffest_walls(arm, masses[there].reshape(-1, 2), workers, progress, executor)
    stiffness = np.full(masses.shape[:2], np.nan)
    stiffness[there] = walls.reshape(-1, masses.shape[1])
    labels = (*arm.axes, "any")
    return WorkspaceMap(counts, points, there, labels, masses[..., 0], masses[..., 1], stiffness, searches)


def _counts(sides_m: FloatArray, poses: int) -> tuple[int, ...]:
    """Return odd numbers of points, so that there is a middle, in the proportion of the sides."""
    step = float(np.prod(sides_m) / poses) ** (1 / len(sides_m))
    while True:
        counts = tuple(2 * int(np.ceil((side / step - 1) / 2)) + 1 for side in sides_m)
        if np.prod(counts) >= poses:
            return tuple(max(3, count) for count in counts)
        step *= 0.98


def stiffest_walls(
    arm: Arm,
    masses_kg: FloatArray,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> tuple[FloatArray, int]:
    """Return the stiffest wall of each range of masses with every corner of the hands and released.

    Args:
        arm: its device and hands.
        masses_kg: lightest and heaviest, shape (n, 2); rounded outwards by at most 3 %.
        workers: processes.
        progress: reported over the searches.
        executor: as in `workspace_map`.

    Returns:
        Stiffness, shape (n,), N/m, and the number of different searches.
    """
    steps = np.log(masses_kg) / np.log(_RATIO)
    rounded = np.stack([np.floor(steps[:, 0] + 1e-9), np.ceil(steps[:, 1] - 1e-9)], axis=-1).astype(int)
    different, which = np.unique(rounded, axis=0, return_inverse=True)
    ends = _RATIO ** different.astype(np.float64)
    some = [ends[begin : begin + _AT_ONCE] for begin in range(0, len(ends), _AT_ONCE)]
    devices = [[tip_device(arm, light, heavy) for light, heavy in part] for part in some]
    sizes = [len(part) for part in some]
    study = Chunked({}, partial(_walls, hands=arm.file.hands), devices, _joined, sizes, "walls")
    walls = study.run(executor, workers=workers if len(ends) > _FEW else 1, progress=progress)
    return np.array(walls)[which.ravel()], len(ends)


def _walls(devices: Sequence[Device], hands: Hands) -> list[float]:
    subjects = with_released(hand_corners(hands))
    return [stiffest_wall(device, subjects).stiffness_n_per_m for device in devices]


def _joined(parts: list[list[float]]) -> list[float]:
    return [wall for part in parts for wall in part]
