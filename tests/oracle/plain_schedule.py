"""The schedule written plainly with casadi.Opti and IPOPT: sampled-data band problem, no delay, magnitude error.

Complex numbers are pairs, equations stand as in the paper, derivatives are CasADi's own. Nothing of the package but the
problem's numbers is used. In this model the ends of a band decide.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from avc_casadi.model.problem import Problem

Pair = tuple[Any, Any]


def _times(x: Pair, y: Pair) -> Pair:
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _series(x: Pair, y: Pair) -> Pair:
    total = x[0] + y[0], x[1] + y[1]
    scale = total[0] ** 2 + total[1] ** 2
    up = _times(_times(x, y), (total[0], -total[1]))
    return up[0] / scale, up[1] / scale


def perceived(problem: Problem, frequency_hz: float, damping: Any, stiffness: Any, wall: tuple[Any, Any]) -> Pair:
    """Z_h of a spring and damper in series with a wall, before the device; no coupling where damping is None."""
    t = problem.device.sample_time_s
    phi = np.pi * frequency_hz * t
    hold = np.cos(2 * phi), -np.sin(2 * phi)

    def joined(b: Any, k: Any) -> Pair:
        return b + k * t / 2, -k * t / 2 / np.tan(phi)

    rendered = joined(*wall) if damping is None else _series(joined(damping, stiffness), joined(*wall))
    felt = _times(hold, rendered)
    return problem.device.damping_ns_per_m + felt[0], 2 * problem.device.mass_kg / t * np.tan(phi) + felt[1]


class PlainSchedule:
    """The problem in Opti, with the environment's stiffness as a parameter."""

    def __init__(self, problem: Problem, floors: Any, **options: Any) -> None:
        self.problem, self.frequency = problem, problem.frequencies_hz()
        n, x = len(self.frequency), np.log(self.frequency)
        opti = self.opti = ca.Opti()
        self.states, self.stiffness = opti.variable(2, n), opti.parameter()
        environment, box = problem.environment, problem.coupling
        upper, lower = problem.boundaries.upper, problem.boundaries.lower
        desired = (
            (upper.damping_ns_per_m + lower.damping_ns_per_m) / 2,
            (upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2,
        )
        wall = environment.damping_ns_per_m, self.stiffness
        step = np.diff(x)
        weight = np.convolve(step, [0.5, 0.5])
        weight = weight / weight.sum()
        nyquist = 0.5 / problem.device.sample_time_s * (1 - 1e-9)
        beta, cost = problem.stability.band_factor, 0
        for stage, frequency in enumerate(self.frequency):
            b = ca.exp(self.states[0, stage]) - floors[0]
            k = ca.exp(self.states[1, stage]) - floors[1]
            z = perceived(problem, frequency, b, k, wall)
            target = np.hypot(*perceived(problem, frequency, None, None, desired))
            cost += weight[stage] * (1 - ca.sqrt(z[0] ** 2 + z[1] ** 2) / target) ** 2
            for end in (frequency / beta, min(frequency * beta, nyquist)):
                real = perceived(problem, end, b, k, wall)[0]
                opti.subject_to(real >= problem.stability.margin_ns_per_m)
            for state, ends in enumerate((box.damping_ns_per_m, box.stiffness_n_per_m)):
                low, high = (float(np.log(value + floors[state])) for value in ends)
                opti.subject_to(opti.bounded(low, self.states[state, stage], high))
            if stage:
                move = self.states[:, stage] - self.states[:, stage - 1]
                cost += problem.schedule.slope_penalty * ca.sumsqr(move) / step[stage - 1] / step.sum()
        opti.minimize(cost)
        opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", **options})

    def solve(self, start: Any, stiffness_n_per_m: float) -> tuple[Any, float]:
        """Return states (2, n) and cost."""
        self.opti.set_value(self.stiffness, stiffness_n_per_m)
        self.opti.set_initial(self.states, start)
        solution = self.opti.solve()
        return np.asarray(solution.value(self.states)), float(solution.value(self.opti.f))
