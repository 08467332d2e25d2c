"""Rows of deployment: exported, pushed, streamed, firmware built, faults of a device.

What the hardware reports is above these rows: `reports` has the values that they show of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from shlex import quote
from typing import Any, ClassVar

from avc_casadi._util.json_values import Document, plain
from avc_casadi._util.text import plural
from avc_casadi._util.units import Quantity, Units
from avc_casadi.claims.deployable import Deployable
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import End, Follower, Simulation, Wall
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, commas, grade, parts, row, verdict_mark
from avc_casadi.present.rows import engines, pieces, subject
from avc_casadi.present.rows.reports import (
    ReportedBoard,
    ReportedDeviceLimits,
    ReportedPush,
    ReportedStream,
    ReportedTrial,
)


@dataclass(frozen=True)
class Deployment(Document):
    """A coupling that goes into a device or into C, with the verdict on it.

    Attributes:
        coupling: its identity.
        deployable: the verdict; None of a coupling to another end.
        unsafe: why it went on by request alone; empty where it is deployable.
        lacks: what a table of gains does not say; None of a coupling to another end.
        holes: what runs at frequencies without gains.
        judged_for: hands and margin that the verdict is for.
    """

    JSON_KEYS: ClassVar = ("coupling", "deployable", "judged_for", "unsafe", "lacks", "holes")

    coupling: str
    deployable: Deployable
    unsafe: str
    lacks: tuple[str, ...]
    holes: str | None
    judged_for: JudgedFor


def _unsafe(why: str) -> list[Row]:
    return [row("Unsafe", why, mark=Mark.FAIL)] if why else []


def limits(result: ReportedDeviceLimits, units: Units) -> Answer:
    """Return the answer of `device`."""
    boards, hold = result.boards, result.hold
    rows = [
        _limit("Force", hold.force_n, boards.force_n, "force"),
        _limit("Speed", hold.speed_m_per_s, boards.speed_m_per_s, "speed"),
        _limit("Energy", hold.energy_j, boards.energy_j, "energy"),
    ]
    if result.waits:
        force = Value(result.asked.force_n, "force")
        rows.append(
            row(
                "Pending", "a limit of", force, "applies once the device is released, out of contact", mark=Mark.CAUTION
            )
        )
    return Answer("limits", plain(result), (f"{result.port}   limits",), tuple(rows), units=units)


def _limit(label: str, in_force: float, built_in: float, quantity: Quantity) -> Row:
    limit: Part = Value(in_force, quantity) if in_force else "no limit"
    of = ("of", Value(built_in, quantity), "built in") if built_in else "; the firmware has no limit"
    return row(label, limit, of)


@dataclass(frozen=True)
class ClearedFaults:
    """Faults of a device before and after they were cleared, in words, and when the first came.

    Attributes:
        port: the device's port.
        were: faults that were latched.
        first: those of the first tick with one.
        left: those that are there still.
        tick: the first tick with one.
        mode: mode of the device afterwards.
    """

    port: str
    were: tuple[str, ...]
    first: tuple[str, ...]
    left: tuple[str, ...]
    tick: int
    mode: str


def faults(result: ClearedFaults, advice: Sequence[str]) -> Answer:
    """Return the answer of `device --clear`: a row for each fault."""
    rows = subject.notes(advice, "Fault") or [row("Faults", "none was latched", mark=Mark.PASS)]
    if set(result.were) & set(result.first):
        rows.append(row("First", f"{', '.join(result.first)}, at tick {result.tick}"))
    if result.left:
        rows.append(row("Not cleared", ", ".join(result.left), mark=Mark.FAIL))
    elif result.were:
        rows.append(row("Cleared", f"the device is in mode {result.mode}", mark=Mark.PASS))
    return Answer("faults", plain(result), (f"{result.port}   latched faults",), tuple(rows))


@dataclass(frozen=True)
class NotTried(Document):
    """Why a push or a trial on the emulated device did not take place."""

    JSON_KEYS: ClassVar = (("skipped", "why"),)

    why: str


@dataclass(frozen=True)
class Refused(Document):
    """Why a push was refused; `deployable` is False where trials refuse the coupling, else None."""

    JSON_KEYS: ClassVar = (("refused", "why"), "deployable")
    JSON_LEFT_OUT: ClassVar = frozenset({"deployable"})

    why: str
    deployable: bool | None = None


@dataclass(frozen=True)
class Tried:
    """A push to the emulated device and the trial there; `unsafe` is why it went on by request alone."""

    push: ReportedPush
    unsafe: str
    loop: ReportedTrial | NotTried

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return self.push.document() | {"unsafe": self.unsafe, "in_the_loop": self.loop.document()}


PushOutcome = NotTried | Refused | Tried
"""What became of the push of a whole run."""


def push(
    result: ReportedPush, deployment: Deployment, loop: ReportedTrial | NotTried | None, coupling: Coupling, shown: str
) -> Answer:
    """Return the answer of `push`; ``loop`` is the trial on the emulated device, None on a device."""
    problem = coupling.problem
    rounding = f" within {result.rounding_max:.0e}, the rounding of" if result.rounding_max else " in"
    attempts = f", {plural(result.attempts, 'attempt')}), CRC {result.crc32:08x}"
    table = f"coupling {coupling.id}, {plural(result.rows, 'row')} on {result.port}"
    rows = [
        *_unsafe(deployment.unsafe),
        row("Pushed", table, "(", Value(result.seconds, "time"), attempts),
        row("Read back", f"equal{rounding} single precision", mark=Mark.PASS),
        row("Limit", Value(result.max_force_n, "force")),
        subject.judged_for(deployment.judged_for),
        *([] if loop is None else [in_the_loop(loop)]),
        *subject.notes(filter(None, [deployment.holes, *result.notes])),
        *subject.edited(coupling),
        *subject.notes(coupling.lacks, "Missing"),
    ]
    onwards = [] if result.port == "emulator" else [f"monitor --port {quote(result.port)}"]
    restless = loop is not None and not isinstance(loop, NotTried) and not loop.at_rest
    why = f"avc: {shown} does not settle on the emulated device: avc simulate {quote(shown)} -v"
    data = deployment.document() | result.document() | {"edited": coupling.edited}
    if loop is not None:
        data["in_the_loop"] = loop.document()
    return subject.answer("push", data, problem, shown, rows, *onwards, complaint=why if restless else "")


def in_the_loop(loop: ReportedTrial | NotTried) -> Row:
    """Return how the pushed coupling performed with a hand on the emulated device."""
    if isinstance(loop, NotTried):
        return row("In the loop", f"not tried; {loop.why}", mark=Mark.CAUTION)
    left = f"; not simulated: {', '.join(loop.left_out)}" if loop.left_out else ""
    faulty = f"; faults: {loop.faults}" if loop.faults else ""
    settles = f"{'settles' if loop.at_rest else 'does NOT settle'} with a hand: at most"
    force, stiffness = Value(loop.peak_force_n, "force"), Value(loop.apparent_stiffness_n_per_m, "stiffness")
    return row("In the loop", settles, force, ",", stiffness, f"at the sensor{left}{faulty}", mark=grade(loop.at_rest))


def pushed(outcome: PushOutcome) -> Row:
    """Return what became of the push of a whole run."""
    if isinstance(outcome, NotTried):
        return row("Device", f"push skipped; {outcome.why}", mark=Mark.CAUTION)
    if isinstance(outcome, Refused):
        advice = "the coupling is not deployable; --unsafe overrides"
        return row("Device", f"push refused; {advice if outcome.deployable is False else outcome.why}", mark=Mark.FAIL)
    loop = in_the_loop(outcome.loop)
    unsafe = f"; {outcome.unsafe}" if outcome.unsafe else ""
    mark = Mark.CAUTION if unsafe and loop.mark is Mark.PASS else loop.mark
    table = f"coupling {outcome.push.coupling_id} on {outcome.push.port}, read back;"
    return row("Device", table, loop.values, unsafe, mark=mark)


@dataclass(frozen=True)
class Exported:
    """C files of a coupling.

    Attributes:
        precision: single or double.
        files: paths of the files.
        unsafe: why it went on by request alone; empty where it is deployable.
        judged_for: hands and margin that the verdict is for.
        deployment: the verdict of a coupling to a wall; None of one to another end.
    """

    precision: str
    files: tuple[str, ...]
    unsafe: str
    judged_for: JudgedFor
    deployment: Deployment | None

    def document(self, coupling: Coupling) -> dict[str, Any]:
        """Return the `export` document: JSON values only."""
        judged = {"coupling": coupling.id, "judged_for": self.judged_for.document(), "unsafe": self.unsafe}
        if self.deployment is not None:
            judged = self.deployment.document()
        return judged | {"edited": coupling.edited, "precision": self.precision, "files": list(self.files)}


def export(result: Exported, coupling: Coupling, shown: str) -> Answer:
    """Return the answer of `export`."""
    in_c, deployment = _in_c(coupling.end, coupling), result.deployment
    periods_s = dict.fromkeys((coupling.sample_time_s, in_c.far_sample_time_s or coupling.sample_time_s))
    rates = commas(Value(1 / period_s, "frequency") for period_s in periods_s)
    rows = [
        *_unsafe(result.unsafe),
        row("Coupling", f"{coupling.id}:", in_c.gains),
        row("C", f"{result.precision} precision,", rates, f", {in_c.size}"),
        subject.judged_for(result.judged_for),
        *subject.edited(coupling),
    ]
    if deployment is not None:
        rows += subject.notes([deployment.holes] if deployment.holes else [])
        rows += subject.notes(deployment.lacks, "Missing")
    commands = [f"export {{}} --parameters {name}" for name in in_c.engines[:1]]
    return subject.answer("export", result.document(coupling), coupling.problem, shown, rows, *commands)


@dataclass(frozen=True)
class ExportedLaw:
    """C files of a law.

    Attributes:
        precision: single or double.
        files: paths of the files.
        law: its identifier.
        passed: whether it is deployable; else it went on by request.
        sound: whether nothing of it is doubted.
        sentence: the verdict.
        judged_for: hands and margin that the verdict is for.
    """

    precision: str
    files: tuple[str, ...]
    law: str
    passed: bool
    sound: bool
    sentence: str
    judged_for: JudgedFor


def export_law(result: ExportedLaw, problem: Problem, shown: str) -> Answer:
    """Return the answer of `export` of a law."""
    law = problem.law
    assert law is not None  # noqa: S101 - it was exported
    rate = Value(1 / problem.device.sample_time_s, "frequency")
    rows = [
        row("Verdict", result.sentence, mark=verdict_mark(result.passed, result.sound)),
        row("Law", f"{result.law}:", pieces.named(law), "" if problem.law_in_wall else ", on both sides of 0"),
        row("C", f"{result.precision} precision,", rate),
        subject.judged_for(result.judged_for),
    ]
    return subject.answer("export", plain(result), problem, shown, rows)


@dataclass(frozen=True)
class _InC:
    """What the C of a coupling holds: gains, how much, the other sample time, and which engines take it without C."""

    gains: tuple[Part, ...]
    size: str = "both ends"
    far_sample_time_s: float | None = None
    engines: tuple[str, ...] = ()


@singledispatch
def _in_c(end: End, coupling: Coupling) -> _InC:  # noqa: ARG001
    return _InC(subject.pair_of(coupling.gains))


@_in_c.register
def _wall_in_c(end: Wall, coupling: Coupling) -> _InC:  # noqa: ARG001
    schedule, usable = coupling.schedule, coupling.schedule.usable
    columns = (schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m)
    damping, stiffness, contact_damping = (column[usable].tolist() for column in columns)
    observer = "observer with state feedback," if coupling.runtime.state_feedback is not None else ""
    gains = parts(observer, subject.gain_spans(damping, stiffness, contact_damping, coupling.problem))
    return _InC(gains, plural(len(coupling.table), "row"))


@_in_c.register
def _tool_in_c(end: Simulation, coupling: Coupling) -> _InC:  # noqa: ARG001
    return _InC(subject.pair_of(coupling.gains), engines=tuple(engines.fitting(coupling)))


@_in_c.register
def _follower_in_c(end: Follower, coupling: Coupling) -> _InC:
    other_end = ("at the follower", subject.pair_of(coupling.at_follower))
    return _InC(commas([subject.pair_of(coupling.gains), other_end], ";"), far_sample_time_s=end.sample_time_s)


@dataclass(frozen=True)
class Firmware:
    """Firmware that was built for a device.

    Attributes:
        board: name of the board.
        build: name of the sources.
        address: address of its first byte.
        commands: each flashes it.
        baud: rate of its serial port.
        size_bytes: bytes in flash.
        notes: values that are the board's own.
        files: paths of the files.
        limits: what is built in.
        figures: what the runtime of a coupling needs of it.
    """

    board: str
    build: str
    address: int
    commands: tuple[str, ...]
    baud: int
    size_bytes: int
    notes: tuple[str, ...]
    files: tuple[str, ...]
    limits: ReportedBoard
    figures: object


def firmware(result: Firmware, title: str, units: Units, held: str) -> Answer:
    """Return the answer of `firmware`: what it is made for, what it runs, how it is flashed."""
    built_in = result.limits
    tick, step = Value(built_in.sample_time_s, "time"), Value(built_in.metres_per_count, "length")
    force = Value(built_in.max_force_n, "force")
    rows = [
        row("Built for", "sample time", tick, ", encoder step", step, ", force limit", force),
        row("Gains", held),
        row("Serial line", f"{result.baud} baud"),
        *subject.notes(result.notes),
        *(row("or by" if place else "Flash by", command) for place, command in enumerate(result.commands)),
    ]
    size = f"{result.size_bytes} bytes from {result.address:#010x}"
    headed = (f"{result.board}   {title} · build {result.build}, {size}",)
    return Answer("firmware", plain(result), headed, tuple(rows), units=units)


def stream(result: ReportedStream, deployment: Deployment, coupling: Coupling) -> Answer:
    """Return the answer of `stream`: messages taken and lost, and the state of the device afterwards."""
    mode = result.status.mode
    after = f"the device does NOT run its table ({mode})" if result.faults else f"the device runs its table ({mode})"
    fell = Mark.CAUTION if result.fell_back else Mark.NONE
    none_lost = not result.late and not result.lost
    median, largest = Value(result.round_trip_s, "time"), Value(result.round_trip_max_s, "time")
    rows = [
        *_unsafe(deployment.unsafe),
        row("Messages", _messages(result), mark=grade(none_lost, Mark.CAUTION)),
        row("Round trip", "median", median, ", largest", largest),
        row("Fell back", "to the table", Value(result.fell_back, "number", 9), "times", mark=fell),
        row("Afterwards", after, mark=grade(not result.faults)),
        subject.judged_for(deployment.judged_for),
        *subject.edited(coupling),
    ]
    streamed = (f"coupling {coupling.id} streamed for", Value(result.seconds, "time"), f"at {result.rate_hz:g} Hz")
    streamed_for = {"problem": coupling.problem.name, "coupling": coupling.id, "edited": coupling.edited}
    data = streamed_for | plain(result) | deployment.document()
    title = parts(result.port, " ", streamed)
    complaint = f"avc: {result.port}: {'; '.join(result.faults)}" if result.faults else ""
    return Answer("stream", data, title, tuple(rows), units=coupling.problem.units, complaint=complaint)


def _messages(result: ReportedStream) -> tuple[Part, ...]:
    counts = {"sent": result.sent, "taken": result.taken, "late": result.late, "lost": result.lost}
    return commas((Value(count, "number", 9), name) for name, count in counts.items())
