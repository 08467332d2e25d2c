"""Verbs that deploy a coupling: export, push, firmware."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli.arguments import (
    add_port,
    add_problem_of_gains,
    add_unsafe,
    add_verbose,
    faults_of,
    is_coupling,
    is_device,
    positive_int,
    read_pair,
    read_subject,
    unsafe_note,
)
from avc_casadi.cli.console import Console, output_folder

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device as DeviceModel
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.row import Answer
    from avc_hardware import BoardLimits

# Names of `avc_casadi.present.engines`.
ENGINES = ("mujoco", "chai3d", "unity", "sofa", "openhaptics", "imstk", "ros2", "pybullet")
IN_CONTACT = "the device is in contact: release it, out of the wall; the new coupling takes over there"
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
    parser.add_argument("--force", action="store_true", help="write over a file that is there and is no export")
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
        "files": _write(args, files),
        "rows": len(coupling.table),
        "sample_time_s": coupling.sample_time_s,
        "precision": args.precision,
        "deployable": verdict.document(),
        "unsafe": unsafe_note(verdict),
        "lacks": list(coupling.lacks),
        "holes": holes(coupling.schedule) or None,
    }
    return export(data, coupling, args.gains)


def _write(args: argparse.Namespace, files: dict[str, str]) -> list[str]:
    """Write files into the folder; return their paths."""
    from avc_casadi._util.files import write_file

    paths = [Path(args.c) / name for name in files]
    for path in paths:
        if path.is_file() and not args.force and b"; do not edit." not in path.read_bytes().partition(b"\n")[0]:
            what = "is there already and no export; allowed: another folder, another --name, or --force"
            raise avc.InputError.of(f"{str(path)!r} {what}", key="--c")
    with output_folder(args.c, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    return [str(path) for path in paths]


def _export_pair(coupling: Any, args: argparse.Namespace, console: Console) -> Answer:
    """Write both ends of a coupling to a simulation or a follower, or return its parameters for an engine."""
    from avc_casadi.present.engines import parameters
    from avc_casadi.present.rows.deploy import pair_export
    from avc_hardware import export_c
    from avc_hardware.codegen.pair_export import pair_verdict

    tool = coupling.problem.simulation
    judged, stable = pair_verdict(coupling, unsafe=args.unsafe)
    if args.parameters is not None:
        return parameters(coupling, args.parameters, args.gains, "" if stable else judged)
    with faults_of(args.gains, args), console.step("C"):
        files = export_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    data = {
        "coupling": coupling.id,
        "files": _write(args, files),
        "sample_time_s": coupling.sample_time_s,
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
    parser.add_argument("--device-id", metavar="ID", help="number of the device's chip; another one is refused")
    add_problem_of_gains(parser)
    add_unsafe(parser)


def run_push(args: argparse.Namespace, console: Console) -> Answer:
    """Push; a refusal is raised."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.rows import deploy, holes
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
    document["holes"] = holes(coupling.schedule) or None
    document["lacks"] = list(coupling.lacks)
    if args.port == EMULATOR:
        with console.step("firmware and plant in the loop"):
            document["in_the_loop"] = tried_or_say(coupling)
    equal = document["readback_equal"]
    complaint = "" if equal else f"avc: {args.port}: the table read back is not the one sent; push again"
    return replace(deploy.push(document, coupling, args.gains), code=0 if equal else 1, complaint=complaint)


def push_or_say(coupling: Coupling | None, *, unsafe: bool) -> dict[str, Any]:
    """Push to the emulated device and try it there; a failed push is a document too: ``skipped`` or ``refused``."""
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
    """Try a pushed coupling with a hand on the emulated device; an unsupported trial is ``{"skipped": why}``."""
    from avc_casadi._util.json_values import plain
    from avc_hardware import tried_in_the_loop

    try:
        found: dict[str, Any] = plain(tried_in_the_loop(coupling).document())
    except avc.UnsupportedError as error:
        return {"skipped": str(error)}
    return found


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
