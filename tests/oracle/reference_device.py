"""The whole control tick in numpy single precision: what the firmware computes, bit for bit, for many devices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, Float32Array
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.simulation.emit import FloatProgram
from avc_casadi.simulation.runtime.observer import state_feedback_step
from avc_casadi.simulation.tick import Step
from avc_hardware.codegen.figures import BoardLimits, RuntimeFigures
from avc_hardware.codegen.tick_program import GAINS, RuntimeProgram, tick_numbers, tick_programs
from avc_hardware.link.table import TableImage, lookup

_f = np.float32
Columns = dict[str, Float32Array]
# Where an observer goes on believing in contact, a table takes over when the device was out of its wall for so long.
TICKS_AWAY = 10


def states_at_rest(
    states: tuple[str, ...], initial: tuple[tuple[float, float, float], ...], position_m: NDArray[Any]
) -> dict[str, NDArray[Any]]:
    """Return the states of a device that has always been at rest at a position, each of its shape and precision."""
    zero = np.zeros_like(position_m)
    found = {}
    for name, (middle, high, low) in zip(states, initial, strict=True):
        value = zero + zero.dtype.type(middle)
        if (high, low) == (middle + 1, middle - 1):
            value = position_m
        elif (high, low) == (middle + 1, middle):
            value = np.where(position_m > 0, position_m, zero)
        found[name] = value
    return found


@dataclass(frozen=True)
class Part:
    """A part of the tick, run in single precision with the numbers of some figures."""

    program: RuntimeProgram
    numbers: Float32Array

    def start(self, position_m: Float32Array) -> Columns:
        of_number = [(float(one),) * 3 for one in self.numbers]
        known = [of_number[int(x.removeprefix("number_"))] if isinstance(x, str) else x for x in self.program.initial]
        return states_at_rest(self.program.states, tuple(known), position_m)

    def __call__(self, states: Columns, inputs: Columns) -> tuple[Columns, Columns]:
        """Run one tick; returns the next states and the outputs."""
        part = self.program
        results = part.program(
            *(inputs[name] for name in part.inputs), *self.numbers, *(states[name] for name in part.states)
        )
        outputs = dict(zip(part.outputs, results, strict=False))
        return dict(zip(part.states, results[len(outputs) :], strict=True)), outputs


def runtime_programs(figures: RuntimeFigures) -> tuple[Part, ...]:
    """Return the parts of the tick: estimate, guard, and the coupling by either contact law."""
    numbers = tick_numbers(figures)
    return tuple(Part(part, numbers) for part in tick_programs(figures.estimator, figures.passive)[0])


@dataclass(frozen=True)
class ReferenceTick:
    """What one tick gives, each of shape (devices,)."""

    force_n: Float32Array
    frequency_hz: Float32Array
    lookup_hz: Float32Array
    gains: Float32Array


class ReferenceFeedback:
    """The step of an observer with state feedback in single precision, its matrices as parameters, for many devices."""

    def __init__(self, settings: StateFeedback, devices: int) -> None:
        """Start them."""
        step = state_feedback_step(settings)
        self._numbers = settings.numbers()
        self._states = np.zeros((len(step.states), devices), dtype=np.float32)
        self._program = FloatProgram(_scalars(step))

    def __call__(self, position_m: Float32Array, force_n: Float32Array) -> Float32Array:
        """Run one tick; returns the position that the wall sees, of the shape (devices,) of its inputs."""
        following, position = self._step(self._states, position_m, force_n)
        self._states = following
        return position

    def begun(self, position_m: Float32Array) -> Float32Array:
        """Return what the wall would see if the observer began here."""
        return self._step(np.zeros_like(self._states), position_m, np.zeros_like(position_m))[1]

    def restart(self, where: BoolArray) -> None:
        """Begin anew in some devices, of shape (devices,)."""
        self._states = np.where(where, np.float32(0), self._states)

    def _step(
        self, states: Float32Array, position_m: Float32Array, force_n: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        *following, position = self._program(*states, position_m, force_n, *self._numbers)
        return np.array([np.broadcast_to(value, position_m.shape) for value in following]), position


def _scalars(step: Step) -> Any:
    """Return a step as a function of scalars: states, inputs, parameters -> next states, outputs."""
    import casadi as ca  # noqa: PLC0415

    parts = [[ca.SX.sym(name) for name in names] for names in (step.states, step.inputs, step.parameters)]
    following, outputs = step.function(*(ca.veccat(*part) if part else ca.SX(0, 1) for part in parts))
    return ca.Function(step.name, [*parts[0], *parts[1], *parts[2]], ca.vertsplit(following) + ca.vertsplit(outputs))


@dataclass
class _Table:
    """A table, its observer, and the devices that run it, shape (devices,)."""

    table: TableImage
    feedback: ReferenceFeedback | None
    runs: BoolArray

    def out_of_wall(self, position_m: Float32Array) -> BoolArray:
        seen = position_m if self.feedback is None else self.feedback.begun(position_m)
        return (position_m <= 0) & (seen <= 0)


class ReferenceDevice:
    """Devices that are given the same tables, each with its own motion; the host is taken to be alive."""

    def __init__(self, figures: RuntimeFigures, limits: BoardLimits, devices: int) -> None:
        """Make devices without a table."""
        self._limits = limits
        estimate, guard, gated, clips = runtime_programs(figures)
        # By either contact law, where there are two.
        self._parts = {"estimate": (estimate, estimate), "guard": (guard, guard), "couple": (gated, clips)}
        self._states: dict[str, Columns] = {}
        self._force = np.zeros(devices, dtype=np.float32)
        self._contact = np.zeros(devices, dtype=np.bool_)
        self._tables: list[_Table] = []
        self._waits = np.zeros(devices, dtype=np.bool_)
        self._estimates = np.zeros(devices, dtype=np.bool_)

    def swap(self, table: TableImage) -> None:
        """Give a table that takes over from the next tick on, in each device as soon as it is out of contact."""
        if self._waits.any():
            raise ValueError(f"devices {np.flatnonzero(self._waits)} have not taken over the table before")
        devices = len(self._force)
        feedback = None if table.feedback is None else ReferenceFeedback(table.feedback, devices)
        self._tables = [one for one in self._tables if one.runs.any()]
        self._tables.append(_Table(table, feedback, np.zeros(devices, dtype=np.bool_)))
        self._waits = np.ones(devices, dtype=np.bool_)
        self._away = np.zeros(devices, dtype=np.intp)

    def tick(self, counts: NDArray[np.int32]) -> ReferenceTick:
        """Run one tick; ``counts`` are the encoders' positions, shape (devices,)."""
        x = counts.astype(np.float32) * _f(self._limits.metres_per_count)
        taken = self._take_over(x) if self._waits.any() else self._waits
        without = ~np.any([one.runs for one in self._tables], axis=0) if self._tables else np.ones(len(x), np.bool_)
        self._rest(without | taken, x)
        rest_hz = self._each(lambda one: one.rows[0, 0], 1.0)
        follows = without | (self._each(lambda one: one.varies) != 0)
        self._begin("estimate", follows & ~self._estimates, x)
        self._estimates = follows
        seen = self._run("estimate", {"position_m": x, "rest_hz": rest_hz})
        frequency = np.where(follows & (seen["valid"] != 0), seen["estimate_hz"], _f(np.nan))
        lookup_hz = np.where(follows, seen["frequency_hz"], rest_hz)
        wanted = np.zeros((len(x), 3), dtype=np.float32)
        y = x
        for one in self._tables:
            wanted = np.where(one.runs[:, np.newaxis], lookup(one.table.rows, lookup_hz), wanted)
            if one.feedback is not None:
                y = np.where(one.runs, one.feedback(x, self._force), y)
                self._begin("couple", taken & one.runs, y)
        inputs: Columns = {f"wanted_{name}": wanted[..., index] for index, name in enumerate(GAINS)}
        inputs |= {
            "position_m": y,
            "rest_stiffness_n_per_m": self._each(lambda one: one.rows[0, 2]),
            "wall_damping_ns_per_m": self._each(lambda one: one.wall_damping_ns_per_m),
            # nobody looks at the force of a device without a table
            "wall_stiffness_n_per_m": self._each(lambda one: one.wall_stiffness_n_per_m, 1.0),
            "relaxes": self._each(lambda one: one.varies),
        }
        made = self._run("couple", inputs)
        force = made["force_n"]
        self._contact = ~without & ((made["tool_m"] > 0) | (force > 0))
        guards = self._each(lambda one: one.guard) != 0
        before = self._states["guard"]
        guarded = self._run("guard", {"position_m": y, "force_n": force, "stored_j": made["stored_j"]})["guarded_n"]
        after = self._states["guard"]
        self._states["guard"] = {name: np.where(guards, after[name], before[name]) for name in before}
        force = np.where(without, _f(0), np.where(guards, guarded, force))
        most = np.minimum(self._each(lambda one: one.max_force_n or np.inf), _f(self._limits.max_force_n))
        force = np.where(force > most, most, np.where(force < -most, -most, force))
        self._states["couple"]["asked_force_n"] = force
        self._states["guard"]["held_force_n"] = force
        self._force = force
        gains = np.stack([np.where(without, _f(0), made[name]) for name in GAINS], axis=-1)
        return ReferenceTick(force, frequency, lookup_hz, gains)

    def _take_over(self, x: Float32Array) -> BoolArray:
        """Give the newest table to the devices that are out of contact and out of its wall; returns which took it."""
        newest = self._tables[-1]
        self._away = np.where(newest.out_of_wall(x), self._away + 1, 0)
        taken = self._waits & (self._away > 0) & (~self._contact | (self._away >= TICKS_AWAY))
        for one in self._tables[:-1]:
            one.runs = one.runs & ~taken
        newest.runs = newest.runs | taken
        if newest.feedback is not None:
            newest.feedback.restart(taken)
        self._waits = self._waits & ~taken
        return taken

    def _rest(self, where: BoolArray, x: Float32Array) -> None:
        for name in ("couple", "guard"):
            self._begin(name, where, x)

    def _begin(self, part: str, where: BoolArray, x: Float32Array) -> None:
        begun = self._by_law(*(one.start(x) for one in self._parts[part]))
        states = self._states.get(part, begun)
        self._states[part] = {name: np.where(where, begun[name], states[name]) for name in begun}

    def _each(self, number: Callable[[TableImage], float], without: float = 0.0) -> Float32Array:
        """Return a number of each device's table, shape (devices,)."""
        values = np.full(len(self._force), without, dtype=np.float32)
        for one in self._tables:
            values = np.where(one.runs, _f(number(one.table)), values)
        return values

    def _by_law(self, gated: Columns, clips: Columns) -> Columns:
        law = self._each(lambda one: one.clips_last) != 0
        return {name: np.where(law, clips[name], gated[name]) for name in gated}

    def _run(self, part: str, inputs: Columns) -> Columns:
        before = self._states[part]
        gated, clips = (one(before, inputs) for one in self._parts[part])
        self._states[part] = self._by_law(gated[0], clips[0])
        return self._by_law(gated[1], clips[1])
