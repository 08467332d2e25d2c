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


@dataclass(frozen=True, eq=False)
class ToolCurve:
    """Largest stable K at each B with an engine's step."""

    step_s: float
    declared: bool
    stiffness_n_per_m: FloatArray
    stiffest: ToolGains | None


@dataclass(frozen=True, eq=False)
class ToolRegion:
    """The K-B region of a coupling to a simulation: with every hand, released, and every tool and contact."""

    problem: str
    damping_ns_per_m: FloatArray
    local_damping_ratio: float
    curves: tuple[ToolCurve, ...]
    units: Units = LINEAR

    def document(self) -> dict[str, Any]:
        """Return the `zwidth` document: JSON values only."""
        return plain_table(
            {
                **{name: getattr(self, name) for name in ("problem", "damping_ns_per_m", "local_damping_ratio")},
                "curves": [
                    {name: getattr(one, name) for name in ("step_s", "declared", "stiffness_n_per_m")}
                    | {"rate_hz": 1 / one.step_s, **_stiffest(one.stiffest)}
                    for one in self.curves
                ],
            }
        )


def _stiffest(gains: ToolGains | None) -> dict[str, float | None]:
    found = None if gains is None or gains.stiffness_n_per_m == 0 else gains
    return {
        "stiffest_n_per_m": None if found is None else found.stiffness_n_per_m,
        "stiffest_with_ns_per_m": None if found is None else found.damping_ns_per_m,
        "stiffest_with_local_ns_per_m": None if found is None else found.local_damping_ns_per_m,
    }


def tool_region(
    problem: Problem,
    progress: Progress = SILENT,
    *,
    rates: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0),
    summits: bool = True,
) -> ToolRegion:
    """Return the largest stable K, to 2 %, at each damper, for the engine's step and faster and slower ones."""
    tool = tool_of(problem)
    t, declared = problem.device.sample_time_s, max(tool.step_s)
    scale = Scale.of(problem, declared)
    mass, least = scale.mass_kg, scale.damping_ns_per_m
    tried = scale.dampers_ns_per_m()
    damping = np.concatenate([[0.0], tried[tried >= 0.999e-3 * tried[-1]]])
    rounded = [round(factor * declared / t) * t for factor in rates if round(factor * declared / t) >= 1]
    others = [step for step in rounded if step <= LONGEST_STEP_S and not math.isclose(step, declared, rel_tol=0.1)]
    steps = dict.fromkeys(others, False) | {declared: True}
    # Damping ratio of the released device with the damper of its own loop.
    ratio = 1.0 if tool.damped_locally else 0.0
    curves = []
    for place, step_s in enumerate(sorted(steps)):
        progress.advance(place, len(steps), f"{1 / step_s:.4g} Hz")
        of_engine = problem if steps[step_s] else problem.changed(simulation={"step_s": step_s})
        softest = 1e-3 * mass / step_s**2
        stiffest = ToolSearch(of_engine).limit[0] if summits else None

        def gains(k: float, b: float) -> ToolGains:
            return ToolGains(k, b, max(0.0, 2 * ratio * math.sqrt(k * mass) - least))

        # Of its own: what the search of the stiffest has refuted is no part of it, so that a curve is the same without.
        limits = _curve(ToolLoops(of_engine), gains, damping.tolist(), softest, 10 * mass / t**2)
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
    for _ in range(20):
        for row, b in enumerate(damping_ns_per_m):

            def stable(k: float, b: float = b) -> bool:
                return loops.stable(gains(k, b))

            limits[row] = edge(stable, softest, stiffest, 1.02) if stable(softest) else 0.0
        top = int(limits.argmax())
        if not loops.has_counterexample(gains(0.98 * limits[top], damping_ns_per_m[top])):
            break
    return limits
