"""Verbs that measure a device: excite, identify, diagnose."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli.arguments import (
    add_log_layout,
    add_verbose,
    add_worded,
    check_worded,
    is_device,
    load_known,
    log_layout,
    positive,
    positive_int,
    read_subject,
)
from avc_casadi.cli.console import PICTURES, Console, output_file, write_figure, write_text

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.excitation.design import Excitation
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands
    from avc_casadi.present.row import Answer
    from avc_hardware import ExcitationLog

# Least travel for `avc identify`, encoder steps.
_FEWEST_STEPS = 12.0
_SIGNALS = ("multisine", "chirp")


def add_excite(parser: argparse.ArgumentParser) -> None:
    """Excite a device within limits of force, speed and travel, and log it for `avc identify`.

    Before anything moves, the plan is simulated on the declared device and at every corner of [device.range]; one that
    would break a limit is refused. The firmware checks force, speed and travel at every tick and holds the device near
    where it stands by a weak spring and damper; hands off. After the end, a limit exceeded, Ctrl-C or a second without
    the host there is no force until a coupling is pushed.
    """
    parser.add_argument(
        "device",
        metavar="DEVICE",
        help="what is known of it: a device, or a problem; a file or a name of the catalogue",
    )
    parser.add_argument(
        "--port",
        default="emulator",
        help="serial port (avc doctor --ports); default `emulator`: the firmware image, with the declared device "
        "on its board",
    )
    parser.add_argument(
        "--signal",
        choices=_SIGNALS,
        default="multisine",
        help="multisine: all frequencies at once (default); chirp: one after the other",
    )
    parser.add_argument("--seconds", type=positive, default=10.0, metavar="S", help="how long; default 10")
    add_worded(parser, "--force-n", "--torque-nm", "N", "force limit; default: half of the device's")
    add_worded(
        parser,
        "--speed-m-per-s",
        "--speed-rad-per-s",
        "V",
        "speed limit; default 0.3 m/s at the hand, at most 10 rad/s",
    )
    add_worded(parser, "--travel-m", "--travel-rad", "X", "travel limit to either side; default 20 mm at the hand")
    parser.add_argument("--out", metavar="FILE", help="write the log (.csv)")
    parser.add_argument("--plan-only", action="store_true", help="say what would be done; nothing moves")
    parser.add_argument(
        "--on-bench", metavar="DEVICE", help="with --port emulator: the device on its board, if not the declared one"
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run_excite(args: argparse.Namespace, console: Console) -> Answer:
    """Plan, report, play, write; 1 if the device stopped before the end."""
    out = output_file(args.out, "--out", (".csv",)) if args.out else None
    device = _excite_device(args.device)
    check_worded(args, device.units)
    on_bench = _excite_device(args.on_bench) if args.on_bench else device
    if args.plan_only and args.out:
        raise avc.InputError.of("makes a log, and --plan-only plays nothing; leave one of them out", key="--out")
    if args.on_bench and args.port != "emulator":
        raise avc.InputError.of(
            f"goes with --port emulator alone, not with {args.port}; leave it out", key="--on-bench"
        )
    from avc_casadi.identification.excitation.design import plan_excitation
    from avc_casadi.present.rows import measure
    from avc_hardware import excite

    with console.step("plan: a signal within the limits on every device of the ranges"):
        made = plan_excitation(
            device,
            args.signal,
            seconds=args.seconds,
            force_n=args.force_n,
            speed_m_per_s=args.speed_m_per_s,
            travel_m=args.travel_m,
            progress=console,
        )
    document: dict[str, Any] = {"plan": _excite_plan(made), "out": None, "log": None}
    planned = measure.plan(document, device.units, args.device, args.port)
    if args.plan_only:
        return planned
    console.say(console.page.rendered(planned))
    with console.step(f"{args.signal} on {args.port}"):

        def cut(log: ExcitationLog) -> None:
            if out is not None:
                log.save(out)
                found = {"log": log.document()}
                console.say(console.page.rendered(measure.log(found, device.units, log.port, f"{out}, cut short")))

        log = excite(
            made.plan,
            args.port,
            on_bench=on_bench,
            baud=args.baud,
            progress=console,
            cut=cut,
            on_silence=console.notice,
        )
    document["log"], onwards = log.document(), []
    if out is not None:
        log.save(out)
        document["out"] = str(out)
    complaint = f"{log.end}; {_excite_advice(log)}" if not log.whole else _excite_too_little(document["log"], device)
    if out is not None and not complaint:
        onwards.append(f"avc identify {quote(str(out))} --device {quote(args.device)} --out mine.toml")
    title = f"{args.device}   {args.signal} on {log.port}"
    answer = measure.log(document, device.units, title, str(out or ""), onwards)
    said = f"avc: {log.port}: {complaint}" if complaint else ""
    return replace(answer, code=1 if complaint else 0, complaint=said)


def _excite_device(source: str) -> Device:
    return avc.load_device(source).device if is_device(source) else avc.load_problem(source).device


def _excite_plan(made: Excitation) -> dict[str, Any]:
    from avc_casadi._util.json_values import plain

    plan, found = made.plan, made.forecast
    low, high = plan.band_hz
    document: dict[str, Any] = plain(
        {
            "signal": plan.kind,
            "seconds": plan.seconds,
            "sample_time_s": plan.sample_time_s,
            "lowest_hz": low,
            "highest_hz": high,
            "tones": len(plan.signal.step),
            "peak_force_n": plan.peak_force_n,
            "held_back_by": plan.units.key(made.held_back_by),
            "limits": plan.limits,
            "centring": {"spring_n_per_m": plan.spring_n_per_m, "damper_ns_per_m": plan.damper_ns_per_m},
            "devices": len(made.devices),
            "forecast": {
                "declared": {key: float(values[0, 0]) for key, values in vars(found).items()},
                "worst": {key: float(values.max()) for key, values in vars(found).items()},
            },
        }
    )
    return document


def _excite_too_little(log: Mapping[str, Any], device: Device) -> str:
    """Describe why a log that was played to its end does not identify the device."""
    steps = log["peak_travel_m"] / device.encoder_resolution_m if device.encoder_resolution_m else math.inf
    if steps >= _FEWEST_STEPS:
        return ""
    return (
        f"the device moved by {number(steps, 2)} steps of its encoder only, as if dry friction or a hand held it: free "
        "it, or give more force"
    )


def _excite_advice(log: ExcitationLog) -> str:
    if "limit" in log.end:
        return (
            "the device is lighter, freer or otherwise held than declared: clear its way, widen [device.range], or "
            "give less force"
        )
    return "look at the link, then excite again"


def add_identify(parser: argparse.ArgumentParser) -> None:
    """Identify a device from logs of time, position and commanded force.

    The device file that is written holds measured values, each with its source and, in [device.range], its 95 %
    interval; it is used at once: device = "device.toml" in a problem file. What the logs do not identify is named, with
    the log that would.
    """
    parser.add_argument("log", metavar="LOG", nargs="+", help=".csv, .txt, .npz or .mat (v5)")
    parser.add_argument("--out", metavar="FILE", help="write the device file (.toml)")
    parser.add_argument(
        "--device", metavar="BASE", help="device or problem: what the logs do not tell is taken from it"
    )
    add_log_layout(parser)
    parser.add_argument(
        "--handle-radius-m",
        type=positive,
        metavar="R",
        help="where the hand holds a device that turns, if BASE is not given",
    )
    parser.add_argument("--encoder-at", choices=("motor", "handle"), help="side of the resonance with the encoder")
    parser.add_argument("--report", metavar="FILE", help="write a page with figures (.html)")
    add_verbose(parser)


def run_identify(args: argparse.Namespace, console: Console) -> Answer:
    """Read, identify, write."""
    out = output_file(args.out, "--out", (".toml",)) if args.out else None
    page = output_file(args.report, "--report", (".html",)) if args.report else None
    layout = log_layout(args)
    base = load_known(args.device) if args.device else None
    from avc_casadi._util.units import units_for
    from avc_casadi.identification.device import device_text
    from avc_casadi.identification.identify import identify
    from avc_casadi.present.rows.measure import identification

    found = identify(
        args.log,
        layout=layout,
        base=base,
        encoder_at=args.encoder_at,
        flip_force=args.flip_force,
        handle_radius_m=args.handle_radius_m,
        progress=console,
    )
    units = units_for(found.motion)
    document = found.data()
    written: list[str] = []
    complaint = ""
    if found.device is None:
        missing = [key for key in ("mass_kg", "damping_ns_per_m") if key not in found.estimates] or ["handle_radius_m"]
        keys = ", ".join(map(units.key, missing))
        complaint = f"avc: no device file: {keys} not known; log it, or state it by --device BASE or an option"
    elif out is not None:
        write_text(out, device_text(found.device), "--out")
        written.append(str(out))
    document["out"] = str(out) if out is not None and found.device is not None else None
    written += [] if page is None else [str(page)]
    answer = identification(document, found, units, args.log, written)
    if page is not None:
        with console.step("page"):
            from avc_casadi.cli.console import package_versions
            from avc_casadi.present.report import identification_html

            write_text(page, identification_html(answer, found, package_versions()), "--report")
    return replace(answer, code=int(found.device is None), complaint=complaint)


def add_diagnose(parser: argparse.ArgumentParser) -> None:
    """Diagnose a log of a loop that swings: the cause, the evidence, a remedy that was simulated.

    Reads the logs that `avc identify` reads. Names one of: delay, sample rate, stiffness or damping over the limit,
    hand released, resonance, a force switched by a sign, two rates in one loop, encoder steps or noise, dropped ticks;
    says that nothing is wrong, or that it cannot tell, and the log that would decide.
    """
    parser.add_argument("log", metavar="LOG", nargs="+", help=".csv, .txt, .npz or .mat (v5): one record each")
    add_log_layout(parser)
    parser.add_argument("--device", metavar="NAME|FILE", help="device or problem: what it was declared to be")
    parser.add_argument("--problem", metavar="P", help="problem: its device and its hands")
    parser.add_argument("--coupling", metavar="FILE", help="coupling.json that was meant to run")
    parser.add_argument(
        "--handle-radius-m", type=positive, metavar="M", help="handle of a device that turns, where no device is given"
    )
    parser.add_argument("--plot", metavar="FILE", help="write a picture of each log (.png, .svg, .pdf)")
    parser.add_argument("--report", metavar="FILE", help="write a page with figures (.html)")
    add_verbose(parser)


def run_diagnose(args: argparse.Namespace, console: Console) -> Answer:
    """Read, diagnose, write."""
    picture = output_file(args.plot, "--plot", PICTURES) if args.plot else None
    page = output_file(args.report, "--report", (".html",)) if args.report else None
    if args.device and args.problem:
        raise avc.InputError.of("stands beside --problem, which has a device; allowed: one of them", key="--device")
    layout = log_layout(args)
    device, hands = _diagnose_declared(args)
    coupling = _diagnose_coupling(args.coupling)
    from avc_casadi.diagnose.causes import diagnose
    from avc_casadi.present.rows.measure import diagnosis

    found = [
        diagnose(
            log,
            layout=layout,
            device=device,
            hands=hands,
            coupling=coupling,
            handle_radius_m=args.handle_radius_m,
            flip_force=args.flip_force,
            progress=console,
        )
        for log in args.log
    ]
    documents = [each.data() for each in found]
    document: dict[str, Any] = documents[0] if len(found) == 1 else {"logs": documents}
    written = [] if picture is None else [str(path) for path in _diagnose_pictures(found, picture)]
    written += [] if page is None else [str(page)]
    healthy = all(each.verdict == "nothing wrong" for each in found)
    code = 0 if healthy or all(each.cause for each in found) else 1
    answer = diagnosis(document, found, f"avc diagnose {' '.join(args.log)} -v", written)
    if page is not None:
        _diagnose_report(answer, found, page, console)
    return replace(answer, code=code)


def _diagnose_declared(args: argparse.Namespace) -> tuple[Device | None, Hands | None]:
    if args.problem:
        problem = avc.load_problem(args.problem)
        return problem.device, problem.hands
    return (load_known(args.device).device if args.device else None), None


def _diagnose_coupling(file: str | None) -> Coupling | None:
    if file is None:
        return None
    return read_subject("diagnose", file)


def _diagnose_pictures(found: list[Diagnosis], picture: Path) -> list[Path]:
    from avc_casadi.present.figures.diagnosis import draw_diagnosis

    written = []
    for index, each in enumerate(found, start=1):
        path = picture if len(found) == 1 else picture.with_stem(f"{picture.stem}-{index}")
        write_figure(path, draw_diagnosis(each))
        written.append(path)
    return written


def _diagnose_report(answer: Answer, found: list[Diagnosis], page: Path, console: Console) -> None:
    with console.step("page"):
        from avc_casadi.cli.console import package_versions
        from avc_casadi.present.report import diagnosis_html

        write_text(page, diagnosis_html(answer, found, package_versions()), "--report")
