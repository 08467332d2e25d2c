"""Stability of a device coupled to a virtual tool: spectral radius of the lifted loop, with hands, tools and clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stability.periodic import TOLERANCE, PeriodicLoops, leading
from avc_casadi.claims.stability.worst_point import Box, Ranges, hand_at, hand_boxes, held_plant, worst_point
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.hands import Hand, hand_corners, joined, with_released
from avc_casadi.model.lifted_loop import LiftedLoop, ToolGains, clocks
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, ToolState, tool_at, tool_states

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.lifted_loop import Clock
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool

# Number of stiffnesses between free and the stiffest contact, spaced logarithmically.
_CONTACTS = 4
# Softest contact, as a share of the stiffest.
_SOFTEST = 1e-3
# Number of steps of the engine that are searched in a range of them.
_STEPS = 4


@dataclass(frozen=True)
class ToolCase:
    """One loop: hand, device, tool with its contact, engine step."""

    hand: dict[str, float]
    device: dict[str, float]
    tool: ToolState
    step_s: float


class ToolLoops(PeriodicLoops):
    """All loops of a problem with [simulation]: hands, released, devices, tools, contacts and clocks of its ranges.

    Args:
        problem: with [simulation].
        beside: hands that are looked at beside the corners, such as the worst of a similar problem.

    Attributes:
        patterns: the lifted loop of each clock, then that of each worst point inside the ranges.
        tool: the [simulation].
        tools: the corners of tool and contact, at the device.
        hands: corners of [hands] and those beside them, the device released last.
    """

    def __init__(self, problem: Problem, beside: Sequence[Hand] = ()) -> None:
        self.problem = problem
        self.tool = tool = required_tool(problem)
        self.hands = with_released(reduce(joined, beside, hand_corners(problem.hands)))
        self._devices = device_corners(problem.device, LINEAR_KEYS)
        self.tools = list(
            dict.fromkeys(one for contact in contact_stiffnesses_n_per_m(tool) for one in tool_states(tool, contact))
        )
        plant = sampled_plant(self._devices, self.hands)
        self.patterns: list[LiftedLoop] = [
            LiftedLoop(plant, clock, tool)
            for step_s in sorted(set(tool.step_s))
            for clock in clocks(step_s, problem.device.sample_time_s)
        ]
        self._clocks = len(self.patterns)
        self._inside: list[ToolCase] = []
        super().__init__()

    @property
    def worst_hands(self) -> tuple[Hand, ...]:
        """The worst hands inside the ranges that searches found."""
        return tuple(Hand(**one.hand) for one in self._inside)

    def __len__(self) -> int:
        return self._clocks * len(self.tools) * len(self._devices) * len(self.hands) + len(self._inside)

    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices over one period of a clock, shape (loops, size, size)."""
        loop = self.patterns[place]
        tools = self.tools if place < self._clocks else [self._inside[place - self._clocks].tool]
        return loop.monodromy(gains, tools).reshape(-1, loop.size, loop.size)

    def radius(self, gains: ToolGains) -> tuple[float, ToolCase]:
        """Return the largest spectral radius, per step of the engine, and its loop, after a search of the ranges."""
        self.search(gains)
        place, row, radius = self.worst(gains)
        return radius ** (1 / len(self.patterns[place].clock.samples)), self._case(place, row)

    def add_worst(self, gains: ToolGains, known: float) -> int:
        """Search each clock, free and in contact, held and released, over all other ranges."""
        sample_time_s, before = self.problem.device.sample_time_s, len(self._inside)
        every = [clock for step_s in _steps_s(self.tool) for clock in clocks(step_s, sample_time_s)]
        contacts, hands = _contact_ranges_n_per_m(self.tool), hand_boxes(self.problem)
        for clock, contact, hand, slow in product(every, contacts, hands, (True, False)):
            growth, loop, case = _Ranges(self.problem, clock, contact, hand).worst(gains, slow=slow)
            if growth > known:
                self.patterns.append(loop)
                self._inside.append(case)
        return len(self._inside) - before

    def radii(self, gains: ToolGains) -> FloatArray:
        """Return the spectral radius of each loop at the corners, for a step of the engine, the largest of all clocks.

        Returns:
            Shape (tools, devices, hands); the device released is the last of the hands.
        """
        each = [
            np.abs(self.eigenvalues(place, gains)).max(axis=-1) ** (1 / len(loop.clock.samples))
            for place, loop in enumerate(self.patterns[: self._clocks])
        ]
        return np.asarray(np.max(each, axis=0).reshape(len(self.tools), len(self._devices), len(self.hands)))

    def engine_alone_stable(self) -> bool:
        """Return whether the tool in contact is stable without any coupling, a property of the engine alone."""
        touching = [one for one in self.tools if not one.fixed and one.contact_stiffness_n_per_m > 0]
        alone = [np.linalg.eigvals(loop.tool_alone(one)) for loop in self.patterns for one in touching]
        return all(np.abs(values).max() <= 1 + TOLERANCE for values in alone)

    def _case(self, place: int, row: int) -> ToolCase:
        if place >= self._clocks:
            return self._inside[place - self._clocks]
        shape = len(self.tools), len(self._devices), len(self.hands)
        tool, device, hand = (int(one) for one in np.unravel_index(row, shape))
        step_s = self.patterns[place].clock.step_s
        return ToolCase(self.hands.values(hand), linear_values(self._devices[device]), self.tools[tool], step_s)


@dataclass(frozen=True)
class _Ranges:
    """The ranges that are left where the clock and the kind of contact are set, and a hand holds the device or none."""

    problem: Problem
    clock: Clock
    contact: tuple[float, float]
    hand: Ranges

    def worst(self, gains: ToolGains, *, slow: bool) -> tuple[float, LiftedLoop, ToolCase]:
        """Return the largest growth that a search finds, its loop and what that is; slow: of all modes."""
        box = Box({**self.hand, **device_ranges(self.problem.device, LINEAR_KEYS), **self._of_tool()})

        def growth(_: IndexArray, places: FloatArray) -> ComplexArray:
            loop, _device, tools = self._loops(box.values(places))
            return leading(loop.paired(gains, tools), loop, slow=slow)

        place, value = worst_point(growth, len(box.sides))
        found = box.values(place[:, None])
        worst, device, states = self._loops(found)
        return abs(value), worst, ToolCase(hand_at(found, 0), linear_values(device), states[0], self.clock.step_s)

    def _of_tool(self) -> Ranges:
        """Return the ranges of the tool, by the arguments of `tool_at`; one that is fixed has no other sides."""
        tool, fixed = required_tool(self.problem), self.contact[0] >= RIGID_N_PER_M
        mass = tool.tool_mass_kg or (math.inf, math.inf)
        found = {
            "tool.mass_kg": (mass[0], mass[0]) if fixed else mass,
            "tool.damping_ns_per_m": (0.0, 0.0) if fixed else tool.tool_damping_ns_per_m,
            "contact.stiffness_n_per_m": self.contact,
        }
        if 0 < self.contact[0] < RIGID_N_PER_M and tool.contact_damping_ns_per_m is not None:
            found["contact.damping_ns_per_m"] = tool.contact_damping_ns_per_m
        return found

    def _loops(self, values: dict[str, FloatArray]) -> tuple[LiftedLoop, Device, list[ToolState]]:
        """Return the loop of m points, the first device and the m tools."""
        tool = required_tool(self.problem)
        devices, plant = held_plant(self.problem.device, values)
        numbers = np.array([values[key] for key in self._of_tool()]).T.tolist()
        return LiftedLoop(plant, self.clock, tool), devices[0], [tool_at(tool, *row) for row in numbers]


def required_tool(problem: Problem) -> VirtualTool:
    """Return the [simulation] of a problem.

    Raises:
        InputError: it has no [simulation].
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


def _contact_ranges_n_per_m(tool: VirtualTool) -> list[tuple[float, float]]:
    """Return the ranges of contacts that are searched, in the scene: free, springs, rigid; none moves a fixed tool."""
    if tool.tool_mass_kg is None:
        return [(RIGID_N_PER_M, RIGID_N_PER_M)]
    contacts = contact_stiffnesses_n_per_m(tool)
    springs = [one for one in contacts if 0 < one < RIGID_N_PER_M]
    ends = [0.0, *([springs[0]] if springs else []), RIGID_N_PER_M]
    return [(one, springs[-1] if one and one < RIGID_N_PER_M else one) for one in ends if one in contacts]


def _steps_s(tool: VirtualTool) -> list[float]:
    """Return the steps of the engine that are searched: the ends of the range and some between."""
    shortest, longest = tool.step_s
    return np.geomspace(shortest, longest, _STEPS).tolist() if longest > shortest else [shortest]
