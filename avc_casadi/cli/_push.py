"""Send a coupling to a device: its table, wall and limits, swapped at once and read back."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from avc_casadi.cli._arguments import add_port, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._deploy import tried_or_say
from avc_casadi.cli._subject import add_problem_of_gains, add_unsafe, faults_of, read_subject, unsafe_note

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


IN_CONTACT = "the device is in contact: release it, out of the wall; the new coupling takes over there"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nA coupling that is not deployable (linearly stable with every hand of [hands] and released) is\n"
        "refused with exit code 1; --unsafe overrides. The emulated device is a fresh one for every command;\n"
        "it runs at the coupling's own sample time, encoder and force limit, with a hand on it."
    )
    parser.add_argument("gains", metavar="COUPLING", help="coupling file; or a gain file with --problem")
    add_port(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")
    parser.add_argument("--device-id", metavar="ID", help="number of the device's chip; another one is refused")
    add_problem_of_gains(parser)
    add_unsafe(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Push; a refusal is raised."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.pages.bench import push_page
    from avc_hardware import EMULATOR, push

    coupling = read_subject("push", args.gains, args.problem)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    with faults_of(args.gains, args), console.step(f"push to {args.port}"):
        document = plain(
            {"schema": "avc-push/2", "coupling": coupling.id, "deployable": verdict.document()}
            | push(
                coupling,
                args.port,
                baud=args.baud,
                on_silence=console.notice,
                unsafe=args.unsafe,
                device_id=args.device_id,
                # The emulated device is released by itself.
                on_wait=lambda: None if args.port == EMULATOR else console.say(IN_CONTACT),
            ).document()
        )
    document["unsafe"] = unsafe_note(verdict)
    document["widest_hole_hz"] = widest_hole(coupling)
    document["lacks"] = list(coupling.lacks)
    if args.port == EMULATOR:
        with console.step("firmware and plant in the loop"):
            document["in_the_loop"] = tried_or_say(coupling)
    equal = document["readback_equal"]
    complaint = "" if equal else f"avc: {args.port}: the table read back is not the one sent; push again"
    text = push_page(document, coupling, console.page, args.gains)
    return Answer(document, text, code=0 if equal else 1, complaint=complaint)


def widest_hole(coupling: Coupling) -> list[float] | None:
    """Return the ends, in Hz, of the widest run of rows without gains between rows with gains; None without one."""
    from itertools import pairwise

    gains = coupling.schedule
    kept = [row for row in range(gains.rows) if gains.usable[row]]
    holes = [(gains.frequency_hz[a], gains.frequency_hz[b]) for a, b in pairwise(kept) if b > a + 1]
    return [float(end) for end in max(holes, key=lambda ends: ends[1] - ends[0])] if holes else None
