"""Verbs that deploy a coupling and operate a device: export, push, firmware, stream, monitor, device."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.files import write_file
from avc_casadi._util.interrupt import DeferredInterrupt, exit_code, take_interrupt
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import units_for
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder
from avc_casadi.files.kinds import FileKind
from avc_casadi.present import rows
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, commas, row, text_of

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device as DeviceModel
    from avc_casadi.present.rows.deploy import NotTried
    from avc_casadi.present.rows.reports import ReportedTrial

_PARAMETERS = "print the settings of a physics engine instead: mujoco, unity, chai3d, sofa and others"
_PRECISION = "set the type of numbers in C: single (float, default) or double"
_NAME = "begin the names of files and C functions with NAME (default: avc_coupling)"
_BOARD = "choose a built-in board (a wrong name lists them), or the folder of your own board (PORTING.md)"
_FIRMWARE_BAUD = "set the baud rate of the board's serial port (default: 115200); use the same rate in push"
_STREAM_RATE = "set the messages per second, 1 to 100 (default: 50)"
_ENERGY = "limit the energy in J that the wall may give out within 1 s (more energy is a fault)"


@cli.verb(
    cli.argument("gains", metavar="COUPLING", text="coupling file, gain file with --problem, or problem with [law]"),
    cli.argument("--c", metavar="DIR", text="write avc_coupling.h and avc_coupling.c to this folder"),
    cli.argument("--parameters", metavar="ENGINE", text=_PARAMETERS),
    cli.argument("--precision", choices=("single", "double"), default="single", metavar="TYPE", text=_PRECISION),
    cli.argument("--name", default="avc_coupling", text=_NAME),
    cli.flag("--force", "overwrite files that avc did not export"),
    cli.BESIDE,
    cli.UNSAFE,
)
def run_export(args: argparse.Namespace, console: Console) -> Answer:
    """Export a coupling, or your own law, as C code for your own firmware.

    The code is valid C99 and C++11, and runs at the coupling's sample time.
    For a [simulation] or a [follower] the code covers the device and its partner.
    A table [law] of a problem is exported with all its pieces.
    For an admittance device the function takes position and force, and returns the velocity to command.
    A coupling or law that is not deployable is refused (exit code 1); --unsafe overrides the refusal.
    """
    from avc_casadi.cli import ends
    from avc_casadi.cli.law import states_law
    from avc_casadi.files.admittance_file import is_admittance
    from avc_casadi.model.ends import Simulation
    from avc_hardware.codegen.pair_export import pair_verdict

    if args.c is None and args.parameters is None:
        raise avc.InputError.of("is missing; give either --c DIR or --parameters ENGINE", key="c")
    if args.c is not None:
        cli.refuse(args, "parameters", why="excludes --c: it writes no C; leave one of the two options out")
    if is_admittance(args.gains):
        return _admittance_exported(args, console)
    if not cli.is_coupling(args.gains) and states_law(args.gains, args.problem):
        return _law_exported(args, console)
    coupling = avc.read_coupling(args.gains, args.problem)
    if not isinstance(coupling.end, Simulation):
        why = f"applies to a [simulation], but this coupling is to a {coupling.end.kind}; use --c DIR"
        cli.refuse(args, "parameters", why=why)
    if args.parameters is not None:
        sentence, stable = pair_verdict(coupling, unsafe=args.unsafe)
        return rows.engines.parameters(coupling, args.parameters, args.gains, "" if stable else sentence)
    judged = ends.judged(coupling.end, coupling, unsafe=args.unsafe)
    paths = _export(coupling, args, console)
    exported = rows.deploy.Exported(args.precision, paths, judged.unsafe, judged.judged_for, judged.deployment)
    return rows.deploy.export(exported, coupling, args.gains)


def _law_exported(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `export` of the law of a problem."""
    from avc_hardware.codegen.c_subject import law_subject

    cli.refuse(
        args, "parameters", why="applies to a coupling to a [simulation], but P has a table [law]; export P by --c DIR"
    )
    problem = avc.load_problem(args.gains)
    paths = _export(problem, args, console)
    subject = law_subject(problem, unsafe=args.unsafe)
    exported = rows.deploy.ExportedLaw(
        args.precision, paths, subject.id, subject.passed, subject.sound, subject.sentence, subject.judged_for
    )
    return rows.deploy.export_law(exported, problem, args.gains)


def _export(exported: Coupling | avc.Problem, args: argparse.Namespace, console: Console) -> tuple[str, ...]:
    """Write the C of a coupling or of a law, and return the paths of its files."""
    with console.step("C"):
        files = avc_hardware.export_c(exported, precision=args.precision, name=args.name, unsafe=args.unsafe)
    return _write_c(files, args, console)


def _admittance_exported(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `export` of the law of an admittance device."""
    cli.refuse(args, "parameters", "problem", why="applies to couplings, but P is an admittance device; leave it out")
    problem = avc.load_admittance(args.gains)
    with console.step("C"):
        files = avc_hardware.admittance_files(problem, precision=args.precision, name=args.name, unsafe=args.unsafe)
    return rows.admittance.exported(problem, args.precision, _write_c(files, args, console), args.gains)


def _write_c(files: Mapping[str, str], args: argparse.Namespace, console: Console) -> tuple[str, ...]:
    """Write files of C, and return their paths."""
    paths = [Path(args.c) / name for name in files]
    for path in paths:
        if path.is_file() and not args.force and b"; do not edit." not in path.read_bytes().partition(b"\n")[0]:
            message = "exists and is not an export of avc; choose another folder or --name, or use --force"
            raise avc.InputError.of(f"{str(path)!r} {message}", key="c")
    with output_folder(args.c, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    written = tuple(map(str, paths))
    console.written += written
    return written


@cli.verb(
    cli.COUPLING,
    *cli.PORT,
    cli.argument("--device-id", metavar="ID", text="push only if the chip of the device has this serial number"),
    cli.BESIDE,
    cli.UNSAFE,
)
def run_push(args: argparse.Namespace, console: Console) -> Answer:
    """Send a coupling to a device that runs the avc firmware, and read it back.

    The device exchanges gains, wall and limits within one sample.
    A coupling that is not deployable is refused with exit code 1; --unsafe overrides the refusal.
    `--port emulator` starts a new emulated device, which has the coupling's sample time, encoder
    and force limit. A simulated hand then presses the wall.
    """
    from avc_casadi.cli import ends

    coupling = cli.read_wall(args.gains, args.problem)
    deployment = ends.deployment(coupling, unsafe=args.unsafe)
    emulated = args.port == avc_hardware.EMULATOR
    wait = "the device is in contact: move it out of the wall and release it, so that the new coupling takes over"
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
    cli.argument(
        "subject", metavar="SUBJECT", text="device or problem file, or coupling file (with its estimator and guard)"
    ),
    cli.argument("--board", required=True, metavar="BOARD", text=_BOARD),
    cli.argument("--out", required=True, metavar="DIR", text="write the .elf, .bin and .hex files to this folder"),
    cli.numeric("--baud", _FIRMWARE_BAUD, metavar="N"),
)
def run_firmware(args: argparse.Namespace, console: Console) -> Answer:
    """Build firmware with the sample time, encoder and force limit of a device.

    The firmware contains no gains: send them with `avc push`.
    The build needs the compiler of the board: arm-none-eabi-gcc, or as your board folder states.
    """
    from avc_casadi.files.problem_file import is_device, require_device

    subject: Coupling | avc.Problem | DeviceModel
    if cli.is_coupling(args.subject):
        subject = cli.read_wall(args.subject)
    else:
        subject = avc.load_device(args.subject).device if is_device(args.subject) else require_device(args.subject)
    with output_folder(args.out, "--out") as folder, console.step(f"firmware for {args.board}"):
        built = avc_hardware.build_firmware(subject, args.board, folder, baud=args.baud)
    problem = getattr(subject, "problem", subject)
    device, notes = getattr(problem, "device", problem), []
    if getattr(problem, "detent", None) is not None:
        notes.append("avc push does not support [detent]; use avc export")
    of_board = {"max_force_n": built.limits.max_force_n, "encoder_resolution_m": built.limits.metres_per_count}
    for key, value in of_board.items():
        if not getattr(device, key):
            taken = f"the board's value {Value.of(key, value).text(device.units)} is used; state the device's"
            notes.append(f"device.{device.units.key(key)} is missing: {taken}")
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
    gains = f"none; send them with avc push{baud_option}; estimator {built.figures.estimator}"
    return rows.deploy.firmware(result, built.title, subject.units, gains)


_STREAM_SHOWN_EVERY_S = 0.5
"""Time between two samples that are shown, s."""


@cli.verb(
    cli.argument("subject", metavar="COUPLING", text="coupling file; or a problem, whose coupling is found first"),
    *cli.PORT,
    cli.numeric("--rate-hz", _STREAM_RATE, default=50.0, metavar="HZ"),
    cli.numeric("--seconds", "set the duration in s (default: 5)", default=5.0, metavar="S"),
    cli.UNSAFE,
)
def run_stream(args: argparse.Namespace, console: Console) -> Answer:
    """Stream gains to a device, for the frequency of motion that the device estimates.

    The table of gains is pushed first: the device returns to this table if messages stop.
    Exit code 1 if the device does not run the table at the end.
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
        after = f"{args.port} returns to its table within {avc_hardware.HOLD_PERIODS / args.rate_hz:.2g} s"
        return Answer("stream", data, (f"interrupted after {sent} messages; {after}",), code=exit_code())
    return rows.deploy.stream(result, deployment, coupling)


_MONITOR_SHOWN_EVERY_S = 0.2
"""Time between two records that are shown as text, s."""

_MONITOR_JSON_S = 5.0
"""Time after which --json ends by itself, s."""

_RATE = (
    "set the records per second that the log gets (default: 5; 115200 baud allow 250); the screen shows 5 per second"
)
_SECONDS = "set the duration in s (default: until Ctrl-C; with --json 5)"
_HEARTBEAT = "send a heartbeat; the force ends if none arrives for S seconds (default: 0.5)"


@cli.verb(
    *cli.PORT,
    cli.numeric("--rate-hz", _RATE, default=5.0, metavar="HZ"),
    cli.numeric("--seconds", _SECONDS, metavar="S"),
    cli.numeric("--heartbeat", _HEARTBEAT, dest="heartbeat_s", nargs="?", const=0.5, metavar="S"),
    cli.output("--out", "log every record to this .csv file", {".csv": (FileKind.LOG,)}),
    cli.MOTION,
)
def run_monitor(args: argparse.Namespace, console: Console) -> Answer:
    """Monitor a device: print and log its state, and send its heartbeat.

    With --heartbeat the device exerts force only while this command runs.
    When monitor ends, the force falls to 0 within 0.1 s; if the connection breaks, after S seconds.
    Out of contact, the force returns with the next heartbeat or after `avc device --clear`.
    """
    units = units_for(args.motion)
    watched = _Watched(args.port, args.out)
    interrupted = False
    shown_s = -1.0
    log: avc_hardware.TelemetryLog | None = None

    def begun(device: avc_hardware.Device) -> None:
        nonlocal log
        if args.out is not None and log is None:  # not before there is something to log
            log = stack.enter_context(avc_hardware.TelemetryLog(args.out, args.motion))
        console.say(text_of(_headline(device), units))

    with ExitStack() as stack:
        samples = avc_hardware.monitor(
            args.port,
            rate_hz=args.rate_hz,
            seconds=args.seconds or (_MONITOR_JSON_S if console.as_json else None),
            heartbeat_s=args.heartbeat_s,
            baud=args.baud,
            on_device=begun,
            on_end=watched.end_with,
        )
        stack.enter_context(closing(samples))
        try:
            for sample in samples:
                words = avc_hardware.DeviceFault(sample.faults).word
                with DeferredInterrupt():  # all or none
                    watched.add(sample, words, keep=console.as_json)
                    if log is not None:
                        log.write(sample)
                if not 0 <= sample.time_s - shown_s < _MONITOR_SHOWN_EVERY_S - 1e-6:
                    shown_s = sample.time_s
                    console.say(text_of(_state(sample, words), units))
        except KeyboardInterrupt:
            if not watched.records:
                raise
            take_interrupt()
            interrupted = True
    faults = avc.fault_document(avc.InputError.of("interrupted")) if interrupted else {}
    rows = tuple(_monitor_rows(watched, args.heartbeat_s))
    return Answer(
        "monitor", faults | watched.document(), rows=rows, units=units, code=exit_code() if interrupted else 0
    )


@dataclass
class _Watched:
    """What a monitor has seen so far.

    Attributes:
        port: of the device.
        out: file of the log; None without one.
        samples: JSON values of the records, where they are kept.
        records: number of records.
        lost: number of records that did not arrive.
        ended: state of the device when the monitor ended; None where it did not answer.
    """

    port: str
    out: Path | None
    samples: list[dict[str, Any]] = field(default_factory=list)
    records: int = 0
    lost: int = 0
    ended: avc_hardware.DeviceStatus | None = None

    def add(self, sample: avc_hardware.TelemetrySample, fault_words: str, *, keep: bool) -> None:
        """Count a record, and keep it on request."""
        self.records += 1
        self.lost += sample.lost
        if keep:
            words = fault_words.split(", ") if fault_words else []
            self.samples.append(plain(vars(sample) | {"fault_words": words}))

    def end_with(self, status: avc_hardware.DeviceStatus) -> None:
        """Keep the state of the device at the end."""
        self.ended = status

    def document(self) -> dict[str, Any]:
        """Return the JSON values."""
        end = self.ended
        return {
            "port": self.port,
            "note": avc_hardware.EMULATOR_IS_FRESH if self.port == avc_hardware.EMULATOR else None,
            "samples": self.samples,
            "records": self.records,
            "lost": self.lost,
            "ended": None if end is None else {"mode": end.mode, "force_n": end.force_n, "faults": end.faults},
            "out": self.out and str(self.out),
        }


def _headline(device: avc_hardware.Device) -> tuple[Part, ...]:
    """Return what is said of a device when its records begin."""
    number = f"{device.unique_id} " if device.unique_id else ""
    tick, largest = Value(device.sample_time_s, "time"), Value(device.max_force_n, "force")
    running = f", coupling {device.coupling_id}" if device.coupling_id else ", no coupling"
    return (f"device {number}with firmware {device.build}: a tick every", tick, ", at most", largest, running)


def _monitor_rows(watched: _Watched, heartbeat_s: float | None) -> Iterator[Row]:
    """Yield the rows of what was watched: records that are lost, the log, and how the heartbeat ended."""
    records = watched.records
    end = watched.ended
    if watched.lost:
        text = f"{watched.lost} of {records + watched.lost} records: the line is too slow or loses data; "
        text += "lower --rate-hz, or build the firmware for a higher --baud"
        yield row("Lost", text, mark=Mark.CAUTION)
    if watched.out:
        yield row("Written", f"{watched.out}, {records} records")
    if heartbeat_s and end is not None:
        until = f"; mode {end.mode} until the next heartbeat out of contact"
        yield row("Heartbeat", "stopped at a force of", Value(end.force_n, "force"), until)
    elif heartbeat_s:
        yield row("Heartbeat", "stopped; the device did not answer, and reduces its force to 0 by itself")


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
    cli.flag("--clear", "print the stored faults and clear them; exit code 1 if a fault remains"),
    *cli.turning("force_n", "N", "limit the force in N (a higher limit waits until the device is out of contact)"),
    *cli.turning("speed_m_per_s", "V", "limit the speed in m/s (a higher speed is a fault)"),
    cli.numeric("--energy-j", _ENERGY, metavar="E"),
    cli.MOTION,
)
def run_device(args: argparse.Namespace, console: Console) -> Answer:
    """Show or lower the limits of a device, or clear its faults.

    The limits of force, speed and energy cannot exceed those built into the firmware.
    New limits apply until the device restarts.
    """
    units = units_for(args.motion)
    wanted = cli.of_motion(args, units, "force_n", "speed_m_per_s", "energy_j")
    if not args.clear:
        with console.step(f"limits of {args.port}"):
            limits = avc_hardware.set_limits(args.port, **wanted, baud=args.baud)
        return rows.deploy.limits(limits, units)
    cli.refuse(args, *map(units.key, wanted), why="does not apply with --clear; leave it out")
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
    complaint = f"avc: {cleared.port}: fault not cleared: {cleared.left.word}" if cleared.left else ""
    return replace(rows.deploy.faults(result, cleared.were.advice), complaint=complaint)


def _words(faults: avc_hardware.DeviceFault) -> tuple[str, ...]:
    """Return faults in words."""
    return tuple(fault.word for fault in faults)
