"""Rows that show: a checked file, the catalogue, the installation, studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.units import LINEAR, RADII
from avc_casadi.files.catalogue import CatalogueEntry
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.files.plausibility import device_plausibility
from avc_casadi.files.problem_file import problem_document
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.declared import declared
from avc_casadi.model.ends import End, Follower, Simulation, Wall
from avc_casadi.model.problem import Problem
from avc_casadi.present import words
from avc_casadi.present.row import (
    Answer,
    Mark,
    Part,
    Parts,
    Row,
    Value,
    commas,
    grade,
    parts,
    quantity_of,
    row,
    span,
)
from avc_casadi.present.rows import subject
from avc_casadi.recommendation.assumptions import Unused

if TYPE_CHECKING:  # studies, which load slowly
    from avc_casadi.design.comparison.accuracy import Accuracy, SolverCost
    from avc_casadi.design.comparison.table1 import Table1, Table1Row


@dataclass(frozen=True)
class Doubt:
    """A value that is unusual or unknown: its key, and what is to be said of it."""

    key: str
    message: str

    @property
    def text(self) -> str:
        """Key and message in a line."""
        return f"{self.key} {self.message}"


_CONTACT_UNSTABLE = "makes the engine's own contact unstable at its step, whatever the coupling"
_AHEAD = (
    "is ahead: the device receives a state that is already the result of its force, which acts like a negative damper; "
    "a damper in the device's loop compensates it. Better send the state with which the step began (on-time)"
)
_EXPLICIT = "is explicit, which adds energy to every oscillation; use semi-implicit if the engine supports it"
_SUBSTEPS = (
    "hold a force for the whole step; compute the force in each substep instead, and state the substep as step_s"
)


@singledispatch
def doubts_of(end: End, problem: Problem) -> Iterator[Doubt]:  # noqa: ARG001
    """Yield values of an end that are unusual, though valid, before any coupling is searched."""
    yield from ()


@doubts_of.register
def _doubts_of_simulation(tool: Simulation, problem: Problem) -> Iterator[Doubt]:
    """Yield what costs most stiffness, or what no coupling can stabilise."""
    if not ToolLoops(problem).engine_alone_stable():
        yield Doubt("simulation.contact_stiffness_n_per_m", _CONTACT_UNSTABLE)
    if tool.exchange == "ahead" and tool.tool_mass_kg is not None:
        yield Doubt("simulation.exchange", _AHEAD)
    if tool.integrator == "explicit":
        yield Doubt("simulation.integrator", _EXPLICIT)
    if tool.substeps > 1:
        yield Doubt("simulation.substeps", _SUBSTEPS)


@dataclass(frozen=True)
class CheckedProblem:
    """What `avc check` finds of a problem.

    Attributes:
        problem: the problem as stated.
        not_used: declared keys that no candidate, certificate or trial uses.
        warnings: unusual values by their keys.
        refused: why `avc recommend` deploys nothing whatever the gains; empty where it may.
    """

    problem: Problem
    not_used: tuple[Unused, ...]
    warnings: tuple[Doubt, ...]
    refused: str

    @property
    def lowest_hz(self) -> float:
        """Lowest frequency of interaction."""
        return float(self.problem.frequencies_hz().min())

    @property
    def highest_hz(self) -> float:
        """Highest frequency of interaction."""
        return float(self.problem.frequencies_hz().max())

    @property
    def nyquist_hz(self) -> float:
        """Half of the sampling rate."""
        return 0.5 / self.problem.device.sample_time_s

    @property
    def frequencies(self) -> int:
        """Number of frequencies of interaction."""
        return len(self.problem.frequencies_hz())

    @property
    def passive_limit_n_per_m(self) -> float:
        """Largest static stiffness of any passive linear rendering."""
        return passive_limit_n_per_m(self.problem.device)

    @property
    def doubts(self) -> list[Doubt]:
        """The warnings; where nothing is deployable that too."""
        if not self.refused:
            return [*self.warnings]
        return [*self.warnings, Doubt("avc recommend", f"finds nothing deployable: {self.refused}")]

    def document(self) -> dict[str, Any]:
        """Return the `check` document: JSON values only."""
        values: dict[str, Any] = plain(
            {
                "valid": True,
                "problem": problem_document(self.problem),
                "frequencies": self.frequencies,
                "lowest_hz": self.lowest_hz,
                "highest_hz": self.highest_hz,
                "nyquist_hz": self.nyquist_hz,
                "passive_limit_n_per_m": self.passive_limit_n_per_m,
                "declared": declared(self.problem),
                "not_used": [str(unused) for unused in self.not_used],
                "warnings": self.doubts,
                "refused": self.refused,
            }
        )
        return values


def problem(result: CheckedProblem, shown: str = "") -> Answer:
    """Return the answer of `check` of a problem: what it asks for, its other end, what is unusual."""
    stated = result.problem
    rows = [row("Valid", stated.title or "yes", mark=Mark.PASS)]
    rows += _asked(stated.end, result)
    if result.refused and stated.law is None:
        rows.append(row("Not deployable", result.refused, mark=Mark.FAIL))
    rows += subject.notes((doubt.text for doubt in result.warnings), "Warning")
    if stated.source:
        rows.append(row("Source", stated.source, rank=1))
    # Where nothing is deployable whatever the gains, its row says so.
    onwards = [] if result.refused else [subject.to_recommend(stated.end)]
    if stated.law is not None:
        onwards = ["certify {}"]
    return subject.answer("check", result.document(), stated, shown, rows, *onwards)


@singledispatch
def _asked(end: End, result: CheckedProblem) -> list[Row]:
    """Return what a problem asks for, and what the headline does not hold of its end."""
    return [*_beyond_headline(end), *subject.not_used(result.not_used)]


@_asked.register
def _asked_of_wall(end: Wall, result: CheckedProblem) -> list[Row]:  # noqa: ARG001
    """Return the rows of what a checked problem requires of a coupling to a wall, and what is not used."""
    stated = result.problem
    structure, stability = stated.coupling.structure, stated.stability
    lowest, highest = Value(result.lowest_hz, "frequency"), Value(result.highest_hz, "frequency")
    nyquist = Value(result.nyquist_hz, "frequency")
    rows = [
        row("Requested", f"structure {structure}, model {stability.model}, scope {stability.scope}", rank=1),
        row("Frequencies", f"{result.frequencies} from", lowest, "to", highest, "; Nyquist", nyquist),
        subject.passive_limit(result.passive_limit_n_per_m),
    ]
    if keys := declared(stated):
        rows.append(row("Declared", ", ".join(map(stated.units.key, keys))))
    weakening = (unused for unused in result.not_used if not unused.asked_of_solve)
    rows += subject.notes((f"{unused}: ignored by avc recommend" for unused in weakening), "Not used")
    return rows + subject.notes(words.used_by_solve(result.not_used), "Not used", Mark.NONE)


@singledispatch
def _beyond_headline(end: End) -> list[Row]:  # noqa: ARG001
    """Return what the headline does not hold of another end than a wall."""
    return []


@_beyond_headline.register
def _engine(tool: Simulation) -> list[Row]:
    """Return what the tool touches, and what the exchange means."""
    what: tuple[Part, ...] = ("none: the spring ends at a position that the engine sets",)
    if tool.tool_mass_kg is not None:
        mass = parts(span(tool.tool_mass_kg, "mass"), ", damping", span(tool.tool_damping_ns_per_m, "damping"))
        what = parts(mass, "; touches", _contacts(tool))
    gets = words.EXCHANGES[tool.exchange].format(step="the engine's step")
    return [row("Tool", what), row("Exchange", f"{tool.exchange}: the device gets {gets}")]


def _contacts(tool: Simulation) -> tuple[Part, ...]:
    """Return what a tool touches: springs, rigid objects, or both."""
    low, high = tool.contact_stiffness_n_per_m
    rigid = "rigid objects" if tool.rigid else None
    if tool.constraint:
        return commas([rigid])
    if tool.rigid:
        return commas([rigid, ("springs from", Value(low, "stiffness"))], "and")
    return parts("springs of", span((low, high), "stiffness"))


@_beyond_headline.register
def _follower(far: Follower) -> list[Row]:
    """Return link, what is sent back, what the follower touches."""
    to_follower = span(far.delay_s, "time")
    to_leader = span(far.return_delay_s or far.delay_s, "time")
    jitter = Value(far.jitter, "share")
    lost = Value(far.lost_share, "share")
    sent = f", {far.force} is sent back" if far.architecture == "position-force" else ""
    contact: Parts = "a rigid object"
    if not far.rigid:
        contact = ("a spring of", Value(far.contact_stiffness_n_per_m[1], "stiffness"))
    return [
        row("Link", to_follower, "there,", to_leader, "back;", jitter, "of jitter,", lost, "of the messages lost"),
        row("Architecture", f"{far.architecture}{sent}"),
        row("Touches", "anything from nothing to", contact),
    ]


_FIRST_VALUES = 10
"""Rows of a device file up to which its values are shown without -v."""


def device(file: DeviceFile, shown: str) -> Answer:
    """Return the answer of `check` of a device file: a value each with its range and source."""
    units = file.device.units
    values = file.device.model_dump(mode="json", exclude_unset=True)
    doubts = [Doubt(fault.key, fault.message) for fault in device_plausibility(file)]
    document = {
        "valid": True,
        **file.model_dump(mode="json", exclude_none=True),
        "device": values,
        "warnings": plain(doubts),
    }
    ranges = values.get("range", {})
    stated = {key: value for key, value in values.items() if key != "range"}
    rows = [row("Valid", file.title or "yes", mark=Mark.PASS)]
    rows += subject.notes((doubt.text for doubt in doubts), "Warning")
    for key, value in stated.items():
        ends = ranges.get(key)
        between = ("(", _value(key, ends[0]), "to", _value(key, ends[1]), ")") if isinstance(ends, list) else None
        origin = f", {file.sources[key].grade}" if key in file.sources else ""
        rank = 0 if len(rows) < _FIRST_VALUES else 1
        rows.append(row(units.key(key), _value(key, value), between, origin, rank=rank))
    if gaps := [gap for gap in file.gaps if units.inner(gap) not in stated]:
        rows.append(row("Not known", ", ".join(map(units.key, gaps)), mark=Mark.CAUTION))
    rows += [row(units.key(key), f"{source.grade}, {source.source}", rank=1) for key, source in file.sources.items()]
    rows.append(row("Use", f'device = "{shown}" in a problem file'))
    return Answer("check", document, (f"{file.name}   device file",), tuple(rows), units=units)


def _value(key: str, value: Any) -> tuple[Part, ...]:
    if isinstance(value, Mapping):
        return commas((name.replace("_", " "), _value(name, inner)) for name, inner in value.items())
    if isinstance(value, bool) or not isinstance(value, int | float):
        return (str(value),)
    return (f"{value:g} m" if key in RADII else Value(value, quantity_of(key)),)


@dataclass(frozen=True)
class CatalogueDevice:
    """A device of the catalogue."""

    name: str
    title: str
    gaps: tuple[str, ...]
    path: str


def catalogue(
    problems: Sequence[CatalogueEntry],
    admittance: Sequence[CatalogueEntry],
    devices: Sequence[CatalogueDevice],
    folder: str,
) -> Answer:
    """Return the answer of `list`."""
    rows = [row(entry.name, entry.title) for entry in (*problems, *admittance)]
    rows += [row(f"devices/{entry.name}", entry.title) for entry in devices]
    document = {
        "problems": [plain(entry) | {"path": str(entry.path)} for entry in problems],
        "admittance": [plain(entry) | {"path": str(entry.path)} for entry in admittance],
        "devices": plain(devices),
    }
    title = f"built-in problems (files in {folder}) and devices"
    return Answer("list", document, (title,), tuple(rows), ("avc check figure5", "avc run figure5"), whole=True)


@dataclass(frozen=True)
class AvcDevice:
    """What the avc device at a port says of itself."""

    build: str
    sample_time_s: float
    faults: int
    unique_id: str
    coupling_id: str


@dataclass(frozen=True)
class SerialPort:
    """A serial port, and the avc device there, if it was asked and one answers."""

    device: str
    description: str
    serial_number: str | None
    accessible: bool
    avc_device: AvcDevice | None = None


@dataclass(frozen=True)
class Installation:
    """What `avc doctor` finds: the process, versions, solvers that solve, programs, the emulator, ports."""

    executable: str
    platform: str
    packages: Mapping[str, str]
    solvers: Mapping[str, bool]
    programs: Mapping[str, str | None]
    emulator: bool
    ports: tuple[SerialPort, ...]


def installation(result: Installation, *, asked: bool) -> Answer:
    """Return the answer of `doctor`: working solvers, packages, compilers, ports."""
    solves = ", ".join(f"{name} {'solves' if good else 'does NOT solve'}" for name, good in result.solvers.items())
    emulator = "installed" if result.emulator else "absent; pip install 'avc-casadi[emulator]'"
    rows = [
        row("Solvers", solves, mark=grade(all(result.solvers.values()))),
        row("Packages", ", ".join(f"{name} {version}" for name, version in result.packages.items())),
        row("Programs", ", ".join(name if place else f"{name} absent" for name, place in result.programs.items())),
        row("Emulator", emulator, mark=grade(result.emulator, Mark.CAUTION)),
        *ports(result.ports, asked=asked),
    ]
    bad = ", ".join(name for name, good in result.solvers.items() if not good)
    complaint = f"avc: {bad} does not solve; install casadi again: pip install --force-reinstall casadi" if bad else ""
    title = (f"{result.executable} on {result.platform}",)
    return Answer("doctor", plain(result), title, tuple(rows), complaint=complaint)


def ports(connected: Sequence[SerialPort], *, asked: bool) -> list[Row]:
    """Return the serial ports, a row each; with ``asked`` the device behind each."""
    return [_port(port, asked=asked) for port in connected] or [row("Serial ports", "none")]


def _port(port: SerialPort, *, asked: bool) -> Row:
    """Return the row of a serial port: whether it is accessible, and if `asked` which device it has."""
    number = f"serial number {port.serial_number}" if port.serial_number else ""
    no_right = "no permission: add yourself to its group (dialout)"
    text = [port.description, number, "accessible" if port.accessible else no_right]
    if asked and port.avc_device is not None:
        named = port.avc_device.unique_id or "without a number"
        text.append(f"avc device {named}, coupling {port.avc_device.coupling_id or 'none'}")
    elif asked:
        text.append("no avc device")
    return row(port.device, ", ".join(filter(None, text)), mark=grade(port.accessible, Mark.CAUTION))


def accuracy(result: Accuracy) -> Answer:
    """Return the answer of `accuracy`: time and error of each solver."""
    rows = [_solver(cost, fast=fast) for cost, fast in zip(result.costs, result.fastest, strict=True)]
    title = (f"{result.problem}   error of |Z_h| beyond the optimum of `exact`, relative to |Z_h_ds|",)
    return Answer("accuracy", result.document(), title, tuple(rows))


def _solver(cost: SolverCost, *, fast: bool) -> Row:
    """Return time and error of a solver; the fastest of its accuracy and the default are shown without -v."""
    tolerance = f"{cost.tolerance:g}" if cost.tolerance else None
    by = " ".join(filter(None, [cost.solver, tolerance]))
    time = (f"{by}:" if by else "", Value(cost.seconds_per_frequency, "time"), "a frequency;")
    median, most = Value(cost.excess_error, "number", 2), Value(cost.largest_excess_error, "number", 2)
    error = ("excess error", median, "median,", most, "at most; optimal at", Value(cost.optimal_share, "share"))
    notable = f"{', fastest of its accuracy' if fast else ''}{', default' if cost.default else ''}"
    return row(cost.method, time, error, notable, rank=0 if notable else 1)


def table1(result: Table1) -> Answer:
    """Return the answer of `table1`: the paper's table with simulated hands of both sets."""
    title = f"Table 1 of the paper with {result.hands} simulated hands, seed {result.seed}; the paper has 10 people"
    rows = [_tried("A", tried, result.hands) for tried in result.rows]
    rows += [_tried("B", tried, result.hands) for tried in result.rows_set_b]
    rows += [
        row("Set A", "mass 0.05 to 0.3 kg, damping 3 to 20 N.s/m, stiffness 200 to 800 N/m"),
        row("Set B", "five-parameter stylus hands within measured ranges"),
        row("Stable", "residual speed below 5 mm/s in press, tap and hold"),
        row(
            "Nearer",
            "with which coupling the wall feels nearer to the ideal wall than with schedule (Weber fraction 0.1)",
        ),
    ]
    return Answer("table1", plain(result), (title,), tuple(rows), whole=True)


def _tried(population: str, tried: Table1Row, hands: int) -> Row:
    """Return what became of the hands with one coupling at one wall, and what the paper counted."""
    wall = Value(tried.stiffness_n_per_m, "stiffness").text(LINEAR)
    text: list[Parts] = [f"{tried.coupling}: not tried"]
    if tried.stable is not None:
        low, high = Value(tried.stable_low, "share"), Value(tried.stable_high, "share")
        text = [
            f"{tried.coupling}: stable",
            Value(tried.stable, "number", 9),
            f"of {hands} (95 %",
            low,
            "to",
            high,
            ")",
        ]
    paper = tried.paper
    if paper is not None:
        text.append(f", paper {paper.stable}")
    if tried.asymptotic is not None:
        text += [",", Value(tried.asymptotic, "number", 9), "without friction"]
    if tried.apparent_stiffness_n_per_m is not None:
        text += [", felt", Value(tried.apparent_stiffness_n_per_m, "stiffness")]
    if tried.matched is not None:
        text += [", nearer", Value(tried.matched, "number", 9)]
    if tried.unable is not None:
        text += [", unable", Value(tried.unable, "number", 9)]
    if paper is not None and paper.matched is not None:
        text.append(f"(paper {paper.matched}/{paper.unable})")
    return row(f"Set {population}, {tried.ve}, {wall}", *text)
