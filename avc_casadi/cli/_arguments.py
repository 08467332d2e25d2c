"""Arguments shared by several commands."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from argparse import _ActionsContainer
    from collections.abc import Callable

    from avc_casadi._util.units import Units
    from avc_casadi.identification.units import Layout


def add_port(parser: argparse.ArgumentParser) -> None:
    """Declare --port."""
    parser.add_argument(
        "--port",
        required=True,
        help="serial port (avc doctor --ports), or `emulator`: the real firmware image on an emulated board",
    )


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


def named(option: argparse.Action) -> tuple[str, str]:
    """Return the option's name in faults: of a linear device, and of a rotary one."""
    strings = option.option_strings
    return (strings[0], strings[-1]) if isinstance(option, _Worded) else (strings[-1], strings[-1])


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
    from avc_casadi.identification.units import Layout, pairs_of

    columns, wrong = pairs_of(args.columns, "--columns")
    units, also = pairs_of(args.units, "--units")
    if wrong or also:
        raise InputError([*wrong, *also])
    return Layout(columns, units, args.sample_time)
