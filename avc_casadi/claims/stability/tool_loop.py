"""Stability of a device coupled to a virtual tool: spectral radius of the lifted loop, with hands, tools and clocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.units import spoken_key
from avc_casadi.claims.stability.periodic import TOLERANCE, PeriodicLoops
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.lifted_loop import LiftedLoop, ToolGains, clocks
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolState, tool_states

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool

# Number of stiffnesses between free and the stiffest contact, spaced logarithmically.
_CONTACTS = 4
# Softest contact, as a share of the stiffest.
_SOFTEST = 1e-3


@dataclass(frozen=True)
class ToolCase:
    """One loop: hand, device, tool with its contact, engine step.

    Attributes:
        hand: its parameters; all 0 for the device released.
        device: number of the device corner.
        tool: the tool, at the device.
        step_s: of the engine.
    """

    hand: dict[str, float]
    device: int
    tool: ToolState
    step_s: float


class ToolLoops(PeriodicLoops):
    """All loops of a problem with [simulation]: hands, released, device corners, tools, contacts and clocks.

    Args:
        problem: with [simulation].

    Attributes:
        patterns: the lifted loop of each clock.
        tool: the [simulation].
        tools: the corners of tool and contact, at the device.
        hands: corners of [hands], the device released last.
    """

    def __init__(self, problem: Problem) -> None:
        self.tool = tool = required_tool(problem)
        self.hands = with_released(hand_corners(problem.hands))
        devices = device_corners(problem.device, LINEAR_KEYS)
        self.tools = list(
            dict.fromkeys(one for contact in contact_stiffnesses_n_per_m(tool) for one in tool_states(tool, contact))
        )
        plant = sampled_plant(devices, self.hands)
        self.patterns: list[LiftedLoop] = [
            LiftedLoop(plant, clock, tool)
            for step_s in sorted(set(tool.step_s))
            for clock in clocks(step_s, problem.device.sample_time_s)
        ]
        self._devices = len(devices)
        super().__init__()

    def __len__(self) -> int:
        return len(self.patterns) * len(self.tools) * self._devices * len(self.hands)

    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices over one period of a clock, shape (loops, size, size)."""
        loop = self.patterns[place]
        return loop.monodromy(gains, self.tools).reshape(-1, loop.size, loop.size)

    def radius(self, gains: ToolGains) -> tuple[float, ToolCase]:
        """Return the largest spectral radius, per step of the engine, and its loop."""
        place, row, radius = self.worst(gains)
        return radius ** (1 / len(self.patterns[place].clock.samples)), self._case(place, row)

    def radii(self, gains: ToolGains) -> FloatArray:
        """Return the spectral radius of each loop, counted by one step of the engine, the largest of all clocks.

        Returns:
            Shape (tools, devices, hands); the device released is the last of the hands.
        """
        each = [
            np.abs(self.eigenvalues(place, gains)).max(axis=-1) ** (1 / len(loop.clock.samples))
            for place, loop in enumerate(self.patterns)
        ]
        return np.asarray(np.max(each, axis=0).reshape(len(self.tools), self._devices, len(self.hands)))

    def engine_alone_stable(self) -> bool:
        """Return whether the tool in contact is stable without any coupling, a property of the engine alone."""
        touching = [one for one in self.tools if not one.fixed and one.contact_stiffness_n_per_m > 0]
        alone = [np.linalg.eigvals(loop.tool_alone(one)) for loop in self.patterns for one in touching]
        return all(np.abs(values).max() <= 1 + TOLERANCE for values in alone)

    def _case(self, place: int, row: int) -> ToolCase:
        tool, device, hand = np.unravel_index(row, (len(self.tools), self._devices, len(self.hands)))
        return ToolCase(
            self.hands.values(int(hand)), int(device), self.tools[int(tool)], self.patterns[place].clock.step_s
        )


def required_tool(problem: Problem) -> VirtualTool:
    """Return the [simulation] of a problem.

    Raises:
        InputError: it has no [simulation].
    """
    if problem.simulation is None:
        raise InputError.of(
            f"is missing; allowed: a table with step_s, and {spoken_key('tool_mass_kg')} where the engine moves a tool",
            file=problem.name or "problem",
            key="simulation",
        )
    return problem.simulation


def contact_stiffnesses_n_per_m(tool: VirtualTool) -> list[float]:
    """Return the contacts that are tried, in the scene: free and rigid, and the springs of a range that has an end.

    An unbounded range stands for an engine that solves contacts as constraints: the tool is free or stopped.

    Args:
        tool: with the range.
    """
    lowest, highest = tool.contact_stiffness_n_per_m
    if tool.rigid:
        return [0.0, *([lowest] if 0 < lowest < RIGID_N_PER_M else []), RIGID_N_PER_M]
    low = max(lowest, _SOFTEST * highest)
    between = np.geomspace(low, highest, _CONTACTS).tolist() if 0 < low < highest else [highest]
    return sorted({0.0, *between, RIGID_N_PER_M})
