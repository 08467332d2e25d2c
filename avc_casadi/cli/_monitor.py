"""Show the state of a device again and again, until Ctrl-C or for a time."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_port, positive, positive_int
from avc_casadi.cli._console import INTERRUPTED, Answer, Console
from avc_casadi.cli._text import number

if TYPE_CHECKING:
    from avc_hardware import DeviceStatus

_SECONDS_WITH_JSON = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_port(parser)
    parser.add_argument("--rate-hz", type=positive, default=5.0, metavar="HZ", help="samples a second; default 5")
    parser.add_argument(
        "--seconds", type=positive, metavar="S", help="duration; default until Ctrl-C, with --json 5 seconds"
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Watch the device; with --json Ctrl-C ends it with the samples so far."""
    from avc_casadi.support import plain
    from avc_hardware import DeviceFault, monitor

    seconds = args.seconds or (_SECONDS_WITH_JSON if console.as_json else None)
    samples: list[dict[str, Any]] = []
    document = {"schema": "avc-monitor/1", "port": args.port, "samples": samples}
    console.say(_line(("ticks", "f Hz", "b N.s/m", "k N/m", "x mm", "force N", "energy J"), "mode"))
    try:
        for status in monitor(args.port, rate_hz=args.rate_hz, seconds=seconds, baud=args.baud):
            words = [fault.word for fault in DeviceFault(status.faults)]
            if console.as_json:
                samples.append(plain(vars(status) | {"fault_words": words}))
            console.say(_state(status, ", ".join(words)))
    except KeyboardInterrupt:
        if not samples:
            raise
        interrupted = avc.fault_document(avc.InputError.of("interrupted"))
        return Answer(interrupted | document, "", code=INTERRUPTED)
    return Answer(document, "")


def _state(status: DeviceStatus, faults: str) -> str:
    values = (
        status.frequency_hz,
        status.damping_ns_per_m,
        status.stiffness_n_per_m,
        1e3 * status.position_m,
        status.force_n,
        status.energy_j,
    )
    mode = status.mode if status.has_table or faults else "no force"
    mode += ", streaming" if status.streaming else ""
    mode += f" ({faults})" if faults else ""
    mode += f", coupling {status.coupling_id}" if status.has_table else ", no coupling"
    mode += ", another waits for the device to be let go" if status.waits else ""
    return _line((str(status.ticks), *map(number, values)), mode)


def _line(cells: tuple[str, ...], mode: str) -> str:
    return "  ".join([*(f"{cell:>9}" for cell in cells), mode])
