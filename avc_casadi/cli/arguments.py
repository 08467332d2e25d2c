"""Declaration of verbs and their arguments, and the problems, couplings and devices that these name."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.units import LINEAR, ROTARY
from avc_casadi.files.kinds import FileKind

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi._util.units import Units
    from avc_casadi.cli.console import Console
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.model.problem import Hands
    from avc_casadi.present.row import Answer

Argument = tuple[tuple[str, ...], dict[str, Any]]
"""Names and options of an argument, as `argparse` takes them."""
Run = Callable[[argparse.Namespace, "Console"], "Answer"]

VERBS: dict[str, tuple[Run, tuple[Argument, ...]]] = {}
"""What each verb does, whose docstring is its help, and its arguments."""


def verb(*arguments: Argument) -> Callable[[Run], Run]:
    """Declare a function ``run_<verb>`` as a verb."""

    def declared(run: Run) -> Run:
        VERBS[run.__name__.removeprefix("run_")] = run, arguments
        return run

    return declared


class _Once(argparse.Action):
    """Keep the value of an option, and refuse a second one, under any of its names."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option_string: Any = None
    ) -> None:
        del parser
        given = vars(namespace).setdefault("given", {})
        if self.dest in given:
            first = given[self.dest]
            how = "twice" if first == option_string else f"as {first} and as {option_string}"
            raise argparse.ArgumentError(self, f"is given {how}; give it once")
        given[self.dest] = option_string
        setattr(namespace, self.dest, values)


def argument(*names: str, text: str, **options: Any) -> Argument:
    """Return an argument; an option that takes a value takes it once."""
    if names[0].startswith("-"):
        options = {"action": _Once, **options}
    return names, {"help": text, **options}


def flag(name: str, text: str) -> Argument:
    """Return an option without a value."""
    return argument(name, action="store_true", text=text)


def output(
    name: str, text: str, kinds: Mapping[str, tuple[FileKind, ...]], *, ending_by_problem: bool = False
) -> Argument:
    """Return an option that names a file to write, which is checked before the long work.

    `kinds` has the kinds of files that it writes, by the ending: it writes over no other file. `ending_by_problem`:
    which of the endings is allowed depends on the problem, and the verb refuses the others by `require_ending`.
    """

    def path_of(typed: str) -> Path:
        path, fault = Path(typed), ""
        if path.suffix.lower() not in kinds:
            fault = "" if ending_by_problem else f" ends in {path.suffix!r}; allowed: {', '.join(kinds)}"
        elif path.is_dir():
            fault = " is a folder; give a file name"
        elif not path.parent.is_dir():
            fault = f": the folder {str(path.parent)!r} does not exist; make it first"
        elif path.exists() and not os.access(path, os.W_OK):
            fault = " is write-protected; choose another file"
        else:
            try:
                TemporaryFile(dir=path.parent).close()
            except OSError as error:
                fault = f" cannot be written ({error.strerror or error}); choose another folder"
            else:
                fault = _foreign(path, kinds[path.suffix.lower()])
                description = path.with_suffix(".json")
                if path.suffix == ".npz" and not fault and _foreign(description, (FileKind.JSON,)):
                    fault = f" is described in {description.name!r}, which{_foreign(description, (FileKind.JSON,))}"
        if fault:
            raise argparse.ArgumentTypeError(f"{typed!r}{fault}")
        return path

    return argument(name, metavar="FILE", type=path_of, text=text)


def require_ending(path: Path | None, ending: str, written: str) -> None:
    """Refuse a file of another ending than that of what is written, in words, for a problem."""
    if path is not None and path.suffix.lower() != ending:
        message = f"{str(path)!r} ends in {path.suffix!r}; allowed: {ending}, for {written} of this problem"
        raise avc.InputError.of(message, key="out")


def _foreign(path: Path, kinds: tuple[FileKind, ...]) -> str:
    """Return why a file is not written over; empty where it does not exist, is empty, or is of these kinds."""
    from avc_casadi.files.problem_file import kind_of_file

    if not path.is_file() or not path.stat().st_size:
        return ""
    try:
        kind = kind_of_file(path)
    except OSError as error:
        return f" exists and cannot be read ({error.strerror or error}); choose another name"
    allowed = " or ".join(replaced.value for replaced in kinds)
    return "" if kind in kinds else f" exists and is {kind.value}; it replaces {allowed} only; choose another name"


def keep_other_files(folder: Path, kinds: Mapping[str, FileKind]) -> None:
    """Refuse a folder of results with files of their names and of another kind."""
    for name, kind in kinds.items():
        fault = _foreign(folder / name, (kind,))
        if fault:
            raise avc.InputError.of(f"{str(folder / name)!r}{fault}", key="out")


def plot(subject: str) -> Argument:
    """Return --plot."""
    pictures = dict.fromkeys((".png", ".svg", ".pdf"), (FileKind.PICTURE,))
    return output("--plot", f"draw {subject} to a .png, .svg or .pdf file", pictures)


@dataclass(frozen=True)
class NumericRange:
    """Reader of the value of an option: a finite number from the lowest to the highest, both allowed."""

    lowest: float
    highest: float
    unit: str = ""
    whole: bool = False

    def __call__(self, text: str) -> float:
        """Return the number, or refuse it."""
        value: float = math.nan
        with suppress(ValueError):
            value = int(text) if self.whole and len(text) <= _LONGEST_WHOLE else float(text)
        # A whole number does not lose digits to a float.
        if self.lowest <= value <= self.highest and "_" not in text and (not self.whole or isinstance(value, int)):
            return value
        kind = "whole" if self.whole else "finite"
        above = " above 0" if self.lowest > 0 else ""
        ends = f"{self.lowest:.12g} to {self.highest:.12g} {self.unit}".rstrip()
        raise argparse.ArgumentTypeError(f"is {text[:_LONGEST_WHOLE]!r}; it must be a {kind} number{above}: {ends}")


_LONGEST_WHOLE = 30
"""Characters of a whole number that are read: longer ones are beyond every range."""
_LONGEST_RUN_S = 1e6
"""Longest run of a command on a device, s: eleven days."""
RANGES: dict[str, NumericRange] = {
    "--baud": NumericRange(1, 12_000_000, "bit/s", whole=True),  # up to that of USB full speed
    "--energy-j": NumericRange(1e-9, 1e6, "J"),
    "--force-n": NumericRange(1e-9, 1e6, "N"),
    "--handle-radius-m": NumericRange(2e-3, 10.0, "m"),  # as in a file
    "--hands": NumericRange(1, 100_000_000, whole=True),
    "--heartbeat": NumericRange(1e-3, 3600.0, "s"),
    "--port": NumericRange(0, 65_535, whole=True),  # of TCP; 0 takes a free one
    "--rate-hz": NumericRange(1e-3, 1e3, "Hz"),  # a serial link answers no faster
    "--sample-time": NumericRange(1e-7, 10.0, "s"),
    "--seconds": NumericRange(1e-3, _LONGEST_RUN_S, "s"),
    "--seed": NumericRange(0, 2**63 - 1, whole=True),
    "--speed-m-per-s": NumericRange(1e-9, 1e4, "m/s"),
    "--speed-rad-per-s": NumericRange(1e-9, 1e6, "rad/s"),
    "--tolerance": NumericRange(1e-14, 1.0),  # as `design.methods`
    "--torque-nm": NumericRange(1e-9, 1e6, "N.m"),
    "--travel-m": NumericRange(1e-9, 100.0, "m"),
    "--travel-rad": NumericRange(1e-9, 1e4, "rad"),
    "--workers": NumericRange(1, 1024, whole=True),
}
"""Ranges of the options that take a number. What a file may state too has the range of the file."""


def numeric(name: str, text: str, **options: Any) -> Argument:
    """Return an option that takes a number of its range."""
    return argument(name, type=RANGES[name], text=text, **options)


PROBLEM = argument("problem", metavar="P", text="problem file, or name of a built-in problem (avc list)")
COUPLING = argument("gains", metavar="COUPLING", text="coupling file (.json), or table of gains (.csv) with --problem")
BESIDE = argument("--problem", metavar="P", text="name the problem that a table of gains (.csv) belongs to")
VERBOSE = argument("-v", "--verbose", action="store_true", text="print all details and assumptions")
UNSAFE = flag("--unsafe", "accept a coupling that is not deployable; the output records --unsafe")
DEFAULT_BAUD = 115200
"""Rate of a serial port unless another is given, bit/s."""
_BAUD = f"set the baud rate of the serial port (default: {DEFAULT_BAUD})"
BAUD = numeric("--baud", _BAUD, default=DEFAULT_BAUD, metavar="N")
_PORT = "choose the serial port, or `emulator` (the firmware with a simulated device)"
PORT = (argument("--port", required=True, metavar="PORT", text=_PORT), BAUD)
_MOTION = "choose the motion of the device: linear (m, N; default) or rotary (rad, N.m)"
MOTION = argument("--motion", choices=("linear", "rotary"), default="linear", metavar="KIND", text=_MOTION)
_SCHEDULER = "use the Dask cluster at this address instead, such as tcp://host:8786"
WORKERS = (
    numeric("--workers", "set the number of processes (default: all processors)", metavar="N"),
    argument("--scheduler", metavar="ADDRESS", text=_SCHEDULER),
)


def executor_of(args: argparse.Namespace) -> AbstractContextManager[Executor | None]:
    """Return the executor of --scheduler; None without it."""
    from avc_casadi._util.parallel import cluster

    if args.scheduler is not None:
        refuse(
            args,
            "workers",
            why="sets processes on this computer, but --scheduler uses a cluster; leave one of the two out",
        )
    return cluster(args.scheduler)


_COLUMNS = "name the columns, by header or number: time=1,position=2,force=3; or angle, torque"
_UNITS = "set units that the header lacks: time=ms,position=um, or angle=deg,torque=N.m"
_FLIP = "reverse the sign of the force, if a positive force pushes towards -position in the log"
_HANDLE = "set the handle radius of a rotary device in m (default: from --device)"
LOGS = (
    argument("log", metavar="LOG", nargs="+", text="log file with one recording: .csv, .txt, .npz or .mat (v5)"),
    argument("--columns", action="append", default=[], metavar="Q=C", text=_COLUMNS),
    argument("--units", action="append", default=[], metavar="Q=U", text=_UNITS),
    numeric("--sample-time", "set the sample time in s of logs without a time column", metavar="S"),
    flag("--flip-force", _FLIP),
    numeric("--handle-radius-m", _HANDLE, metavar="R"),
)


def turning(key: str, metavar: str, text: str) -> tuple[Argument, ...]:
    """Return an option of a linear device, and that of a rotary one; the help lists both in one entry."""
    option, rotary = (f"--{name.replace('_', '-')}" for name in (key, ROTARY.key(key)))
    return (
        numeric(option, f"{text}; rotary: {rotary}", metavar=metavar),
        numeric(rotary, argparse.SUPPRESS, metavar=metavar),
    )


def of_motion(args: argparse.Namespace, units: Units, *keys: str) -> dict[str, Any]:
    """Return such options for a motion, by their keys; those of the other kind of motion are refused."""
    foreign_units = ROTARY if units.linear else LINEAR
    for key in keys:
        option, foreign = units.key(key), foreign_units.key(key)
        if option == foreign or getattr(args, foreign) is None:
            continue
        kind, motion = ("linear", "rotary") if units.linear else ("rotary", "linear")
        or_motion = f", or --motion {motion}" if hasattr(args, "motion") else ""
        message = f"does not apply to a {kind} device; use {args.options[option]}{or_motion}"
        raise avc.InputError.of(message, key=foreign)
    return {key: getattr(args, units.key(key)) for key in keys}


def log_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return how logs are read, by the options."""
    from avc_casadi.identification.read import Layout, pairs_of

    columns, column_faults = pairs_of(args.columns, "--columns")
    units, unit_faults = pairs_of(args.units, "--units")
    if column_faults or unit_faults:
        raise avc.InputError([*column_faults, *unit_faults])
    layout = Layout(columns, units, args.sample_time)
    return {"layout": layout, "flip_force": args.flip_force, "handle_radius_m": args.handle_radius_m}


OF_WALLS = "applies to walls only, but P has a [simulation] or [follower]; leave it out"


@contextmanager
def faults_of(option: str) -> Iterator[None]:
    """Let faults of the value of an option, which are found inside, name the option."""
    try:
        yield
    except avc.InputError as error:
        faults = []
        for fault in error.faults:
            part = fault.key.rpartition(".")[2]
            message = f"{part} {fault.message}" if part and not part.startswith(option) else fault.message
            faults.append(avc.Fault("", None, option, message))
        raise avc.InputError(faults) from error


def refuse(args: argparse.Namespace, *options: str, why: str) -> None:
    """Refuse arguments that do not apply."""
    for option in options:
        if getattr(args, option, None) not in (None, False, 0):
            raise avc.InputError.of(why, key=option)


def refuse_file(args: argparse.Namespace, argument: str, why: str) -> None:
    """Refuse a file without an option that does not apply, by its name as typed."""
    named = getattr(args, argument)
    refuse(args, argument, why=f"{named!r} {why}")


def is_coupling(text: str) -> bool:
    """Return whether an argument is a coupling or gain file, by its ending."""
    return Path(text).suffix.lower() in (".json", ".csv")


def load_any_device(source: str) -> tuple[DeviceFile, Hands | None]:
    """Load a device file, or the device of a problem with its hands."""
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.files.problem_file import is_device, require_device

    if is_device(source):
        return avc.load_device(source), None
    problem = require_device(source)
    return DeviceFile(name=problem.name, title=problem.title, device=problem.device), problem.hands


def read_wall(file: str, problem: str | None = None) -> Coupling:
    """Read a coupling to a wall; or a table of gains, for a problem."""
    from avc_casadi.coupling import require_coupling

    coupling = avc.read_coupling(file, problem)
    require_coupling(coupling)
    return coupling


def subject(source: str, gains: str | None) -> tuple[avc.Problem, Coupling | None, list[str]]:
    """Return a problem, the coupling of a file for it, if one is given, and notes; or both of a coupling file.

    A coupling that was made for another problem is put on this one with its table and runtime.
    """
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.coupling_file import coupling_beside, read_file, same_problem
    from avc_casadi.model.ends import Wall

    if is_coupling(source):
        if gains is not None:
            raise avc.InputError.of(
                "is a second coupling; leave it out, or give a problem in place of the first coupling", file=gains
            )
        coupling = avc.read_coupling(source)
        return coupling.problem, coupling, _notes_on(coupling)
    problem = avc.load_problem(source)
    if gains is None:
        return problem, None, []
    read = read_file(gains)
    kind, kinds = read.end.kind if isinstance(read, Coupling) else Wall.kind, _kinds_of_end(problem)
    if kind not in kinds:
        make = f"avc recommend {quote(source)} --out c.json"
        raise avc.InputError.of(f"is a coupling to a {kind}, but the problem has a {kinds[0]}; run {make}", file=gains)
    if not isinstance(read, Coupling):
        return problem, coupling_beside(problem, read, gains), []
    if same_problem(problem, read.problem):
        return problem, read, _notes_on(read)
    here, made_for = problem.model_dump(), read.problem.model_dump()
    tables = [key for key in here if isinstance(here[key], dict) and here[key] != made_for[key]]
    differ = ", ".join(f"[{key}]" for key in tables)
    designed_for = f"the coupling was designed for {read.problem.name}, with a different {differ}"
    return problem, read.for_problem(problem), [designed_for, *_notes_on(read)]


def _notes_on(coupling: Coupling) -> list[str]:
    """Return the note on a coupling whose file was changed after it was written."""
    from avc_casadi.present.rows.subject import EDITED

    return [EDITED] if coupling.edited else []


def _kinds_of_end(problem: avc.Problem) -> tuple[str, ...]:
    """Return the ends of couplings that a problem takes: its own first; one with a follower takes a wall's too."""
    end = problem.end
    return (end.kind, problem.wall.kind) if end.beside_wall else (end.kind,)


RECOMMENDED_HANDS = 100
"""Simulated hands of a recommendation, unless others are stated."""


def recommended(
    problem: avc.Problem, console: Console, hands: int = RECOMMENDED_HANDS, **options: Any
) -> avc.Recommendation:
    """Return the recommended coupling to a wall, a simulation or a follower."""
    from avc_casadi._util.parallel import processors
    from avc_casadi.cli.console import package_versions
    from avc_casadi.model.ends import Wall
    from avc_casadi.simulation.execute import compiler

    if compiler() is None:
        console.notice("avc: no C compiler found (cc, or the variable CC): the simulation takes about 15 times as long")
    if isinstance(problem.end, Wall):
        options |= {"workers": min(2, processors())}
    with console.step(f"couplings with {hands} hands"):
        return avc.recommend(problem, hands, versions=package_versions(), progress=console, **options)


def recommended_coupling(problem: avc.Problem, console: Console) -> Coupling:
    """Return the coupling of the recommendation; a refusal is raised."""
    recommendation = recommended(problem, console)
    if recommendation.coupling is None:
        raise avc.NotDeployableError(f"{problem.name}: {recommendation.reason}")
    return recommendation.coupling
