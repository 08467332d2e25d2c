"""Rows of a coupling in the parameters and units of a simulation engine."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import get_args

from avc_casadi._errors import InputError
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import plural
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import Exchange, Simulation, mujoco_contact_n_per_m
from avc_casadi.model.ends import ToolIntegrator as Integrator
from avc_casadi.present import words
from avc_casadi.present.row import Answer, Row, Value, caution, parts, row
from avc_casadi.present.rows import subject


@dataclass(frozen=True)
class EngineNames:
    """A simulation engine: name, call of its step, its names of integrators, whether a device that turns fits."""

    title: str
    step: str
    integrators: Mapping[Integrator, str]
    turns: bool = True


_SEMI_IMPLICIT: dict[Integrator, str] = {"semi-implicit": "semi-implicit"}
_MUJOCO: dict[Integrator, str] = {"semi-implicit": "Euler", "implicit-damping": "implicitfast", "exact": "RK4"}
_ANY_INTEGRATOR: dict[Integrator, str] = {name: name for name in get_args(Integrator)}
_ENGINES = {
    "mujoco": EngineNames("MuJoCo", "mj_step", _MUJOCO),
    "chai3d": EngineNames("CHAI3D", "updateDynamics", _SEMI_IMPLICIT, turns=False),
    "unity": EngineNames("Unity (PhysX)", "the physics step", _SEMI_IMPLICIT),
    "sofa": EngineNames("SOFA", "animate", {"implicit": "EulerImplicitSolver"}, turns=False),
    "openhaptics": EngineNames("OpenHaptics", "your step", _ANY_INTEGRATOR, turns=False),
    "imstk": EngineNames("iMSTK", "the scene's step", {}),
    "ros2": EngineNames("ROS 2", "the update", _SEMI_IMPLICIT),
    "pybullet": EngineNames("PyBullet", "stepSimulation", _SEMI_IMPLICIT),
}
_AHEAD = "a state read after the step is already the result of the force, and reduces K by a factor of 10 to 60"
_HEAVIER = 1e-3
"""Share by which a tool is heavier with the impedance of a weld that lets spring and damper act nearly as a force."""
_CONTACT_N = 2.0
"""Force, N, at which the stiffness of MuJoCo's own contact is stated."""
_EACH_STEP = "each step"
"""Formula of the line that runs in each step of an engine."""


@dataclass(frozen=True)
class EnginePlace:
    """Where an engine takes the value of a formula, its unit for a device that slides, and what to beware of."""

    engine: str
    place: str
    formula: str
    unit: str
    trap: str


@dataclass(frozen=True)
class EngineParameter(EnginePlace):
    """A value in the place and the unit that an engine takes it in."""

    value: float


@dataclass(frozen=True)
class EngineParameters:
    """A coupling to a simulation in the parameters and units of an engine.

    Attributes:
        engine: name of the engine.
        title: its name as it is written.
        coupling: identity of the coupling.
        exchange: what the device is handed.
        integrator: the engine's own name of its integrator.
        parameters: the values.
        sample_time_s: period of the device's loop.
        device: call of that loop.
        law: line that runs in each step of the engine.
        traps: what to beware of.
        judged_for: hands and margin that the verdict on the coupling is for.
    """

    engine: str
    title: str
    coupling: str
    exchange: Exchange
    integrator: str
    parameters: tuple[EngineParameter, ...]
    sample_time_s: float
    device: str
    law: str
    traps: tuple[str, ...]
    judged_for: JudgedFor


def _values_of(coupling: Coupling) -> dict[str, float]:
    """Return the value of each formula that applies: of K, B, m, h, T, F, position scale p and force scale f."""
    tool, device = coupling.tool, coupling.problem.device
    k, b = coupling.in_scene.stiffness_n_per_m, coupling.in_scene.damping_ns_per_m
    p, f = tool.position_scale, tool.force_scale
    values = {"K": k, "B": b, "B/K": b / k if k else 0.0, "K f": k * f, "B p f": b * p * f, "0": 0.0, "1": 1.0}
    values |= {"K p f/1000": k * p * f / 1e3, "B p f/1000": b * p * f / 1e3, "p": p, "f": f}
    h, n = max(tool.step_s), tool.substeps
    values |= {"h": h, "h/n": h / n, "n": n, "T": device.sample_time_s, "1/T": 1 / device.sample_time_s}
    if device.max_force_n is not None:
        values["F/f"] = device.max_force_n / f
    if tool.tool_mass_kg is None:
        return values
    m = min(tool.tool_mass_kg)
    values |= {"m": m, "B/(2 sqrt(K m))": b / (2 * math.sqrt(k * m)) if k else math.nan}
    if coupling.problem.units.linear:
        d = _HEAVIER
        values |= {"-K (1 - d)/m": -k * (1 - d) / m, "-B (1 - d)/m": -b * (1 - d) / m, "d": d}
        values["contact 2 N"] = mujoco_contact_n_per_m(m, _CONTACT_N)
    return values


def _places(engine: str) -> list[EnginePlace]:
    """Return where an engine takes the value of each formula."""
    with Path(__file__).with_name("engines.csv").open(encoding="utf-8", newline="") as text:
        return [place for place in (EnginePlace(**line) for line in csv.DictReader(text)) if place.engine == engine]


def fitting(coupling: Coupling) -> list[str]:
    """Return the engines that take a coupling."""
    return [name for name in _ENGINES if not _misfit(coupling, name)]


def _misfit(coupling: Coupling, name: str) -> str:
    """Return why an engine does not take a coupling; empty where it does."""
    if name not in _ENGINES:
        return f"is not a known engine; allowed: {', '.join(_ENGINES)}"
    engine, tool = _ENGINES[name], coupling.tool
    if not engine.turns and not coupling.problem.units.linear:
        turning = ", ".join(engine for engine, known in _ENGINES.items() if known.turns)
        return f"supports no rotary device; use {turning}"
    integrators = engine.integrators or _SEMI_IMPLICIT
    lacking = ""
    allowed = ""
    if tool.integrator not in integrators and tool.tool_mass_kg is not None:
        lacking = tool.integrator
        allowed = " or ".join(f'integrator = "{integrator}"' for integrator in integrators)
    elif tool.substeps > 1 and not any(place.formula == "n" for place in _places(name)):
        step_s = max(max(tool.step_s) / tool.substeps, coupling.problem.device.sample_time_s)
        lacking = f"substeps = {tool.substeps}"
        allowed = f"substeps = 1, step_s = {step_s:.6g}"
    if not lacking:
        return ""
    return f"does not support {lacking}; set {allowed} in [simulation] and recommend again"


def parameters(coupling: Coupling, engine: str, shown: str = "coupling.json", unsafe: str = "") -> Answer:
    """Return a coupling to a simulation in the parameters and units of an engine."""
    if why := _misfit(coupling, engine):
        raise InputError.of(f"is {engine!r}, which {why}", key="--parameters")
    result = _parameters(coupling, engine, unsafe)
    rows = [_parameter(parameter) for parameter in result.parameters]
    rows += [row("Device", result.device, Value(result.sample_time_s, "time")), row("Each step", result.law)]
    rows += [*subject.notes(result.traps, "Trap"), subject.judged_for(result.judged_for)]
    integrator = f" · integrator {result.integrator}" if result.integrator else ""
    exchanged = f"· exchange {result.exchange}{integrator}"
    title = parts(shown, f"  for {result.title} ·", subject.pair_of(coupling.gains), exchanged)
    onwards = (f"avc export {quote(shown)} --c firmware",)
    return Answer("parameters", plain(result), title, tuple(rows), onwards, coupling.problem.units, whole=True)


def _parameter(parameter: EngineParameter) -> Row:
    trap = f"; {parameter.trap}" if parameter.trap else ""
    where = f"{parameter.unit} · {parameter.place}{trap}".lstrip()
    return row(parameter.formula, Value(parameter.value, "number", 6), where, mark=caution(parameter.trap))


def _parameters(coupling: Coupling, name: str, unsafe: str) -> EngineParameters:
    """Return what an engine of a name is to be set to for a coupling: parameters, integrator, exchange."""
    engine = _ENGINES[name]
    tool = coupling.tool
    places = _places(name)
    traps = (unsafe, _handed_out(tool, engine))
    return EngineParameters(
        engine=name,
        title=engine.title,
        coupling=coupling.id,
        exchange=tool.exchange,
        integrator=engine.integrators.get(tool.integrator, ""),
        parameters=(*_table(coupling, places), *_own_damper(coupling, name)),
        sample_time_s=coupling.problem.device.sample_time_s,
        device=f"F = avc_coupling_step(&c, x, {_handed_in(tool)}) every",
        law=_law(tool, name, places),
        traps=tuple(trap for trap in traps if trap),
        judged_for=JudgedFor.of_coupling(coupling),
    )


def _table(coupling: Coupling, places: Sequence[EnginePlace]) -> Iterator[EngineParameter]:
    """Yield the value of each formula that applies, in the order of an engine's table."""
    values, units = _values_of(coupling), coupling.problem.units
    for place in places:
        if place.formula in values:
            unit = units.unit(place.unit)
            yield EngineParameter(place.engine, place.place, place.formula, unit, place.trap, values[place.formula])


def _own_damper(coupling: Coupling, name: str) -> list[EngineParameter]:
    """Return the damper of the device's own loop, which no engine has."""
    damping = coupling.gains.local_damping_ns_per_m
    if not damping:
        return []
    place, unit = "the device's own loop: avc_coupling_step alone has it", coupling.problem.units.unit("N.s/m")
    return [EngineParameter(name, place, "local B", unit, trap="", value=damping)]


def _law(tool: Simulation, name: str, places: Sequence[EnginePlace]) -> str:
    """Return the line that runs in each step of an engine; its joint has the damper that implicitfast solves."""
    law = next(place.place for place in places if place.formula == _EACH_STEP)
    if name == "mujoco" and tool.solved == "damper":
        return law.replace("(v - data.qvel[dof])", "v")
    return law


def _handed_in(tool: Simulation) -> str:
    """Return what the device's loop takes of the engine."""
    if tool.exchange != "held-force":
        return "tool_x, tool_v"
    return "force on the tool" if tool.solved == "nothing" else "avc_coupling_handed_force(...)"


def _handed_out(tool: Simulation, engine: EngineNames) -> str:
    """Return what the engine hands to the device's loop, and when."""
    late = f", {plural(tool.steps_late, 'step')} later" if tool.steps_late else ""
    ahead = "" if tool.exchange == "held-force" else f"; {_AHEAD}"
    return f"hand out {words.EXCHANGES[tool.exchange].format(step=engine.step)}{ahead}{late}"
