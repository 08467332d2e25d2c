"""What would help: the stiffness limit with one property changed, the range of a stiffness, and what a margin costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from avc_casadi._util.json_values import Document
from avc_casadi._util.page import Worded
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.program import program_answers, why_no_law
from avc_casadi.design.virtual_tool import WIDEST_MARGIN, ToolSearch, ToolSearchOptions
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import stiffest_wall
from avc_casadi.model.device import Device
from avc_casadi.model.ends import HEAVIEST_TOOL_KG, LIGHTEST_TOOL_KG, LONGEST_STEP_S, Simulation, ToolGains
from avc_casadi.model.problem import Problem


class Change(Worded, Enum):
    """A change of a device, of an engine or of the tool in it."""

    HALF_SAMPLE_TIME = auto()
    TWICE_DAMPING = auto()
    TWICE_MASS = auto()
    NO_DELAY = auto()
    AMPLIFIER_WITHOUT_LAG = auto()
    NO_RESONANCE = auto()
    ENGINE_TWICE_AS_FAST = auto()
    FORCE_IN_EACH_SUBSTEP = auto()
    STATE_ON_TIME = auto()
    TOOL_TWICE_AS_HEAVY = auto()
    IMPLICIT_INTEGRATOR = auto()
    LOCAL_DAMPER = auto()


@dataclass(frozen=True)
class Sensitivity(Document):
    """A change, and the stiffest coupling that it allows, by linear stability alone; 0 without any."""

    JSON_KEYS: ClassVar[tuple[str | tuple[str, str], ...]] = ("change", "stiffest_n_per_m")

    change: Change
    stiffest_n_per_m: float


@dataclass(frozen=True)
class WallSensitivity(Sensitivity):
    """A change of the device, and the stiffest wall that is then stable with every hand and released."""

    JSON_KEYS: ClassVar = ("change", ("stiffest_wall_n_per_m", "stiffest_n_per_m"))


def what_would_help(problem: Problem) -> tuple[WallSensitivity, ...]:
    """Return the stiffest wall, N/m, of a spring and damper after each change of the device, most effective first."""
    if problem.environment.stiffness_n_per_m == 0:
        return ()
    changes = [
        WallSensitivity(change, float(stiffest_wall(PlantFamily.of(problem.changed(device=values))).stiffness_n_per_m))
        for change, values in _linear_changes(problem.device).items()
    ]
    return tuple(sorted(changes, key=lambda change: -change.stiffest_n_per_m))


def _linear_changes(device: Device) -> dict[Change, dict[str, Any]]:
    """Return changes of a device that linear stability shows, with the keys that change, one at a time.

    Half the sample time, twice damping and mass, no delay, no lag of the amplifier, no resonance.
    """
    keys: dict[Change, dict[str, Any]] = {Change.HALF_SAMPLE_TIME: {"sample_time_s": device.sample_time_s / 2}}
    for change, key in ((Change.TWICE_DAMPING, "damping_ns_per_m"), (Change.TWICE_MASS, "mass_kg")):
        value, interval = getattr(device, key), getattr(device.range, key)
        twice = None if interval is None else tuple(2 * end for end in interval)
        if value:
            keys[change] = {key: 2 * value, "range": {key: twice}}
    if device.delay_samples:
        keys[Change.NO_DELAY] = {"delay_samples": 0, "range": {"delay_samples": None}}
    if device.amplifier_bandwidth_hz is not None:
        lags = {"amplifier_bandwidth_hz": None, "amplifier_damping_ratio": None}
        keys[Change.AMPLIFIER_WITHOUT_LAG] = {"amplifier_bandwidth_hz": None, "amplifier_order": 1, "range": lags}
    if device.resonance is not None:
        nothing = dict.fromkeys(type(device.resonance).model_fields)
        keys[Change.NO_RESONANCE] = {"resonance": None, "encoder_at": "motor", "range": {"resonance": nothing}}
    return keys


TRADED_MARGINS = (0.1, 0.2, 0.3, 0.5)
"""Disk margins whose price in accuracy is shown."""
TRADED_HZ = (1.0, 10.0, 30.0)
"""Frequencies of the errors that are shown, from slow motion of a hand to the end of its band."""
_SAME_MARGIN = 0.01  # disk margins closer than this are one point of the trade


@dataclass(frozen=True)
class Trade:
    """What the best law found reaches at a disk margin of every corner hand and released."""

    disk_margin: float
    error: tuple[float, float, float]  # that of `impedance_error` at 1, 10 and 30 Hz
    ripple_n: float  # at the hand, for a sine of one encoder step
    met: bool  # clipped force, decay and noise too


def trade_off(problem: Problem, progress: Progress = SILENT) -> tuple[Trade, ...]:
    """Return error, margin and ripple of observer laws at some disk margins, each found from the last; or none."""
    margins = TRADED_MARGINS
    none = problem.detent is not None or why_no_law(problem)
    answer = None if none else next(iter(program_answers(problem, margins[0])), None)
    trades: list[Trade] = []
    for done, margin in enumerate(margins):
        progress.advance(done, len(margins), "laws of the trade-off")
        if answer is None:
            break
        answer = answer if done == 0 else answer.with_goals(margin / answer.program.goals.disk_margin)
        if trades and abs(answer.performance.disk_margin - trades[-1].disk_margin) < _SAME_MARGIN:
            continue
        slow, brisk, fast = answer.errors(np.array(TRADED_HZ)).tolist()
        step = problem.device.encoder_resolution_m / problem.device.metres_per_unit
        ripple = answer.performance.noise_n_per_m * step
        trades.append(Trade(answer.performance.disk_margin, (slow, brisk, fast), ripple, answer.meets_goals))
    return tuple(trades)


_WORTH_SAYING = 1.02  # times the present limit: twice what the rough search of a change may be off


def what_would_help_tool(problem: Problem, search: ToolSearch, *, local: bool) -> tuple[Sensitivity, ...]:
    """Return the stiffest K, N/m, of a tool after each change that raises it, largest first.

    Changes are of engine, exchange and tool; with `local` false also a damper of the device's own loop.
    """
    tool, t = problem.end_as(Simulation), problem.device.sample_time_s
    step_s, hands = max(tool.step_s), search.loops.worst_hands
    changes: dict[Change, dict[str, Any]] = {}
    if step_s >= 2 * t:
        changes[Change.ENGINE_TWICE_AS_FAST] = tool.keys_with_step((step_s / 2, step_s / 2), t)
    if tool.substeps > 1 and min(tool.step_s) >= t * tool.substeps:
        shortest_s, longest_s = (end_s / tool.substeps for end_s in tool.step_s)
        of_substeps = tool.keys_with_step((shortest_s, longest_s), t)
        changes[Change.FORCE_IN_EACH_SUBSTEP] = {**of_substeps, "substeps": 1}
    if tool.exchange != "on-time" or tool.steps_late:
        changes[Change.STATE_ON_TIME] = {"exchange": "on-time", "steps_late": 0}
    if tool.tool_mass_kg is not None:
        heavier = [min(2 * mass, HEAVIEST_TOOL_KG) for mass in tool.tool_mass_kg]
        changes[Change.TOOL_TWICE_AS_HEAVY] = {"tool_mass_kg": heavier}
    if tool.integrator != "implicit" and tool.tool_mass_kg is not None:
        changes[Change.IMPLICIT_INTEGRATOR] = {"integrator": "implicit"}
    roughly = ToolSearchOptions(precision=0.01)  # one part in a hundred, beside a limit
    sensitivities = []
    for change, keys in changes.items():
        changed = ToolSearch(problem.changed(simulation=keys), roughly, hands)
        sensitivities.append(Sensitivity(change, changed.stiffest().stiffness_n_per_m))
    if not local:
        damped = ToolSearch(problem, roughly, hands).stiffest_beside_local_damper()
        sensitivities.append(Sensitivity(Change.LOCAL_DAMPER, damped.stiffness_n_per_m))
    worth_saying_n_per_m = _WORTH_SAYING * search.limit[0].stiffness_n_per_m
    better = (change for change in sensitivities if change.stiffest_n_per_m > worth_saying_n_per_m)
    return tuple(sorted(better, key=lambda change: -change.stiffest_n_per_m))


def stable_on_other_devices(problem: Problem, gains: ToolGains) -> bool:
    """Return whether gains are stable on devices a tenth off and a quarter sample late, or throughout the ranges."""
    device, known = problem.device, problem.device.range
    about = {
        key: getattr(known, key) or (getattr(device, key) * 0.9, getattr(device, key) * 1.1)
        for key in ("mass_kg", "damping_ns_per_m")
    }
    about["delay_samples"] = known.delay_samples or (device.delay_samples, device.delay_samples + 0.25)
    return ToolLoops(problem.changed(device={"range": about})).stable_over_ranges(gains)


def search_ends(problem: Problem) -> dict[str, float]:
    """Return where the searches of mass, step and gain margin end: what is found there is no limit."""
    tool, t = problem.end_as(Simulation), problem.device.sample_time_s
    return {
        "least_tool_mass_kg": _masses_kg(tool)[0],
        "slowest_step_s": _most_samples(tool, t) * t,
        "gain_margin": WIDEST_MARGIN,
    }


def _masses_kg(tool: Simulation, most: float = 100.0) -> tuple[float, float, float]:
    """Return the lightest tool that is searched, the declared one, and the heaviest that is searched."""
    declared = min(tool.tool_mass_kg or (1.0,))
    return max(declared / most, LIGHTEST_TOOL_KG), declared, min(declared * most, HEAVIEST_TOOL_KG)


def _most_samples(tool: Simulation, sample_time_s: float) -> int:
    """Return the longest step that is searched, in samples."""
    longest_s = min(64.0 * max(tool.step_s), LONGEST_STEP_S)
    return math.floor(longest_s / sample_time_s * (1 + 1e-9))


def same_stiffness(problem: Problem, stiffness_n_per_m: float, *, local: bool) -> dict[str, Any]:
    """Return the lightest tool, kg, slowest step, s, and exchanges with which K is stable, and the gains of each."""
    tool, t = problem.end_as(Simulation), problem.device.sample_time_s

    @cache
    def held(key: str, value: Any, of_device: bool = False, *, inside: bool = True) -> ToolGains | None:
        search = ToolSearch(problem.changed(simulation={key: value}))
        return search.held(stiffness_n_per_m, local=local or of_device, inside=inside)

    def end(find: Callable[[Callable[[Any], object]], Any], key: str, unit: float = 1.0) -> Any:
        """Return an end with the corners of the ranges alone where it holds inside them too, which takes long."""
        value = find(lambda value: held(key, value * unit, inside=False))
        return value if not value or held(key, value * unit) else find(lambda value: held(key, value * unit))

    names = ("on-time", "late", "ahead", "held-force")
    gains_of = {name: held("exchange", name, name == "held-force") for name in names}
    mass = None if tool.tool_mass_kg is None else end(partial(_lightest_kg, tool), "tool_mass_kg")
    samples = end(partial(_slowest, _most_samples(tool, t)), "step_s", t)
    gains_of["least_tool_mass_kg"] = None if mass is None else held("tool_mass_kg", mass)
    gains_of["slowest_step_s"] = held("step_s", samples * t) if samples else None
    return {
        "least_tool_mass_kg": mass,
        "slowest_step_s": samples * t if samples else None,
        "exchanges": {name: gains_of[name] is not None for name in names},
        "same_k": {name: gains for name, gains in gains_of.items() if gains is not None},
    }


def _lightest_kg(tool: Simulation, holds: Callable[[float], object]) -> float | None:
    """Return the lightest tool, kg, that `holds`, searched from the declared mass down, or up; None if none does."""
    lightest, mass, heaviest = _masses_kg(tool)
    before = lightest
    while not holds(mass):
        if mass == heaviest:
            return None
        before, mass = mass, min(2 * mass, heaviest)
    return _between(holds, before, mass)


def _between(holds: Callable[[float], object], low: float, high: float) -> float:
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


def _slowest(most: int, holds: Callable[[int], object]) -> int:
    """Return the most samples of a step, up to `most`, up to which it `holds`; 0 where not even one does."""
    good, bad = 0, 1
    while good < most and holds(bad):
        good, bad = bad, min(2 * bad, most)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good
