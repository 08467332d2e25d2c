"""Identify a device from logs of time, position and commanded force.

The device file that is written holds measured values, each with its source and, in [device.range], its 95 % interval;
it is used at once: device = "device.toml" in a problem file. What the logs do not identify is named, with the log that
would.
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_log_layout, add_verbose, log_layout, positive
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.cli._subject import load_known

if TYPE_CHECKING:
    from avc_casadi.identification.model import Identification


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("log", metavar="LOG", nargs="+", help=".csv, .txt, .json, .npy, .npz or .mat (v5): records")
    parser.add_argument("--out", metavar="FILE", help="write the device file (.toml)")
    parser.add_argument(
        "--device", metavar="BASE", help="device or problem: what the logs do not tell is taken from it"
    )
    add_log_layout(parser)
    parser.add_argument(
        "--added-mass",
        metavar="KG,...",
        help="known mass (kg.m2 on what turns) on the device, one of each log: tells the force's scale",
    )
    parser.add_argument(
        "--known",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a value not to search for: mass_kg=0.1, or inertia_kgm2=1e-5",
    )
    parser.add_argument(
        "--handle-radius-m",
        type=positive,
        metavar="R",
        help="where the hand holds a device that turns, if BASE is not given",
    )
    parser.add_argument("--encoder-at", choices=("motor", "handle"), help="side of the resonance with the encoder")
    parser.add_argument("--report", metavar="FILE", help="write a page with figures (.html)")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Read, identify, write."""
    out = output_file(args.out, "--out", (".toml",)) if args.out else None
    page = output_file(args.report, "--report", (".html",)) if args.report else None
    layout, masses, known = log_layout(args), _masses(args), _known(args)
    base = load_known(args.device) if args.device else None
    from avc_casadi._util.units import speak, spoken, units_for
    from avc_casadi.identification.device import device_text
    from avc_casadi.identification.identify import identify
    from avc_casadi.identification.told import identification_document, identification_text
    from avc_casadi.present.pages.logs import identification_page

    found = identify(
        args.log,
        layout=layout,
        base=base,
        known=known,
        added_mass_kg=masses,
        encoder_at=args.encoder_at,
        flip_force=args.flip_force,
        handle_radius_m=args.handle_radius_m,
        progress=console,
    )
    if base is None:
        speak(units_for(found.motion))
    document: dict[str, Any] = identification_document(found)
    written: list[str] = []
    code, complaint = 0, ""
    if found.device is None:
        missing = ", ".join(key for key in ("mass_kg", "damping_ns_per_m") if key not in found.estimates)
        code = 1
        complaint = f"avc: no device file: {missing} not identified; excite it in a log, or state it by --device BASE"
    elif out is not None:
        write_text(out, device_text(found.device), "--out")
        written.append(str(out))
    document["out"] = str(out) if out is not None and found.device is not None else None
    if page is not None:
        _report(found, page, console)
        written.append(str(page))
    text = identification_page(found, spoken(), console.page, args.log, written)
    return Answer(document, text, code, complaint, more=identification_text(found))


def _report(found: Identification, page: Any, console: Console) -> None:
    with console.step("page"):
        from avc_casadi.cli._versions import package_versions
        from avc_casadi.present.report.logs import identification_html

        write_text(page, identification_html(found, package_versions()), "--report")


def _masses(args: argparse.Namespace) -> tuple[float, ...]:
    if args.added_mass is None:
        return ()
    try:
        masses = tuple(float(part) for part in args.added_mass.split(","))
    except ValueError:
        masses = (math.nan,)
    if not all(0 <= mass <= 1e6 for mass in masses):
        raise avc.InputError.of(
            f"is {args.added_mass!r}; allowed: kilograms, at most 1e6, one of each log: 0,0.2", key="--added-mass"
        )
    if len(masses) != len(args.log):
        logs = "one log" if len(args.log) == 1 else f"{len(args.log)} logs"
        raise avc.InputError.of(
            f"is {args.added_mass!r} for {logs}; allowed: kilograms, at most 1e6, one of each log: 0,0.2",
            key="--added-mass",
        )
    return masses


def _known(args: argparse.Namespace) -> dict[str, float]:
    known: dict[str, float] = {}
    for text in args.known:
        key, _, value = text.partition("=")
        try:
            known[key] = float(value)
        except ValueError:
            raise avc.InputError.of(f"is {text!r}; allowed: KEY=VALUE, as mass_kg=0.1", key="--known") from None
    return known
