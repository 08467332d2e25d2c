"""Commission a device: its wiring checked, its wall placed, its force limited at first.

The operator pushes the device into the wall, draws it back to where the wall's face shall be and releases it; then a
small stated pulse must move it the way of the force. A reversed or stuck encoder, a reversed or dead motor is named and
latched on the device, which then takes no coupling. After that the force is limited until `avc device --force-n` raises
it.
"""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli._arguments import add_port, add_worded, check_worded, positive_int
from avc_casadi.cli._check_device import is_device
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import load_device, load_problem

_WIRINGS = ("right", "encoder-reversed", "encoder-stuck", "motor-reversed", "motor-dead")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "device",
        metavar="DEVICE",
        help="what is known of it: a device or a problem; a file or a catalogue name",
    )
    add_port(parser)
    pulse = "of the pulse; default three times the dry friction, at least a tenth of the device's force"
    add_worded(parser, "--force-n", "--torque-nm", "N", pulse)
    touch = "force limit afterwards; default a tenth of the device's"
    add_worded(parser, "--first-touch-n", "--first-touch-nm", "N", touch)
    add_worded(parser, "--by-hand-m", "--by-hand-rad", "X", "least way of the hand; default 0.005 m at the hand")
    parser.add_argument(
        "--on-bench", choices=_WIRINGS, default="right", help="with --port emulator: how its device is wired"
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Instruct, measure, report; 1 where the wiring is wrong."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.present.pages.bench import commission_page
    from avc_hardware import EMULATOR, Wiring, commission

    if args.on_bench != "right" and args.port != EMULATOR:
        raise avc.InputError.of(
            f"goes with --port emulator alone, not with {args.port}; leave it out", key="--on-bench"
        )
    problem = None if is_device(args.device) else load_problem(args.device)
    device = load_device(args.device).device if problem is None else problem.device
    check_worded(args, device.units)
    found = commission(
        device,
        args.port,
        force_n=args.force_n,
        first_touch_n=args.first_touch_n,
        by_hand_m=args.by_hand_m,
        on_bench=Wiring(args.on_bench),
        baud=args.baud,
        on_silence=console.notice,
        on_step=console.say if not console.as_json else console.complain,
    )
    document = plain({"schema": "avc-commission/1"} | found.document())
    if found.found:
        return Answer(document, "", code=1, complaint=f"avc: {found.port}: {found.sentence}")
    motion = "" if device.units.linear else " --motion rotary"
    option = "--force-n" if device.units.linear else "--torque-nm"
    # With detents no table is pushed.
    deploy = "avc push" if problem is None or problem.detent is None else "avc firmware --built-in"
    onwards = [deploy, f"touch the wall, then raise the limit: avc device {option} F{motion}"]
    return Answer(document, commission_page(document, device.units, console.page, onwards))
