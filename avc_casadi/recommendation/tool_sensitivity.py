"""Range of a stiffness over tool mass, engine step, exchange and device; sensitivity of its limit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi.design.virtual_tool import WIDEST_MARGIN, ToolSearch, ToolSearchOptions
from avc_casadi.loops.engine import ToolLoops, required_tool
from avc_casadi.model.ends import HEAVIEST_TOOL_KG, LIGHTEST_TOOL_KG, LONGEST_STEP_S

if TYPE_CHECKING:
    from avc_casadi.model.ends import Exchange, ToolGains, VirtualTool
    from avc_casadi.model.problem import Problem


# Relative change of the device's mass and damping, and additional delay, samples, with which gains must stay stable.
_MISMATCH, _LATER_SAMPLES = 0.1, 0.25
# Largest factor on the tool's mass, up and down, and on the engine's step.
_HEAVIEST, _SLOWEST = 100.0, 64.0
# Sensitivities are printed beside a limit: one part in a hundred suffices.
_ROUGHLY = ToolSearchOptions(precision=0.01)


@dataclass(frozen=True)
class ToolHelp:
    """A change and the stiffest coupling that it allows.

    Attributes:
        change: in words.
        stiffest_n_per_m: K with the best B, linear stability alone.
    """

    change: str
    stiffest_n_per_m: float


def stable_on_other_devices(problem: Problem, gains: ToolGains) -> bool:
    """Return whether the gains are stable on perturbed devices, or throughout the declared ranges."""
    device, known, off = problem.device, problem.device.range, _MISMATCH
    about = {
        key: getattr(known, key) or (getattr(device, key) * (1 - off), getattr(device, key) * (1 + off))
        for key in ("mass_kg", "damping_ns_per_m")
    }
    about["delay_samples"] = known.delay_samples or (device.delay_samples, device.delay_samples + _LATER_SAMPLES)
    return ToolLoops(problem.changed(device={"range": about})).stable_over_ranges(gains)


def search_ends(problem: Problem) -> dict[str, float]:
    """Return where the searches of mass, step and gain margin end: what is found there is no limit."""
    tool, t = required_tool(problem), problem.device.sample_time_s
    lightest, _ = _masses_kg(tool)
    return {
        "least_tool_mass_kg": lightest,
        "slowest_step_s": _most_samples(tool, t) * t,
        "gain_margin": WIDEST_MARGIN,
    }


def _masses_kg(tool: VirtualTool) -> tuple[float, float]:
    """Return the lightest and the heaviest tool that are searched."""
    declared = min(tool.tool_mass_kg or (1.0,))
    return (
        max(declared / _HEAVIEST, LIGHTEST_TOOL_KG),
        min(declared * _HEAVIEST, HEAVIEST_TOOL_KG),
    )


def _most_samples(tool: VirtualTool, sample_time_s: float) -> int:
    """Return the longest step that is searched, in samples."""
    longest_s = min(_SLOWEST * max(tool.step_s), LONGEST_STEP_S)
    return math.floor(longest_s / sample_time_s * (1 + 1e-9))


def least_tool_mass_kg(problem: Problem, stiffness_n_per_m: float, *, local: bool) -> float | None:
    """Return the lightest tool with which a stiffness is stable, searched from the declared mass down, or up."""
    tool = required_tool(problem)
    declared = min(tool.tool_mass_kg or (1.0,))
    lightest, heaviest = _masses_kg(tool)

    def holds(mass_kg: float) -> bool:
        return _search(problem, tool_mass_kg=mass_kg).holds(stiffness_n_per_m, local=local)

    if holds(declared):
        return _between(holds, lightest, declared)
    mass = declared
    while mass < heaviest:
        before, mass = mass, min(2 * mass, heaviest)
        if holds(mass):
            return _between(holds, before, mass)
    return None


def slowest_step_s(problem: Problem, stiffness_n_per_m: float, *, local: bool) -> float | None:
    """Return the longest step, a multiple of T, up to which a stiffness is stable; None where not even T is."""
    tool, t = required_tool(problem), problem.device.sample_time_s

    def holds(samples: int) -> bool:
        search = _search(problem, step_s=samples * t)
        return search.holds(stiffness_n_per_m, local=local)

    most = _most_samples(tool, t)
    good, bad = 0, 1
    while good < most and holds(bad):
        good, bad = bad, min(2 * bad, most)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good * t if good else None


def exchanges_that_hold(problem: Problem, stiffness_n_per_m: float, *, local: bool) -> dict[str, bool]:
    """Return the exchanges with which a stiffness is stable at some damping."""
    names: tuple[Exchange, ...] = ("on-time", "late", "ahead", "held-force")
    return {
        name: _search(problem, exchange=name).holds(stiffness_n_per_m, local=local or name == "held-force")
        for name in names
    }


def what_would_help(problem: Problem, search: ToolSearch, *, local: bool) -> tuple[ToolHelp, ...]:
    """Return the sensitivities of the stiffness limit, largest first."""
    tool, t = required_tool(problem), problem.device.sample_time_s
    step_s, hands = max(tool.step_s), search.loops.worst_hands
    changes: dict[str, dict[str, Any]] = {}
    if step_s >= 2 * t:
        changes["an engine twice as fast"] = {"step_s": step_s / 2}
    if tool.exchange != "on-time" or tool.steps_late:
        changes["the tool's state on time"] = {"exchange": "on-time", "steps_late": 0}
    if tool.tool_mass_kg is not None:
        changes["a tool twice as heavy"] = {
            "tool_mass_kg": [min(2 * mass, HEAVIEST_TOOL_KG) for mass in tool.tool_mass_kg]
        }
    if tool.integrator != "implicit" and tool.tool_mass_kg is not None:
        changes["an implicit integrator"] = {"integrator": "implicit"}
    found = [
        ToolHelp(change, ToolSearch(problem.changed(simulation=keys), _ROUGHLY, hands).stiffest().stiffness_n_per_m)
        for change, keys in changes.items()
    ]
    if not local:
        beside = ToolSearch(problem, _ROUGHLY, hands).stiffest_beside_local_damper()
        damper = f"{beside.local_damping_ns_per_m:.3g}"
        found.append(ToolHelp(f"a damper of {damper} in the device's own loop", beside.stiffness_n_per_m))
    better = [one for one in found if one.stiffest_n_per_m > 1.02 * search.limit[0].stiffness_n_per_m]
    return tuple(sorted(better, key=lambda one: -one.stiffest_n_per_m))


def _between(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return the smallest value, down to `low`, above which all up to `high` hold, within 2 %."""
    while high > low:
        lower = max(high / 2, low)
        if not holds(lower):
            low = lower
            break
        high = lower
    else:
        return high
    while high > 1.02 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _search(problem: Problem, **simulation: Any) -> ToolSearch:
    return ToolSearch(problem.changed(simulation=simulation))
