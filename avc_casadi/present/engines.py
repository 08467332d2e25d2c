"""A coupling to a simulation in the parameters of each engine: places, formulas, units and traps of one table."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

from avc_casadi._errors import InputError
from avc_casadi.model.ends import SOFT_IMPEDANCE, MujocoConstraint, ToolIntegrator
from avc_casadi.present.row import Answer, Mark, Value, parts, row
from avc_casadi.present.rows.subject import notes, pair

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _text:
    TABLE: tuple[dict[str, str], ...] = tuple(csv.DictReader(_text))
"""Engine, place, formula, unit and trap of each parameter."""


class Engine(NamedTuple):
    """A simulation engine: name, call of its step, its names of integrators, code of each step, whether it turns."""

    title: str
    step: str
    integrators: dict[ToolIntegrator, str]
    law: str
    turns: bool = True


_ANY: dict[ToolIntegrator, str] = {one: one for one in get_args(ToolIntegrator)}
_SEMI: dict[ToolIntegrator, str] = {"semi-implicit": "semi-implicit"}
_MUJOCO: dict[ToolIntegrator, str] = {"semi-implicit": "Euler", "implicit-damping": "implicitfast", "exact": "RK4"}
_TOOL = "avc_coupling_tool_force(&c, place, velocity)"
_QFRC = "data.qfrc_applied[dof] = K*(x - data.qpos[dof]) + B*(v - data.qvel[dof])"
_REST = "avc_coupling_target(&c, &place, &velocity) before the step: place is the spring's rest"
_HD = "hdSetDoublev(HD_CURRENT_FORCE, F times the direction) in the callback of hdScheduleAsynchronous"
_PB = "p.applyExternalForce(tool, -1, (K*(x - tool_x) + B*(v - tool_v)) times the direction, place, p.WORLD_FRAME)"
ENGINES = {
    "mujoco": Engine("MuJoCo", "mj_step", _MUJOCO, _QFRC),
    "chai3d": Engine("CHAI3D", "updateDynamics", _SEMI, "device->setForce(F), times the direction", turns=False),
    "unity": Engine("Unity (PhysX)", "the physics step", _SEMI, f"AddForce({_TOOL}) in FixedUpdate"),
    "sofa": Engine("SOFA", "animate", {"implicit": "EulerImplicitSolver"}, _REST, turns=False),
    "openhaptics": Engine("OpenHaptics", "your engine's step", _ANY, _HD, turns=False),
    "imstk": Engine("iMSTK", "the scene's step", {}, f"{_TOOL} on the body, in place of the controller"),
    "ros2": Engine("ROS 2", "the update", _SEMI, "the robot is the tool, the device its reference"),
    "pybullet": Engine("PyBullet", "stepSimulation", _SEMI, _PB),
}
"""Engines in whose parameters a coupling can be expressed."""
_AHEAD = "position and velocity of after it lie in the future of the force that made them, which costs 10 to 60 times K"
_EXCHANGE = {
    "on-time": f"hand out position and velocity that {{step}} begins with; {_AHEAD}",
    "late": f"hand out position and velocity that the {{step}} before began with; {_AHEAD}",
    "ahead": f"certified with position and velocity read after {{step}}; {_AHEAD}: on-time allows more",
    "held-force": "hand out the force that you apply in {step}; the device holds it until the next one",
}


def values_of(coupling: Coupling) -> dict[str, float]:
    """Return the value of each formula that applies: of K, B, m, h, T, F, position scale p and force scale f."""
    tool, k, b = coupling.tool, coupling.in_scene.stiffness_n_per_m, coupling.in_scene.damping_ns_per_m
    device, p, f = coupling.problem.device, tool.position_scale, tool.force_scale
    found = {"K": k, "B": b, "B/K": b / k if k else 0.0, "K f": k * f, "B p f": b * p * f, "0": 0.0, "1": 1.0}
    found |= {"K p f/1000": k * p * f / 1e3, "B p f/1000": b * p * f / 1e3, "p": p, "f": f}
    h, n = max(tool.step_s), tool.substeps
    found |= {"h": h, "h/n": h / n, "n": n, "T": device.sample_time_s, "1/T": 1 / device.sample_time_s}
    if device.max_force_n is not None:
        found["F/f"] = device.max_force_n / f
    if tool.tool_mass_kg is None:
        return found
    m = min(tool.tool_mass_kg)
    found |= {"m": m, "B/(2 sqrt(K m))": b / (2 * math.sqrt(k * m)) if k else math.nan}
    if coupling.problem.units.linear:
        weld = MujocoConstraint.of(k, b, m).solref
        found |= {"-K (1 - d)/m": weld[0], "-B (1 - d)/m": weld[1], "d": SOFT_IMPEDANCE}
        found["contact 2 N"] = MujocoConstraint().stiffness_n_per_m(m, 2.0)
    return found


def parameters(coupling: Coupling, engine: str, shown: str = "coupling.json", unsafe: str = "") -> Answer:
    """Return a coupling to a simulation in the parameters and units of an engine."""
    if engine not in ENGINES:
        raise InputError.of(f"is {engine!r}; allowed: {', '.join(ENGINES)}", key="--parameters")
    known, tool, units, values = ENGINES[engine], coupling.tool, coupling.problem.units, values_of(coupling)
    if not known.turns and not units.linear:
        others = ", ".join(name for name, one in ENGINES.items() if one.turns)
        raise InputError.of(f"is {engine!r}, which knows no device that turns; allowed: {others}", key="--parameters")
    integrators, wanted = known.integrators, ""
    if tool.integrator not in (integrators or _SEMI) and tool.tool_mass_kg is not None:
        wanted = f'integrator = "{" or ".join(integrators or _SEMI)}"'
    elif tool.substeps > 1 and not any(one["engine"] == engine and one["formula"] == "n" for one in TABLE):
        wanted = f"substeps = 1, step_s = {max(values['h/n'], values['T']):.6g}"
    if wanted:
        loop = f"integrator = {tool.integrator!r}, substeps = {tool.substeps}"
        message = f"is {engine!r}, which has no {loop} of this coupling; say {wanted} in [simulation] and make it again"
        raise InputError.of(message, key="--parameters")
    # The joint has the damper that implicitfast solves.
    law = known.law.replace(" - data.qvel[dof]", "") if engine == "mujoco" and tool.solved == "damper" else known.law
    handed = "tool_x, tool_v"
    if tool.exchange == "held-force":
        handed = "force on the tool" if tool.solved == "nothing" else "avc_coupling_handed_force(...)"
    late = f", {tool.steps_late} steps later" if tool.steps_late else ""
    traps = [unsafe, _EXCHANGE[tool.exchange].format(step=known.step) + late]
    table: list[dict[str, Any]] = [
        {**one, "value": values[one["formula"]], "unit": units.unit(one["unit"])}
        for one in TABLE
        if one["engine"] == engine and one["formula"] in values
    ]
    if own := coupling.gains.local_damping_ns_per_m:
        place, unit = "the device's own loop: avc_coupling_step alone has it", units.unit("N.s/m")
        table.append({"engine": engine, "place": place, "formula": "local B", "value": own, "unit": unit, "trap": ""})
    step = f"F = avc_coupling_step(&c, x, {handed}) every"
    data: dict[str, Any] = {
        "engine": engine,
        "title": known.title,
        "coupling": coupling.id,
        "exchange": tool.exchange,
        "integrator": integrators.get(tool.integrator, ""),
        "parameters": table,
        "sample_time_s": coupling.problem.device.sample_time_s,
        "device": step,
        "law": law,
        "traps": [one for one in traps if one],
    }
    rows = []
    for one in table:
        trap = f"; {one['trap']}" if one["trap"] else ""
        number = Value(one["value"], "number", 6)
        mark = Mark.CAUTION if trap else Mark.NONE
        rows.append(row(one["formula"], number, f"{one['unit']} · {one['place']}{trap}".lstrip(), mark=mark))
    rows += [row("Device", step, Value(data["sample_time_s"], "time")), row("Each step", law)]
    rows += notes(data["traps"], "Trap")
    title = parts(shown, f"  for {known.title} ·", pair(vars(coupling.gains)), f"· exchange {tool.exchange}")
    onwards = (f"avc export {quote(shown)} --c firmware",)
    return Answer("parameters", data, title, tuple(rows), onwards, units, whole=True)
