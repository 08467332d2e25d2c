"""Verbs that deploy a coupling: export, push, stream, monitor, device, firmware."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.interrupt import EXIT_CODE, HeldInterrupt, take_interrupt
from avc_casadi._util.text import number
from avc_casadi.cli.arguments import (
    add_motion,
    add_port,
    add_problem_of_gains,
    add_unsafe,
    add_verbose,
    add_worded,
    check_worded,
    faults_of,
    is_coupling,
    is_device,
    positive,
    positive_int,
    read_pair,
    read_subject,
    unsafe_note,
)
from avc_casadi.cli.console import Console, output_file, output_folder

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device as DeviceModel
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.row import Answer, Part
    from avc_hardware import BoardLimits, Device, DeviceStatus, StreamSample, TelemetryLog, TelemetrySample

# Names of `avc_casadi.present.engines`.
ENGINES = ("mujoco", "chai3d", "unity", "sofa", "openhaptics", "imstk", "ros2", "pybullet")
IN_CONTACT = "the device is in contact: release it, out of the wall; the new coupling takes over there"
_SECONDS_WITH_JSON = 5.0
_HEARTBEAT_S = 0.5
# Rate of readable lines of text.
_LINES_HZ = 5.0
_OF_LIMITS = {
    "force_n": "--force-n",
    "speed_m_per_s": "--speed-m-per-s",
    "energy_j": "--energy-j",
    "built_in": "--built-in",
}
_USUAL_BAUD = 115200


def add_export(parser: argparse.ArgumentParser) -> None:
    """Write a coupling as C for firmware of your own: avc_coupling.h and avc_coupling.c.

    The whole coupling at its own sample time: wall, look-up, estimator, adaptation, observer, guard and force limit, in
    C99 that is also C++11 and later. A coupling that is not deployable is refused with exit code 1; --unsafe overrides.
    Of a coupling to a [simulation] both ends, the device's and the engine's; or its numbers in the parameters of an
    engine (--parameters). Of a coupling to a [follower] one source for both ends.
    """
    parser.add_argument("gains", metavar="COUPLING", help="coupling file; or a gain file with --problem")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--c", metavar="DIR", help="folder for avc_coupling.h and avc_coupling.c")
    what.add_argument(
        "--parameters",
        choices=ENGINES,
        metavar="ENGINE",
        help=f"numbers of a coupling to a [simulation] in the parameters and units of an engine: {', '.join(ENGINES)}",
    )
    parser.add_argument(
        "--precision",
        choices=("single", "double"),
        default="single",
        help="single (default): float, as in the packaged firmware; double: where a processor has it in hardware",
    )
    parser.add_argument(
        "--name",
        default="avc_coupling",
        help="what files, functions, types and macros begin with (default: avc_coupling); couplings of two names link "
        "into one program",
    )
    add_problem_of_gains(parser)
    add_unsafe(parser)
    add_verbose(parser)


def run_export(args: argparse.Namespace, console: Console) -> Answer:
    """Write both files, or print the parameters."""
    found = read_pair(args.gains) or read_subject("export", args.gains, args.problem)
    if found.end == "wall":
        if args.parameters is not None:
            raise avc.InputError.of(
                "is of a coupling to a [simulation], and this file holds none; for C: --c DIR",
                file=args.gains,
                key="--parameters",
            )
        return _export_wall(found, args, console)
    simulated = found.end == "simulation"
    alien = [one for one in ("problem", *(() if simulated else ("parameters",))) if getattr(args, one)]
    if alien:
        raise avc.InputError.of("does not apply to this coupling; for C: --c DIR", file=args.gains, key=f"--{alien[0]}")
    return _export_pair(found, args, console)


def _export_wall(coupling: Coupling, args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.rows import holes
    from avc_casadi.present.rows.deploy import export
    from avc_hardware import export_c

    verdict = require_deployable(coupling, unsafe=args.unsafe)
    with faults_of(args.gains, args), console.step("C"):
        files = export_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    data: dict[str, Any] = {
        "coupling": coupling.id,
        "files": _write(args.c, files),
        "rows": len(coupling.table),
        "sample_time_s": coupling.sample_time_s,
        "precision": args.precision,
        "deployable": verdict.document(),
        "unsafe": unsafe_note(verdict),
        "lacks": list(coupling.lacks),
        "holes": holes(coupling.schedule) or None,
    }
    return export(data, coupling, args.gains)


def _write(to: str, files: dict[str, str]) -> list[str]:
    """Write files into a folder; return their paths."""
    from avc_casadi._util.files import write_file

    with output_folder(to, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    return [str(Path(to) / name) for name in files]


def _export_pair(coupling: Any, args: argparse.Namespace, console: Console) -> Answer:
    """Write both ends of a coupling to a simulation or a follower, or return its parameters for an engine."""
    from avc_casadi.loops.engine import ToolLoops
    from avc_casadi.loops.follower import FollowerLoops
    from avc_casadi.present.engines import parameters
    from avc_casadi.present.rows.deploy import pair_export
    from avc_hardware import export_teleoperator_c, export_tool_c
    from avc_hardware.codegen.other_end_export import verdict

    problem, gains, tool = coupling.problem, coupling.gains, coupling.problem.simulation
    loops: Any = FollowerLoops(problem) if tool is None else ToolLoops(problem)
    if args.parameters is not None:
        judged = verdict(problem, loops, gains, unsafe=args.unsafe)
        return parameters(coupling, args.parameters, args.gains, "" if loops.stable(gains) else judged)
    export = export_teleoperator_c if tool is None else export_tool_c
    with faults_of(args.gains, args), console.step("C"):
        files = export(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    stable = loops.stable_over_ranges(gains)
    data = {
        "coupling": coupling.id,
        "files": _write(args.c, files),
        "sample_time_s": problem.device.sample_time_s,
        "precision": args.precision,
        "unsafe": "" if stable else "UNSAFE, went on by request: a loop is linearly unstable",
    }
    if tool is None:
        data["follower_sample_time_s"] = coupling.follower.sample_time_s
    else:
        data |= {"step_s": list(tool.step_s), "exchange": tool.exchange}
    return pair_export(data, coupling, args.gains)


def add_push(parser: argparse.ArgumentParser) -> None:
    """Send a coupling to a device: its table, wall and limits, swapped at once and read back.

    A coupling that is not deployable (linearly stable with every hand of [hands] and released) is refused with exit
    code 1; --unsafe overrides. The emulated device is a fresh one for every command; it runs at the coupling's own
    sample time, encoder and force limit, with a hand on it.
    """
    parser.add_argument("gains", metavar="COUPLING", help="coupling file; or a gain file with --problem")
    add_port(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")
    parser.add_argument("--device-id", metavar="ID", help="number of the device's chip; another one is refused")
    add_problem_of_gains(parser)
    add_unsafe(parser)


def run_push(args: argparse.Namespace, console: Console) -> Answer:
    """Push; a refusal is raised."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.rows import deploy
    from avc_hardware import EMULATOR, push

    coupling = read_subject("push", args.gains, args.problem)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    with faults_of(args.gains, args), console.step(f"push to {args.port}"):
        document = plain(
            {"coupling": coupling.id, "deployable": verdict.document()}
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
    return replace(deploy.push(document, coupling, args.gains), code=0 if equal else 1, complaint=complaint)


def widest_hole(coupling: Coupling) -> list[float] | None:
    """Return the ends, in Hz, of the widest run of rows without gains between rows with gains; None without one."""
    from itertools import pairwise

    gains = coupling.schedule
    kept = [row for row in range(gains.rows) if gains.usable[row]]
    holes = [(gains.frequency_hz[a], gains.frequency_hz[b]) for a, b in pairwise(kept) if b > a + 1]
    return [float(end) for end in max(holes, key=lambda ends: ends[1] - ends[0])] if holes else None


def push_or_say(coupling: Coupling | None, *, unsafe: bool) -> dict[str, Any]:
    """Push to the emulated device and try it there; a failed push does not discard the other results.

    Returns:
        The `push` document with ``unsafe`` (empty where it is deployable) and ``in_the_loop``; or ``{"skipped": why}``,
        or ``{"refused": why}``, with ``"deployable": False`` where that is the reason.
        ``{"skipped": why}``, or ``{"refused": why}``, with ``"deployable": False`` where that is why.
    """
    from avc_casadi.claims.deployable import require_deployable
    from avc_hardware import push

    if coupling is None:
        return {"skipped": "no coupling is deployable"}
    try:
        note = unsafe_note(require_deployable(coupling, unsafe=unsafe))
        pushed = push(coupling, "emulator", unsafe=unsafe).document()
        return pushed | {"unsafe": note, "in_the_loop": tried_or_say(coupling)}
    except (avc.MissingExtraError, avc.UnsupportedError) as error:
        return {"skipped": str(error)}
    except avc.NotDeployableError as error:
        return {"refused": str(error), "deployable": False}
    except avc.LinkError as error:
        return {"refused": str(error)}


def tried_or_say(coupling: Coupling) -> dict[str, Any]:
    """Try a pushed coupling with a hand on the emulated device; an unsupported trial does not discard the push.

    Returns:
        The figures of the trial; or ``{"skipped": why}``.
    """
    from avc_casadi._util.json_values import plain
    from avc_hardware import tried_in_the_loop

    try:
        found: dict[str, Any] = plain(tried_in_the_loop(coupling).document())
    except avc.UnsupportedError as error:
        return {"skipped": str(error)}
    return found


def add_stream(parser: argparse.ArgumentParser) -> None:
    """Stream a coupling's gains live: read the device's frequency estimate, send the gains for it."""
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


def run_stream(args: argparse.Namespace, console: Console) -> Answer:
    """Push the table as the fallback, then stream; 1 if the device does not end on this coupling's table."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.row import Value, text_of
    from avc_casadi.present.rows import deploy
    from avc_hardware import stream

    coupling = _stream_coupling(args, console)
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
        return _stream_interrupted(coupling, args, sent)
    document: dict[str, Any] = plain(
        {"problem": coupling.problem.name, "coupling": coupling.id}
        | {key: value for key, value in vars(result).items() if key not in {"samples", "push", "status"}}
        | {"push": result.push.document(), "status": vars(result.status)}
        | {"deployable": verdict.document(), "unsafe": unsafe_note(verdict)}
        | {"samples": [vars(sample) for sample in result.samples]}
    )
    complaint = f"avc: {result.port}: {'; '.join(result.faults)}" if result.faults else ""
    answer = deploy.stream(document, result.faults)
    return replace(answer, units=units, code=1 if complaint else 0, complaint=complaint)


def _stream_interrupted(coupling: Coupling, args: argparse.Namespace, sent: int) -> Answer:
    """Describe the device's behaviour after the stream was interrupted."""
    from avc_casadi.present.row import Answer as Result
    from avc_hardware import HOLD_PERIODS

    data = avc.fault_document(avc.InputError.of("interrupted")) | {
        "problem": coupling.problem.name,
        "coupling": coupling.id,
        "sent": sent,
    }
    stays = f"{args.port} goes back to its table, coupling {coupling.id}, within {HOLD_PERIODS / args.rate_hz:.2g} s"
    left = "the emulated board ends with this command" if args.port == "emulator" else stays
    return Result("stream", data, (f"interrupted after {sent} messages; {left}",), code=EXIT_CODE)


def _stream_coupling(args: argparse.Namespace, console: Console) -> Coupling:
    """Read the coupling; or recommend one for a problem."""
    if is_coupling(args.subject):
        return read_subject("stream", args.subject, args.problem)
    from avc_casadi.recommendation.recommend import recommend

    problem = avc.load_problem(args.subject)
    with console.step("recommended coupling"):
        found = recommend(problem, progress=console)
    if found.coupling is None or found.coupling.end != "wall":
        raise avc.NotDeployableError(f"{problem.name}: {found.reason}")
    return found.coupling


def add_monitor(parser: argparse.ArgumentParser) -> None:
    """Watch a device: records of its own ticks, as text, plot or log; and keep its heartbeat.

    The device pushes a record every so many of its own ticks, with the tick's number; one that is lost is seen by it.
    With --heartbeat the device lives as long as this command: when it ends, is killed or loses the line, the force
    falls to 0 within 0.1 s, and comes back out of contact with the next heartbeat.
    """
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


def _monitor_sample_document(sample: TelemetrySample, words: str) -> Any:
    """Return a record as JSON values, its faults in words."""
    from avc_casadi._util.json_values import plain

    return plain(vars(sample) | {"fault_words": words.split(", ") if words else []})


def run_monitor(args: argparse.Namespace, console: Console) -> Answer:
    """Watch the device; Ctrl-C ends it with all samples so far."""
    from avc_casadi._util.units import units_for
    from avc_casadi.present.row import Value, text_of
    from avc_hardware import EMULATOR, EMULATOR_IS_FRESH, LOG_ENDINGS, DeviceFault, LivePlot, monitor, open_log

    units = units_for(args.motion)
    out = output_file(args.out, "--out", LOG_ENDINGS) if args.out else None
    samples: list[dict[str, Any]] = []
    document: dict[str, Any] = {"port": args.port, "note": None, "samples": samples, "records": 0, "lost": 0}
    document |= {"ended": None, "out": args.out}
    code, shown = 0, -1.0
    log: TelemetryLog | None = None
    if args.port == EMULATOR:
        document["note"] = EMULATOR_IS_FRESH

    def begun(device: Device) -> None:
        nonlocal log
        if out is not None and log is None:  # not before there is something to log
            log = stack.enter_context(open_log(out, args.motion))
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
                        samples.append(_monitor_sample_document(sample, words))
                if plot is not None:
                    plot.take(sample)
                    if plot.closed:
                        break
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
    from avc_casadi.present.row import Answer as Result
    from avc_casadi.present.row import Mark, Value, row

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
    return Result("monitor", data, rows=tuple(rows), units=units, code=code)


def _monitor_state(sample: TelemetrySample, faults: str) -> tuple[Part, ...]:
    from avc_casadi.present.row import Value, listed

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


def add_device(parser: argparse.ArgumentParser) -> None:
    """Show or lower the limits of a device, or clear its faults."""
    add_port(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--limits", action="store_true", help="show or lower the limits (what is done by default)")
    what.add_argument("--clear", action="store_true", help="show the latched faults and clear them; 1 if one stays")
    limits = parser.add_argument_group(
        "limits",
        "Never above those built into the firmware, and until the device starts anew. A lower force\n"
        "holds at once, a higher one from the next time that the device is out of contact.",
    )
    add_worded(limits, "--force-n", "--torque-nm", "N", "limit of the force")
    add_worded(limits, "--speed-m-per-s", "--speed-rad-per-s", "V", "a fault is latched beyond it")
    limits.add_argument(
        "--energy-j", type=positive, metavar="E", help="that a coupling may give out, a second, without having got it"
    )
    limits.add_argument("--built-in", action="store_true", help="those of the firmware, for all that is not given")
    add_motion(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run_device(args: argparse.Namespace, console: Console) -> Answer:
    """Carry out the options.

    Raises:
        InputError: options that do not belong together.
    """
    if not args.clear:
        return _device_limited(args, console)
    given = [option for key, option in _OF_LIMITS.items() if getattr(args, key) not in {None, False}]
    if given:
        raise avc.InputError.of("goes with --limits, not with --clear", key=given[0])
    return _device_cleared(args, console)


def _device_limited(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import units_for
    from avc_casadi.present.rows.deploy import limits
    from avc_hardware import set_limits

    units = units_for(args.motion)
    check_worded(args, units)
    with console.step(f"limits of {args.port}"):
        found = set_limits(
            args.port,
            force_n=args.force_n,
            speed_m_per_s=args.speed_m_per_s,
            energy_j=args.energy_j,
            built_in=args.built_in,
            baud=args.baud,
            on_silence=console.notice,
        )
    three = {name: vars(getattr(found, name)) for name in ("boards", "asked", "hold")}
    document: dict[str, Any] = plain({"port": found.port, "waits": found.waits} | three)
    return limits(document, units)


def _device_cleared(args: argparse.Namespace, console: Console) -> Answer:
    """Clear the faults; 1 if one remains."""
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
    return replace(faults(document, list(found.were.advice)), code=1 if complaint else 0, complaint=complaint)


def add_firmware(parser: argparse.ArgumentParser) -> None:
    """Build firmware for a device, its sample time, encoder and force limit built in.

    No gains are in it: they are pushed (avc push), and a coupling for another sample time or for more force is refused
    by the device. It needs the board's compiler: arm-none-eabi-gcc, or that of your folder.
    """
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


def run_firmware(args: argparse.Namespace, console: Console) -> Answer:
    """Build the image and print the commands that flash it."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.present.rows.deploy import firmware
    from avc_hardware import build_firmware

    subject: Coupling | avc.Problem | DeviceModel
    if is_coupling(args.subject):
        subject = read_subject("firmware", args.subject, args.problem)
    else:
        subject = avc.load_device(args.subject).device if is_device(args.subject) else avc.load_problem(args.subject)
    with output_folder(args.out, "--out") as folder, console.step(f"firmware for {args.board}"):
        built = build_firmware(subject, args.board, folder, baud=args.baud)
    baud = args.baud or _USUAL_BAUD
    limits, figures = built.limits, built.figures
    notes = _firmware_notes(subject, limits)
    document: dict[str, Any] = plain(
        {
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
    return firmware(document, built.title, subject.units, held)


def _firmware_notes(subject: Coupling | Problem | DeviceModel, limits: BoardLimits) -> list[str]:
    """Describe defaults of the image that the file does not give, and keys of the file that it ignores."""
    problem = getattr(subject, "problem", subject)
    device = getattr(problem, "device", problem)
    notes = []
    if getattr(subject, "detent", None) is not None:
        notes.append("[detent] has no place in what is pushed: export it (avc export)")
    for key, value in (("max_force_n", limits.max_force_n), ("encoder_resolution_m", limits.metres_per_count)):
        if not getattr(device, key):
            name = device.units.key(key)
            notes.append(f"the file has no device.{name}: {number(value)} is the board's own; give the device's")
    return notes
