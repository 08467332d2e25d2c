"""The classical Runge-Kutta method of fourth order, for comparison: dry friction as the sign of the velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from avc_casadi.loop import LinearPlant
from avc_casadi.scene.advance._advance import Drive
from avc_casadi.scene.advance._layout import Layout, PlantSymbols
from avc_casadi.scene.loop import Expr, Tick
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class RungeKutta:
    """Explicit steps of equal length; friction neither sticks nor is its change of sign located.

    Attributes:
        layout: the plant's numbers.
        substeps: steps a sample.
    """

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
