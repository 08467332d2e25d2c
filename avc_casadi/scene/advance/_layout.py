"""The plant's equations as expressions: which numbers differ from 0, as parameters that a run sets for each hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi.loop import LinearPlant
from avc_casadi.scene.loop import Expr, Tick
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class Layout:
    """Where a plant has numbers that differ from 0 for any hand.

    Attributes:
        states: number of states.
        entries: rows and columns of A.
        force_row: the state on which the actuator acts.
        target_row: the velocity on which the hand's target acts; None without a hand.
        friction_n: dry friction; 0 for none.
    """

    states: int
    entries: tuple[tuple[int, int], ...]
    force_row: int
    target_row: int | None
    friction_n: float

    @classmethod
    def of(cls, plant: LinearPlant, friction_n: float) -> Layout:
        """Take the layout of a plant, of all hands."""
        hands = tuple(range(plant.matrix.ndim - 2))
        rows = np.flatnonzero(np.any(plant.target != 0, axis=(*hands, plant.target.ndim - 1)))
        return cls(
            states=plant.states,
            entries=tuple((int(i), int(j)) for i, j in np.argwhere(np.any(plant.matrix != 0, axis=hands))),
            force_row=int(np.flatnonzero(np.any(plant.force != 0, axis=hands))[0]),
            target_row=int(rows[0]) if len(rows) else None,
            friction_n=friction_n,
        )

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the numbers as changes in one sample, shape (..., p), in the order of `PlantSymbols`."""
        columns = [plant.matrix[..., row, column] for row, column in self.entries]
        columns.append(plant.force[..., self.force_row])
        if self.target_row is not None:
            columns += [plant.target[..., self.target_row, 0], plant.target[..., self.target_row, 1]]
        if self.friction_n > 0:
            columns.append(-self.friction_n * plant.friction[..., 1])
        return np.stack(columns, axis=-1) * sample_time_s


class PlantSymbols:
    """The numbers of a layout as parameters of a sample; time is counted in samples."""

    def __init__(self, layout: Layout, tick: Tick) -> None:
        self._sample_time_s = tick.sample_time_s
        self._entries = {entry: tick.parameter(f"plant_{entry[0]}_{entry[1]}") for entry in layout.entries}
        self._force = (layout.force_row, tick.parameter("plant_force"))
        self._target: Any = None
        if layout.target_row is not None:
            self._target = (layout.target_row, tick.parameter("plant_spring"), tick.parameter("plant_damper"))
        self.friction: Expr = tick.parameter("plant_friction") if layout.friction_n > 0 else None

    def moved(self, target: Any, share: Expr) -> Any:
        """Return the target a share of a sample later."""
        return None if target is None else (target[0] + target[1] * (self._sample_time_s * share), target[1])

    def rates(self, state: list[Expr], force: Expr, target: Any) -> list[Expr]:
        """Return the change of the state per sample, without dry friction."""
        rates = self.coupled(state)
        if force is not None:
            rates[self._force[0]] += self._force[1] * force
        if target is not None:
            row, spring, damper = self._target
            rates[row] += spring * target[0] + damper * target[1]
        return rates

    def coupled(self, state: list[Expr]) -> list[Expr]:
        """Return A times a state, per sample."""
        rates: list[Expr] = [0.0] * len(state)
        for (row, column), entry in self._entries.items():
            rates[row] += entry * state[column]
        return rates

    def driven(self, rates: list[Expr], target: Any) -> list[Expr]:
        """Add how the rates change because the target moves, per sample squared."""
        if target is not None:
            row, spring, _ = self._target
            rates[row] += spring * (target[1] * self._sample_time_s)
        return rates
