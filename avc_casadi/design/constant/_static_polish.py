"""What the search of `static` hands to the polish: its condition frequency by frequency, and its cost."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.joint import fitted_quadratic
from avc_casadi.loop import abs2, coupling_impedance, loop_at, margin_over_range
from avc_casadi.support import FloatArray, IndexArray

if TYPE_CHECKING:
    from avc_casadi.design.constant._static_search import StaticSearch
    from avc_casadi.design.joint import Evaluate
    from avc_casadi.loop import Loop

# Shares of the Nyquist frequency at which the condition is fitted; the exact check sees what lies between them.
_SHARES = np.unique(np.concatenate((np.geomspace(1e-5, 0.1, 20), np.linspace(0.02, 1 - 1e-9, 50))))
_LARGEST = 1e9


@dataclass(frozen=True)
class StaticBounds:
    """The condition as columns that must not be positive: what it lacks at some frequencies, and at the worst of all.

    Attributes:
        search: its points, (m, d), are taken here as (d, m).
    """

    search: StaticSearch
    most = 0.0
    """What is lacking must not be positive."""
    held = 20
    """How many frequencies the polish looks at: several may decide together."""

    @property
    def low(self) -> FloatArray:
        """Lower ends of the points, (d,)."""
        return np.zeros(len(self.search.low))

    @property
    def high(self) -> FloatArray:
        """Upper ends, (d,)."""
        return np.ones(len(self.search.low))

    @property
    def smooth(self) -> IndexArray:
        """Positions of the single frequencies."""
        return np.arange(len(_SHARES))

    @cached_property
    def _loop(self) -> Loop:
        problem = self.search.problem.changed(stability={"model": self.search.loop.model})
        return loop_at(problem, _SHARES * self.search.loop.nyquist_hz)

    def at(self, points: FloatArray, some: IndexArray | None = None) -> FloatArray:
        """What is lacking, N.s/m, (m, h), at points (d, m)."""
        b, k, contact = (gain[:, None] for gain in self.search.gains(points.T))
        loop = self._loop if some is None else self._loop.rows(some)
        if self.search.condition == "all":
            margin = loop.perceived(b, k, contact).real
        else:
            coupling = coupling_impedance(loop.angle, b, k)
            resistance = np.where(coupling.real > 0, coupling.real, 1.0)
            loss = (np.abs(loop.hold) - loop.hold.real) / 2 * abs2(coupling) / resistance
            margin = loop.device.real + contact * loop.hold.real - loss
        lacking = margin_over_range(self.search.problem) - margin
        if some is None:
            lacking = np.concatenate((lacking, -self.search.slack(points.T)[:, None]), axis=1)
        return np.asarray(np.clip(lacking, -_LARGEST, _LARGEST))


@dataclass(frozen=True)
class StaticGoal:
    """The cost of constant gains; a quadratic stands for it within a window, as for the condition.

    Attributes:
        search: knows the cost.
        scale: what costs are counted in, so that what is nearly free is told from what is free.
    """

    search: StaticSearch
    scale: float

    def value(self, points: FloatArray, stage: IndexArray) -> FloatArray:  # noqa: ARG002 - one goal for all
        """Cost (m, s) at points (d, m, s)."""
        d, m, s = points.shape
        return self.search.errors(points.reshape(d, -1).T).reshape(m, s) / self.scale

    def window(self, centre: FloatArray, half: FloatArray, stage: IndexArray) -> tuple[Evaluate, Evaluate]:
        """Return the fitted cost at points of windows, twice: its valleys are its own."""
        fitted = fitted_quadratic(
            lambda at: self.value(centre[:, :, None] + half[:, :, None] * at, stage), *centre.shape
        )
        return fitted, fitted
