"""Verbs that operate a device: stream, monitor, device."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.interrupt import EXIT_CODE, HeldInterrupt, take_interrupt
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import units_for
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console
from avc_casadi.present.row import Answer, Mark, Part, Value, listed, row, text_of

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.coupling import Coupling
    from avc_hardware import Device, DeviceStatus, StreamSample, TelemetrySample

_SECONDS_WITH_JSON = 5.0
_HEARTBEAT_S = 0.5
# Rate of readable lines of text.
_LINES_HZ = 5.0


@cli.verb(
    cli.argument("subject", metavar="COUPLING", text="coupling file; or a problem, for its recommended one"),
    *cli.PORT,
    cli.argument("--rate-hz", type=cli.positive, default=50.0, metavar="HZ", text="messages a second, 1 to 100 (50)"),
    cli.argument("--seconds", type=cli.positive, default=5.0, metavar="S", text="duration; default 5"),
    cli.UNSAFE,
)
def run_stream(args: argparse.Namespace, console: Console) -> Answer:
    """Stream a coupling's gains live: read the device's frequency estimate, send the gains for it.

    The table is pushed first, as what the device falls back to. Exit code 1 if it does not end on it.
    """
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.coupling import require_coupling
    from avc_casadi.present.rows import deploy
    from avc_hardware import stream

    if cli.is_coupling(args.subject):
        coupling = cli.read_wall(args.subject)
    else:
        coupling = cli.recommended_coupling(avc.load_problem(args.subject), console)
        require_coupling(coupling)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    units, shown, sent = coupling.problem.units, -1.0, 0

    def show(sample: StreamSample) -> None:
        nonlocal shown, sent
        sent += 1
        if sample.time_s >= shown + 0.5:
            shown = sample.time_s
            b, k = Value(sample.damping_ns_per_m, "damping"), Value(sample.stiffness_n_per_m, "stiffness")
            heard = (Value(sample.frequency_hz, "frequency"), ": b", b, ", k", k)
            given = ("; applied", Value(sample.force_n, "force"))
            console.say(f"{sample.time_s:7.2f} s  {text_of((*heard, *given), units)}")

    try:
        with cli.faults_of(args.subject, args):
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
        return _stream_interrupted(coupling, args, sent)
    document: dict[str, Any] = plain(
        {"problem": coupling.problem.name, "coupling": coupling.id}
        | {key: value for key, value in vars(result).items() if key not in {"samples", "push", "status"}}
        | {"push": result.push.document(), "status": vars(result.status)}
        | {"deployable": verdict.document(), "unsafe": cli.unsafe_note(verdict)}
        | {"samples": [vars(sample) for sample in result.samples]}
    )
    complaint = f"avc: {result.port}: {'; '.join(result.faults)}" if result.faults else ""
    answer = deploy.stream(document, result.faults)
    return replace(answer, units=units, complaint=complaint)


def _stream_interrupted(coupling: Coupling, args: argparse.Namespace, sent: int) -> Answer:
    """Describe the device's behaviour after the stream was interrupted."""
    from avc_hardware import HOLD_PERIODS

    data: dict[str, Any] = dict(avc.fault_document(avc.InputError.of("interrupted")))
    data |= {"problem": coupling.problem.name, "coupling": coupling.id, "sent": sent}
    stays = f"{args.port} goes back to its table, coupling {coupling.id}, within {HOLD_PERIODS / args.rate_hz:.2g} s"
    left = "the emulated board ends with this command" if args.port == "emulator" else stays
    return Answer("stream", data, (f"interrupted after {sent} messages; {left}",), code=EXIT_CODE)


@cli.verb(
    *cli.PORT,
    cli.argument(
        "--rate-hz",
        type=cli.positive,
        default=_LINES_HZ,
        metavar="HZ",
        text="records a second; default 5; 115200 baud carry about 250. At most 5 a second are shown as text",
    ),
    cli.argument("--seconds", type=cli.positive, metavar="S", text="default until Ctrl-C, with --json 5 seconds"),
    cli.argument(
        "--heartbeat",
        dest="heartbeat_s",
        type=cli.positive,
        nargs="?",
        const=_HEARTBEAT_S,
        metavar="S",
        text=f"keep the device's heartbeat: the force falls when none comes for S seconds; default {_HEARTBEAT_S:g}",
    ),
    cli.output("--out", "log every record as it comes: .csv", ".csv"),
    cli.MOTION,
)
def run_monitor(args: argparse.Namespace, console: Console) -> Answer:
    """Watch a device: records of its own ticks, as text or log; and keep its heartbeat.

    With --heartbeat the device lives as long as this command: when that ends or loses the line, the force falls to 0
    within 0.1 s, and comes back out of contact with the next heartbeat.
    """
    from avc_hardware import EMULATOR, EMULATOR_IS_FRESH, DeviceFault, TelemetryLog, monitor

    units = units_for(args.motion)
    samples: list[dict[str, Any]] = []
    note = EMULATOR_IS_FRESH if args.port == EMULATOR else None
    document: dict[str, Any] = {"port": args.port, "note": note, "samples": samples, "records": 0, "lost": 0}
    document |= {"ended": None, "out": args.out and str(args.out)}
    code, shown = 0, -1.0
    log: TelemetryLog | None = None

    def begun(device: Device) -> None:
        nonlocal log
        if args.out is not None and log is None:  # not before there is something to log
            log = stack.enter_context(TelemetryLog(args.out, args.motion))
        own, tick, most = device.unique_id, Value(device.sample_time_s, "time"), Value(device.max_force_n, "force")
        running = f", coupling {device.coupling_id}" if device.coupling_id else ", no coupling"
        told = (f"device {own} with firmware {device.build}: a tick every", tick, ", at most", most, running)
        console.say(text_of(told, units))

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
        stack.enter_context(closing(watched))
        try:
            for sample in watched:
                words = DeviceFault(sample.faults).word
                with HeldInterrupt():  # all or none
                    document["records"] += 1
                    document["lost"] += sample.lost
                    if log is not None:
                        log.write(sample)
                    if console.as_json:
                        samples.append(plain(vars(sample) | {"fault_words": words.split(", ") if words else []}))
                if not 0 <= sample.time_s - shown < 1 / _LINES_HZ - 1e-6:
                    shown = sample.time_s
                    console.say(text_of(_monitor_state(sample, words), units))
        except KeyboardInterrupt:
            if not document["records"]:
                raise
            take_interrupt()
            code = EXIT_CODE
    if code:
        document = avc.fault_document(avc.InputError.of("interrupted")) | document
    return _monitor_end(document, args, units, code)


def _monitor_end(data: dict[str, Any], args: argparse.Namespace, units: Units, code: int) -> Answer:

    rows, ended = [], data["ended"]
    if lost := data["lost"]:
        what = f"{lost} of {data['records'] + lost} records: the line is too slow or lossy; give less --rate-hz, or a "
        rows.append(row("Lost", f"{what}faster --baud with firmware built for it", mark=Mark.CAUTION))
    if data["out"]:
        rows.append(row("Written", f"{data['out']}, {data['records']} records"))
    if args.heartbeat_s and ended is not None:
        until = f"; mode {ended['mode']} until the next heartbeat, out of contact"
        rows.append(row("Heartbeat", "ended, at", Value(ended["force_n"], "force"), until))
    elif args.heartbeat_s:
        rows.append(row("Heartbeat", "ended, and the device did not answer: it falls to 0 by itself"))
    return Answer("monitor", data, rows=tuple(rows), units=units, code=code)


def _monitor_state(sample: TelemetrySample, faults: str) -> tuple[Part, ...]:

    mode = sample.mode if sample.has_table or faults else "idle"
    coupling = f"coupling {sample.coupling_id}" if sample.has_table else "no coupling"
    return listed(
        [
            f"tick {sample.ticks}",
            ("f", Value(sample.frequency_hz, "frequency")),
            ("b", Value(sample.damping_ns_per_m, "damping")),
            ("k", Value(sample.stiffness_n_per_m, "stiffness")),
            ("at", Value(sample.position_m, "length")),
            ("applied", Value(sample.force_n, "force")),
            Value(sample.energy_j, "energy"),
            f"{mode} ({faults})" if faults else mode,
            "streaming" if sample.streaming else None,
            coupling,
        ]
    )


@cli.verb(
    *cli.PORT,
    cli.flag("--clear", "show the latched faults and clear them; 1 if one stays"),
    *cli.turning("force_n", "N", "limit of the force; a higher one holds from the next time out of contact"),
    *cli.turning("speed_m_per_s", "V", "a fault is latched beyond it"),
    cli.argument("--energy-j", type=cli.positive, metavar="E", text="given out in a second beyond what came in"),
    cli.MOTION,
)
def run_device(args: argparse.Namespace, console: Console) -> Answer:
    """Show or lower the limits of a device, or clear its faults.

    Limits are never above those built into the firmware, and hold until the device starts anew.
    """
    from avc_casadi.present.rows.deploy import limits
    from avc_hardware import set_limits

    units = units_for(args.motion)
    asked = {key: cli.of_motion(args, units, key) for key in ("force_n", "speed_m_per_s", "energy_j")}
    if args.clear:
        if given := [key for key, value in asked.items() if value is not None]:
            raise avc.InputError.of("is a limit, and --clear sets none; leave it out", key=units.key(given[0]))
        return _cleared(args, console)
    with console.step(f"limits of {args.port}"):
        found = set_limits(args.port, **asked, baud=args.baud, on_silence=console.notice)
    three = {name: vars(getattr(found, name)) for name in ("boards", "asked", "hold")}
    document: dict[str, Any] = plain({"port": found.port, "waits": found.waits} | three)
    return limits(document, units)


def _cleared(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.present.rows.deploy import faults
    from avc_hardware import clear_faults

    with console.step(f"clear {args.port}"):
        found = clear_faults(args.port, baud=args.baud, on_silence=console.notice)
    document = {
        "port": found.port,
        "were": [fault.word for fault in found.were],
        "first": [fault.word for fault in found.first],
        "tick": found.tick,
        "left": [fault.word for fault in found.left],
        "mode": found.status.mode,
    }
    complaint = f"avc: {found.port}: still there: {found.left.word}" if found.left else ""
    return replace(faults(document, list(found.were.advice)), complaint=complaint)
