"""Stability of a device coupled to a virtual tool: spectral radius of the lifted loop, with hands, tools and clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.claims.stability.eigenvalues import eigenvalues
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import hand_corners, with_let_go
from avc_casadi.model.lifted_loop import LiftedLoop, ToolGains, clocks
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolState, tool_states

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool

# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is not told from none.
_TOLERANCE = 1e-9
# Contacts between free and the stiffest are tried at so many stiffnesses, evenly in the logarithm.
_CONTACTS = 4
# Eigenvalues this small belong to what is forgotten within a step; slower swings than this are drift.
_DEAD, _DRIFT_HZ = 1e-6, 0.1
# Softest contact beside free motion, as a share of the stiffest.
_SOFTEST = 1e-3


@dataclass(frozen=True)
class ToolCase:
    """One loop: who holds which device, and what the tool is and touches.

    Attributes:
        hand: its numbers; all 0 for the device released.
        device: number of the device corner.
        tool: the tool, at the device.
        step_s: of the engine.
    """

    hand: dict[str, float]
    device: int
    tool: ToolState
    step_s: float


@dataclass(frozen=True)
class Mode:
    """An oscillation of a loop.

    Attributes:
        damping_ratio: as a share of the critical; 1 where nothing swings.
        frequency_hz: of the oscillation.
        time_constant_s: in which it falls to 1/e.
    """

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class ToolLoops:
    """All loops of a problem with [simulation]: hands, released, device corners, tools, contacts and clocks.

    Args:
        problem: with [simulation].

    Attributes:
        tool: the [simulation].
        tools: the corners of tool and contact, at the device.
        hands: corners of [hands], the device released last.
    """

    def __init__(self, problem: Problem) -> None:
        self.tool = tool = required_tool(problem)
        self.hands = with_let_go(hand_corners(problem.hands))
        devices = device_corners(problem.device, LINEAR_KEYS)
        self.tools = list(
            dict.fromkeys(one for contact in contact_stiffnesses_n_per_m(tool) for one in tool_states(tool, contact))
        )
        plant = sampled_plant(devices, self.hands)
        self._loops = [
            LiftedLoop(plant, clock, tool)
            for step_s in sorted(set(tool.step_s))
            for clock in clocks(step_s, problem.device.sample_time_s)
        ]
        self._devices = len(devices)
        self._few: list[list[int]] = [[] for _ in self._loops]

    def __len__(self) -> int:
        return len(self._loops) * len(self.tools) * self._devices * len(self.hands)

    def stable(self, gains: ToolGains) -> bool:
        """Whether every loop is; those that failed before are asked first."""
        if not self._settle(gains, self._few):
            return False
        failed = self._first_unstable(gains)
        if failed is None:
            return True
        self._few[failed[0]].append(failed[1])
        return False

    def radius(self, gains: ToolGains) -> tuple[float, ToolCase]:
        """Return the largest spectral radius, counted by one step of the engine, and the loop that has it."""
        worst, where = -1.0, (0, 0)
        for place, loop in enumerate(self._loops):
            values = np.abs(self._eigenvalues(loop, gains)).max(axis=-1) ** (1 / len(loop.clock.samples))
            row = int(np.argmax(values))
            if values[row] > worst:
                worst, where = float(values[row]), (place, row)
        return worst, self._case(*where)

    def engine_alone_stable(self) -> bool:
        """Whether the tool in contact stays where it is without any coupling: an engine's own matter."""
        touching = [one for one in self.tools if not one.fixed and one.contact_stiffness_n_per_m > 0]
        alone = [np.linalg.eigvals(loop.tool_alone(one)) for loop in self._loops for one in touching]
        return all(np.abs(values).max() <= 1 + _TOLERANCE for values in alone)

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped mode of all loops that swings, faster than once in ten seconds."""
        found = Mode(1.0, 0.0, math.inf)
        for loop in self._loops:
            period_s = sum(loop.clock.samples) * loop.sample_time_s
            values = self._eigenvalues(loop, gains).ravel()
            poles = np.log(values[np.abs(values) > _DEAD]) / period_s
            poles = poles[np.abs(poles.imag) > 2 * np.pi * _DRIFT_HZ]
            if len(poles) == 0:
                continue
            ratio = -poles.real / np.abs(poles)
            row = int(np.argmin(ratio))
            if ratio[row] < found.damping_ratio:
                pole = poles[row]
                found = Mode(float(ratio[row]), float(abs(pole.imag) / (2 * np.pi)), float(-1 / pole.real))
        return found

    def _settle(self, gains: ToolGains, rows: Sequence[Sequence[int]]) -> bool:
        for loop, some in zip(self._loops, rows, strict=True):
            if some and not _contracts(self._eigenvalues(loop, gains, some)).all():
                return False
        return True

    def _first_unstable(self, gains: ToolGains) -> tuple[int, int] | None:
        for place, loop in enumerate(self._loops):
            unstable = np.abs(self._eigenvalues(loop, gains)).max(axis=-1)
            row = int(np.argmax(unstable))
            if not unstable[row] < 1 - _TOLERANCE:
                return place, row
        return None

    def _eigenvalues(self, loop: LiftedLoop, gains: ToolGains, rows: Sequence[int] | None = None) -> ComplexArray:
        """Return the eigenvalues of loops, one of what floats freely taken out, shape (loops, size)."""
        matrices = loop.monodromy(gains, self.tools).reshape(-1, loop.size, loop.size)
        return eigenvalues(_held(matrices if rows is None else matrices[rows], loop.shift))

    def _case(self, place: int, row: int) -> ToolCase:
        tool, device, hand = np.unravel_index(row, (len(self.tools), self._devices, len(self.hands)))
        return ToolCase(
            self.hands.values(int(hand)), int(device), self.tools[int(tool)], self._loops[place].clock.step_s
        )


def required_tool(problem: Problem) -> VirtualTool:
    """Return the [simulation] of a problem.

    Raises:
        InputError: it has none.
    """
    if problem.simulation is None:
        raise InputError.of(
            "is missing; allowed: a table with step_s, and tool_mass_kg where the engine moves a tool",
            file=problem.name or "problem",
            key="simulation",
        )
    return problem.simulation


def contact_stiffnesses_n_per_m(tool: VirtualTool) -> list[float]:
    """Return the contacts that are tried, in the scene: free and rigid, and the springs of a range that has an end.

    A range without an end stands for an engine that solves its contacts as constraints: the tool moves freely or stops.

    Args:
        tool: with the range.
    """
    lowest, highest = tool.contact_stiffness_n_per_m
    if tool.rigid:
        return [0.0, *([lowest] if 0 < lowest < RIGID_N_PER_M else []), RIGID_N_PER_M]
    low = max(lowest, _SOFTEST * highest)
    between = np.geomspace(low, highest, _CONTACTS).tolist() if 0 < low < highest else [highest]
    return sorted({0.0, *between, RIGID_N_PER_M})


def _contracts(values: ComplexArray) -> BoolArray:
    return np.asarray(np.abs(values).max(axis=-1) < 1 - _TOLERANCE)


def _held(matrices: FloatArray, shift: FloatArray) -> FloatArray:
    """Take the eigenvalue 1 of a free translation out of matrices that have it, the others staying (Wielandt)."""
    floats = np.abs(matrices @ shift - shift).max(axis=-1) < 1e-9
    taken = matrices - shift[:, None] * matrices[..., :1, :]
    return np.where(floats[..., None, None], taken, matrices)
