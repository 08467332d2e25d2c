"""Dry friction by projection: in each substep the constant friction that stops the device, or the largest there is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.plant import LinearPlant, transition
from avc_casadi.simulation.advance.advance import Continuous, Drive, MatrixExponential, PlantSymbols, Stretch, stretches
from avc_casadi.simulation.tick import Expr, Tick


@dataclass(frozen=True)
class RungeKutta(Continuous):
    """Explicit steps of equal length; friction neither sticks nor is its change of sign located."""

    def _through(self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, duration: Expr) -> list[Expr]:
        h = duration / self.substeps
        for _ in range(self.substeps):
            middle, end = plant.moved(target, h / 2), plant.moved(target, h)
            k1 = _rates(plant, state, force, target)
            k2 = _rates(plant, _ahead(state, k1, h / 2), force, middle)
            k3 = _rates(plant, _ahead(state, k2, h / 2), force, middle)
            k4 = _rates(plant, _ahead(state, k3, h), force, end)
            mean = [(a + 2 * (b + c) + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
            state, target = _ahead(state, mean, h), end
        return state


def _ahead(state: list[Expr], rates: list[Expr], h: Expr) -> list[Expr]:
    return [x + h * rate for x, rate in zip(state, rates, strict=True)]


def _rates(plant: PlantSymbols, state: list[Expr], force: Expr, target: Any) -> list[Expr]:
    import casadi as ca  # noqa: PLC0415

    rates = plant.rates(state, force, target)
    if plant.friction is not None:
        rates[1] -= plant.friction * ca.sign(state[1])
    return rates


@dataclass(frozen=True)
class Projected:
    """Implicit and free of events; exact while the device slides, of first order where it stops or breaks away.

    Attributes:
        substeps: equal steps a stretch.
        held: whether a force acts at all.
        driven: whether a hand moves the plant.
        late: when the new force arrives, as a share of the sample.
        friction_n: dry friction.
    """

    substeps: int
    held: bool
    driven: bool
    late: float
    friction_n: float

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the transition matrices and return the state one sample later."""
        for stretch in stretches(self.late):
            state = self._through(tick, stretch, state, drive)
        return state

    def _through(self, tick: Tick, stretch: Stretch, state: list[Expr], drive: Drive) -> list[Expr]:
        import casadi as ca  # noqa: PLC0415

        free = MatrixExponential(1, self.held, self.driven)
        inner = Tick(tick.sample_time_s * stretch.share / self.substeps, tick.start_m)
        now = [ca.SX.sym(f"x{index}") for index in range(len(state))]
        symbols = {name: ca.SX.sym(name) for name in ("force", "position", "velocity")}
        target = (symbols["position"], symbols["velocity"]) if self.driven else None
        moved = free.step(inner, now, Drive(symbols["force"] if self.held else None, None, None, target))
        parameters = [slot.symbol for slot in inner.parameters]
        substep = ca.Function("substep", [*now, *symbols.values(), *parameters], moved)
        held = [tick.parameter(f"{slot.name}{stretch.name}", slot.symbol.sparsity()) for slot in inner.parameters]
        of_friction = tick.parameter(f"transition_of_friction{stretch.name}", ca.Sparsity.dense(len(state), 1))
        force = drive.force_before if stretch.before else drive.force
        for index in range(self.substeps):
            elapsed = tick.sample_time_s * (stretch.begin + stretch.share * index / self.substeps)
            aim = (0.0, 0.0) if drive.target is None else (drive.target[0] + drive.target[1] * elapsed, drive.target[1])
            sliding = substep(*state, 0.0 if force is None else force, *aim, *held)
            stopping = -sliding[1] / of_friction[1]
            friction = ca.fmin(ca.fmax(stopping, -self.friction_n), self.friction_n)
            state = [x + of_friction[row] * friction for row, x in enumerate(sliding)]
            state[1] *= ca.fabs(stopping) > self.friction_n
        return state

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the transition matrices of each stretch, that of the friction last."""
        parts = []
        for stretch in stretches(self.late):
            step_s = sample_time_s * stretch.share / self.substeps
            parts.append(MatrixExponential(1, self.held, self.driven).parameters(plant, step_s))
            parts.append(transition(replace(plant, force=plant.friction), step_s).force)
        return np.concatenate(parts, axis=-1)
