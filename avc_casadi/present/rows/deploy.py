"""Rows of deployment: exported, pushed, streamed, firmware built, faults of a device, parameters of an engine."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple, get_args

from avc_casadi._errors import InputError
from avc_casadi._util.units import Units
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import ToolIntegrator, mujoco_contact_n_per_m
from avc_casadi.present.row import Answer, Mark, Row, Value, caution, commas, fill, grade, parts, row
from avc_casadi.present.rows import subject


def _unsafe(data: Mapping[str, Any]) -> list[Row]:
    return [row("Unsafe", data["unsafe"], mark=Mark.FAIL)] if data["unsafe"] else []


def limits(data: Mapping[str, Any], units: Units) -> Answer:
    """Return the answer of `device`."""
    rows = []
    for label, key in (("Force", "force_n"), ("Speed", "speed_m_per_s"), ("Energy", "energy_j")):
        built_in = fill(f"of {{{key}}} built in", data["boards"]) if data["boards"][key] else "; none is built in"
        rows.append(row(label, Value.of(key, data["hold"][key]) if data["hold"][key] else "no limit", built_in))
    if data["waits"]:
        wanted = fill("{force_n} hold when the device is released, out of contact", data["asked"])
        rows.append(row("Waits", wanted, mark=Mark.CAUTION))
    return Answer("limits", data, (f"{data['port']}   limits",), tuple(rows), units=units)


def faults(data: Mapping[str, Any], advice: Sequence[str]) -> Answer:
    """Return the answer of `device --clear`: a row for each fault."""
    rows = subject.notes(advice, "Fault") or [row("Faults", "none was latched", mark=Mark.PASS)]
    if set(data["were"]) & set(data["first"]):
        rows.append(row("First", f"{', '.join(data['first'])}, at tick {data['tick']}"))
    if data["left"]:
        rows.append(row("Still there", ", ".join(data["left"]), mark=Mark.FAIL))
    elif data["were"]:
        rows.append(row("Cleared", f"the device is in mode {data['mode']}", mark=Mark.PASS))
    return Answer("faults", data, (f"{data['port']}   latched faults",), tuple(rows))


def push(data: Mapping[str, Any], coupling: Coupling, shown: str) -> Answer:
    """Return the answer of `push`."""
    problem, trial = coupling.problem, data.get("in_the_loop", {})
    rounding = "exact in" if not data["rounding_max"] else f"within {data['rounding_max']:.0e} by"
    took = fill(f"({{seconds:time}}, {subject.plural(data['attempts'], 'attempt')}), CRC {data['crc32']:08x}", data)
    rows = [
        *_unsafe(data),
        row("Pushed", f"coupling {coupling.id}, {subject.plural(data['rows'], 'row')} on {data['port']}", took),
        row("Read back", f"equal, {rounding} single precision", mark=Mark.PASS),
        row("Limit", fill("{max_force_n}", data)),
        *([in_the_loop(trial)] if trial else []),
    ]
    rows += subject.notes(filter(None, [data["holes"], *data.get("notes", ())]))
    rows += subject.notes(coupling.lacks, "Lacks")
    onwards = [] if data["port"] == "emulator" else [f"monitor --port {quote(data['port'])}"]
    why = f"avc: {shown} does not settle on the emulated device: avc simulate {quote(shown)} -v"
    no = "" if trial.get("at_rest", True) else why
    return subject.answer("push", data, problem, shown, rows, *onwards, complaint=no)


def in_the_loop(trial: Mapping[str, Any]) -> Row:
    """Return how the pushed coupling performed with a hand on the emulated device."""
    if "skipped" in trial:
        return row("In the loop", f"not tried; {trial['skipped']}", mark=Mark.CAUTION)
    left = f"; without {', '.join(trial['left_out'])}" if trial["left_out"] else ""
    faulty = f"; faults: {trial['faults']}" if trial["faults"] else ""
    what = f"{'settles' if trial['at_rest'] else 'does NOT settle'} with a hand: at most"
    force = fill(f"{what} {{peak_force_n}}, {{apparent_stiffness_n_per_m}} at the sensor{left}{faulty}", trial)
    return row("In the loop", force, mark=grade(trial["at_rest"]))


def export(data: Mapping[str, Any], coupling: Coupling, shown: str) -> Answer:
    """Return the answer of `export`."""
    problem = coupling.problem
    far = coupling.follower.sample_time_s if coupling.end == "follower" else coupling.sample_time_s
    rates = commas(Value(1 / one, "frequency") for one in dict.fromkeys((coupling.sample_time_s, far)))
    if coupling.end == "wall":
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        table = {key: getattr(coupling.schedule, key)[coupling.schedule.usable].tolist() for key in keys}
        observer = "observer with state feedback," if coupling.runtime.state_feedback is not None else ""
        what, size = parts(observer, subject.gains(table, problem)), subject.plural(len(coupling.table), "row")
    else:
        there = ("at the follower", subject.pair(vars(coupling.at_follower))) if coupling.end == "follower" else None
        what, size = commas([subject.pair(vars(coupling.gains)), there], ";"), "both ends"
    fitting = (name for name in _ENGINES if not _misfit(coupling, name)) if coupling.end == "simulation" else ()
    onwards = [f"export {{}} --parameters {name}" for name in fitting][:1]
    rows = [
        *_unsafe(data),
        row("Coupling", f"{coupling.id}:", what),
        row("C", f"{data['precision']} precision,", rates, f", {size}"),
        *subject.notes(filter(None, [data.get("holes")])),
        *subject.notes(data.get("lacks", ()), "Lacks"),
    ]
    return subject.answer("export", data, problem, shown, rows, *onwards)


def firmware(data: Mapping[str, Any], title: str, units: Units, held: str) -> Answer:
    """Return the answer of `firmware`: what it is made for, what it runs, how it is flashed."""
    made = "T {sample_time_s}, encoder steps of {metres_per_count:length}, at most {max_force_n}"
    rows = [
        row("Made for", fill(made, data["limits"])),
        row("Gains", held),
        row("Serial line", f"{data['baud']} baud"),
        *subject.notes(data["notes"]),
        *(row("or by" if place else "Flash by", one) for place, one in enumerate(data["commands"])),
    ]
    size = f"{data['size_bytes']} bytes from {data['address']:#010x}"
    headed = (f"{data['board']}   {title} · build {data['build']}, {size}",)
    return Answer("firmware", data, headed, tuple(rows), units=units)


def stream(data: Mapping[str, Any], deviations: Sequence[str]) -> Answer:
    """Return the answer of `stream`: messages taken and lost, and the state of the device afterwards."""
    mode = data["status"]["mode"]
    after = f"NOT as it should be ({mode})" if deviations else f"the device is on its table ({mode})"
    taken = "{sent:9} sent, {taken:9} taken, {late:9} late, {lost:9} lost"
    fell = Mark.CAUTION if data["fell_back"] else Mark.NONE
    rows = [
        *_unsafe(data),
        row("Messages", fill(taken, data), mark=grade(not data["late"] and not data["lost"], Mark.CAUTION)),
        row("Round trip", fill("median {round_trip_s}, largest {round_trip_max_s}", data)),
        row("Back to table", fill("{fell_back:9} times", data), mark=fell),
        row("Afterwards", after, mark=grade(not deviations)),
    ]
    title = fill(f"coupling {data['coupling']} streamed for {{seconds:time}} at {data['rate_hz']:g} Hz", data)
    return Answer("stream", data, parts(data["port"], " ", title), tuple(rows))


class EngineNames(NamedTuple):
    """A simulation engine: name, call of its step, its names of integrators, whether a device that turns fits."""

    title: str
    step: str
    integrators: dict[ToolIntegrator, str]
    turns: bool = True


_SEMI: dict[ToolIntegrator, str] = {"semi-implicit": "semi-implicit"}
_MUJOCO: dict[ToolIntegrator, str] = {"semi-implicit": "Euler", "implicit-damping": "implicitfast", "exact": "RK4"}
_ENGINES = {
    "mujoco": EngineNames("MuJoCo", "mj_step", _MUJOCO),
    "chai3d": EngineNames("CHAI3D", "updateDynamics", _SEMI, turns=False),
    "unity": EngineNames("Unity (PhysX)", "the physics step", _SEMI),
    "sofa": EngineNames("SOFA", "animate", {"implicit": "EulerImplicitSolver"}, turns=False),
    "openhaptics": EngineNames("OpenHaptics", "your step", {one: one for one in get_args(ToolIntegrator)}, turns=False),
    "imstk": EngineNames("iMSTK", "the scene's step", {}),
    "ros2": EngineNames("ROS 2", "the update", _SEMI),
    "pybullet": EngineNames("PyBullet", "stepSimulation", _SEMI),
}
_AHEAD = "position and velocity of after it lie in the future of the force that made them, which costs 10 to 60 times K"


def _values_of(coupling: Coupling) -> dict[str, float]:
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
        # With this impedance of a weld the tool is a thousandth heavier, and spring and damper act nearly as a force.
        d = 1e-3
        found |= {"-K (1 - d)/m": -k * (1 - d) / m, "-B (1 - d)/m": -b * (1 - d) / m, "d": d}
        found["contact 2 N"] = mujoco_contact_n_per_m(m, 2.0)
    return found


def _places(engine: str) -> list[dict[str, str]]:
    """Return where an engine takes the value of each formula."""
    with Path(__file__).with_name("engines.csv").open(encoding="utf-8", newline="") as text:
        return [one for one in csv.DictReader(text) if one["engine"] == engine]


def _misfit(coupling: Coupling, engine: str) -> str:
    """Return why an engine does not take a coupling; empty where it does."""
    if engine not in _ENGINES:
        return f"is no engine of this table; allowed: {', '.join(_ENGINES)}"
    known, tool, lacks, wanted = _ENGINES[engine], coupling.tool, "", ""
    if not known.turns and not coupling.problem.units.linear:
        return f"knows no device that turns; allowed: {', '.join(name for name, one in _ENGINES.items() if one.turns)}"
    integrators = known.integrators or _SEMI
    if tool.integrator not in integrators and tool.tool_mass_kg is not None:
        lacks, wanted = tool.integrator, " or ".join(f'integrator = "{one}"' for one in integrators)
    elif tool.substeps > 1 and not any(one["formula"] == "n" for one in _places(engine)):
        step_s = max(max(tool.step_s) / tool.substeps, coupling.problem.device.sample_time_s)
        lacks, wanted = f"substeps = {tool.substeps}", f"substeps = 1, step_s = {step_s:.6g}"
    return f"has no {lacks} of this coupling; say {wanted} in [simulation] and make it again" if wanted else ""


def parameters(coupling: Coupling, engine: str, shown: str = "coupling.json", unsafe: str = "") -> Answer:
    """Return a coupling to a simulation in the parameters and units of an engine."""
    if why := _misfit(coupling, engine):
        raise InputError.of(f"is {engine!r}, which {why}", key="--parameters")
    places = _places(engine)
    known, tool, units, values = _ENGINES[engine], coupling.tool, coupling.problem.units, _values_of(coupling)
    # The joint has the damper that implicitfast solves.
    law = next(one["place"] for one in places if one["formula"] == "each step")
    if engine == "mujoco" and tool.solved == "damper":
        law = law.replace("(v - data.qvel[dof])", "v")
    handed = "tool_x, tool_v"
    if tool.exchange == "held-force":
        handed = "force on the tool" if tool.solved == "nothing" else "avc_coupling_handed_force(...)"
    late = f", {subject.plural(tool.steps_late, 'step')} later" if tool.steps_late else ""
    ahead = "" if tool.exchange == "held-force" else f"; {_AHEAD}"
    traps = [unsafe, f"hand out {subject.EXCHANGES[tool.exchange].format(step=known.step)}{ahead}{late}"]
    table: list[dict[str, Any]] = [
        {**one, "value": values[one["formula"]], "unit": units.unit(one["unit"])}
        for one in places
        if one["formula"] in values
    ]
    if own := coupling.gains.local_damping_ns_per_m:
        place, unit = "the device's own loop: avc_coupling_step alone has it", units.unit("N.s/m")
        table.append({"engine": engine, "place": place, "formula": "local B", "value": own, "unit": unit, "trap": ""})
    data: dict[str, Any] = {
        "engine": engine,
        "title": known.title,
        "coupling": coupling.id,
        "exchange": tool.exchange,
        "integrator": known.integrators.get(tool.integrator, ""),
        "parameters": table,
        "sample_time_s": coupling.problem.device.sample_time_s,
        "device": f"F = avc_coupling_step(&c, x, {handed}) every",
        "law": law,
        "traps": [one for one in traps if one],
    }
    rows = []
    for one in table:
        what = f"{one['unit']} · {one['place']}{'; ' if one['trap'] else ''}{one['trap']}".lstrip()
        rows.append(row(one["formula"], Value(one["value"], "number", 6), what, mark=caution(one["trap"])))
    rows += [row("Device", fill("{device} {sample_time_s}", data)), row("Each step", law)]
    rows += subject.notes(data["traps"], "Trap")
    how = f"· exchange {tool.exchange}" + (f" · integrator {data['integrator']}" if data["integrator"] else "")
    title = parts(shown, f"  for {known.title} ·", subject.pair(vars(coupling.gains)), how)
    onwards = (f"avc export {quote(shown)} --c firmware",)
    return Answer("parameters", data, title, tuple(rows), onwards, units, whole=True)
