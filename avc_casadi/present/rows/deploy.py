"""Rows of deployment: exported, pushed, streamed, firmware built, faults of a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi.present.row import Answer, Mark, Part, Row, Value, count, listed, marked, parts, row
from avc_casadi.present.rows.subject import answer, gains, notes, pair, plural

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.coupling import Coupling

_LIMITED: tuple[tuple[str, str, Any], ...] = (
    ("Force", "force_n", "force"),
    ("Speed", "speed_m_per_s", "speed"),
    ("Energy", "energy_j", "energy"),
)


def _unsafe(data: Mapping[str, Any]) -> list[Row]:
    return [row("Unsafe", data["unsafe"], mark=Mark.FAIL)] if data["unsafe"] else []


def _files(files: Sequence[str]) -> list[Row]:
    """List the written files: all where they fit into a line or two, or the first and their number."""
    if len(files) <= 4:
        return [row("Written", ", ".join(files))]
    every = [row("Written", one, rank=1) for one in files]
    return [row("Written", f"{', '.join(files[:2])} and {len(files) - 2} more files"), *every]


def limits(data: Mapping[str, Any], units: Units) -> Answer:
    """Return the answer of `device`."""
    rows = [
        row(label, Value(data["hold"][key], of), "of", Value(data["boards"][key], of), "built in")
        for label, key, of in _LIMITED
    ]
    if data["waits"]:
        wanted = Value(data["asked"]["force_n"], "force")
        rows.append(row("Waits", wanted, "hold when the device is released, out of contact", mark=Mark.CAUTION))
    return Answer("limits", data, (f"{data['port']}   limits",), tuple(rows), units=units)


def faults(data: Mapping[str, Any], advice: Sequence[str]) -> Answer:
    """Return the answer of `device --clear`: a row for each fault."""
    rows = notes(advice, "Fault") or [row("Faults", "none was latched", mark=Mark.PASS)]
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
    took = ("(", Value(data["seconds"], "time"), f", {plural(data['attempts'], 'attempt')}), CRC {data['crc32']:08x}")
    limit: Part = "the device's own" if coupling.max_force_n is None else Value(coupling.max_force_n, "force")
    rows = [
        *_unsafe(data),
        row("Pushed", f"coupling {coupling.id}, {plural(data['rows'], 'row')} on {data['port']}", took),
        row("Read back", f"equal, {rounding} single precision" if equal else "NOT EQUAL", mark=marked(equal)),
        row("Limit", limit),
    ]
    if "in_the_loop" in data:
        rows.append(in_the_loop(data["in_the_loop"]))
    rows += [*notes([*filter(None, [data["holes"]]), *data.get("notes", ())]), *notes(coupling.lacks, "Lacks")]
    onwards = () if data["port"] == "emulator" else (f"avc monitor --port {quote(data['port'])}",)
    return answer("push", data, problem, shown, rows, onwards)


def in_the_loop(tried: Mapping[str, Any]) -> Row:
    """Return how the pushed coupling performed with a hand on the emulated device."""
    if "skipped" in tried:
        return row("In the loop", f"not tried; {tried['skipped']}", mark=Mark.CAUTION)
    left = f"; without {', '.join(tried['left_out'])}" if tried["left_out"] else ""
    faulty = f"; faults: {tried['faults']}" if tried["faults"] else ""
    what = ("settles with a hand" if tried["at_rest"] else "does NOT settle with a hand", ": at most")
    felt = (Value(tried["peak_force_n"], "force"), ",", Value(tried["apparent_stiffness_n_per_m"], "stiffness"))
    mark = marked(tried["at_rest"] and not faulty)
    return row("In the loop", what, felt, "at the sensor", left, faulty, mark=mark)


def export(data: Mapping[str, Any], coupling: Coupling, shown: str) -> Answer:
    """Return the answer of `export`."""
    problem = coupling.problem
    periods = dict.fromkeys(filter(None, (data["sample_time_s"], data.get("follower_sample_time_s"))))
    rates = listed(Value(1 / one, "frequency") for one in periods)
    if coupling.end == "wall":
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        table = {key: getattr(coupling.schedule, key)[coupling.schedule.usable].tolist() for key in keys}
        observer = "observer with state feedback," if coupling.runtime.state_feedback is not None else ""
        what, size = parts(observer, gains(table, problem)), plural(data["rows"], "row")
    else:
        there = parts("at the follower", pair(vars(coupling.at_follower))) if coupling.end == "follower" else None
        what, size = listed([pair(vars(coupling.gains)), there], ";"), "both ends"
    onwards = (f"avc export {quote(shown)} --parameters mujoco",) if coupling.end == "simulation" else ()
    rows = [
        *_unsafe(data),
        row("Coupling", f"{coupling.id}:", what),
        row("C", f"{data['precision']} precision,", rates, f", {size}"),
        *_files(data["files"]),
        *notes(filter(None, [data.get("holes")])),
        *notes(data.get("lacks", ()), "Lacks"),
    ]
    return answer("export", data, problem, shown, rows, onwards)


def firmware(data: Mapping[str, Any], title: str, units: Units, held: str) -> Answer:
    """Return the answer of `firmware`: what it is made for, what it runs, how it is flashed."""
    made = data["limits"]
    rows = [
        row(
            "Made for",
            ("T", Value(made["sample_time_s"], "time")),
            (", encoder steps of", Value(made["metres_per_count"], "length")),
            (", at most", Value(made["max_force_n"], "force")),
        ),
        row("Gains", held),
        row("Serial line", f"{data['baud']} baud"),
        *_files(data["files"]),
        *notes(data["notes"]),
        *(row("or by" if place else "Flash by", one) for place, one in enumerate(data["commands"])),
    ]
    size = f"{data['size_bytes']} bytes from {data['address']:#010x}"
    headed = (f"{data['board']}   {title} · build {data['build']}, {size}",)
    return Answer("firmware", data, headed, tuple(rows), units=units)


def stream(data: Mapping[str, Any], deviations: Sequence[str]) -> Answer:
    """Return the answer of `stream`: messages taken and lost, and the state of the device afterwards."""
    mode, fell = data["status"]["mode"], data["fell_back"]
    taken = listed((count(data[key]), key) for key in ("sent", "taken", "late", "lost"))
    median, largest = (Value(data[key], "time") for key in ("round_trip_s", "round_trip_max_s"))
    after = f"NOT as it should be ({mode})" if deviations else f"the device is on its table ({mode})"
    rows = [
        *_unsafe(data),
        row("Messages", taken, mark=marked(not data["late"] and not data["lost"], Mark.CAUTION)),
        row("Round trip", "median", median, ", largest", largest),
        row("Back to table", count(fell), "times", mark=Mark.CAUTION if fell else Mark.NONE),
        row("Afterwards", after, mark=marked(not deviations)),
    ]
    length = ("for", Value(data["seconds"], "time"), f"at {data['rate_hz']:g} Hz")
    return Answer("stream", data, parts(f"{data['port']}   coupling {data['coupling']} streamed", length), tuple(rows))
