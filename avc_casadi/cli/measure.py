"""Verbs that measure a device: excite, identify, diagnose."""

from __future__ import annotations

import argparse
import math
import shlex
from dataclasses import replace
from functools import partial

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.text import number
from avc_casadi._util.units import units_for
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, write_figure
from avc_casadi.files.kinds import FileKind
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

_LEAST_STROKE_STEPS = 12
"""Encoder steps of travel below which a log is too poor for `avc identify`."""

_DEVICE = "device file or problem with what you know of the device"
_PORT = "choose the serial port (default: `emulator`, a model of the device)"
_SIGNAL = "choose multisine (all frequencies at once, default) or chirp (a sweep)"
_ON_BENCH = "emulate this device instead of DEVICE, to test a plan on another device (--port emulator)"
_BASE = "take values that the logs do not determine from this device or problem"
_JUDGES_LAW = "avc certify judges the stated law"
_DECLARED = "compare the log with this device file, or with a problem file and its hands"


@cli.verb(
    cli.argument("device", metavar="DEVICE", text=_DEVICE),
    cli.argument("--port", default="emulator", metavar="PORT", text=_PORT),
    cli.argument("--signal", choices=("multisine", "chirp"), default="multisine", metavar="SIGNAL", text=_SIGNAL),
    cli.numeric("--seconds", "set the duration in s (default: 10)", default=10.0, metavar="S"),
    *cli.turning("force_n", "N", "limit the force in N (default: half of the device's)"),
    *cli.turning("speed_m_per_s", "V", "limit the speed in m/s (default: 0.3)"),
    *cli.turning("travel_m", "X", "limit the travel to either side in m (default: 0.02)"),
    cli.output("--out", "write the log to this .csv file", {".csv": (FileKind.LOG,)}),
    cli.flag("--plan-only", "print the plan without moving the device"),
    cli.argument("--on-bench", metavar="DEVICE", text=_ON_BENCH),
    cli.BAUD,
)
def run_excite(args: argparse.Namespace, console: Console) -> Answer:
    """Excite a device and log its motion for `avc identify`.

    The motion is first simulated for all extreme values of [device.range]; a motion beyond a limit
    is refused.
    The firmware checks force, speed and travel at every tick, and keeps the device near its start.
    Do not touch the device during the motion. At the end the device has no force.
    """
    from avc_casadi.identification.excitation import plan_excitation

    if args.port != avc_hardware.EMULATOR:
        why = f"emulates a device, and --port {args.port} is a real one; leave it out, or use --port emulator"
        cli.refuse(args, "on_bench", why=why)
    device = cli.load_any_device(args.device)[0].device
    on_bench = cli.load_any_device(args.on_bench or args.device)[0].device
    limits = cli.of_motion(args, device.units, "force_n", "speed_m_per_s", "travel_m")
    with console.step("plan: a signal within the limits on every device of the ranges"):
        planned = plan_excitation(device, args.signal, seconds=args.seconds, progress=console, **limits)
    figures = rows.measure.ExcitationPlan.of(planned)
    answer = rows.measure.plan(figures, device.units, args.device, args.port)
    if args.plan_only:
        return answer
    console.say(console.page.rendered(answer))

    def cut(log: avc_hardware.ExcitationLog) -> None:
        if args.out is not None:
            console.write(args.out, log.csv())
            shown = rows.measure.log(log.figures, device.units, f"{log.port}   {args.out}, cut short")
            console.say(console.page.rendered(shown))

    with console.step(f"{args.signal} on {args.port}"):
        log = avc_hardware.excite(planned.plan, args.port, on_bench=on_bench, baud=args.baud, progress=console, cut=cut)
    complaint = _excitation_fault(log, log.stroke_m, device.encoder_resolution_m)
    onwards = []
    if args.out is not None:
        console.write(args.out, log.csv())
        if not complaint:
            command = ["avc", "identify", str(args.out), "--device", args.device, "--out", "mine.toml"]
            onwards.append(shlex.join(command))
    title = f"{args.device}   {args.signal} on {log.port}"
    out = None if args.out is None else str(args.out)
    answer = rows.measure.log(log.figures, device.units, title, planned=figures, out=out, onwards=onwards)
    return replace(answer, complaint=f"avc: {log.port}: {complaint}") if complaint else answer


def _excitation_fault(log: avc_hardware.ExcitationLog, stroke_m: float, encoder_m: float) -> str:
    """Return why a log does not do for `avc identify`, and what to do; empty where it does."""
    if not log.whole and "limit" in log.end:
        fault = f"{log.end}; the device moves more easily than declared, or is held otherwise: "
        return fault + "clear its way, widen [device.range], or lower the force"
    if not log.whole:
        return f"{log.end}; check the link, then excite again"
    steps = stroke_m / encoder_m if encoder_m else math.inf
    if steps < _LEAST_STROKE_STEPS:
        fault = f"the device moved by {number(steps, 2)} encoder steps only, as if dry friction or a hand "
        return fault + "blocked it: release it, or raise the force"
    return ""


@cli.verb(
    *cli.LOGS,
    cli.output("--out", "write the device to this .toml file", {".toml": (FileKind.DEVICE,)}),
    cli.argument("--device", metavar="BASE", text=_BASE),
    cli.plot("log and model"),
    cli.VERBOSE,
)
def run_identify(args: argparse.Namespace, console: Console) -> Answer:
    """Identify a device from logs of time, position and commanded force.

    The device file has each value, its source and its 95 % interval.
    To use the device file, write device = "device.toml" in a problem file.
    """
    from avc_casadi.identification.device import device_text
    from avc_casadi.identification.identify import identify

    base = cli.load_any_device(args.device)[0] if args.device else None
    identified = identify(args.log, base=base, progress=console, **cli.log_options(args))
    units, complaint = units_for(identified.motion), ""
    write_figure(console, args.plot, lambda: avc.figures.draw_identification(identified))
    out: str | None = None
    if identified.device is None:
        known = {key for key, estimate in identified.estimates.items() if estimate.identified}
        keys = ", ".join(units.key(key) for key in ("mass_kg", "damping_ns_per_m") if key not in known)
        complaint = f"avc: no device file: {keys} not identified; log more motion, or state the value by --device BASE"
    elif args.out is not None:
        console.write(args.out, device_text(identified.device))
        out = str(args.out)
    return replace(rows.measure.identification(identified, units, args.log, out), complaint=complaint)


@cli.verb(
    *cli.LOGS,
    cli.argument("--device", metavar="D", text=_DECLARED),
    cli.argument("--coupling", metavar="FILE", text="compare the log with the coupling file that should have run"),
    cli.plot("each log"),
    cli.VERBOSE,
)
def run_diagnose(args: argparse.Namespace, console: Console) -> Answer:
    """Diagnose why a device oscillates, from a log.

    The answer names the cause, the evidence, and a remedy that was tried in a simulation.
    Or the answer says that nothing is wrong, or, if the log cannot decide, which log would decide.
    The logs are those that `avc identify` reads. Exit code 1 if some log cannot decide.
    """
    from avc_casadi.diagnose.causes import diagnose
    from avc_casadi.files.problem_file import is_device, load_any

    file, hands = (None, None) if args.device is None else cli.load_any_device(args.device)
    coupling = None if args.coupling is None else cli.read_wall(args.coupling)
    known = {"device": file and file.device, "hands": hands, "coupling": coupling, **cli.log_options(args)}
    diagnoses = [diagnose(log, progress=console, **known) for log in args.log]
    if args.plot is not None:
        for place, diagnosis in enumerate(diagnoses, start=1):
            path = args.plot if len(diagnoses) == 1 else args.plot.with_stem(f"{args.plot.stem}-{place}")
            write_figure(console, path, partial(avc.figures.draw_diagnosis, diagnosis))
    answer = rows.measure.diagnosis(diagnoses)
    if args.device is not None and not is_device(args.device):
        unused = rows.subject.law_not_used(
            load_any(args.device), f"the force of the log is fitted instead; {_JUDGES_LAW}"
        )
        answer = replace(answer, rows=(*answer.rows, *unused))
    decided = all(diagnosis.cause or diagnosis.verdict == "nothing wrong" for diagnosis in diagnoses)
    return replace(answer, code=0 if decided else 1)
