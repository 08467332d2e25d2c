"""Excite a device within limits of force, speed and travel, and log it for `avc identify`.

Before anything moves, the plan is simulated on the declared device and at every corner of [device.range]; one that
would break a limit is refused. The firmware checks force, speed and travel at every tick and holds the device near
where it stands by a weak spring and damper; hands off. After the end, a limit exceeded, Ctrl-C or a second without the
host there is no force until a coupling is pushed.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from shlex import quote
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli._arguments import add_worded, check_worded, positive, positive_int
from avc_casadi.cli._check_device import is_device
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._subject import load_device, load_problem
from avc_casadi.present.terminal import Row

if TYPE_CHECKING:
    from avc_casadi.identification.excitation.design import Excitation
    from avc_casadi.model.device import Device
    from avc_hardware import ExcitationLog

# Least travel for `avc identify`, encoder steps.
_FEWEST_STEPS = 12.0
_SIGNALS = ("multisine", "chirp", "sweep", "release")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
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
        help="multisine: tells the most (default); chirp; sweep: at constant speed; release: pulled and released",
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


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Plan, report, play, write; 1 if the device stopped before the end."""
    out = output_file(args.out, "--out", (".csv",)) if args.out else None
    device = _device(args.device)
    check_worded(args, device.units)
    on_bench = _device(args.on_bench) if args.on_bench else device
    if args.plan_only and args.out:
        raise avc.InputError.of("makes a log, and --plan-only plays nothing; leave one of them out", key="--out")
    if args.on_bench and args.port != "emulator":
        raise avc.InputError.of(
            f"goes with --port emulator alone, not with {args.port}; leave it out", key="--on-bench"
        )
    from avc_casadi.identification.excitation.design import plan_excitation
    from avc_casadi.present.pages.bench import log_rows, plan_page
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
    document: dict[str, Any] = {"schema": "avc-excite/1", "plan": _plan(made), "out": None, "log": None}
    text = plan_page(document["plan"], device.units, console.page, args.device, args.port)
    if args.plan_only:
        return Answer(document, text)
    console.say(text)
    with console.step(f"{args.signal} on {args.port}"):

        def cut(log: ExcitationLog) -> None:
            if out is not None:
                log.save(out)
                rows = [*log_rows(log.document(), device.units), Row("Written", f"{out}, as far as it went")]
                console.say(console.page.rendered(log.port, rows))

        log = excite(
            made.plan,
            args.port,
            on_bench=on_bench,
            baud=args.baud,
            progress=console,
            cut=cut,
            on_silence=console.notice,
        )
    document["log"] = log.document()
    rows, onwards = log_rows(document["log"], device.units), []
    if out is not None:
        log.save(out)
        document["out"] = str(out)
        rows.append(Row("Written", str(out)))
    complaint = f"{log.end}; {_advice(log)}" if not log.whole else _too_little(document["log"], device)
    if out is not None and not complaint:
        onwards.append(f"avc identify {quote(str(out))} --device {quote(args.device)} --out mine.toml")
    text = console.page.rendered(f"{args.device}   {args.signal} on {log.port}", rows, onwards)
    return Answer(document, text, 1 if complaint else 0, f"avc: {log.port}: {complaint}" * bool(complaint))


def _device(source: str) -> Device:
    return load_device(source).device if is_device(source) else load_problem(source).device


def _plan(made: Excitation) -> dict[str, Any]:
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import spoken_key

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
            "peak_force_n": made.peak_force_n,
            "crest_factor": made.crest,
            "held_back_by": spoken_key(made.held_back_by),
            "limits": {
                "force_n": plan.max_force_n,
                "speed_m_per_s": plan.max_speed_m_per_s,
                "travel_m": plan.max_travel_m,
            },
            "centring": {"spring_n_per_m": plan.spring_n_per_m, "damper_ns_per_m": plan.damper_ns_per_m},
            "devices": len(made.devices),
            "forecast": {
                "declared": {key: float(values[0, 0]) for key, values in vars(found).items()},
                "worst": {key: float(values.max()) for key, values in vars(found).items()},
            },
        }
    )
    return document


def _too_little(log: Mapping[str, Any], device: Device) -> str:
    """Describe why a log that was played to its end does not identify the device."""
    from avc_casadi._util.units import spoken_key

    steps = log["peak_travel_m"] / device.encoder_resolution_m if device.encoder_resolution_m else math.inf
    if steps >= _FEWEST_STEPS:
        return ""
    return (
        f"the device moved by {number(steps, 2)} steps of its encoder only, as if dry friction or a hand held it: free "
        f"it, or give more {spoken_key('--force-n')}"
    )


def _advice(log: ExcitationLog) -> str:
    from avc_casadi._util.units import spoken_key

    if "limit" in log.end:
        return (
            "the device is lighter, freer or otherwise held than declared: clear its way, widen [device.range], or "
            f"give less {spoken_key('--force-n')}"
        )
    return "look at the link, then excite again"
