"""Build firmware for a device, its sample time, encoder and force limit built in."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._check_device import is_device
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_folder
from avc_casadi.cli._subject import add_problem_of_gains, is_coupling, load_device, load_problem, read_subject

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem
    from avc_hardware import BoardLimits

_USUAL_BAUD = 115200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nNo gains are in it: they are pushed (avc push), and a coupling for another sample time or for\n"
        "more force is refused by the device. It needs the board's compiler: arm-none-eabi-gcc, or that of your folder."
    )
    parser.add_argument(
        "subject", metavar="SUBJECT", help="device, or problem; or a coupling file, for what runs beside its gains"
    )
    parser.add_argument(
        "--board",
        required=True,
        help="a board (a wrong name lists them), or the folder of your own (hardware/PORTING.md)",
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the .elf, .bin and .hex file")
    parser.add_argument(
        "--baud",
        type=positive_int,
        help=f"rate of its serial port; default {_USUAL_BAUD}; push, stream and monitor need the same",
    )
    add_problem_of_gains(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Build the image and print the commands that flash it."""
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import spoken
    from avc_casadi.present.pages.bench import firmware_page
    from avc_hardware import build_firmware

    subject: Coupling | avc.Problem | Device
    if is_coupling(args.subject):
        subject = read_subject("firmware", args.subject, args.problem)
    else:
        subject = load_device(args.subject).device if is_device(args.subject) else load_problem(args.subject)
    with output_folder(args.out, "--out") as folder, console.step(f"firmware for {args.board}"):
        built = build_firmware(subject, args.board, folder, baud=args.baud)
    baud = args.baud or _USUAL_BAUD
    limits, figures = built.limits, built.figures
    notes = _notes(subject, limits)
    document: dict[str, Any] = plain(
        {
            "schema": "avc-firmware/1",
            "board": built.board,
            "build": built.build,
            "baud": baud,
            "files": [str(Path(args.out) / path.name) for path in built.files],
            "address": built.address,
            "size_bytes": built.size,
            "limits": vars(limits),
            "figures": vars(figures),
            "commands": list(built.commands),
            "notes": notes,
        }
    )
    at = "" if baud == _USUAL_BAUD else f" --baud {baud}"
    held = f"pushed: avc push{at}; estimator {figures.estimator}"
    text = firmware_page(document, built.title, spoken(), console.page, held)
    return Answer(document, text)


def _notes(subject: Coupling | Problem | Device, limits: BoardLimits) -> list[str]:
    """Describe defaults of the image that the file does not give, and keys of the file that it ignores."""
    from avc_casadi._util.units import METRE, NEWTON, spoken_key

    problem = getattr(subject, "problem", subject)
    device = getattr(problem, "device", problem)
    notes = []
    if getattr(subject, "detent", None) is not None:
        notes.append("[detent] has no place in what is pushed: export it (avc export)")
    for key, value, unit in (
        ("max_force_n", limits.max_force_n, NEWTON),
        ("encoder_resolution_m", limits.metres_per_count, METRE),
    ):
        if not getattr(device, key):
            known = f"{number(value)} {unit} is the board's own"
            notes.append(f"the file has no {spoken_key(f'device.{key}')}: {known}; give the device's")
    return notes
