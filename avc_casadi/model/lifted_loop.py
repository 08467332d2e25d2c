"""Monodromy matrix (lifted loop) of device and virtual tool over whole steps of the engine.

Between two steps of the engine the device takes some samples; each is one linear map of the state, a step of the engine
is another. Their product over one period of the pattern is the monodromy matrix, whose spectral radius decides on
stability; no transfer function at T does, as the loop is periodic, not time-invariant.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.sampled_plant import SampledPlant

if TYPE_CHECKING:
    from avc_casadi.model.virtual_tool import ToolState, VirtualTool

# Largest number of engine steps until the pattern recurs, if no multiple of T: 1/60 s recurs after three of 50 ms.
_LONGEST_PERIOD = 8


@dataclass(frozen=True)
class ToolGains:
    """The coupling between a device and a virtual tool, in the device's units of position and force.

    Attributes:
        stiffness_n_per_m: K.
        damping_ns_per_m: B.
        local_damping_ns_per_m: b_l of a damper that the device's local loop adds at T, towards ground.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    local_damping_ns_per_m: float = 0.0

    def times(self, factor: float) -> ToolGains:
        """Return K and B multiplied by a factor, as by an error of the force constant."""
        return replace(
            self,
            stiffness_n_per_m=factor * self.stiffness_n_per_m,
            damping_ns_per_m=factor * self.damping_ns_per_m,
        )

    def at_scale(self, factor: float) -> ToolGains:
        """Return K, B and the local damper multiplied by a factor, in the remote end's units."""
        return replace(self.times(factor), local_damping_ns_per_m=factor * self.local_damping_ns_per_m)


@dataclass(frozen=True)
class Clock:
    """Timing of an engine's steps in samples of the device, until the pattern recurs.

    Attributes:
        samples: samples that the device takes after each step of the engine, before the next one.
        aged: whether each step falls between two samples and reads the earlier one.
        step_s: step of the engine's integrator.
    """

    samples: tuple[int, ...]
    aged: tuple[bool, ...]
    step_s: float

    @property
    def whole(self) -> bool:
        """Whether each step of the engine falls on a sample, evenly spaced."""
        return len(self.samples) == 1 and not self.aged[0]


def clocks(step_s: float, sample_time_s: float) -> list[Clock]:
    """Return the patterns of an engine's steps: one where T divides the step, otherwise one for each distinct phase."""
    ratio = step_s / sample_time_s
    if math.isclose(ratio, round(ratio), rel_tol=1e-6) and round(ratio) >= 1:
        return [Clock((round(ratio),), (False,), step_s)]
    period = Fraction(ratio).limit_denominator(_LONGEST_PERIOD)
    if period == 0:
        period = Fraction(1, _LONGEST_PERIOD)
    # Phases within 1/period of each other give the same pattern; either one step falls on a sample or none does.
    return [_clock(period, phase, step_s) for phase in (Fraction(0), Fraction(1, 2 * period.denominator))]


def _clock(period: Fraction, phase: Fraction, step_s: float) -> Clock:
    times = [step * period + phase for step in range(period.denominator + 1)]
    # A step at a sample precedes the force of that sample; one between two samples takes effect at the later one.
    first = [math.ceil(time) for time in times]
    return Clock(
        tuple(after - before for before, after in itertools.pairwise(first)),
        tuple(time.denominator != 1 for time in times[:-1]),
        step_s,
    )


def driven_plant(sample_time_s: float) -> SampledPlant:
    """Return a device in imposed motion: its one state is its position, replaced at each sample."""
    none, one = np.zeros((1, 1, 1)), np.ones(1)
    return SampledPlant(("device_position_m",), none[..., None], none, none, np.array([0]), one, one, sample_time_s)


class LiftedLoop:
    """Device, hands and virtual tools, ready for the monodromy matrices of any gains.

    State: that of the device with its pending forces, its last two measured positions, position and velocity of the
    tool, and the queued outputs of the engine (position and velocity, or a force).

    Args:
        plant: devices with hands, from sample to sample.
        clock: when the engine steps.
        engine: its integrator and its outputs.

    Attributes:
        size: number of states.
        shift: the state with all positions one metre on, shape (size,).
        sample_time_s: T.
        period_s: after which the pattern of steps recurs.
    """

    def __init__(self, plant: SampledPlant, clock: Clock, engine: VirtualTool) -> None:
        self.clock, self.engine = clock, engine
        self.sample_time_s = plant.sample_time_s
        self.period_s = sum(clock.samples) * plant.sample_time_s
        self._matrix, self._force = plant.with_forces_under_way()
        self._n = n = self._matrix.shape[-1]
        held = 1 if engine.exchange == "held-force" else 2
        self._known = n + 4
        self.size = self._known + held * (1 + engine.queued)
        unit = np.eye(self.size)
        measured = np.zeros(self.size)
        measured[: len(plant.measured)] = plant.measured
        self._measured, self._last, self._older = measured, unit[n], unit[n + 1]
        self._tool_m, self._tool_m_per_s = unit[n + 2], unit[n + 3]
        # All positions one metre on: the rigid-body mode.
        self.shift = np.zeros(self.size)
        self.shift[: len(plant.names)] = [name.endswith("_position_m") for name in plant.names]
        self.shift[n : n + 3] = 1.0
        if held == 2:
            self.shift[self._known :: 2] = 1.0

    def force_per_metre(self, gains: ToolGains, tool: ToolState, frequency_hz: float) -> complex:
        """Return the force commanded by the device's loop per metre of a `driven_plant`'s oscillation, N/m.

        Of a periodic loop this is the component at that frequency; with hold and delay it is the actuator's force.

        Args:
            gains: of the coupling.
            tool: with its contact.
            frequency_hz: below half the sampling rate.
        """
        turn = np.exp(2j * np.pi * frequency_hz * self.sample_time_s)
        sample, row = self._sample(gains, fixed=tool.fixed)[0, 0], self._force_row(gains, fixed=tool.fixed)
        whole, offset = np.eye(self.size, dtype=complex), np.zeros(self.size, dtype=complex)
        rows, past, count = np.zeros(self.size, dtype=complex), 0.0 + 0.0j, 0
        for samples, aged in zip(self.clock.samples, self.clock.aged, strict=True):
            step = self._step(gains, tool, aged=aged)
            whole, offset = step @ whole, step @ offset
            for _ in range(samples):
                rows, past = rows + turn**-count * (row @ whole), past + turn**-count * (row @ offset)
                count += 1
                whole, offset = sample @ whole, sample @ offset
                offset[0] = turn**count
        state = np.linalg.solve(turn**count * np.eye(self.size) - whole, offset)
        return complex((rows @ state + past) / count)

    def tool_alone(self, tool: ToolState) -> FloatArray:
        """Return the map of a tool's position and velocity over a step without any coupling, shape (2, 2)."""
        nothing = np.zeros(self.size)
        return self._moved(ToolGains(0.0, 0.0), tool, nothing, nothing)[:, self._n + 2 : self._n + 4]

    def monodromy(self, gains: ToolGains, tools: Sequence[ToolState]) -> FloatArray:
        """Return the product of all maps over one period, shape (tools, devices, hands, size, size).

        Args:
            gains: of the coupling.
            tools: with their contacts.
        """
        loose, fixed = self._sample(gains), self._sample(gains, fixed=True)
        powers: dict[tuple[bool, int], FloatArray] = {}
        found = []
        for tool in tools:
            whole, steps = None, {}
            for samples, aged in zip(self.clock.samples, self.clock.aged, strict=True):
                key = (tool.fixed, samples)
                if key not in powers:
                    powers[key] = np.linalg.matrix_power(fixed if tool.fixed else loose, samples)
                if (samples, aged) not in steps:
                    steps[samples, aged] = powers[key] @ self._step(gains, tool, aged=aged)
                step = steps[samples, aged]
                whole = step if whole is None else step @ whole
            found.append(whole)
        return np.stack([one for one in found if one is not None])

    def paired(self, gains: ToolGains, tools: Sequence[ToolState]) -> FloatArray:
        """Return the product of all maps over one period with each plant's own tool, shape (plants, size, size).

        Args:
            gains: of the coupling.
            tools: one for each plant, all fixed or none.
        """
        sample = self._sample(gains, fixed=tools[0].fixed).reshape(-1, self.size, self.size)
        whole = np.eye(self.size)
        for samples, aged in zip(self.clock.samples, self.clock.aged, strict=True):
            steps = np.stack([self._step(gains, tool, aged=aged) for tool in tools])
            whole = np.linalg.matrix_power(sample, samples) @ steps @ whole
        return np.asarray(whole)

    def _seen(self, *, aged: bool) -> tuple[FloatArray, FloatArray]:
        """Return rows of position and velocity of the device at the newest sample."""
        now, before = (self._last, self._older) if aged else (self._measured, self._last)
        return now, (now - before) / self.sample_time_s

    def _sample(self, gains: ToolGains, *, fixed: bool = False) -> FloatArray:
        """Return the map over one sample of the device, shape (devices, hands, size, size)."""
        n, size = self._n, self.size
        force = self._force_row(gains, fixed=fixed)
        step = np.zeros((*self._matrix.shape[:-2], size, size))
        step[..., :n, :n] = self._matrix
        step[..., :n, :] += self._force[..., None] * force
        step[..., n, :] = self._measured
        step[..., n + 1, n] = 1.0
        kept = np.arange(n + 2, size)
        step[..., kept, kept] = 1.0
        return step

    def _force_row(self, gains: ToolGains, *, fixed: bool) -> FloatArray:
        """Return the force commanded by the device's loop, as a row of the state."""
        position, velocity = self._seen(aged=False)
        unit, k, b = np.eye(self.size), gains.stiffness_n_per_m, gains.damping_ns_per_m
        if self.engine.exchange == "held-force":
            force = unit[self._known]
        elif fixed:
            force = k * position + b * velocity
        else:
            force = k * (position - unit[self._known]) + b * (velocity - unit[self._known + 1])
        return np.asarray(force + gains.local_damping_ns_per_m * velocity)

    def _step(self, gains: ToolGains, tool: ToolState, *, aged: bool) -> FloatArray:
        """Return the map of one step of the engine, shape (size, size)."""
        n, known, unit = self._n, self._known, np.eye(self.size)
        position, velocity = self._seen(aged=aged)
        force = gains.stiffness_n_per_m * (position - self._tool_m) + gains.damping_ns_per_m * (
            velocity - self._tool_m_per_s
        )
        if tool.fixed:
            force = gains.stiffness_n_per_m * position + gains.damping_ns_per_m * velocity
        after = self._moved(gains, tool, position, velocity)
        step = unit.copy()
        step[n + 2 : n + 4] = after
        if self.engine.exchange == "held-force":
            handed = force[None]
        else:
            handed = after if self.engine.exchange == "ahead" else np.stack([self._tool_m, self._tool_m_per_s])
            if tool.fixed:
                handed = np.zeros_like(handed)
        width = len(handed)
        step[self.size - width :] = handed
        step[known : self.size - width] = unit[known + width : self.size]
        return step

    def _moved(self, gains: ToolGains, tool: ToolState, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return rows of the tool's position and velocity after a step, from the state before, shape (2, size)."""
        x, v, t = self._tool_m, self._tool_m_per_s, self.clock.step_s
        if tool.fixed:
            return np.zeros((2, self.size))
        m, drag = tool.mass_kg, tool.damping_ns_per_m + tool.contact_damping_ns_per_m
        k, b, k_c = gains.stiffness_n_per_m, gains.damping_ns_per_m, tool.contact_stiffness_n_per_m
        pull = k * (position - x) - k_c * x + b * velocity
        if self.engine.integrator == "implicit":
            after = (m * v + t * pull) / (m + t * (drag + b) + t**2 * (k + k_c))
        elif self.engine.integrator == "implicit-damping":
            after = (m * v + t * pull) / (m + t * (drag + b))
        else:
            after = v + t / m * (pull - (drag + b) * v)
        return np.stack([x + t * (v if self.engine.integrator == "explicit" else after), after])
