"""A coupling to a simulation in the parameters of each engine: one table of places, formulas, units and traps."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, get_args

from avc_casadi._errors import InputError
from avc_casadi._util.text import quantity
from avc_casadi.model.mujoco_constraint import SOFT_IMPEDANCE, MujocoConstraint
from avc_casadi.model.virtual_tool import ToolIntegrator
from avc_casadi.present.pages.tool_claims import coupling_text
from avc_casadi.present.pages.virtual_tool import headline as tool_headline
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from avc_casadi.other_end_coupling import ToolCoupling

_KEY = "--parameters"
with Path(__file__).with_name("engines.csv").open(encoding="utf-8", newline="") as _text:
    TABLE: tuple[dict[str, str], ...] = tuple(csv.DictReader(_text))
"""Engine, place, formula, unit and trap of each parameter."""


@dataclass(frozen=True)
class Numbers:
    """Numbers of a coupling that formulas are made of.

    Attributes:
        k: K in the scene.
        b: B in the scene.
        m: least mass of the tool; nan where a place couples.
        h: longest step of the engine.
        t: sample time of the device.
        p: position scale.
        f: force scale.
    """

    k: float
    b: float
    m: float
    h: float
    t: float
    p: float
    f: float


FORMULAS: dict[str, Callable[[Numbers], float]] = {
    "K": lambda n: n.k,
    "B": lambda n: n.b,
    "B/K": lambda n: n.b / n.k if n.k else 0.0,
    "B/(2 sqrt(K m))": lambda n: n.b / (2 * math.sqrt(n.k * n.m)) if n.k else math.nan,
    "K f": lambda n: n.k * n.f,
    "B p f": lambda n: n.b * n.p * n.f,
    "K p f/1000": lambda n: n.k * n.p * n.f / 1e3,
    "B p f/1000": lambda n: n.b * n.p * n.f / 1e3,
    "-K (1 - d)/m": lambda n: MujocoConstraint.of(n.k, n.b, n.m).solref[0],
    "-B (1 - d)/m": lambda n: MujocoConstraint.of(n.k, n.b, n.m).solref[1],
    "d": lambda _: SOFT_IMPEDANCE,
    "contact 2 N": lambda n: MujocoConstraint().stiffness_n_per_m(n.m, 2.0),
    "m": lambda n: n.m,
    "h": lambda n: n.h,
    "1/T": lambda n: 1 / n.t,
    "p": lambda n: n.p,
    "f": lambda n: n.f,
    "0": lambda _: 0.0,
    "1": lambda _: 1.0,
}
"""K, B, m, h, T, position scale p and force scale f; d is the impedance of a weld that leaves the tool its mass."""
_OF_A_MASS = {"m", "B/(2 sqrt(K m))", "-K (1 - d)/m", "-B (1 - d)/m", "d", "contact 2 N"}
_OF_A_LINE = {"-K (1 - d)/m", "-B (1 - d)/m", "d", "contact 2 N"}


@dataclass(frozen=True)
class Engine:
    """A simulation engine.

    Attributes:
        title: its name.
        step: the call of its time step.
        integrators: its names of the integrators; empty where unknown.
        law: code of each step; K, B, x and v of the device stand for themselves.
        turns: whether it supports a rotary device.
    """

    title: str
    step: str
    integrators: dict[ToolIntegrator, str]
    law: str
    turns: bool = True


_ANY: dict[ToolIntegrator, str] = {one: one for one in get_args(ToolIntegrator)}
_SEMI_IMPLICIT: dict[ToolIntegrator, str] = {"semi-implicit": "semi-implicit"}
_TOOL_FORCE = "avc_coupling_tool_force(&c, place, velocity)"
ENGINES: dict[str, Engine] = {
    "mujoco": Engine(
        "MuJoCo",
        "mj_step",
        {"semi-implicit": "Euler", "implicit-damping": "implicitfast"},
        "data.qfrc_applied[dof] = K*(x - data.qpos[dof]) + B*(v - data.qvel[dof])",
    ),
    "chai3d": Engine(
        "CHAI3D", "updateDynamics", _SEMI_IMPLICIT, "device->setForce(F), times the direction", turns=False
    ),
    "unity": Engine("Unity (PhysX)", "the physics step", _SEMI_IMPLICIT, f"AddForce({_TOOL_FORCE}) in FixedUpdate"),
    "sofa": Engine(
        "SOFA",
        "animate",
        {"implicit": "EulerImplicitSolver"},
        "avc_coupling_target(&c, &place, &velocity) before the step: place is the spring's rest",
        turns=False,
    ),
    "openhaptics": Engine(
        "OpenHaptics",
        "your engine's step",
        _ANY,
        "hdSetDoublev(HD_CURRENT_FORCE, F times the direction) in the callback of hdScheduleAsynchronous",
        turns=False,
    ),
    "imstk": Engine("iMSTK", "the scene's step", {}, f"{_TOOL_FORCE} on the body, in place of the controller"),
    "ros2": Engine(
        "ROS 2", "the controller's update", _SEMI_IMPLICIT, "the robot is the tool, the device its reference"
    ),
    "pybullet": Engine(
        "PyBullet",
        "stepSimulation",
        _SEMI_IMPLICIT,
        "p.applyExternalForce(tool, -1, (K*(x - tool_x) + B*(v - tool_v)) times the direction, place, p.WORLD_FRAME)",
    ),
}
"""Engines in whose parameters a coupling can be expressed."""
_AHEAD = "position and velocity of after it lie in the future of the force that made them, which costs 10 to 60 times K"
_EXCHANGE = {
    "on-time": f"hand out position and velocity that {{step}} begins with; {_AHEAD}",
    "late": f"hand out position and velocity that the {{step}} before began with; {_AHEAD}",
    "ahead": f"certified with position and velocity read after {{step}}; {_AHEAD}: on-time allows more",
    "held-force": "hand out the force that you apply in {step}; the device holds it until the next one",
}


def numbers_of(coupling: ToolCoupling) -> Numbers:
    """Return the numbers of a coupling, in the scene's units of position and force."""
    tool, scene = coupling.tool, coupling.in_scene
    return Numbers(
        scene.stiffness_n_per_m,
        scene.damping_ns_per_m,
        math.nan if tool.tool_mass_kg is None else min(tool.tool_mass_kg),
        max(tool.step_s),
        coupling.problem.device.sample_time_s,
        tool.position_scale,
        tool.force_scale,
    )


def tool_parameters(coupling: ToolCoupling, engine: str) -> dict[str, Any]:
    """Return a coupling to a simulation in the parameters and units of an engine, as JSON values.

    Args:
        coupling: of a problem with [simulation].
        engine: one of `ENGINES`.

    Raises:
        InputError: another engine, or one that supports no rotary device, or not the integrator.
    """
    if engine not in ENGINES:
        raise InputError.of(f"is {engine!r}; allowed: {', '.join(ENGINES)}", key=_KEY)
    known, tool = ENGINES[engine], coupling.tool
    if not known.turns and not coupling.problem.units.linear:
        others = ", ".join(name for name, one in ENGINES.items() if one.turns)
        raise InputError.of(f"is {engine!r}, which knows no device that turns; allowed: {others}", key=_KEY)
    if tool.solved != "nothing" and tool.integrator not in known.integrators:
        message = f"is {engine!r}, which solves no {tool.solved} of this coupling, as {tool.integrator} does"
        wanted = " or ".join(known.integrators) or "semi-implicit"
        raise InputError.of(f'{message}; say integrator = "{wanted}" in [simulation] and make it again', key=_KEY)
    law = known.law
    if engine == "mujoco" and tool.solved == "damper":
        law = law.replace(" - data.qvel[dof]", "")  # the joint has it, and implicitfast solves it
    handed = "force on the tool" if tool.exchange == "held-force" else "tool_x, tool_v"
    if tool.exchange == "held-force" and tool.solved != "nothing":
        handed = "avc_coupling_handed_force(...)"
    late = f", {tool.steps_late} steps later" if tool.steps_late else ""
    traps = [_EXCHANGE[tool.exchange].format(step=known.step) + late]
    if tool.tool_mass_kg is not None and known.integrators and tool.integrator not in known.integrators:
        traps.append(
            f"certified with integrator {tool.integrator}, and {known.title} has {', '.join(known.integrators)}"
        )
    return {
        "schema": "avc-tool-parameters/2",
        "engine": engine,
        "title": known.title,
        "coupling": coupling.id,
        "exchange": tool.exchange,
        "integrator": known.integrators.get(tool.integrator, ""),
        "parameters": _rows(coupling, engine),
        "device": f"F = avc_coupling_step(&c, x, {handed}) every {quantity(numbers_of(coupling).t, 's')}",
        "law": law,
        "traps": traps,
    }


def _rows(coupling: ToolCoupling, engine: str) -> list[dict[str, Any]]:
    """Return the rows of the table that this coupling has, each with its value."""
    numbers, unit = numbers_of(coupling), coupling.units.unit
    without = (_OF_A_MASS if math.isnan(numbers.m) else set()) | (
        set() if coupling.problem.units.linear else _OF_A_LINE
    )
    rows: list[dict[str, Any]] = [
        {**row, "value": FORMULAS[row["formula"]](numbers), "unit": unit(row["unit"])}
        for row in TABLE
        if row["engine"] == engine and row["formula"] not in without
    ]
    local = coupling.gains.local_damping_ns_per_m
    if local:
        place = "the device's own loop: avc_coupling_step alone has it"
        rows.append(
            {"engine": engine, "place": place, "formula": "local B", "value": local, "unit": unit("N.s/m"), "trap": ""}
        )
    return rows


def parameters_page(document: dict[str, Any], coupling: ToolCoupling, page: Page, shown: str) -> str:
    """Return the parameters as a headline and rows.

    Args:
        document: of `tool_parameters`.
        coupling: with these parameters.
        page: where it is printed.
        shown: the file as the user names it.
    """
    gains, unit = coupling.gains, coupling.problem.units.unit
    headline = (
        f"{shown}   for {document['title']} · K {quantity(gains.stiffness_n_per_m, unit('N/m'))}, "
        f"B {quantity(gains.damping_ns_per_m, unit('N.s/m'))} at the device · exchange {coupling.tool.exchange}"
    )
    rows = [
        Row(one["formula"], f"{one['value']:.6g} {one['unit']} · {one['place']}".replace("  ", " "))
        for one in document["parameters"]
    ]
    rows += [Row("Device", document["device"]), Row("Each step", document["law"])]
    rows += [Row("Trap", one, Mark.CAUTION) for one in document["traps"]]
    rows += [
        Row("Trap", f"{one['formula']}: {one['trap']}", Mark.CAUTION) for one in document["parameters"] if one["trap"]
    ]
    return page.rendered(headline, rows, [f"avc export {quote(shown)} --c DIR"])


def tool_export_page(document: Mapping[str, Any], coupling: ToolCoupling, page: Page, shown: str) -> str:
    """Return the `export` document of a coupling to a simulation as a headline and rows.

    Args:
        document: of `avc export --json`.
        coupling: that was exported.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    rate = quantity(1 / document["sample_time_s"], "Hz")
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row("Coupling", f"{coupling.id}: {coupling_text(vars(coupling.gains), coupling.problem)}"),
        Row("C", f"{document['precision']} precision, {rate}, exchange {document['exchange']}, both ends"),
        Row("Written", ", ".join(document["files"])),
    ]
    commands = [f"avc export {quote(shown)} --parameters ENGINE"]
    return page.rendered(tool_headline(coupling.problem, shown), rows, commands)
