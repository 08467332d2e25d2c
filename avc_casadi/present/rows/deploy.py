"""Rows of deployment: exported, pushed, streamed, firmware built, faults of a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi.present.row import Answer, Mark, Row, Value, fill, listed, marked, parts, row
from avc_casadi.present.rows import subject

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.coupling import Coupling


def _unsafe(data: Mapping[str, Any]) -> list[Row]:
    return [row("Unsafe", data["unsafe"], mark=Mark.FAIL)] if data["unsafe"] else []


def _files(files: Sequence[str]) -> list[Row]:
    """List the written files: all where they fit into a line or two, or the first and their number."""
    more = f" and {len(files) - 2} more files" if len(files) > 4 else ""
    return [row("Written", ", ".join(files[:2] if more else files) + more)]


def limits(data: Mapping[str, Any], units: Units) -> Answer:
    """Return the answer of `device`."""
    rows = []
    for label, key in (("Force", "force_n"), ("Speed", "speed_m_per_s"), ("Energy", "energy_j")):
        built_in = fill(f"of {{{key}}} built in", data["boards"])
        rows.append(row(label, fill(f"{{{key}}}", data["hold"]), built_in))
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
    equal, problem = data["readback_equal"], coupling.problem
    rounding = "exact in" if not data["rounding_max"] else f"within {data['rounding_max']:.0e} by"
    took = fill(f"({{seconds:time}}, {subject.plural(data['attempts'], 'attempt')}), CRC {data['crc32']:08x}", data)
    limit = None if coupling.max_force_n is None else Value(coupling.max_force_n, "force")
    rows = [
        *_unsafe(data),
        row("Pushed", f"coupling {coupling.id}, {subject.plural(data['rows'], 'row')} on {data['port']}", took),
        row("Read back", f"equal, {rounding} single precision" if equal else "NOT EQUAL", mark=marked(equal)),
        row("Limit", limit or "the device's own"),
    ]
    if "in_the_loop" in data:
        rows.append(in_the_loop(data["in_the_loop"]))
    rows += [
        *subject.notes([*filter(None, [data["holes"]]), *data.get("notes", ())]),
        *subject.notes(coupling.lacks, "Lacks"),
    ]
    onwards = [] if data["port"] == "emulator" else [f"monitor --port {quote(data['port'])}"]
    return subject.answer("push", data, problem, shown, rows, *onwards)


def in_the_loop(tried: Mapping[str, Any]) -> Row:
    """Return how the pushed coupling performed with a hand on the emulated device."""
    if "skipped" in tried:
        return row("In the loop", f"not tried; {tried['skipped']}", mark=Mark.CAUTION)
    left = f"; without {', '.join(tried['left_out'])}" if tried["left_out"] else ""
    faulty = f"; faults: {tried['faults']}" if tried["faults"] else ""
    what = f"{'settles' if tried['at_rest'] else 'does NOT settle'} with a hand: at most"
    force = fill(f"{what} {{peak_force_n}}, {{apparent_stiffness_n_per_m}} at the sensor{left}{faulty}", tried)
    return row("In the loop", force, mark=marked(tried["at_rest"] and not faulty))


def export(data: Mapping[str, Any], coupling: Coupling, shown: str) -> Answer:
    """Return the answer of `export`."""
    problem = coupling.problem
    periods = dict.fromkeys(filter(None, (data["sample_time_s"], data.get("follower_sample_time_s"))))
    rates = listed(Value(1 / one, "frequency") for one in periods)
    if coupling.end == "wall":
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        table = {key: getattr(coupling.schedule, key)[coupling.schedule.usable].tolist() for key in keys}
        observer = "observer with state feedback," if coupling.runtime.state_feedback is not None else ""
        what, size = parts(observer, subject.gains(table, problem)), subject.plural(data["rows"], "row")
    else:
        there = (
            parts("at the follower", subject.pair(vars(coupling.at_follower))) if coupling.end == "follower" else None
        )
        what, size = listed([subject.pair(vars(coupling.gains)), there], ";"), "both ends"
    onwards = ["export {} --parameters mujoco"] if coupling.end == "simulation" else []
    rows = [
        *_unsafe(data),
        row("Coupling", f"{coupling.id}:", what),
        row("C", f"{data['precision']} precision,", rates, f", {size}"),
        *_files(data["files"]),
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
        *_files(data["files"]),
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
        row("Messages", fill(taken, data), mark=marked(not data["late"] and not data["lost"], Mark.CAUTION)),
        row("Round trip", fill("median {round_trip_s}, largest {round_trip_max_s}", data)),
        row("Back to table", fill("{fell_back:9} times", data), mark=fell),
        row("Afterwards", after, mark=marked(not deviations)),
    ]
    title = fill(f"coupling {data['coupling']} streamed for {{seconds:time}} at {data['rate_hz']:g} Hz", data)
    return Answer("stream", data, parts(data["port"], " ", title), tuple(rows))
