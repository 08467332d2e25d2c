"""Stable springs and dampers to a virtual tool: K against B, a curve for each engine rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain_table
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.design.virtual_tool import Scale, ToolSearch, edge
from avc_casadi.loops.engine import ToolLoops, tool_of
from avc_casadi.model.ends import LONGEST_STEP_S, ToolGains
from avc_casadi.model.problem import Problem

# Dampers B that are drawn: from this share of the heaviest, less rounding.
_LIGHTEST_SHARE = 0.999e-3
# Two steps of an engine within this share are one curve.
_SAME_STEP = 0.1
# Bounds of K: this share of m/T_s^2 with the engine's step T_s, and this multiple of m/T^2 with the device's T.
_SOFTEST_SHARE = 1e-3
_STIFFEST_RATIO = 10
# Ratio of two stiffnesses between which a limit is not bisected any further.
_PRECISION = 1.02
# Searches of the ranges of one curve, and the share of its highest limit at which one looks for a counterexample.
_SEARCHES = 20
_BELOW_LIMIT = 0.98


@dataclass(frozen=True, eq=False)
class ToolCurve:
    """Largest stable K at each B with an engine's step.

    Attributes:
        step_s: the engine's step, s.
        declared: whether it is the one of the problem.
        stiffness_n_per_m: largest stable K at each damper of the region, shape (n,).
        stiffest: the stiffest stable coupling over all dampers; None where it was not searched.
    """

    step_s: float
    declared: bool
    stiffness_n_per_m: FloatArray
    stiffest: ToolGains | None


@dataclass(frozen=True, eq=False)
class ToolRegion:
    """The K-B region of a coupling to a simulation: with every hand, released, and every tool and contact.

    Attributes:
        problem: name of the problem.
        damping_ns_per_m: dampers B of the curves, shape (n,).
        local_damping_ratio: damping ratio of the released device with the damper of its own loop; 0 without one.
        curves: one for each step of an engine.
        units: units of the problem.
    """

    problem: str
    damping_ns_per_m: FloatArray
    local_damping_ratio: float
    curves: tuple[ToolCurve, ...]
    units: Units = LINEAR

    def document(self) -> dict[str, Any]:
        """Return the `zwidth` document: JSON values only."""
        return plain_table(
            {
                "problem": self.problem,
                "damping_ns_per_m": self.damping_ns_per_m,
                "local_damping_ratio": self.local_damping_ratio,
                "curves": [
                    {
                        "step_s": curve.step_s,
                        "declared": curve.declared,
                        "stiffness_n_per_m": curve.stiffness_n_per_m,
                        "rate_hz": 1 / curve.step_s,
                        **_stiffest(curve.stiffest),
                    }
                    for curve in self.curves
                ],
            }
        )


def _stiffest(gains: ToolGains | None) -> dict[str, float | None]:
    """Return the stiffest coupling of a curve as JSON values, null where there is none."""
    if gains is None or gains.stiffness_n_per_m == 0:
        return {"stiffest_n_per_m": None, "stiffest_with_ns_per_m": None, "stiffest_with_local_ns_per_m": None}
    return {
        "stiffest_n_per_m": gains.stiffness_n_per_m,
        "stiffest_with_ns_per_m": gains.damping_ns_per_m,
        "stiffest_with_local_ns_per_m": gains.local_damping_ns_per_m,
    }


def tool_region(
    problem: Problem,
    progress: Progress = SILENT,
    *,
    rates: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0),
    summits: bool = True,
) -> ToolRegion:
    """Return the largest stable K, to 2 %, at each damper, for the engine's step and faster and slower ones.

    Args:
        problem: a problem with [simulation].
        progress: reported over the curves.
        rates: steps of an engine, as multiples of the declared one, rounded to whole samples of the device.
        summits: whether the stiffest coupling over all dampers is searched too.
    """
    tool = tool_of(problem)
    t = problem.device.sample_time_s
    declared = max(tool.step_s)
    scale = Scale.of(problem, declared)
    mass = scale.mass_kg
    least = scale.damping_ns_per_m
    dampers = scale.dampers_ns_per_m()
    damping = np.concatenate([[0.0], dampers[dampers >= _LIGHTEST_SHARE * dampers[-1]]])
    rounded = [round(factor * declared / t) * t for factor in rates if round(factor * declared / t) >= 1]
    not_declared = [
        step for step in rounded if step <= LONGEST_STEP_S and not math.isclose(step, declared, rel_tol=_SAME_STEP)
    ]
    steps = dict.fromkeys(not_declared, False) | {declared: True}
    # Damping ratio of the released device with the damper of its own loop.
    ratio = 1.0 if tool.damped_locally else 0.0
    curves = []
    for place, step_s in enumerate(sorted(steps)):
        progress.advance(place, len(steps), f"{1 / step_s:.4g} Hz")
        of_engine = problem if steps[step_s] else problem.changed(simulation={"step_s": step_s})
        softest = _SOFTEST_SHARE * mass / step_s**2
        stiffest = ToolSearch(of_engine).limit[0] if summits else None

        def gains(k: float, b: float) -> ToolGains:
            return ToolGains(k, b, max(0.0, 2 * ratio * math.sqrt(k * mass) - least))

        # Of its own: what the search of the stiffest has refuted is no part of it, so that a curve is the same without.
        limits = _curve(ToolLoops(of_engine), gains, damping.tolist(), softest, _STIFFEST_RATIO * mass / t**2)
        curves.append(ToolCurve(step_s, steps[step_s], limits, stiffest))
    return ToolRegion(problem.name, damping, ratio, tuple(curves), units=problem.units)


def _curve(
    loops: ToolLoops,
    gains: Callable[[float, float], ToolGains],
    damping_ns_per_m: Sequence[float],
    softest: float,
    stiffest: float,
) -> FloatArray:
    """Return the limit with each damper, once no search of the ranges refutes the highest."""
    limits = np.zeros(len(damping_ns_per_m))
    for _ in range(_SEARCHES):
        for row, b in enumerate(damping_ns_per_m):

            def stable(k: float, b: float = b) -> bool:
                return loops.stable(gains(k, b))

            limits[row] = edge(stable, softest, stiffest, _PRECISION) if stable(softest) else 0.0
        top = int(limits.argmax())
        if not loops.has_counterexample(gains(_BELOW_LIMIT * limits[top], damping_ns_per_m[top])):
            break
    return limits
