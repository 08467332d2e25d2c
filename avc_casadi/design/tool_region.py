"""Stable springs and dampers to a virtual tool: K against B, a curve for each engine rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.design.virtual_tool import Scale, ToolSearch, edge
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.model.declared import effects_of_scene_alone
from avc_casadi.model.ends import LONGEST_STEP_S, Simulation, ToolGains
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
class ToolCurve(Document):
    """Largest stable K at each B with an engine's step.

    Attributes:
        step_s: the engine's step, s.
        declared: whether it is the one of the problem.
        stiffness_n_per_m: largest stable K at each damper of the region, shape (n,).
        stiffest: the stiffest stable coupling over all dampers; None where it was not searched.
    """

    JSON_KEYS: ClassVar = (
        "step_s",
        "declared",
        "stiffness_n_per_m",
        "rate_hz",
        "stiffest_n_per_m",
        "stiffest_with_ns_per_m",
        "stiffest_with_local_ns_per_m",
    )

    step_s: float
    declared: bool
    stiffness_n_per_m: FloatArray
    stiffest: ToolGains | None

    @property
    def rate_hz(self) -> float:
        """The engine's rate."""
        return 1 / self.step_s

    @property
    def stable(self) -> ToolGains | None:
        """The stiffest stable coupling; None where none with a spring is stable."""
        return None if self.stiffest is None or self.stiffest.stiffness_n_per_m == 0 else self.stiffest

    @property
    def stiffest_n_per_m(self) -> float | None:
        """Its spring."""
        return None if self.stable is None else self.stable.stiffness_n_per_m

    @property
    def stiffest_with_ns_per_m(self) -> float | None:
        """Its damper."""
        return None if self.stable is None else self.stable.damping_ns_per_m

    @property
    def stiffest_with_local_ns_per_m(self) -> float | None:
        """Its damper in the device's own loop."""
        return None if self.stable is None else self.stable.local_damping_ns_per_m


@dataclass(frozen=True, eq=False)
class ToolRegion(Document):
    """The K-B region of a coupling to a simulation: with every hand, released, and every tool and contact.

    Attributes:
        problem: name of the problem.
        damping_ns_per_m: dampers B of the curves, shape (n,).
        local_damping_ratio: damping ratio of the released device with the damper of its own loop; 0 without one.
        curves: one for each step of an engine.
        not_used: effects of the scene, none of which is part of these loops.
        units: units of the problem.
    """

    JSON_KEYS: ClassVar = ("problem", "damping_ns_per_m", "local_damping_ratio", "curves", "not_used")

    problem: str
    damping_ns_per_m: FloatArray
    local_damping_ratio: float
    curves: tuple[ToolCurve, ...]
    not_used: tuple[str, ...] = ()
    units: Units = LINEAR


def tool_region(
    problem: Problem,
    progress: Progress = SILENT,
    *,
    rates: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0),
    summits: bool = True,
) -> ToolRegion:
    """Return the largest stable spring K, N/m, to 2 %, at each damper B, N s/m, for the engine's step and other ones.

    Args:
        problem: a problem with [simulation].
        progress: reported over the curves.
        rates: steps of an engine, as multiples of the declared one, rounded to whole samples of the device.
        summits: whether the stiffest coupling over all dampers is searched too.
    """
    tool = problem.end_as(Simulation)
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
    return ToolRegion(problem.name, damping, ratio, tuple(curves), effects_of_scene_alone(problem), problem.units)


def _curve(
    loops: ToolLoops,
    gains: Callable[[float, float], ToolGains],
    damping_ns_per_m: Sequence[float],
    softest: float,
    stiffest: float,
) -> FloatArray:
    """Return the largest stable K, N/m, with each damper, once no search of the ranges refutes the highest.

    `gains` makes a coupling of K and B; K is looked for from `softest` to `stiffest`, N/m.
    """
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
