"""A schedule problem in numbers: stages, states, costs, constraints and their scales."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.design.schedule.hands import hands_spline
from avc_casadi.design.schedule.nlp import Data
from avc_casadi.design.schedule.scope import REALISM_BACKOFF, REALISM_ROWS, Slots, loop_parameters, relative_bounds
from avc_casadi.design.schedule.stage import stage_functions
from avc_casadi.design.schedule.states import States
from avc_casadi.model.problem import Problem
from avc_casadi.paper.loop import Loop, loop_at

_BACKOFF = 1e-7
"""Backoff of the NLP from the margin, in the scale of Re Z, so that its tolerance never violates it."""
_HANDS_BACKOFF = 1e-6
"""The same for 1 - spectral radius."""
_MISS = 1e3
"""Cost in the lattice of violating a constraint by its scale: far above any error."""


@dataclass(frozen=True)
class Task:
    """Common input of all steps of the solution.

    Attributes:
        problem: the problem.
        frequency_hz: stages, (n,).
        loop: the loop at the stages.
        states: map between gains and states.
        scale_ns_per_m: scale of the constraints on Re Z_h at each stage, (n,).
        hands: sigma -> 1 - spectral radius, for scope hands; else None.
        objective: error that is minimised: the problem's, or tied, the magnitude with a small share of the rest.
        weight: of the whole goal; a large one tightens the solver's tolerance.
        constant: whether the gains may not vary with frequency.
    """

    problem: Problem
    frequency_hz: FloatArray
    loop: Loop
    states: States
    scale_ns_per_m: FloatArray
    hands: Any
    objective: str
    weight: float = 1.0
    constant: bool = False

    @classmethod
    def of(
        cls,
        problem: Problem,
        frequency_hz: FloatArray | None = None,
        *,
        objective: str | None = None,
        constant: bool = False,
    ) -> Task:
        """Return the task, with everything evaluated that does not depend on the gains.

        Args:
            problem: the problem.
            frequency_hz: stages, (n,), increasing; None are the problem's frequencies.
            objective: error that is minimised; None is the problem's.
            constant: whether the gains may not vary with frequency.
        """
        frequency = problem.frequencies_hz() if frequency_hz is None else frequency_hz
        loop = loop_at(problem, frequency)
        states = States.of(problem, loop)
        hands = hands_spline(problem, states) if problem.stability.scope == "hands" else None
        objective = objective or problem.realism.objective
        return cls(problem, frequency, loop, states, _scale(problem, loop), hands, objective, constant=constant)

    def at(self, frequency_hz: FloatArray) -> Task:
        """Return the same problem with other stages, (m,), and the same states and hands."""
        loop = loop_at(self.problem, frequency_hz)
        return replace(self, frequency_hz=frequency_hz, loop=loop, scale_ns_per_m=_scale(self.problem, loop))

    @property
    def log_frequency(self) -> FloatArray:
        """ln(omega) up to a constant, (n,)."""
        return np.asarray(np.log(self.frequency_hz))

    @property
    def tolerance(self) -> float:
        """Backoff of each stage from its scope, in the unit of `backoff`."""
        return _BACKOFF if self.hands is None else _HANDS_BACKOFF

    def backoff(self, dropped: BoolArray, tight: BoolArray) -> FloatArray:
        """Return the backoff of each stage from its scope and from its realism, (2, n).

        The first in the scale of Re Z, or in spectral radius for scope hands; the second in that of `realism_slack`.

        Args:
            dropped: stages without constraints, (n,): -inf for both.
            tight: stages whose scope has no interior, (n,): no backoff from it.
        """
        inside = np.array([np.where(tight, 0.0, self.tolerance), np.full(len(tight), REALISM_BACKOFF)])
        return np.where(dropped, -np.inf, inside)

    def data(self, slots: Slots, backoff: FloatArray) -> Data:
        """Return the data of the NLP; ``backoff`` (2, n) as in `backoff`."""
        settings = self.problem.schedule
        if self.hands is None:
            least = self.problem.stability.margin_ns_per_m / self.scale_ns_per_m + backoff[0]
            least, parameters = np.repeat(least[None], len(slots.frequency_hz), axis=0), slots.parameters(self.problem)
        else:
            least, parameters = backoff[:1], np.empty((0, len(self.frequency_hz)))
        n = len(self.frequency_hz)
        low, high = (np.repeat(end[:, None], n, axis=1) for end in (self.states.low, self.states.high))
        real = np.repeat(backoff[1:], REALISM_ROWS[self.problem.realism.require], axis=0)
        return Data(
            cost=self._cost_parameters(),
            slots=parameters,
            weight=self._weight(),
            step=np.diff(self.log_frequency),
            slope_penalty=settings.slope_penalty,
            slope_limit=np.inf if settings.slope_limit is None else settings.slope_limit,
            least=np.concatenate((least, real) if self.hands is None else (real, least)),
            low=low,
            high=high,
            constant=self.constant,
            require=self.problem.realism.require,
        )

    def _weight(self) -> FloatArray:
        """Return trapezoidal weights over ln(omega), a tenth outside the interaction frequencies; they sum to 1."""
        x = self.log_frequency
        weight = np.ones(1) if len(x) == 1 else np.convolve(np.diff(x), [0.5, 0.5])
        interaction = self.problem.schedule.interaction_hz
        if interaction is not None:
            inside = (self.frequency_hz >= interaction[0]) & (self.frequency_hz <= interaction[1])
            weight = np.where(inside, weight, 0.1 * weight)
        return np.asarray(weight / weight.sum() * self.weight)

    def _cost_parameters(self) -> FloatArray:
        target = self.loop.target
        floors = np.append(self.states.floors, 1.0)[:3]
        constants = (
            *floors,
            self.scale_ns_per_m,
            self.problem.schedule.contact_damping_penalty,
            self.problem.realism.jnd,
            *relative_bounds(self.problem, self.loop),
        )
        rows = np.broadcast_arrays(target.real, target.imag, *constants)
        return np.concatenate((loop_parameters(self.loop), np.array(rows, dtype=np.float64)))

    def lattice_costs(self, data: Data, first_miss: float = 0.0) -> Callable[[FloatArray], Callable[[int], FloatArray]]:
        """Return states (d, m) -> stage -> cost of each, (m,), with a penalty for violated constraints.

        Args:
            data: those of many slots (`Slots.of` with ``spread``), so that little of the scope is missed.
            first_miss: cost of any violation.
        """
        size = data.size(self.objective)
        functions = stage_functions(size.objective, size.states, 0, size.require)
        margins = stage_functions(size.objective, size.states, size.slots, "none").margins
        # These scopes are the same at all stages, except for the scale of Re Z_h.
        common = self.problem.stability.scope in {"all", "hands"}

        def at(nodes: FloatArray) -> Callable[[int], FloatArray]:
            def scope(stage: int) -> FloatArray:
                if self.hands is not None:
                    return np.asarray(data.least[-1:, stage, None] - self.hands(nodes).full())
                missed = margins(nodes, data.cost[:, stage], data.slots[:, stage]).full()
                return np.asarray(data.least[: size.slots, stage, None] - missed)

            once = np.maximum(0.0, scope(0)).sum(axis=0) if common and size.stages else None

            def cost(stage: int) -> FloatArray:
                own = functions.cost(nodes, data.cost[:, stage]).full()[0]
                if once is None:
                    missed = np.maximum(0.0, scope(stage)).sum(axis=0)
                elif self.hands is not None:
                    missed = once
                else:
                    missed = once * self.scale_ns_per_m[0] / self.scale_ns_per_m[stage]
                if size.require != "none":
                    real = functions.margins(nodes, data.cost[:, stage], data.slots[:0, stage]).full()
                    first = 0 if self.hands is not None else size.slots
                    least = data.least[first : first + len(real), stage, None]
                    missed = missed + np.maximum(0.0, least - real).sum(axis=0)
                total: FloatArray = own + _MISS * missed + np.where(missed > 0, first_miss, 0.0)
                return total

            return cost

        return at

    def cost_of(self, data: Data, path: FloatArray) -> float:
        """Return the NLP's objective at states (d, n)."""
        cost = stage_functions(self.objective, len(path), 0, self.problem.realism.require).cost
        goal = float(cost(path, data.cost).full()[0] @ data.weight)
        if self.constant or path.shape[1] == 1:
            return goal
        roughness = float((np.diff(path, axis=1) ** 2 / data.step).sum() / data.step.sum())
        return goal + data.slope_penalty * roughness


def _scale(problem: Problem, loop: Loop) -> FloatArray:
    """Return the scale of Re Z_h at each stage, N.s/m: the size of its terms."""
    target = np.asarray(loop.target)
    return np.asarray(problem.device.damping_ns_per_m + np.abs(target.real) + 1e-3 * np.abs(target))
