"""Watch a device: records of its own ticks, as text, plot or log; and keep its heartbeat."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.interrupt import EXIT_CODE, HeldInterrupt, take_interrupt
from avc_casadi._util.text import number, quantity
from avc_casadi.cli._arguments import add_motion, add_port, positive, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file

if TYPE_CHECKING:
    from avc_hardware import Device, DeviceStatus, TelemetryLog, TelemetrySample

_SECONDS_WITH_JSON = 5.0
_HEARTBEAT_S = 0.5
# Rate of readable lines of text.
_LINES_HZ = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Watch a device: it pushes a record every so many of its own ticks, with the tick's number; one that is lost\n"
        "is seen by it. With --heartbeat the device lives as long as this command: when it ends, is killed or loses\n"
        "the line, the force falls to 0 within 0.1 s, and comes back out of contact with the next heartbeat."
    )
    add_port(parser)
    parser.add_argument(
        "--rate-hz",
        type=positive,
        default=_LINES_HZ,
        metavar="HZ",
        help="records a second; default 5; 115200 baud carry about 250. At most 5 a second are shown as text",
    )
    parser.add_argument(
        "--seconds", type=positive, metavar="S", help="duration; default until Ctrl-C, with --json 5 seconds"
    )
    parser.add_argument(
        "--heartbeat",
        dest="heartbeat_s",
        type=positive,
        nargs="?",
        const=_HEARTBEAT_S,
        metavar="S",
        help=f"keep the device's heartbeat: the force falls when none comes for S seconds; default {_HEARTBEAT_S:g}",
    )
    parser.add_argument("--out", metavar="FILE", help="log every record as it comes: .csv, or .mcap (extra 'mcap')")
    add_motion(parser)
    parser.add_argument("--plot", action="store_true", help="draw the last 10 s in a window")
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def _sample_document(sample: TelemetrySample, words: str) -> Any:
    """Return a record as JSON values, its faults in words."""
    from avc_casadi._util.json_values import plain

    return plain(vars(sample) | {"fault_words": words.split(", ") if words else []})


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Watch the device; Ctrl-C ends it with all samples so far."""
    from avc_casadi._util.units import FORCE, MM, N_PER_M, NEWTON, NS_PER_M, speak, units_for
    from avc_hardware import EMULATOR, EMULATOR_IS_FRESH, LOG_ENDINGS, DeviceFault, LivePlot, monitor, open_log

    speak(units_for(args.motion))
    out = output_file(args.out, "--out", LOG_ENDINGS) if args.out else None
    samples: list[dict[str, Any]] = []
    document: dict[str, Any] = {"schema": "avc-monitor/2", "port": args.port, "note": None, "samples": samples}
    document |= {"records": 0, "lost": 0, "ended": None, "out": None if out is None else str(out)}
    code, shown = 0, -1.0
    log: TelemetryLog | None = None
    if args.port == EMULATOR:
        document["note"] = EMULATOR_IS_FRESH
        console.say(f"note: {EMULATOR_IS_FRESH}")

    def begun(device: Device) -> None:
        nonlocal log
        if out is not None and log is None:  # not before there is something to log
            log = stack.enter_context(open_log(out, args.motion))
        console.say(_device(device))
        head = ("ticks", "f Hz", f"b {NS_PER_M}", f"k {N_PER_M}", f"x {MM}", f"{FORCE} {NEWTON}", "energy J")
        console.say(_line(head, "mode"))

    def ended(status: DeviceStatus) -> None:
        document["ended"] = {"mode": status.mode, "force_n": status.force_n, "faults": status.faults}

    with ExitStack() as stack:
        watched = monitor(
            args.port,
            rate_hz=args.rate_hz,
            seconds=args.seconds or (_SECONDS_WITH_JSON if console.as_json else None),
            heartbeat_s=args.heartbeat_s,
            baud=args.baud,
            on_silence=console.notice,
            on_device=begun,
            on_end=ended,
        )
        plot = stack.enter_context(LivePlot()) if args.plot else None
        stack.enter_context(closing(watched))
        try:
            for sample in watched:
                words = DeviceFault(sample.faults).word
                with HeldInterrupt():  # all three or none
                    document["records"] += 1
                    document["lost"] += sample.lost
                    if log is not None:
                        log.write(sample)
                    if console.as_json:
                        samples.append(_sample_document(sample, words))
                if plot is not None:
                    plot.take(sample)
                    if plot.closed:
                        break
                if not 0 <= sample.time_s - shown < 1 / _LINES_HZ - 1e-6:
                    shown = sample.time_s
                    console.say(_state(sample, words))
        except KeyboardInterrupt:
            if not document["records"]:
                raise
            take_interrupt()
            code = EXIT_CODE
    if code:
        document = avc.fault_document(avc.InputError.of("interrupted")) | document
    return Answer(document, _end(document, args), code=code)


def _device(device: Device) -> str:
    from avc_casadi._util.units import NEWTON

    running = f"coupling {device.coupling_id}" if device.coupling_id else "no coupling"
    own = f" {device.unique_id}" if device.unique_id else ""
    return (
        f"device{own} with firmware {device.build}: a tick every {1e3 * device.sample_time_s:g} ms, at most "
        f"{device.max_force_n:g} {NEWTON}, {running}"
    )


def _end(document: dict[str, Any], args: argparse.Namespace) -> str:
    from avc_casadi._util.units import units_for

    lines, units = [], units_for(args.motion)
    if document["lost"]:
        lines.append(
            f"{document['lost']} of {document['records'] + document['lost']} records lost: the line is too slow or "
            "lossy; give less --rate-hz, or a faster --baud with firmware built for it"
        )
    if document["out"]:
        lines.append(f"written: {document['out']}, {document['records']} records")
    ended, force = document["ended"], units.key("force")
    if args.heartbeat_s and ended is not None:
        fell = f"the {force} fell to {quantity(ended['force_n'], units.unit('N'))}"
        until = f"mode {ended['mode']} until the next heartbeat, out of contact"
        lines.append(f"heartbeat ended: {fell}; {until}")
    elif args.heartbeat_s:
        lines.append(f"heartbeat ended, and the device did not answer: its {force} falls by itself")
    return "\n".join(lines)


def _state(sample: TelemetrySample, faults: str) -> str:
    from avc_casadi._util.units import FORCE

    values = (
        sample.frequency_hz,
        sample.damping_ns_per_m,
        sample.stiffness_n_per_m,
        1e3 * sample.position_m,
        sample.force_n,
        sample.energy_j,
    )
    mode = sample.mode if sample.has_table or faults else f"no {FORCE}"
    mode += ", streaming" if sample.streaming else ""
    mode += f" ({faults})" if faults else ""
    mode += f", coupling {sample.coupling_id}" if sample.has_table else ", no coupling"
    return _line((str(sample.ticks), *map(number, values)), mode)


def _line(cells: tuple[str, ...], mode: str) -> str:
    return "  ".join([*(f"{cell:>9}" for cell in cells), mode])
