"""Verbs that measure a device: excite, identify, diagnose."""

from __future__ import annotations

import argparse
import math
import shlex
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.text import number
from avc_casadi._util.units import units_for
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, write_figure
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

if TYPE_CHECKING:
    pass

_LEAST_STROKE_STEPS = 12
"""Encoder steps of travel below which a log tells too little for `avc identify`."""

_SIGNAL = "all frequencies at once (default), or one after the other"


@cli.verb(
    cli.argument("device", metavar="DEVICE", text="what is known of it: a device or problem, a file or a name"),
    cli.argument("--port", default="emulator", text="serial port (avc doctor --ports); default `emulator`, a model"),
    cli.argument("--signal", choices=("multisine", "chirp"), default="multisine", text=_SIGNAL),
    cli.argument("--seconds", type=cli.positive, default=10.0, metavar="S", text="how long; default 10"),
    *cli.turning("force_n", "N", "force limit; default: half of the device's"),
    *cli.turning("speed_m_per_s", "V", "speed limit; default 0.3 m/s at the hand, at most 10 rad/s"),
    *cli.turning("travel_m", "X", "travel limit to either side; default 20 mm at the hand"),
    cli.output("--out", "write the log (.csv)", ".csv"),
    cli.flag("--plan-only", "say what would be done; nothing moves"),
    cli.argument("--on-bench", metavar="DEVICE", text="with --port emulator: the device there, if another"),
    cli.BAUD,
)
def run_excite(args: argparse.Namespace, console: Console) -> Answer:
    """Excite a device within limits of force, speed and travel, and log it for `avc identify`.

    The plan is simulated first on every corner of [device.range]; one that would break a limit is refused. The firmware
    checks the limits at every tick and holds the device near where it stands; hands off. Afterwards there is no force.
    """
    from avc_casadi.identification.excitation import plan_excitation

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
        fault = f"{log.end}; the device is lighter, freer or otherwise held than declared: clear its way, "
        return fault + "widen [device.range], or give less force"
    if not log.whole:
        return f"{log.end}; look at the link, then excite again"
    steps = stroke_m / encoder_m if encoder_m else math.inf
    if steps < _LEAST_STROKE_STEPS:
        fault = f"the device moved by {number(steps, 2)} steps of its encoder only, as if dry friction or a hand "
        return fault + "held it: free it, or give more force"
    return ""


@cli.verb(
    *cli.LOGS,
    cli.output("--out", "write the device file (.toml)", ".toml"),
    cli.argument("--device", metavar="BASE", text="device or problem: what the logs do not tell is taken from it"),
    cli.plot("the log beside its model"),
    cli.VERBOSE,
)
def run_identify(args: argparse.Namespace, console: Console) -> Answer:
    """Identify a device from logs of time, position and commanded force.

    The device file holds each value with its source and 95 % interval, for device = "device.toml" in a problem.
    """
    from avc_casadi.identification.device import device_text
    from avc_casadi.identification.identify import identify

    base = cli.load_any_device(args.device)[0] if args.device else None
    identified = identify(args.log, base=base, progress=console, **cli.log_options(args))
    units, complaint = units_for(identified.motion), ""
    write_figure(console, args.plot, lambda: avc.figures.draw_identification(identified))
    out: str | None = None
    if identified.device is None:
        missing = [key for key in ("mass_kg", "damping_ns_per_m") if key not in identified.estimates]
        missing = missing or ["handle_radius_m"]
        keys = ", ".join(map(units.key, missing))
        complaint = f"avc: no device file: {keys} not known; log it, or state it by --device BASE or an option"
    elif args.out is not None:
        console.write(args.out, device_text(identified.device))
        out = str(args.out)
    return replace(rows.measure.identification(identified, units, args.log, out), complaint=complaint)


@cli.verb(
    *cli.LOGS,
    cli.argument("--device", metavar="D", text="device, or problem with its hands: what it was declared to be"),
    cli.argument("--coupling", metavar="FILE", text="coupling.json that was meant to run"),
    cli.plot("each log"),
    cli.VERBOSE,
)
def run_diagnose(args: argparse.Namespace, console: Console) -> Answer:
    """Diagnose a log of a loop that swings: the cause, the evidence, a remedy that was simulated.

    Or that nothing is wrong, or that it cannot tell, and the log that would decide. Reads what `avc identify` reads.
    """
    from avc_casadi.diagnose.causes import diagnose

    file, hands = (None, None) if args.device is None else cli.load_any_device(args.device)
    coupling = None if args.coupling is None else cli.read_wall(args.coupling)
    known = {"device": file and file.device, "hands": hands, "coupling": coupling, **cli.log_options(args)}
    diagnoses = [diagnose(log, progress=console, **known) for log in args.log]
    if args.plot is not None:
        for place, diagnosis in enumerate(diagnoses, start=1):
            path = args.plot if len(diagnoses) == 1 else args.plot.with_stem(f"{args.plot.stem}-{place}")
            write_figure(console, path, partial(avc.figures.draw_diagnosis, diagnosis))
    answer = rows.measure.diagnosis(diagnoses)
    healthy = all(diagnosis.verdict == "nothing wrong" for diagnosis in diagnoses)
    named = all(diagnosis.cause for diagnosis in diagnoses)
    return replace(answer, code=0 if healthy or named else 1)
