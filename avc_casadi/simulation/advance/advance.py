"""From one sample to the next: the device and the hand move while the force is held."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.plant import LinearPlant, transition
from avc_casadi.simulation.tick import Expr, Tick


def column(*symbols: Expr) -> Expr:
    """Stack symbols, in the order in which CasADi stores their entries."""
    import casadi as ca  # noqa: PLC0415

    return ca.veccat(*symbols) if symbols else ca.SX(0, 1)


@dataclass(frozen=True)
class Layout:
    """Structure of a plant: its entries that are nonzero for any hand."""

    states: int
    entries: tuple[tuple[int, int], ...]
    force_row: int
    target_row: int | None
    friction_n: float

    @classmethod
    def of(cls, plant: LinearPlant, friction_n: float) -> Layout:
        """Return the layout of a plant, of all hands."""
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


@dataclass(frozen=True)
class Drive:
    """Inputs of the plant between two samples."""

    force: Expr
    force_before: Expr
    late: Expr
    target: tuple[Expr, Expr] | None


class Advance(Protocol):
    """Propagation of the continuous part from one sample to the next."""

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the parameters and return the state one sample later."""

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the parameters for each hand, shape (..., p), in the order in which `step` adds them."""


@dataclass(frozen=True)
class Continuous(ABC):
    """A scheme on the plant's rates, over each stretch of constant force."""

    layout: Layout
    substeps: int

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the plant's numbers over one sample, shape (..., p)."""
        return self.layout.parameters(plant, sample_time_s)

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the plant's numbers and return the state one sample later."""
        plant = PlantSymbols(self.layout, tick)
        if drive.late is None:
            return self._through(plant, state, drive.force, drive.target, 1.0)
        middle = self._through(plant, state, drive.force_before, drive.target, drive.late)
        return self._through(plant, middle, drive.force, plant.moved(drive.target, drive.late), 1.0 - drive.late)

    @abstractmethod
    def _through(self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, duration: Expr) -> list[Expr]:
        """Return the state after a stretch, its duration a share of the sample."""


@dataclass(frozen=True)
class Stretch:
    """A part of the sample of constant force."""

    name: str
    begin: float
    share: float
    before: bool


def stretches(late: float) -> tuple[Stretch, ...]:
    """Return the parts of a sample whose new force arrives at `late`, the same share of every sample."""
    if late == 0:
        return (Stretch("", 0.0, 1.0, False),)
    return (Stretch("_before", 0.0, late, True), Stretch("", late, 1.0 - late, False))


@dataclass(frozen=True)
class MatrixExponential:
    """Linear plant whose force is held, or changes at a moment that is the same in every sample: exact to rounding."""

    substeps: int
    held: bool
    driven: bool
    late: float = 0.0

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the transition matrices and return the state one sample later."""
        import casadi as ca  # noqa: PLC0415

        x = ca.vertcat(*state)
        for stretch in stretches(self.late):
            x = self._through(tick, stretch, x, drive)
        return list(ca.vertsplit(x))

    def _through(self, tick: Tick, stretch: Stretch, x: Expr, drive: Drive) -> Expr:
        import casadi as ca  # noqa: PLC0415

        n, name = x.numel(), f"transition{stretch.name}"
        matrix = tick.parameter(name, ca.Sparsity.dense(n, n))
        of_force: Expr = tick.parameter(f"{name}_of_force", ca.Sparsity.dense(n, 1)) if self.held else None
        of_target: Expr = tick.parameter(f"{name}_of_target", ca.Sparsity.dense(n, 2)) if self.driven else None
        for substep in range(self.substeps):
            x = ca.mtimes(matrix, x)
            if self.held:
                x += of_force * (drive.force_before if stretch.before else drive.force)
            if drive.target is not None:
                position, velocity = drive.target
                elapsed = tick.sample_time_s * (stretch.begin + stretch.share * substep / self.substeps)
                x += ca.mtimes(of_target, ca.vertcat(position + velocity * elapsed if elapsed else position, velocity))
        return x

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the transition matrices, columns first, as CasADi stores them."""
        parts = []
        for stretch in stretches(self.late):
            moves = transition(plant, sample_time_s * stretch.share / self.substeps)
            parts.append(_columns_first(moves.matrix))
            if self.held:
                parts.append(moves.force)
            if self.driven:
                parts.append(_columns_first(moves.target))
        return np.concatenate(parts, axis=-1)


def _columns_first(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2).reshape(*matrix.shape[:-2], -1)
