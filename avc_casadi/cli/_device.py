"""Show or lower the limits of a device, or clear its faults."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi import InputError
from avc_casadi.cli._arguments import add_motion, add_port, add_worded, check_worded, positive, positive_int
from avc_casadi.cli._console import Answer, Console

_OF_LIMITS = {
    "force_n": "--force-n",
    "speed_m_per_s": "--speed-m-per-s",
    "energy_j": "--energy-j",
    "built_in": "--built-in",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_port(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--limits", action="store_true", help="show or lower the limits (what is done by default)")
    what.add_argument("--clear", action="store_true", help="show the latched faults and clear them; 1 if one stays")
    limits = parser.add_argument_group(
        "limits",
        "Never above those built into the firmware, and until the device starts anew. A lower force\n"
        "holds at once, a higher one from the next time that the device is out of contact.",
    )
    add_worded(limits, "--force-n", "--torque-nm", "N", "limit of the force")
    add_worded(limits, "--speed-m-per-s", "--speed-rad-per-s", "V", "a fault is latched beyond it")
    limits.add_argument(
        "--energy-j", type=positive, metavar="E", help="that a coupling may give out, a second, without having got it"
    )
    limits.add_argument("--built-in", action="store_true", help="those of the firmware, for all that is not given")
    add_motion(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Carry out the options.

    Raises:
        InputError: options that do not belong together.
    """
    if not args.clear:
        return _limited(args, console)
    given = [option for key, option in _OF_LIMITS.items() if getattr(args, key) not in {None, False}]
    if given:
        raise InputError.of("goes with --limits, not with --clear", key=given[0])
    return _cleared(args, console)


def _limited(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import speak, units_for
    from avc_casadi.present.pages.bench import limits_page
    from avc_hardware import set_limits

    units = units_for(args.motion)
    check_worded(args, units)
    speak(units)
    with console.step(f"limits of {args.port}"):
        found = set_limits(
            args.port,
            force_n=args.force_n,
            speed_m_per_s=args.speed_m_per_s,
            energy_j=args.energy_j,
            built_in=args.built_in,
            baud=args.baud,
            on_silence=console.notice,
        )
    three = {name: vars(getattr(found, name)) for name in ("boards", "asked", "hold")}
    document: dict[str, Any] = plain({"schema": "avc-limits/1", "port": found.port, "waits": found.waits} | three)
    return Answer(document, limits_page(document, units, console.page))


def _cleared(args: argparse.Namespace, console: Console) -> Answer:
    """Clear the faults; 1 if one remains."""
    from avc_casadi.present.pages.bench import faults_page
    from avc_hardware import clear_faults

    with console.step(f"clear {args.port}"):
        found = clear_faults(args.port, baud=args.baud, on_silence=console.notice)
    document = {
        "schema": "avc-clear/1",
        "port": found.port,
        "were": [fault.word for fault in found.were],
        "first": [fault.word for fault in found.first],
        "tick": found.tick,
        "left": [fault.word for fault in found.left],
        "mode": found.status.mode,
    }
    complaint = f"avc: {found.port}: still there: {found.left.word}" if found.left else ""
    text = faults_page(document, list(found.were.advice), console.page)
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint)
