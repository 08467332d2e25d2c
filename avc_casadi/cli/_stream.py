"""Stream a coupling's gains live: read the device's frequency estimate, send the gains for it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.interrupt import EXIT_CODE, take_interrupt
from avc_casadi.cli._arguments import add_port, positive, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import (
    add_problem_of_gains,
    add_unsafe,
    faults_of,
    is_coupling,
    load_problem,
    read_subject,
    unsafe_note,
)

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_hardware import StreamSample


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "subject", metavar="COUPLING", help="coupling file; or a problem, whose recommended coupling is streamed"
    )
    add_port(parser)
    parser.add_argument(
        "--rate-hz", type=positive, default=50.0, metavar="HZ", help="messages a second, 1 to 100; default 50"
    )
    parser.add_argument("--seconds", type=positive, default=5.0, metavar="S", help="duration; default 5")
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")
    add_problem_of_gains(parser)
    add_unsafe(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Push the table as the fallback, then stream; 1 if the device does not end on this coupling's table."""
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.text import quantity
    from avc_casadi._util.units import FORCE
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.pages.bench import stream_page
    from avc_casadi.present.pages.subject import quantities
    from avc_hardware import stream

    coupling = _coupling(args, console)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    told, shown, sent = quantities(coupling.problem.units), -1.0, 0

    def show(sample: StreamSample) -> None:
        nonlocal shown, sent
        sent += 1
        if sample.time_s >= shown + 0.5:
            shown = sample.time_s
            console.say(
                f"{sample.time_s:7.2f} s  {quantity(sample.frequency_hz, 'Hz'):>8}  "
                f"b {told(sample.damping_ns_per_m, 'N.s/m'):>12}  k {told(sample.stiffness_n_per_m, 'N/m'):>9}  "
                f"{FORCE} {told(sample.force_n, 'N'):>7}"
            )

    try:
        with faults_of(args.subject, args):
            result = stream(
                coupling,
                args.port,
                rate_hz=args.rate_hz,
                seconds=args.seconds,
                baud=args.baud,
                on_silence=console.notice,
                on_sample=show,
                unsafe=args.unsafe,
            )
    except KeyboardInterrupt:
        if not sent:
            raise
        take_interrupt()
        return _interrupted(coupling, args, sent)
    document: dict[str, Any] = plain(
        {"schema": "avc-stream/2", "problem": coupling.problem.name, "coupling": coupling.id}
        | {key: value for key, value in vars(result).items() if key not in {"samples", "push", "status"}}
        | {"push": result.push.document(), "status": vars(result.status)}
        | {"deployable": verdict.document(), "unsafe": unsafe_note(verdict)}
        | {"samples": [vars(sample) for sample in result.samples]}
    )
    text = stream_page(document, console.page, result.faults)
    complaint = f"avc: {result.port}: {'; '.join(result.faults)}" if result.faults else ""
    return Answer(document, text, code=1 if result.faults else 0, complaint=complaint)


def _interrupted(coupling: Coupling, args: argparse.Namespace, sent: int) -> Answer:
    """Describe the device's behaviour after the stream was interrupted."""
    from avc_hardware import HOLD_PERIODS

    document = avc.fault_document(avc.InputError.of("interrupted")) | {
        "schema": "avc-stream/2",
        "problem": coupling.problem.name,
        "coupling": coupling.id,
        "sent": sent,
    }
    stays = f"{args.port} goes back to its table, coupling {coupling.id}, within {HOLD_PERIODS / args.rate_hz:.2g} s"
    left = "the emulated board ends with this command" if args.port == "emulator" else stays
    return Answer(document, f"interrupted after {sent} messages; {left}", code=EXIT_CODE)


def _coupling(args: argparse.Namespace, console: Console) -> Coupling:
    """Read the coupling; or recommend one for a problem."""
    if is_coupling(args.subject):
        return read_subject("stream", args.subject, args.problem)
    from avc_casadi.recommendation.recommend import recommend

    problem = load_problem(args.subject)
    with console.step("recommended coupling"):
        found = recommend(problem, progress=console)
    if found.coupling is None:
        raise avc.NotDeployableError(f"{problem.name}: {found.reason}")
    return found.coupling
