"""Lower the limits of a device while it runs, raise them again, or show them: force, speed and energy."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._arguments import add_motion, add_port, add_worded, check_worded, positive, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import number, table

_UNITS = {"force_n": "force, N", "speed_m_per_s": "speed, m/s", "energy_j": "energy, J"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nNever above those built into the firmware, and until the device starts anew. A lower force\n"
        "holds at once, a higher one from the next time that the device is out of contact."
    )
    add_port(parser)
    add_worded(parser, "--force-n", "--torque-nm", "N", "limit of the force")
    add_worded(parser, "--speed-m-per-s", "--speed-rad-per-s", "V", "a fault is latched beyond it")
    parser.add_argument(
        "--energy-j", type=positive, metavar="E", help="that a coupling may give out, a second, without having got it"
    )
    parser.add_argument("--built-in", action="store_true", help="those of the firmware, for all that is not given")
    add_motion(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Set or show."""
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import speak, units_for
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
    rows = [(label, *(number(three[name][key]) for name in ("hold", "boards"))) for key, label in _UNITS.items()]
    text = table(("limit", "now", "built in"), rows, left=(0,))
    if found.waits:
        text += f"\n{number(found.asked.force_n)} N hold when the device is let go, out of contact"
    return Answer(document, text)
