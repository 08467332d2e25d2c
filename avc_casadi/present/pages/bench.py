"""Summaries of work with a device at its port: excited, limited, pushed to, streamed to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.pages.subject import gains_text, headline, plural, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.coupling import Coupling

_LIMITED = (("Force", "force_n", "N"), ("Speed", "speed_m_per_s", "m/s"), ("Energy", "energy_j", "J"))
_MOVED = (("Force", "force_n", "N"), ("Speed", "speed_m_per_s", "m/s"), ("Travel", "travel_m", "m"))


def plan_page(plan: Mapping[str, Any], units: Units, page: Page, shown: str, port: str) -> str:
    """Return the plan of the `excite` document as a headline and rows.

    Args:
        plan: ``plan`` of `avc excite --json`.
        units: of the device's motion.
        page: where it is printed.
        shown: the device as the user names it.
        port: of the device.
    """
    told, forecast, centring, force = quantities(units), plan["forecast"], plan["centring"], units.key("force")
    corners = "worst of its ranges" if plan["devices"] > 1 else "declared device"
    held = {"force_n": force, "speed_m_per_s": "speed", "travel_m": "travel"}[units.inner(plan["held_back_by"])]
    spring, damper = told(centring["spring_n_per_m"], "N/m"), told(centring["damper_ns_per_m"], "N.s/m")
    span = f"{quantity(plan['lowest_hz'], 'Hz')} to {quantity(plan['highest_hz'], 'Hz')}"
    rows = [
        Row(
            "Signal", f"{plan['signal']}, {span}, peak {told(plan['peak_force_n'], 'N')}; held back by the {held} limit"
        ),
        *(
            Row(
                _label(label, units),
                f"{told(forecast['worst'][key], unit)} of {told(plan['limits'][key], unit)} allowed, {corners}",
            )
            for label, key, unit in _MOVED
        ),
        Row("Centred by", f"spring {spring}, damper {damper}: hands off"),
    ]
    return page.rendered(f"{shown}   {plan['signal']} of {quantity(plan['seconds'], 's')} on {port}", rows)


def _label(word: str, units: Units) -> str:
    return units.key(word.lower()).capitalize()


def log_rows(log: Mapping[str, Any], units: Units) -> list[Row]:
    """Return the rows of the log of an excitation.

    Args:
        log: ``log`` of `avc excite --json`.
        units: of the device's motion.
    """
    told = quantities(units)
    peaks = ", ".join(told(log[f"peak_{key}"], unit) for _, key, unit in _MOVED)
    lost = f"{log['lost']} lost, seen as gaps" if log["lost"] else "none lost"
    return [
        Row("Played", log["end"], Mark.PASS if log["whole"] else Mark.FAIL),
        Row("Recorded", f"{plural(log['records'], 'record')} in {quantity(log['seconds'], 's')}, {lost}"),
        Row("At most", peaks),
    ]


def limits_page(document: Mapping[str, Any], units: Units, page: Page) -> str:
    """Return the `device --limits` document as a headline and rows.

    Args:
        document: of `avc device --json`.
        units: of the device's motion.
        page: where it is printed.
    """
    told = quantities(units)
    rows = [
        Row(
            _label(label, units),
            f"{told(document['hold'][key], unit)} of {told(document['boards'][key], unit)} built in",
        )
        for label, key, unit in _LIMITED
    ]
    if document["waits"]:
        asked = told(document["asked"]["force_n"], "N")
        rows.append(Row("Waits", f"{asked} hold when the device is released, out of contact", Mark.CAUTION))
    return page.rendered(f"{document['port']}   limits", rows)


def faults_page(document: Mapping[str, Any], advice: Sequence[str], page: Page) -> str:
    """Return the `device --clear` document as a headline and rows, a fault each.

    Args:
        document: of `avc device --clear --json`.
        advice: by fault.
        page: where it is printed.
    """
    rows = [Row("Fault", line, Mark.CAUTION) for line in advice] or [Row("Faults", "none was latched", Mark.PASS)]
    if set(document["were"]) & set(document["first"]):
        rows.append(Row("First", f"{', '.join(document['first'])}, at tick {document['tick']}"))
    if document["left"]:
        rows.append(Row("Still there", ", ".join(document["left"]), Mark.FAIL))
    elif document["were"]:
        rows.append(Row("Cleared", f"the device is in mode {document['mode']}", Mark.PASS))
    return page.rendered(f"{document['port']}   latched faults", rows)


def push_page(document: Mapping[str, Any], coupling: Coupling, page: Page, shown: str) -> str:
    """Return the `push` document as a headline and rows.

    Args:
        document: of `avc push --json`.
        coupling: that was pushed.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    problem, units, told = coupling.problem, coupling.problem.units, quantities(coupling.problem.units)
    limit = "the device's own" if coupling.max_force_n is None else told(coupling.max_force_n, "N")
    attempts = plural(document["attempts"], "attempt")
    took = f"{quantity(document['seconds'], 's')}, {attempts}"
    equal = document["readback_equal"]
    rounding = "exact in" if not document["rounding_max"] else f"within {document['rounding_max']:.0e} by"
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row(
            "Pushed",
            f"coupling {coupling.id}, {plural(document['rows'], 'row')} on {document['port']} ({took}), CRC "
            f"{document['crc32']:08x}",
        ),
        Row(
            "Read back",
            f"equal, {rounding} single precision" if equal else "NOT EQUAL",
            Mark.PASS if equal else Mark.FAIL,
        ),
        Row(f"{_label('force', units)} limit", limit),
    ]
    if document["widest_hole_hz"] is not None:
        low, high = (quantity(end, "Hz") for end in document["widest_hole_hz"])
        rows.append(Row("Holes", f"rows without gains are interpolated, at most from {low} to {high}", Mark.CAUTION))
    if "in_the_loop" in document:
        rows.append(_in_the_loop(document["in_the_loop"], coupling))
    rows += [Row("Note", note, Mark.CAUTION) for note in document.get("notes", ())]
    rows += [Row("Lacks", one, Mark.CAUTION) for one in coupling.lacks]
    commands = [f"avc monitor --port {document['port']}"] if document["port"] != "emulator" else []
    return page.rendered(headline(problem, shown), rows, commands)


def _in_the_loop(tried: Mapping[str, Any], coupling: Coupling) -> Row:
    """Describe how the pushed coupling performed with a hand on the emulated device."""
    if "skipped" in tried:
        return Row("In the loop", f"not tried; {tried['skipped']}", Mark.CAUTION)
    told = quantities(coupling.problem.units)
    settled = "settles with a hand" if tried["at_rest"] else "does NOT settle with a hand"
    stiffness = told(tried["apparent_stiffness_n_per_m"], "N/m")
    left = f"; without {', '.join(tried['left_out'])}" if tried["left_out"] else ""
    faults = f"; faults: {tried['faults']}" if tried["faults"] else ""
    what = f"{settled}: at most {told(tried['peak_force_n'], 'N')}, {stiffness} at the sensor{left}{faults}"
    return Row("In the loop", what, Mark.PASS if tried["at_rest"] and not faults else Mark.FAIL)


def export_page(document: Mapping[str, Any], coupling: Coupling, page: Page, shown: str) -> str:
    """Return the `export` document as a headline and rows.

    Args:
        document: of `avc export --json`.
        coupling: that was exported.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    schedule = coupling.schedule
    columns = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    gains = {key: getattr(schedule, key)[schedule.usable].tolist() for key in columns}
    observer = "observer with state feedback, " if coupling.runtime.state_feedback is not None else ""
    rate, rows_of = quantity(1 / coupling.sample_time_s, "Hz"), plural(document["rows"], "row")
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row("Coupling", f"{coupling.id}: {observer}{gains_text(gains, coupling.problem)}"),
        Row("C", f"{document['precision']} precision, {rate}, {rows_of}"),
        *_files(document["files"]),
        *([Row("Note", document["holes"], Mark.CAUTION)] if document["holes"] else []),
        *(Row("Lacks", one, Mark.CAUTION) for one in document["lacks"]),
    ]
    return page.rendered(headline(coupling.problem, shown), rows)


def firmware_page(document: Mapping[str, Any], title: str, units: Units, page: Page, held: str) -> str:
    """Return the `firmware` document as a headline and rows.

    Args:
        document: of `avc firmware --json`.
        title: of the board.
        units: of the device's motion.
        page: where it is printed.
        held: the gains that it runs.
    """
    told, limits = quantities(units), document["limits"]
    made = f"T {quantity(limits['sample_time_s'], 's')}, encoder steps of {told(limits['metres_per_count'], 'm')}"
    rows = [
        Row("Made for", f"{made}, at most {told(limits['max_force_n'], 'N')}"),
        Row("Gains", held),
        Row("Serial line", f"{document['baud']} baud"),
        *_files(document["files"]),
        *(Row("Note", note, Mark.CAUTION) for note in document["notes"]),
        *(Row("Flash by" if not place else "or by", one) for place, one in enumerate(document["commands"])),
    ]
    size = f"{document['size_bytes']} bytes from {document['address']:#010x}"
    return page.rendered(f"{document['board']}   {title} · build {document['build']}, {size}", rows)


def _files(files: Sequence[str]) -> list[Row]:
    """List the written files: all where they fit into a line or two, or the first and their number."""
    if len(files) <= 4:
        return [Row("Written", ", ".join(files))]
    return [Row("Written", f"{', '.join(files[:2])} and {len(files) - 2} more files")]


def stream_page(document: Mapping[str, Any], page: Page, faults: Sequence[str]) -> str:
    """Return the end of the `stream` document as a headline and rows.

    Args:
        document: of `avc stream --json`.
        page: where it is printed.
        faults: deviations from the expected state.
    """
    median, longest = (quantity(document[key], "s") for key in ("round_trip_s", "round_trip_max_s"))
    mode = document["status"]["mode"]
    whole = not document["late"] and not document["lost"]
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row(
            "Messages",
            f"{document['taken']} of {document['sent']} taken, {document['late']} late, {document['lost']} lost",
            Mark.PASS if whole else Mark.CAUTION,
        ),
        Row("Round trip", f"median {median}, largest {longest}"),
        Row("Back to table", f"{document['fell_back']} times", Mark.CAUTION if document["fell_back"] else Mark.NONE),
        Row("Afterwards", f"NOT as it should be ({mode})", Mark.FAIL)
        if faults
        else Row("Afterwards", f"the device is on its table ({mode})", Mark.PASS),
    ]
    length = f"{quantity(document['seconds'], 's')} at {document['rate_hz']:g} Hz"
    return page.rendered(f"{document['port']}   coupling {document['coupling']} streamed for {length}", rows)
