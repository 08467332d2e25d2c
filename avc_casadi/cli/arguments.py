"""Arguments of commands: shared options, and problems, couplings and devices that they name."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import avc_casadi as avc

if TYPE_CHECKING:
    from argparse import _ActionsContainer
    from collections.abc import Callable

    from avc_casadi._util.units import Units
    from avc_casadi.cli.console import Console
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.identification.read import Layout
    from avc_casadi.model.virtual_tool import ToolGains


def add_port(parser: argparse.ArgumentParser) -> None:
    """Declare --port and --baud."""
    parser.add_argument(
        "--port",
        required=True,
        help="serial port (avc doctor --ports), or `emulator`: the real firmware image on an emulated board",
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Declare --verbose."""
    parser.add_argument("-v", "--verbose", action="store_true", help="print all that is known of it")


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Declare --workers and --scheduler."""
    parser.add_argument("--workers", type=positive_int, metavar="N", help="processes (default: one for each processor)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster that works instead, for example tcp://host:8786"
    )


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
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above 0")
    return value


class _Worded(argparse.Action):
    """Record a value and the option it came by: of linear or of rotary motion."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,  # noqa: ARG002
        namespace: argparse.Namespace,
        values: Any,
        option: str | None = None,
    ) -> None:
        setattr(namespace, self.dest, values)
        namespace.worded = {**getattr(namespace, "worded", {}), self.dest: (option, self.option_strings)}


def add_worded(
    parser: _ActionsContainer,
    linear: str,
    rotary: str,
    metavar: str,
    text: str,
    read: Callable[[str], Any] = positive,
) -> None:
    """Declare an option that has a rotary counterpart in its own unit."""
    parser.add_argument(linear, rotary, action=_Worded, type=read, metavar=metavar, help=text)


def add_motion(parser: argparse.ArgumentParser) -> None:
    """Declare --motion, for commands that only know a connected device."""
    parser.add_argument(
        "--motion", choices=("linear", "rotary"), default="linear", help="of the device: rotary has rad and N.m"
    )


def check_worded(args: argparse.Namespace, units: Units) -> None:
    """Refuse options of the other kind of motion."""
    from avc_casadi import Fault, InputError

    faults = []
    for given, (linear, rotary) in getattr(args, "worded", {}).values():
        meant = linear if units.linear else rotary
        if given != meant:
            kind = "a linear device" if units.linear else "a device that turns"
            faults.append(Fault("", None, meant, f"was given as {given.lstrip('-')!r}; allowed of {kind}: {meant}"))
    if faults:
        raise InputError(faults)


def add_log_layout(parser: argparse.ArgumentParser) -> None:
    """Declare the options on the columns of a log."""
    parser.add_argument(
        "--columns",
        action="append",
        default=[],
        metavar="Q=C",
        help="columns by header or number, 1 is the first: time=1,position=2,force=3; angle and torque of what turns",
    )
    parser.add_argument(
        "--units",
        action="append",
        default=[],
        metavar="Q=U",
        help="units where no header says them: time=ms,position=um, or angle=deg,torque=N.m",
    )
    parser.add_argument("--sample-time", type=positive, metavar="S", help="sample time in seconds of logs without time")
    parser.add_argument("--flip-force", action="store_true", help="the logs count the force against +position")


def log_layout(args: argparse.Namespace) -> Layout:
    """Return the columns and units given by the options."""
    from avc_casadi import InputError
    from avc_casadi.identification.read import Layout, pairs_of

    columns, wrong = pairs_of(args.columns, "--columns")
    units, also = pairs_of(args.units, "--units")
    if wrong or also:
        raise InputError([*wrong, *also])
    return Layout(columns, units, args.sample_time)


_FILES = (".json", ".csv")
TOOL_VERBS = "avc recommend, certify, zwidth, explore, simulate, run, check and export know a [simulation]"


def load_known(source: str) -> DeviceFile:
    """Load a device file, or the device of a problem."""
    from avc_casadi.files.device_file import DeviceFile

    if not _has_wall(source):
        return avc.load_device(source)
    problem = avc.load_problem(source)
    return DeviceFile(name=problem.name, title=problem.title, device=problem.device)


def _has_wall(source: str) -> bool:
    from avc_casadi.files.catalogue import catalogue_names, device_names
    from avc_casadi.files.toml_text import tables_of, text_of

    if not source.endswith(".toml"):
        return source in catalogue_names() and source not in device_names()
    try:
        return "environment" in tables_of(text_of(Path(source)), source)
    except avc.InputError:  # reported where it is loaded
        return False


def is_coupling(text: str) -> bool:
    """Return whether an argument is a coupling or gain file, by its ending."""
    return Path(text).suffix.lower() in _FILES


def add_problem_of_gains(parser: argparse.ArgumentParser) -> None:
    """Declare --problem, for gain files without one."""
    parser.add_argument("--problem", metavar="P", help="problem of a table of gains, .csv")


def add_unsafe(parser: argparse.ArgumentParser) -> None:
    """Declare --unsafe."""
    parser.add_argument(
        "--unsafe", action="store_true", help="go on with a coupling that is not deployable; this is written down"
    )


def read_subject(verb: str, file: str, problem: str | None = None, *, beside: str = "--problem P") -> Coupling:
    """Read a coupling file, or a gain file for the problem of --problem."""
    from avc_casadi.coupling import Coupling, require_coupling
    from avc_casadi.files.coupling_file import GAINS_ALONE, end_of, read_file

    if end_of(file) == "simulation":
        why = f"is a coupling to a simulation; {verb} takes one to a wall in the device's own loop: {TOOL_VERBS}"
        raise avc.InputError.of(why, file=file)
    if not is_coupling(file) and _is_problem(file):
        make = f"avc recommend {quote(file)} --out c.json"
        raise avc.InputError.of(f"is a problem; {verb} takes a coupling: {make}", file=file)
    if problem is not None:
        return avc.read_coupling(Path(file), avc.load_problem(problem))
    found = read_file(Path(file))
    if isinstance(found, Coupling):
        require_coupling(found)
        return found
    raise avc.InputError.of(f"{GAINS_ALONE}: {beside}", file=file)


def _is_problem(text: str) -> bool:
    from avc_casadi.files.catalogue import catalogue_names

    return text.endswith(".toml") or text in catalogue_names()


@contextmanager
def faults_of(file: str, args: argparse.Namespace) -> Iterator[None]:
    """Attribute faults without a file or an option to the command's coupling file."""
    try:
        yield
    except avc.InputError as error:
        options = vars(args)
        raise avc.InputError(
            [fault if fault.file or fault.key in options else replace(fault, file=file) for fault in error.faults]
        ) from None


def unsafe_note(verdict: avc.Deployable) -> str:
    """Return a note that a coupling was used although it is not deployable; empty where it is."""
    return "" if verdict.passed else f"UNSAFE, went on by request: {verdict.sentence}"


def is_device(source: str) -> bool:
    """Return whether a name or a file is that of a device rather than a problem."""
    from avc_casadi.files.catalogue import catalogue_names, device_names
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.files.toml_text import tables_of, text_of

    if source.startswith("devices/") and not source.endswith(".toml"):
        return True
    if not source.endswith(".toml"):
        return source in device_names() and source not in catalogue_names()
    try:
        tables = tables_of(text_of(Path(source)), source)
    except avc.InputError:  # reported where it is loaded as a problem
        return False
    return isinstance(tables.get("device"), dict) and set(tables) <= set(DeviceFile.model_fields)


def couples_to_simulation(source: str) -> bool:
    """Return whether a source is a coupling to a simulation, or a problem with one; False if unreadable."""
    if is_coupling(source):
        from avc_casadi.files.coupling_file import end_of

        return end_of(source) == "simulation"
    try:
        return avc.load_problem(source).simulation is not None
    except avc.AvcError:  # reported where it is loaded
        return False


def read_tool(file: str) -> Coupling:
    """Read a coupling to a simulation."""
    found = avc.read_coupling(file)
    if found.end != "simulation":
        raise avc.InputError.of(f"leads to a {found.end}; allowed: a coupling to a simulation", file=file)
    return found


def pair_of(source: str, gains: str | None, console: Console | None = None) -> tuple[avc.Problem, ToolGains | None]:
    """Return the problem, and the gains; None where a problem came alone and none are asked for."""
    from avc_casadi.files.coupling_file import end_of

    if is_coupling(source):
        if gains is not None:
            raise avc.InputError.of("is given beside a coupling; give the problem, or leave it out", file=gains)
        coupling = read_tool(source)
        return coupling.problem, coupling.gains
    problem = avc.load_problem(source)
    if gains is not None:
        if end_of(gains) != "simulation":
            make = f"avc recommend {quote(source)} --out c.json"
            raise avc.InputError.of(f"is no coupling to a simulation; make one: {make}", file=gains)
        return problem, read_tool(gains).gains
    return problem, None if console is None else _recommended(problem, source, console)


def _recommended(problem: avc.Problem, source: str, console: Console) -> ToolGains:
    """Return the recommended coupling."""
    from avc_casadi.design.virtual_tool import ToolSearch
    from avc_casadi.recommendation.tried_tool import tried_coupling
    from avc_casadi.recommendation.virtual_tool import why_infeasible

    search = ToolSearch(problem)
    with console.step("recommended coupling"):
        why = why_infeasible(problem, search)
        found = None if why else tried_coupling(problem, search, progress=console)[0]
    if found is None:
        told = f"no coupling is deployable, which avc recommend {quote(source)} explains; give one: --gains c.json"
        raise avc.InputError.of(told, file=source)
    return found


def refuse(
    args: argparse.Namespace,
    options: tuple[str, ...],
    why: str = "is an option of walls, and the other end is none; leave it out",
) -> None:
    """Refuse options that do not apply."""
    given = [one for one in options if getattr(args, one) not in (None, False, 0)]
    if given:
        raise avc.InputError.of(why, key=f"--{given[0].replace('_', '-')}")


def gains_for(problem: avc.Problem, file: str) -> tuple[Coupling, list[str]]:
    """Read a file for a problem, with notes on how its own problem differs.

    A coupling file is checked as everywhere and put on this problem with its table and runtime.
    """
    from avc_casadi.coupling import Coupling, require_coupling
    from avc_casadi.files.coupling_file import coupling_beside, read_file, same_problem

    found = read_file(file)
    if not isinstance(found, Coupling):
        return coupling_beside(problem, found, file), []
    require_coupling(found)
    if same_problem(problem, found.problem):
        return found, []
    note = f"the coupling was made for {found.problem.name} with another {_differing(problem, found.problem)}"
    return found.on(problem), [note]


def _differing(one: avc.Problem, other: avc.Problem) -> str:
    """Name the tables in which two problems differ."""
    mine, theirs = one.model_dump(), other.model_dump()
    return ", ".join(f"[{key}]" for key in mine if isinstance(mine[key], dict) and mine[key] != theirs[key])


def read_pair(file: str) -> Coupling | None:
    """Read a coupling to a simulation or a follower; None for one to a wall."""
    from avc_casadi.files.coupling_file import end_of

    if end_of(file) not in {"simulation", "follower"}:
        return None
    return avc.read_coupling(file)
