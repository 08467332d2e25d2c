"""Declaration of verbs and their arguments, and the problems, couplings and devices that these name."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from pathlib import Path
from shlex import quote
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.units import LINEAR, ROTARY

if TYPE_CHECKING:
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


def argument(*names: str, text: str, **options: Any) -> Argument:
    """Return an argument."""
    return names, {"help": text, **options}


def flag(name: str, text: str) -> Argument:
    """Return an option without a value."""
    return argument(name, action="store_true", text=text)


def output(name: str, text: str, *endings: str) -> Argument:
    """Return an option that names a file to write, which is checked before the long work."""

    def path_of(typed: str) -> Path:
        path, fault = Path(typed), ""
        if path.suffix.lower() not in endings:
            fault = f" ends in {path.suffix!r}; allowed: {', '.join(endings)}"
        elif path.is_dir():
            fault = " is a folder; give a file name"
        elif not path.parent.is_dir():
            fault = f": there is no folder {str(path.parent)!r}; make it first"
        elif path.exists() and not os.access(path, os.W_OK):
            fault = " may not be written by this user; choose another place"
        else:
            try:
                TemporaryFile(dir=path.parent).close()
            except OSError as error:
                fault = f" cannot be written ({error.strerror or error}); choose another place"
        if fault:
            raise argparse.ArgumentTypeError(f"{typed!r}{fault}")
        return path

    return argument(name, metavar="FILE", type=path_of, text=text)


def plot(subject: str) -> Argument:
    """Return --plot."""
    return output("--plot", f"draw {subject}: .png, .svg or .pdf", ".png", ".svg", ".pdf")


def positive(text: str) -> float:
    """Read a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is no number above 0; allowed: finite numbers above 0")
    return value


def positive_int(text: str) -> int:
    """Read a whole number above 0."""
    if not (text.isascii() and text.isdigit() and int(text)):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above 0")
    return int(text)


PROBLEM = argument("problem", metavar="P", text="problem file or name of the catalogue")
COUPLING = argument("gains", metavar="COUPLING", text="coupling file; or a gain file with --problem")
BESIDE = argument("--problem", metavar="P", text="problem of a table of gains, .csv")
VERBOSE = argument("-v", "--verbose", action="store_true", text="print all that is known of it")
UNSAFE = flag("--unsafe", "go on with a coupling that is not deployable; this is written down")
DEFAULT_BAUD = 115200
"""Rate of a serial port unless another is given, bit/s."""
BAUD = argument(
    "--baud", type=positive_int, default=DEFAULT_BAUD, text=f"rate of a serial port; default {DEFAULT_BAUD}"
)
PORT = (
    argument("--port", required=True, text="serial port (avc doctor --ports), or `emulator`: firmware on a model"),
    BAUD,
)
MOTION = argument("--motion", choices=("linear", "rotary"), default="linear", text="of the device: rotary: rad, N.m")
WORKERS = (
    argument("--workers", type=positive_int, metavar="N", text="processes (default: one for each processor)"),
    argument("--scheduler", metavar="ADDRESS", text="Dask cluster that works instead, for example tcp://host:8786"),
)
_COLUMNS = "by header or number, 1 is the first: time=1,position=2,force=3; angle and torque of what turns"
_UNITS = "where no header says them: time=ms,position=um, or angle=deg,torque=N.m"
LOGS = (
    argument("log", metavar="LOG", nargs="+", text=".csv, .txt, .npz or .mat (v5): one record each"),
    argument("--columns", action="append", default=[], metavar="Q=C", text=_COLUMNS),
    argument("--units", action="append", default=[], metavar="Q=U", text=_UNITS),
    argument("--sample-time", type=positive, metavar="S", text="sample time in seconds of logs without time"),
    flag("--flip-force", "the logs count the force against +position"),
    argument("--handle-radius-m", type=positive, metavar="R", text="of the handle of what turns, if no device says it"),
)


def turning(key: str, metavar: str, text: str) -> tuple[Argument, ...]:
    """Return an option under its name of a device that slides and of one that turns, each in its own unit."""
    keys = (key, ROTARY.key(key))
    options = [f"--{name.replace('_', '-')}" for name in keys]
    return tuple(argument(option, type=positive, metavar=metavar, text=text) for option in options)


def of_motion(args: argparse.Namespace, units: Units, *keys: str) -> dict[str, Any]:
    """Return such options for a motion, by their keys; those of the other kind of motion are refused."""
    foreign_units = ROTARY if units.linear else LINEAR
    for key in keys:
        option, foreign = units.key(key), foreign_units.key(key)
        if option == foreign or getattr(args, foreign) is None:
            continue
        kind, motion = ("a linear device", "rotary") if units.linear else ("a device that turns", "linear")
        or_motion = f", or --motion {motion}" if hasattr(args, "motion") else ""
        message = f"is no option of {kind}; allowed: {args.options[option]}{or_motion}"
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


OF_WALLS = "is an option of walls, and P couples to a [simulation] or [follower]; leave it out"


def refuse(args: argparse.Namespace, *options: str, why: str) -> None:
    """Refuse arguments that do not apply."""
    for option in options:
        if getattr(args, option, None) not in (None, False, 0):
            raise avc.InputError.of(why, key=option)


def is_coupling(text: str) -> bool:
    """Return whether an argument is a coupling or gain file, by its ending."""
    return Path(text).suffix.lower() in (".json", ".csv")


def load_any_device(source: str) -> tuple[DeviceFile, Hands | None]:
    """Load a device file, or the device of a problem with its hands."""
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.files.problem_file import is_device

    if is_device(source):
        return avc.load_device(source), None
    problem = avc.load_problem(source)
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
            raise avc.InputError.of("is given beside a coupling; give the problem, or leave it out", file=gains)
        coupling = avc.read_coupling(source)
        return coupling.problem, coupling, []
    problem = avc.load_problem(source)
    if gains is None:
        return problem, None, []
    read = read_file(gains)
    kind, kinds = read.end.kind if isinstance(read, Coupling) else Wall.kind, _kinds_of_end(problem)
    if kind not in kinds:
        make = f"avc recommend {quote(source)} --out c.json"
        raise avc.InputError.of(f"is no coupling to a {kinds[0]}; make one: {make}", file=gains)
    if not isinstance(read, Coupling):
        return problem, coupling_beside(problem, read, gains), []
    if same_problem(problem, read.problem):
        return problem, read, []
    here, made_for = problem.model_dump(), read.problem.model_dump()
    tables = [key for key in here if isinstance(here[key], dict) and here[key] != made_for[key]]
    differ = ", ".join(f"[{key}]" for key in tables)
    return problem, read.on(problem), [f"the coupling was made for {read.problem.name} with another {differ}"]


def _kinds_of_end(problem: avc.Problem) -> tuple[str, ...]:
    """Return the ends of couplings that a problem takes: its own first; one with a follower takes a wall's too."""
    end = problem.end
    return (end.kind, problem.wall.kind) if end.beside_wall else (end.kind,)


def recommended(problem: avc.Problem, console: Console, hands: int = 100, **options: Any) -> avc.Recommendation:
    """Return the recommended coupling to a wall, a simulation or a follower."""
    from avc_casadi._util.parallel import processors
    from avc_casadi.cli.console import package_versions
    from avc_casadi.model.ends import Wall
    from avc_casadi.simulation.execute import compiler

    if compiler() is None:
        console.notice("avc: no C compiler is found (cc, or CC): hands are simulated some fifteen times as slowly")
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
