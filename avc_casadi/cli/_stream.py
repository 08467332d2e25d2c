"""Stream gains live: read the device's frequency estimate, send (b, k) for it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_port, positive, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._solve import without_gains
from avc_casadi.cli._text import number

if TYPE_CHECKING:
    from avc_hardware import StreamSample


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue; solved by direct")
    add_port(parser)
    parser.add_argument("--rate-hz", type=positive, default=50.0, metavar="HZ", help="messages a second; default 50")
    parser.add_argument("--seconds", type=positive, default=5.0, metavar="S", help="duration; default 5")
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Solve, push the table as the safety net, stream."""
    from avc_casadi.cli._push import wall_of
    from avc_casadi.coupling import gain_document
    from avc_casadi.support import plain
    from avc_hardware import stream

    problem = avc.load_problem(args.problem)
    with console.step(f"direct: {len(problem.frequencies_hz())} frequencies"):
        gains = avc.solve(problem, "direct")
    shown = -1.0

    def show(sample: StreamSample) -> None:
        nonlocal shown
        if sample.time_s >= shown + 0.5:
            shown = sample.time_s
            console.say(
                f"{sample.time_s:7.2f} s  {number(sample.frequency_hz):>8} Hz  "
                f"b {number(sample.damping_ns_per_m):>9} N.s/m  k {number(sample.stiffness_n_per_m):>9} N/m  "
                f"force {number(sample.force_n):>8} N"
            )

    result = stream(
        gains,
        args.port,
        rate_hz=args.rate_hz,
        seconds=args.seconds,
        baud=args.baud,
        settings=wall_of(problem),
        on_sample=show,
    )
    document: dict[str, Any] = plain(
        {"schema": "avc-stream/1", "problem": problem.name}
        | {key: value for key, value in vars(result).items() if key not in {"samples", "push", "status"}}
        | {"push": result.push.document(), "status": vars(result.status)}
        | {"samples": [vars(sample) for sample in result.samples]}
    )
    missing = without_gains(gain_document(gains))
    text = (
        f"{result.sent} messages in {result.seconds:.3g} s at {result.rate_hz:g} Hz on {result.port}: "
        f"{result.taken} taken, {result.late} late, {result.lost} lost; back to the table {result.fell_back} times\n"
        f"round trip: median {1e3 * result.round_trip_s:.3g} ms, largest {1e3 * result.round_trip_max_s:.3g} ms; "
        f"afterwards the device is on its table ({result.status.mode})"
    )
    return Answer(document, text, code=1 if missing else 0, complaint=missing)
