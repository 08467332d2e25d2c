"""What a verb is asked about: a problem, or a coupling file with the problem in it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import avc_casadi as avc

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

_FILES = (".json", ".csv")


def is_coupling(text: str) -> bool:
    """Tell a coupling or gain file from a problem by its ending."""
    return Path(text).suffix.lower() in _FILES


def add_problem_of_gains(parser: argparse.ArgumentParser) -> None:
    """Declare --problem, for gain files that do not carry theirs."""
    parser.add_argument(
        "--problem", metavar="P", help="problem of a gain file that does not carry its own (.csv, or of release 0.1.0)"
    )


def add_unsafe(parser: argparse.ArgumentParser) -> None:
    """Declare --unsafe."""
    parser.add_argument(
        "--unsafe", action="store_true", help="go on with a coupling that is not deployable; this is written down"
    )


def read_subject(file: str, problem: str | None) -> Coupling:
    """Read a coupling file, or a gain file beside the problem that --problem names."""
    return avc.read_coupling(Path(file), None if problem is None else avc.load_problem(problem))


def unsafe_note(verdict: avc.Deployable) -> str:
    """Say that a coupling went on although it is not deployable; empty where it is."""
    return "" if verdict.passed else f"UNSAFE, went on by request: {verdict.sentence}"
