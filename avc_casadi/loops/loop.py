"""A sampled loop as one linear state with named blocks: events map it, their product over a period decides."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.plant import SampledPlant

Rows = NDArray[Any]
"""Linear forms of the state, shape (..., k, size), or (..., size) for a single one."""
Map = NDArray[Any]
"""From the state before an event to that after it, shape (..., size, size)."""


class Loop:
    """Named blocks of one state; leading axes of rows and maps run over corners, hands and contacts."""

    def __init__(self, **sizes: int) -> None:
        ends = np.cumsum([0, *sizes.values()]).tolist()
        self.size = ends[-1]
        self.at = {name: slice(*ends[place : place + 2]) for place, name in enumerate(sizes)}
        self.unit = np.eye(self.size)

    def __getitem__(self, name: str) -> Rows:
        """Return the rows of a block."""
        return self.unit[self.at[name]]

    def event(self, **new: Rows) -> Map:
        """Return the map that sets blocks to rows (..., k, size) of the state before, and keeps the others."""
        shape = np.broadcast_shapes(*(rows.shape[:-2] for rows in new.values()))
        step = np.empty((*shape, self.size, self.size), dtype=np.result_type(*new.values()))
        step[...] = self.unit
        for name, rows in new.items():
            step[..., self.at[name], :] = rows
        return step

    def queue(self, name: str, first: Rows) -> Rows:
        """Return the rows of a queue, newest entries first, into which `first` (..., k, size) is put."""
        rest = self[name][: len(self[name]) - first.shape[-2]]
        return np.concatenate([first, np.broadcast_to(rest, (*first.shape[:-2], *rest.shape))], axis=-2)

    def rests(self, *bodies: dict[str, Any]) -> FloatArray:
        """Return the states at which each body rests one metre on, from values of its blocks, then all of them."""
        states = np.zeros((len(bodies), self.size))
        for state, blocks in zip(states, bodies, strict=True):
            for name, value in blocks.items():
                state[self.at[name]] = value
        return states if len(states) == 1 else np.append(states, states.sum(axis=0, keepdims=True), axis=0)


def period(events: Sequence[Map]) -> Map:
    """Return the map over all events, the first one first."""
    whole = events[0]
    for event in events[1:]:
        whole = event @ whole
    return whole


def turn_of(frequency_hz: float, sample_time_s: float) -> complex:
    """Return the factor by which an oscillation turns in a sample."""
    return cmath.exp(2j * math.pi * frequency_hz * sample_time_s)


def response(events: Sequence[Map], reads: Sequence[Rows | None], turn: complex) -> complex:
    """Return what is read per unit of a first state that turns by a factor at every read, averaged over a period.

    `events` are the maps of a period, `reads` the row that is read before each or None, and `turn` the factor exp(j
    omega T) by which `Body.motion_source`, the first state, moves.
    """
    whole = period(events)
    count = sum(read is not None for read in reads)
    inner = turn**count * np.eye(len(whole) - 1) - whole[1:, 1:]
    state = np.append(1.0, np.linalg.solve(inner, whole[1:, 0]))
    total = 0.0 + 0.0j
    sample = 0
    for event, read in zip(events, reads, strict=True):
        if read is not None:
            total += turn**-sample * (read @ state)
            sample += 1
        state = event @ state
    return complex(total / count)


@dataclass(frozen=True, eq=False)
class Body:
    """A sampled plant with its forces under way; velocities are counted by the sample, which keeps digits."""

    a: NDArray[Any]
    b: FloatArray
    output_row: FloatArray
    sample_time_s: float
    names: tuple[str, ...]
    force_row: FloatArray | None = None

    @classmethod
    def of(cls, plant: SampledPlant) -> Self:
        """Return the bodies of a sampled plant, leading axes (devices, hands), with the forces on their way as states.

        Velocities are scaled by T to lengths, which keeps digits.
        """
        a, b = plant.with_forces_under_way()
        scale = np.ones(b.shape[-1])
        scale[: len(plant.names)] = [plant.sample_time_s if state.endswith("_per_s") else 1.0 for state in plant.names]
        output_row = np.pad(plant.output_row, (0, len(scale) - len(plant.output_row)))
        force_row = plant.force_row
        if force_row is not None:
            unused = np.zeros((*force_row.shape[:-1], len(scale) - force_row.shape[-1]))
            force_row = np.concatenate([force_row, unused], axis=-1) / scale
        return cls(a * scale[:, None] / scale, b * scale, output_row, plant.sample_time_s, plant.names, force_row)

    @classmethod
    def motion_source(cls, sample_time_s: float, turn: complex = 1.0) -> Self:
        """Return a device in imposed motion: its one state is its position, which turns by a factor each sample."""
        return cls(np.full((1, 1), turn), np.zeros(1), np.ones(1), sample_time_s, ("device_position_m",))

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.output_row)

    @property
    def shift(self) -> FloatArray:
        """The state with all positions one metre on."""
        shift = [float(name.endswith("_position_m")) for name in self.names]
        return np.pad(shift, (0, self.size - len(shift)))

    def row(self, name: str) -> FloatArray:
        """Return the row of a state in its own unit, shape (n,)."""
        unit = 1 / self.sample_time_s if name.endswith("_per_s") else 1.0
        return np.pad([unit * (state == name) for state in self.names], (0, self.size - len(self.names)))

    def axes(self, *index: Any) -> Self:
        """Return the body with its leading axes indexed."""
        force_row = None if self.force_row is None else self.force_row[index]
        return type(self)(self.a[index], self.b[index], self.output_row, self.sample_time_s, self.names, force_row)

    def flat(self) -> Self:
        """Return the body with one leading axis."""
        n = self.size
        shape = self.a.reshape(-1, n, n), self.b.reshape(-1, n)
        force_row = None if self.force_row is None else self.force_row.reshape(-1, n)
        return type(self)(*shape, self.output_row, self.sample_time_s, self.names, force_row)

    @property
    def measured(self) -> FloatArray:
        """What a law reads, rows (..., m, n): the position, then the force of a sensor where there is one."""
        if self.force_row is None:
            return self.output_row[None]
        return np.stack(np.broadcast_arrays(self.output_row, self.force_row), axis=-2)

    def next_state(self, state: Rows, force: Rows) -> Rows:
        """Return the rows of the next state, from those of the state (n, size) and of the force (..., size)."""
        return np.asarray(self.a @ state + self.b[..., None] * force[..., None, :])
