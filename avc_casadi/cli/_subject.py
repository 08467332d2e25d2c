"""Input of a command: a problem, or a coupling file with the problem in it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.device_file import DeviceFile

_FILES = (".json", ".csv")
TOOL_VERBS = "avc recommend, certify, zwidth, explore, simulate, run, check and export know a [simulation]"


def load_problem(source: str) -> avc.Problem:
    """Load a problem, and set the units of output to those of its device."""
    from avc_casadi._util.units import speak

    problem = avc.load_problem(source)
    speak(problem.units)
    return problem


def load_device(source: str) -> DeviceFile:
    """Load a device file, and set the units of output to its own."""
    from avc_casadi._util.units import speak

    file = avc.load_device(source)
    speak(file.device.units)
    return file


def load_known(source: str) -> DeviceFile:
    """Load a device file, or the device of a problem, and set the units of output to its own."""
    from avc_casadi.files.device_file import DeviceFile

    if not _has_wall(source):
        return load_device(source)
    problem = load_problem(source)
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
    parser.add_argument(
        "--problem", metavar="P", help="problem of a gain file that does not carry its own (.csv, or of release 0.1.0)"
    )


def add_unsafe(parser: argparse.ArgumentParser) -> None:
    """Declare --unsafe."""
    parser.add_argument(
        "--unsafe", action="store_true", help="go on with a coupling that is not deployable; this is written down"
    )


def read_subject(verb: str, file: str, problem: str | None = None, *, beside: str = "--problem P") -> Coupling:
    """Read a coupling file, or a gain file for the problem of --problem.

    Args:
        verb: command, for messages.
        file: the argument.
        problem: of a gain file; None where none was given.
        beside: option for the problem of a gain file.

    Raises:
        InputError: with every fault; for a problem in place of a coupling, with the command that makes one.
    """
    from avc_casadi._util.units import speak
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.coupling_file import GAINS_ALONE, read_file
    from avc_casadi.files.other_end_coupling_file import is_tool_coupling

    if is_tool_coupling(file):
        why = f"is a coupling to a simulation; {verb} takes one to a wall in the device's own loop: {TOOL_VERBS}"
        raise avc.InputError.of(why, file=file)
    if not is_coupling(file) and _is_problem(file):
        make = f"avc recommend {quote(file)} --out c.json"
        raise avc.InputError.of(f"is a problem; {verb} takes a coupling: {make}", file=file)
    if problem is not None:
        return avc.read_coupling(Path(file), load_problem(problem))
    found = read_file(Path(file))
    if isinstance(found, Coupling):
        speak(found.problem.units)
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
