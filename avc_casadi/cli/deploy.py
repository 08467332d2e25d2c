"""Verbs that deploy a coupling and operate a device: export, push, firmware, stream, monitor, device."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.files import write_file
from avc_casadi._util.interrupt import EXIT_CODE, DeferredInterrupt, take_interrupt
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import units_for
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder
from avc_casadi.present import rows
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, commas, row, text_of

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device as DeviceModel
    from avc_casadi.present.rows.deploy import NotTried
    from avc_casadi.present.rows.reports import ReportedTrial

_PARAMETERS = "in place of C: a coupling to a [simulation] for mujoco, unity, chai3d, sofa or another engine"
_PRECISION = "single (default): float, as in the packaged firmware; double: where a processor has it in hardware"


@cli.verb(
    cli.COUPLING,
    cli.argument("--c", metavar="DIR", text="folder for avc_coupling.h and avc_coupling.c"),
    cli.argument("--parameters", metavar="ENGINE", text=_PARAMETERS),
    cli.argument("--precision", choices=("single", "double"), default="single", text=_PRECISION),
    cli.argument("--name", default="avc_coupling", text="what files and names in C begin with (default: avc_coupling)"),
    cli.flag("--force", "write over a file that is there and is no export"),
    cli.BESIDE,
    cli.UNSAFE,
)
def run_export(args: argparse.Namespace, console: Console) -> Answer:
    """Write a coupling as C for firmware of your own: avc_coupling.h and avc_coupling.c.

    The whole coupling at its own sample time, in C99 that is also C++11; of one to a [simulation] or a [follower] both
    ends. What is not deployable is refused with exit code 1; --unsafe overrides.
    """
    from avc_casadi.cli import ends
    from avc_casadi.model.ends import Simulation
    from avc_hardware.codegen.pair_export import pair_verdict

    if (args.c is None) == (args.parameters is None):
        raise avc.InputError.of("is missing; allowed: --c DIR or --parameters ENGINE", key="c")
    coupling = avc.read_coupling(args.gains, args.problem)
    if not isinstance(coupling.end, Simulation):
        cli.refuse(args, "parameters", why=f"is of a [simulation], not of a {coupling.end.kind}; for C: --c DIR")
    if args.parameters is not None:
        sentence, stable = pair_verdict(coupling, unsafe=args.unsafe)
        return rows.engines.parameters(coupling, args.parameters, args.gains, "" if stable else sentence)
    judged = ends.judged(coupling.end, coupling, unsafe=args.unsafe)
    with console.step("C"):
        files = avc_hardware.export_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    paths = [Path(args.c) / name for name in files]
    for path in paths:
        if path.is_file() and not args.force and b"; do not edit." not in path.read_bytes().partition(b"\n")[0]:
            message = "is there already and no export; allowed: another folder, another --name, or --force"
            raise avc.InputError.of(f"{str(path)!r} {message}", key="c")
    with output_folder(args.c, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    console.written += map(str, paths)
    exported = rows.deploy.Exported(args.precision, tuple(map(str, paths)), judged.unsafe, judged.deployment)
    return rows.deploy.export(exported, coupling, args.gains)


@cli.verb(
    cli.COUPLING,
    *cli.PORT,
    cli.argument("--device-id", metavar="ID", text="number of the device's chip; another one is refused"),
    cli.BESIDE,
    cli.UNSAFE,
)
def run_push(args: argparse.Namespace, console: Console) -> Answer:
    """Send a coupling to a device: its table, wall and limits, swapped at once and read back.

    What is not deployable is refused with exit code 1; --unsafe overrides. The emulated device is a fresh one for every
    command, of the coupling's own sample time, encoder and force limit, with a hand on it.
    """
    from avc_casadi.cli import ends

    coupling = cli.read_wall(args.gains, args.problem)
    deployment = ends.deployment(coupling, unsafe=args.unsafe)
    emulated = args.port == avc_hardware.EMULATOR
    wait = "the device is in contact: release it, out of the wall; the new coupling takes over there"
    with console.step(f"push to {args.port}"):
        done = avc_hardware.push(
            coupling,
            args.port,
            baud=args.baud,
            unsafe=args.unsafe,
            device_id=args.device_id,
            on_wait=lambda: None if emulated else console.say(wait),  # the emulated device is released by itself
        )
    loop: ReportedTrial | NotTried | None = None
    if emulated:
        with console.step("firmware and plant in the loop"):
            loop = in_the_loop(coupling)
    return rows.deploy.push(done, deployment, loop, coupling, args.gains)


def in_the_loop(coupling: Coupling) -> ReportedTrial | NotTried:
    """Try a pushed coupling with a hand on the emulated device; or say why that cannot be tried."""
    try:
        return avc_hardware.tried_in_the_loop(coupling)
    except avc.UnsupportedError as error:
        return rows.deploy.NotTried(str(error))


@cli.verb(
    cli.argument("subject", metavar="SUBJECT", text="device or problem; or a coupling file, for its runtime"),
    cli.argument("--board", required=True, text="a board (a wrong name lists them), or your own's folder (PORTING.md)"),
    cli.argument("--out", required=True, metavar="DIR", text="folder for the .elf, .bin and .hex file"),
    cli.argument("--baud", type=cli.positive_int, text="rate of its serial port; default 115200; push needs the same"),
)
def run_firmware(args: argparse.Namespace, console: Console) -> Answer:
    """Build firmware for a device, its sample time, encoder and force limit built in.

    No gains are in it: they are pushed (avc push). It needs the board's compiler: arm-none-eabi-gcc, or your folder's.
    """
    from avc_casadi.files.problem_file import is_device

    subject: Coupling | avc.Problem | DeviceModel
    if cli.is_coupling(args.subject):
        subject = cli.read_wall(args.subject)
    else:
        subject = avc.load_device(args.subject).device if is_device(args.subject) else avc.load_problem(args.subject)
    with output_folder(args.out, "--out") as folder, console.step(f"firmware for {args.board}"):
        built = avc_hardware.build_firmware(subject, args.board, folder, baud=args.baud)
    problem = getattr(subject, "problem", subject)
    device, notes = getattr(problem, "device", problem), []
    if getattr(problem, "detent", None) is not None:
        notes.append("[detent] has no place in what is pushed: export it (avc export)")
    of_board = {"max_force_n": built.limits.max_force_n, "encoder_resolution_m": built.limits.metres_per_count}
    for key, value in of_board.items():
        if not getattr(device, key):
            advice = f"{Value.of(key, value).text(device.units)} is the board's own; give the device's"
            notes.append(f"the file has no device.{device.units.key(key)}: {advice}")
    baud = args.baud or cli.DEFAULT_BAUD
    console.written += [str(Path(args.out) / path.name) for path in built.files]
    result = rows.deploy.Firmware(
        board=built.board,
        build=built.build,
        address=built.address,
        commands=built.commands,
        baud=baud,
        size_bytes=built.size,
        notes=tuple(notes),
        files=tuple(console.written),
        limits=built.limits,
        figures=built.figures,
    )
    baud_option = "" if baud == cli.DEFAULT_BAUD else f" --baud {baud}"
    gains = f"pushed: avc push{baud_option}; estimator {built.figures.estimator}"
    return rows.deploy.firmware(result, built.title, subject.units, gains)


_STREAM_SHOWN_EVERY_S = 0.5
"""Time between two samples that are shown, s."""


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
    from avc_casadi.cli import ends
    from avc_casadi.coupling import require_coupling

    if cli.is_coupling(args.subject):
        coupling = cli.read_wall(args.subject)
    else:
        coupling = cli.recommended_coupling(avc.load_problem(args.subject), console)
        require_coupling(coupling)
    deployment = ends.deployment(coupling, unsafe=args.unsafe)
    units = coupling.problem.units
    shown_s = -1.0
    sent = 0

    def show(sample: avc_hardware.StreamSample) -> None:
        nonlocal shown_s, sent
        sent += 1
        if sample.time_s >= shown_s + _STREAM_SHOWN_EVERY_S:
            shown_s = sample.time_s
            console.say(f"{sample.time_s:7.2f} s  {text_of(commas(_applied(sample)), units)}")

    try:
        result = avc_hardware.stream(
            coupling,
            args.port,
            rate_hz=args.rate_hz,
            seconds=args.seconds,
            baud=args.baud,
            on_sample=show,
            unsafe=args.unsafe,
        )
    except KeyboardInterrupt:
        if not sent:
            raise
        take_interrupt()
        streamed = {"problem": coupling.problem.name, "coupling": coupling.id, "sent": sent}
        data: dict[str, Any] = avc.fault_document(avc.InputError.of("interrupted")) | streamed
        after = f"{args.port} goes back to its table within {avc_hardware.HOLD_PERIODS / args.rate_hz:.2g} s"
        return Answer("stream", data, (f"interrupted after {sent} messages; {after}",), code=EXIT_CODE)
    return rows.deploy.stream(result, deployment, coupling)


_MONITOR_SHOWN_EVERY_S = 0.2
"""Time between two records that are shown as text, s."""

_MONITOR_JSON_S = 5.0
"""Time after which --json ends by itself, s."""

_RATE = "records a second; default 5; 115200 baud carry about 250. At most 5 a second are shown as text"


@cli.verb(
    *cli.PORT,
    cli.argument("--rate-hz", type=cli.positive, default=5.0, metavar="HZ", text=_RATE),
    cli.argument("--seconds", type=cli.positive, metavar="S", text="default until Ctrl-C, with --json 5 seconds"),
    cli.argument(
        "--heartbeat",
        dest="heartbeat_s",
        type=cli.positive,
        nargs="?",
        const=0.5,
        metavar="S",
        text="keep the device's heartbeat: the force falls when none comes for S seconds; default 0.5",
    ),
    cli.output("--out", "log every record as it comes: .csv", ".csv"),
    cli.MOTION,
)
def run_monitor(args: argparse.Namespace, console: Console) -> Answer:
    """Watch a device: records of its own ticks, as text or log; and keep its heartbeat.

    With --heartbeat the device lives as long as this command: when that ends or loses the line, the force falls to 0
    within 0.1 s, and comes back out of contact with the next heartbeat, or after avc device --clear.
    """
    units = units_for(args.motion)
    data = _nothing_watched(args.port, args.out)
    code, shown_s = 0, -1.0
    log: avc_hardware.TelemetryLog | None = None

    def begun(device: avc_hardware.Device) -> None:
        nonlocal log
        if args.out is not None and log is None:  # not before there is something to log
            log = stack.enter_context(avc_hardware.TelemetryLog(args.out, args.motion))
        console.say(text_of(_headline(device), units))

    def ended(status: avc_hardware.DeviceStatus) -> None:
        data["ended"] = {"mode": status.mode, "force_n": status.force_n, "faults": status.faults}

    with ExitStack() as stack:
        watched = avc_hardware.monitor(
            args.port,
            rate_hz=args.rate_hz,
            seconds=args.seconds or (_MONITOR_JSON_S if console.as_json else None),
            heartbeat_s=args.heartbeat_s,
            baud=args.baud,
            on_device=begun,
            on_end=ended,
        )
        stack.enter_context(closing(watched))
        try:
            for sample in watched:
                words = avc_hardware.DeviceFault(sample.faults).word
                with DeferredInterrupt():  # all or none
                    data["records"] += 1
                    data["lost"] += sample.lost
                    if log is not None:
                        log.write(sample)
                    if console.as_json:
                        fault_words = words.split(", ") if words else []
                        data["samples"].append(plain(vars(sample) | {"fault_words": fault_words}))
                if not 0 <= sample.time_s - shown_s < _MONITOR_SHOWN_EVERY_S - 1e-6:
                    shown_s = sample.time_s
                    console.say(text_of(_state(sample, words), units))
        except KeyboardInterrupt:
            if not data["records"]:
                raise
            take_interrupt()
            code, data = EXIT_CODE, avc.fault_document(avc.InputError.of("interrupted")) | data
    return Answer("monitor", data, rows=tuple(_monitor_rows(data, args.heartbeat_s)), units=units, code=code)


def _nothing_watched(port: str, out: Path | None) -> dict[str, Any]:
    """Return the JSON values of a monitor before its first record."""
    return {
        "port": port,
        "note": avc_hardware.EMULATOR_IS_FRESH if port == avc_hardware.EMULATOR else None,
        "samples": [],
        "records": 0,
        "lost": 0,
        "ended": None,
        "out": out and str(out),
    }


def _headline(device: avc_hardware.Device) -> tuple[Part, ...]:
    """Return what is said of a device when its records begin."""
    number = f"{device.unique_id} " if device.unique_id else ""
    tick, largest = Value(device.sample_time_s, "time"), Value(device.max_force_n, "force")
    running = f", coupling {device.coupling_id}" if device.coupling_id else ", no coupling"
    return (f"device {number}with firmware {device.build}: a tick every", tick, ", at most", largest, running)


def _monitor_rows(data: dict[str, Any], heartbeat_s: float | None) -> Iterator[Row]:
    """Yield the rows of what was watched: records that are lost, the log, and how the heartbeat ended."""
    lost, records, end = data["lost"], data["records"], data["ended"]
    if lost:
        text = f"{lost} of {records + lost} records: the line is too slow or lossy; "
        text += "give less --rate-hz, or a faster --baud with firmware built for it"
        yield row("Lost", text, mark=Mark.CAUTION)
    if data["out"]:
        yield row("Written", f"{data['out']}, {records} records")
    if heartbeat_s and end is not None:
        until = f"; mode {end['mode']} until the next heartbeat, out of contact"
        yield row("Heartbeat", "ended, at", Value(end["force_n"], "force"), until)
    elif heartbeat_s:
        yield row("Heartbeat", "ended, and the device did not answer: it falls to 0 by itself")


def _applied(sample: avc_hardware.StreamSample | avc_hardware.TelemetrySample) -> list[tuple[Part, ...]]:
    keys = {"f": "frequency_hz", "b": "damping_ns_per_m", "k": "stiffness_n_per_m", "applied": "force_n"}
    return [(name, Value.of(key, getattr(sample, key))) for name, key in keys.items()]


def _state(sample: avc_hardware.TelemetrySample, faults: str) -> tuple[Part, ...]:
    mode = sample.mode if sample.has_table or faults else "idle"
    return commas(
        [
            f"tick {sample.ticks}",
            *_applied(sample),
            ("at", Value(sample.position_m, "length")),
            Value(sample.energy_j, "energy"),
            f"{mode} ({faults})" if faults else mode,
            "streaming" if sample.streaming else None,
            f"coupling {sample.coupling_id}" if sample.has_table else "no coupling",
        ]
    )


@cli.verb(
    *cli.PORT,
    cli.flag("--clear", "show the faults and clear them, that of a silent host too; 1 if one stays"),
    *cli.turning("force_n", "N", "limit of the force; a higher one holds from the next time out of contact"),
    *cli.turning("speed_m_per_s", "V", "a fault is latched beyond it"),
    cli.argument("--energy-j", type=cli.positive, metavar="E", text="given out in a second beyond what came in"),
    cli.MOTION,
)
def run_device(args: argparse.Namespace, console: Console) -> Answer:
    """Show or lower the limits of a device, or clear its faults.

    Limits are never above those built into the firmware, and hold until the device starts anew.
    """
    units = units_for(args.motion)
    wanted = cli.of_motion(args, units, "force_n", "speed_m_per_s", "energy_j")
    if not args.clear:
        with console.step(f"limits of {args.port}"):
            limits = avc_hardware.set_limits(args.port, **wanted, baud=args.baud)
        return rows.deploy.limits(limits, units)
    cli.refuse(args, *map(units.key, wanted), why="is a limit, and --clear sets none; leave it out")
    with console.step(f"clear {args.port}"):
        cleared = avc_hardware.clear_faults(args.port, baud=args.baud)
    result = rows.deploy.ClearedFaults(
        port=cleared.port,
        were=_words(cleared.were),
        first=_words(cleared.first),
        left=_words(cleared.left),
        tick=cleared.tick,
        mode=cleared.status.mode,
    )
    complaint = f"avc: {cleared.port}: still there: {cleared.left.word}" if cleared.left else ""
    return replace(rows.deploy.faults(result, cleared.were.advice), complaint=complaint)


def _words(faults: avc_hardware.DeviceFault) -> tuple[str, ...]:
    """Return faults in words."""
    return tuple(fault.word for fault in faults)
