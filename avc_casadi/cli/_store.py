"""Have a device keep its running coupling, its limits and its name over a reset."""

from __future__ import annotations

import argparse

from avc_casadi.cli._arguments import add_motion, add_port, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nThe device gives no force meanwhile. Where the power is cut, what was kept before or this\n"
        "is whole. A coupling that acts after a reset takes over out of contact alone; an encoder that counts from\n"
        "where it stood has its wall there, until avc commission places it. --no-coupling switches it off."
    )
    add_port(parser)
    parser.add_argument("--acts", action="store_true", help="the coupling takes over after a reset by itself")
    parser.add_argument("--no-coupling", action="store_true", help="keep limits and name alone")
    parser.add_argument("--name", metavar="NAME", help="of the device, at most 16 bytes; default the one it has")
    add_motion(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Store."""
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import speak, units_for
    from avc_hardware import store

    speak(units_for(args.motion))
    with console.step(f"store on {args.port}"):
        kept = store(
            args.port,
            coupling=not args.no_coupling,
            acts=args.acts,
            name=args.name,
            baud=args.baud,
            on_silence=console.notice,
        )
    after = "acts after a reset, out of contact" if kept.acts else "does not act after a reset"
    coupling = f"coupling {kept.coupling_id}, which {after}" if kept.coupling_id else "no coupling"
    text = f"kept: {coupling}; force limit {number(kept.force_n)} N; name {kept.name or 'none'}; store {kept.number}"
    return Answer(plain({"schema": "avc-store/1"} | vars(kept)), text)
