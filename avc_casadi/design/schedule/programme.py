"""The schedule as one sparse NLP: a stage in CasADi by the equations of the paper, mapped over the frequencies."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.design.schedule.hands import HandsTable
from avc_casadi.design.schedule.scope import (
    REALISM_ROWS,
    Slots,
    deciding_corners,
    realism_slack,
    realism_values,
    relative_bounds,
    worst_slack,
)
from avc_casadi.design.schedule.states import States
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import Loop, loop_at
from avc_casadi.paper.numbers import ComplexExpr, Real, abs2, casadi_numbers
from avc_casadi.paper.realism import relative_errors
from avc_casadi.paper.rows import GainArrays

_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 400,
    # The starts are good: a larger barrier pushes them out of their basin, often into a worse one.
    "ipopt.mu_init": 1e-6,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
}
BACKOFF, _HANDS_BACKOFF = 1e-7, 1e-6
"""Backoff of the NLP from scope and realism, and in spectral radius, so that its tolerance never violates them."""
_TINY = 1e-30
"""Keeps the gradient of a root finite at 0."""


@dataclass(frozen=True)
class Solution:
    """States (d, n), their cost, infinite after a failure, and what each stage lacks where that was minimised."""

    states: FloatArray
    cost: float
    failure: str = ""
    short: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Programme:
    """A schedule problem in numbers, and its NLP."""

    problem: Problem
    frequency_hz: FloatArray
    states: States
    hands: HandsTable | None
    constant: bool = False
    elastic: str = ""

    @classmethod
    def of(cls, problem: Problem, *, constant: bool = False) -> Programme:
        """Return the programme of a problem at its frequencies, which increase."""
        frequency = problem.frequencies_hz()
        states = States.of(problem, loop_at(problem, frequency))
        hands = HandsTable.of(problem, states) if problem.stability.scope == "hands" else None
        return cls(problem, frequency, states, hands, constant=constant)

    @cached_property
    def loop(self) -> Loop:
        """The loop at the stages."""
        return loop_at(self.problem, self.frequency_hz)

    @cached_property
    def scale_ns_per_m(self) -> FloatArray:
        """Scale of Re Z_h at each stage, (n,): the size of its terms."""
        target = np.asarray(self.loop.target)
        return np.asarray(self.problem.device.damping_ns_per_m + np.abs(target.real) + 1e-3 * np.abs(target))

    @property
    def tolerance(self) -> float:
        """Backoff of each stage from its scope, in the scale of Re Z or in spectral radius."""
        return BACKOFF if self.hands is None else _HANDS_BACKOFF

    @cached_property
    def log_frequency(self) -> FloatArray:
        """ln(omega) up to a constant, (n,)."""
        return np.asarray(np.log(self.frequency_hz))

    @cached_property
    def weight(self) -> FloatArray:
        """Trapezoidal weights over ln(omega), a tenth outside the interaction frequencies; they sum to 1."""
        x = self.log_frequency
        weight = np.ones(1) if len(x) == 1 else np.convolve(np.diff(x), [0.5, 0.5])
        interaction = self.problem.schedule.interaction_hz
        if interaction is not None:
            inside = (self.frequency_hz >= interaction[0]) & (self.frequency_hz <= interaction[1])
            weight = np.where(inside, weight, 0.1 * weight)
        return np.asarray(weight / weight.sum())

    @property
    def slope_limit(self) -> float:
        """Largest |d sigma/d ln(omega)|."""
        limit = self.problem.schedule.slope_limit
        return np.inf if limit is None else limit

    def errors(self, gains: GainArrays) -> FloatArray:
        """Return squared error and cost of b_p at each stage, for gains (..., n) or (..., 1)."""
        goal, target = self.problem.realism, np.asarray(self.loop.target)
        error = relative_errors(self.loop.perceived(*gains), target, goal.objective, goal.jnd)
        return np.asarray(error**2 + self.problem.schedule.contact_damping_penalty * (gains[2] / np.abs(target)) ** 2)

    def cost_of(self, path: FloatArray) -> float:
        """Return the NLP's objective at states (d, n)."""
        goal = float(self.errors(self.states.gains(path)) @ self.weight)
        if self.constant or path.shape[1] == 1:
            return goal
        step = np.diff(self.log_frequency)
        roughness = float((np.diff(path, axis=1) ** 2 / step).sum() / step.sum())
        return goal + self.problem.schedule.slope_penalty * roughness

    def spare(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what states (d, n) leave of the scope, exactly, in the unit of `tolerance`, and of realism."""
        gains = self.states.gains(path)
        slack = worst_slack(self.problem, self.frequency_hz, gains).slack
        real = realism_slack(self.problem, self.loop, gains)
        return slack if self.hands is not None else slack / self.scale_ns_per_m, real

    def at(self, rows: BoolArray) -> Programme:
        """Return the programme of some stages."""
        return replace(self, frequency_hz=self.frequency_hz[rows])

    def solve(self, slots: Slots, backoff: FloatArray, start: FloatArray) -> Solution:
        """Solve from states (d, n)."""
        d, n = start.shape
        free = 1 if self.constant else n
        low, high = (np.repeat(end[:, None], free, axis=1) for end in (self.states.low, self.states.high))
        begin = np.clip(start[:, :free], low, high)
        margin = self.problem.stability.margin_ns_per_m / self.scale_ns_per_m
        bounded = [margin + backoff[0]] * len(slots.frequency_hz)
        bounded += [backoff[1]] * REALISM_ROWS[self.problem.realism.require]
        bounded += [backoff[0]] * (self.hands is not None)
        least = np.array(bounded).reshape(-1, n)
        slopes = np.full(d * (n - 1) if self._steep else 0, self.slope_limit)
        lacking = np.full(n if self.elastic else 0, self.tolerance)
        given = (self.frequency_hz, self.scale_ns_per_m, *relative_bounds(self.problem, self.loop), *slots.frequency_hz)
        # CasADi warns of the evaluation interrupted by Ctrl-C; other faults show in the exact checks.
        with contextlib.redirect_stderr(io.StringIO()):
            result = self._solver(
                x0=np.concatenate((begin.ravel("F"), 1 + lacking)),
                p=np.array(given),
                lbx=np.concatenate((low.ravel("F"), -2 * lacking)),
                ubx=np.concatenate((high.ravel("F"), np.inf + lacking)),
                lbg=np.concatenate((least.ravel("F"), -slopes)),
                ubg=np.concatenate((np.full(least.size, np.inf), slopes)),
            )
        stats, found = self._solver.stats(), result["x"].full()[:, 0]
        if stats["return_status"] == "NonIpopt_Exception_Thrown":  # which Ctrl-C is to IPOPT
            raise KeyboardInterrupt
        states = found[: d * free].reshape((d, free), order="F")
        cost, failure = (float(result["f"]), "") if stats["success"] else (np.inf, str(stats["return_status"]))
        return Solution(np.repeat(states, n // free, axis=1), cost, failure, found[d * free :])

    @property
    def _steep(self) -> bool:
        """Whether slopes are limited."""
        return np.isfinite(self.slope_limit) and len(self.frequency_hz) > 1 and not (self.constant or self.elastic)

    def _stage(self, slots: int) -> Any:
        """Return (sigma, parameters) -> cost, margins: Re Z_h of each slot over its scale, then realism's values."""
        problem, goal = self.problem, self.problem.realism
        sigma, given = ca.SX.sym("sigma", len(self.states.floors)), ca.SX.sym("given", 4 + slots)
        frequency, scale, *bounds = ca.vertsplit(given[:4])
        gains = [ca.exp(state) - floor for state, floor in zip(ca.vertsplit(sigma), self.states.floors, strict=True)]
        b, k, contact = (*gains, ca.SX(0))[:3]
        numbers = casadi_numbers()
        loop = loop_at(problem, frequency, numbers)
        z, target = loop.perceived(b, k, contact), loop.target
        cost = _error(goal.objective, z, target, goal.jnd)
        cost += problem.schedule.contact_damping_penalty * contact * contact / abs2(target)
        corner = deciding_corners(problem)[0]
        margins = [
            loop_at(corner, given[4 + slot], numbers).perceived(b, k, contact).real / scale for slot in range(slots)
        ]
        margins += realism_values(problem, z, target, bounds)
        return ca.Function("stage", [sigma, given], [cost, ca.vertcat(ca.SX(0, 1), *margins)], {"cse": True})

    @cached_property
    def _solver(self) -> Any:
        """IPOPT, with the frequencies of the scopes as parameters."""
        slots = len(Slots.of(self.problem, self.frequency_hz).frequency_hz)
        d, n = len(self.states.floors), len(self.frequency_hz)
        x, given = ca.MX.sym("x", d, 1 if self.constant else n), ca.MX.sym("given", 4 + slots, n)
        sigma = ca.repmat(x, 1, n) if self.constant else x
        cost, margins = self._stage(slots).map(n)(sigma, given)
        if self.hands is not None:
            margins = ca.vertcat(margins, self.hands.spline.map(n)(sigma))
        short = ca.MX.sym("short", 1, n if self.elastic else 0)
        if self.elastic:
            rows = np.zeros(margins.shape[0])
            rows[slots : slots + REALISM_ROWS[self.problem.realism.require]] = 1.0
            margins += ca.mtimes(ca.DM(rows if self.elastic == "realism" else 1 - rows), short)
            nlp = {"x": ca.veccat(x, short), "f": ca.sum2(short), "g": ca.vec(margins), "p": given}
            return ca.nlpsol("shortest", "ipopt", nlp, _OPTIONS)
        goal, limits = ca.dot(cost, ca.DM(self.weight).T), []
        if n > 1 and not self.constant:
            step, move = ca.repmat(ca.DM(np.diff(self.log_frequency)).T, d), x[:, 1:] - x[:, :-1]
            goal += self.problem.schedule.slope_penalty / np.ptp(self.log_frequency) * ca.dot(move, move / step)
            limits = [ca.vec(move / step)] if self._steep else []
        nlp = {"x": ca.vec(x), "f": goal, "g": ca.vertcat(ca.vec(margins), *limits), "p": given}
        return ca.nlpsol("schedule", "ipopt", nlp, _OPTIONS)


def _error(objective: str, z: ComplexExpr, target: ComplexExpr, noticeable: Real) -> Real:
    """Return the squared relative error of Z_h: of its magnitude, complex, or of its noticeable part."""
    error2 = abs2(z - target) / abs2(target)
    if objective == "magnitude":
        return (1 - ca.sqrt(abs2(z) / abs2(target) + _TINY)) ** 2
    if objective == "complex":
        return error2
    return (ca.sqrt(ca.fmax(error2 / noticeable**2, 1.0)) - 1) ** 2
