"""Verbs that deploy a coupling: export, push, firmware."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder
from avc_casadi.present.row import Answer

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device as DeviceModel
    from avc_hardware import BoardLimits

# Names of engines in `avc_casadi.present.rows.deploy`.
ENGINES = ("mujoco", "chai3d", "unity", "sofa", "openhaptics", "imstk", "ros2", "pybullet")
_IN_CONTACT = "the device is in contact: release it, out of the wall; the new coupling takes over there"
_USUAL_BAUD = 115200


@cli.verb(
    cli.COUPLING,
    cli.argument("--c", metavar="DIR", text="folder for avc_coupling.h and avc_coupling.c"),
    cli.argument(
        "--parameters",
        choices=ENGINES,
        metavar="ENGINE",
        text=f"in place of C: numbers of a coupling to a [simulation] for an engine: {', '.join(ENGINES)}",
    ),
    cli.argument(
        "--precision",
        choices=("single", "double"),
        default="single",
        text="single (default): float, as in the packaged firmware; double: where a processor has it in hardware",
    ),
    cli.argument("--name", default="avc_coupling", text="what files and names in C begin with (default: avc_coupling)"),
    cli.flag("--force", "write over a file that is there and is no export"),
    cli.BESIDE,
    cli.UNSAFE,
    cli.VERBOSE,
)
def run_export(args: argparse.Namespace, console: Console) -> Answer:
    """Write a coupling as C for firmware of your own: avc_coupling.h and avc_coupling.c.

    The whole coupling at its own sample time, in C99 that is also C++11; of one to a [simulation] or a [follower] both
    ends. What is not deployable is refused with exit code 1; --unsafe overrides.
    """
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.rows import deploy, holes
    from avc_casadi.present.rows.deploy import parameters
    from avc_hardware import export_c
    from avc_hardware.codegen.pair_export import pair_verdict

    if (args.c is None) == (args.parameters is None):
        raise avc.InputError.of("is missing; allowed: --c DIR or --parameters ENGINE", key="--c")
    coupling = avc.read_coupling(args.gains, args.problem)
    if coupling.end != "simulation":
        cli.refuse(args, "parameters", why=f"is of a [simulation], not of a {coupling.end}; for C: --c DIR")
    data: dict[str, Any] = {
        "coupling": coupling.id,
        "sample_time_s": coupling.sample_time_s,
        "precision": args.precision,
    }
    if coupling.end == "wall":
        verdict = require_deployable(coupling, unsafe=args.unsafe)
        data |= {
            "rows": len(coupling.table),
            "deployable": verdict.document(),
            "unsafe": cli.unsafe_note(verdict),
            "lacks": list(coupling.lacks),
            "holes": holes(coupling.schedule) or None,
        }
    else:
        judged, stable = pair_verdict(coupling, unsafe=args.unsafe)
        if args.parameters is not None:
            return parameters(coupling, args.parameters, args.gains, "" if stable else judged)
        data["unsafe"] = "" if stable else "UNSAFE, went on by request: a loop is linearly unstable"
    if coupling.end == "simulation":
        data |= {"step_s": list(coupling.tool.step_s), "exchange": coupling.tool.exchange}
    elif coupling.end == "follower":
        data["follower_sample_time_s"] = coupling.follower.sample_time_s
    with cli.faults_of(args.gains, args), console.step("C"):
        files = export_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    data["files"] = _write(args, files)
    return deploy.export(data, coupling, args.gains)


def _write(args: argparse.Namespace, files: dict[str, str]) -> list[str]:
    """Write files into the folder; return their paths."""
    paths = [Path(args.c) / name for name in files]
    for path in paths:
        if path.is_file() and not args.force and b"; do not edit." not in path.read_bytes().partition(b"\n")[0]:
            what = "is there already and no export; allowed: another folder, another --name, or --force"
            raise avc.InputError.of(f"{str(path)!r} {what}", key="--c")
    with output_folder(args.c, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    return [str(path) for path in paths]


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
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.present.rows import deploy, holes
    from avc_hardware import EMULATOR, push

    coupling = cli.read_wall(args.gains, args.problem)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    with cli.faults_of(args.gains, args), console.step(f"push to {args.port}"):
        done = push(
            coupling,
            args.port,
            baud=args.baud,
            on_silence=console.notice,
            unsafe=args.unsafe,
            device_id=args.device_id,
            # The emulated device is released by itself.
            on_wait=lambda: None if args.port == EMULATOR else console.say(_IN_CONTACT),
        )
    data = plain({"coupling": coupling.id, "deployable": verdict.document()} | done.document())
    data |= {"unsafe": cli.unsafe_note(verdict), "holes": holes(coupling.schedule) or None, "lacks": [*coupling.lacks]}
    if args.port == EMULATOR:
        with console.step("firmware and plant in the loop"):
            data["in_the_loop"] = in_the_loop(coupling)
    answer = deploy.push(data, coupling, args.gains)
    if data["readback_equal"]:
        return answer
    complaint = f"avc: {args.port}: the table read back is not the one sent; push again"
    return replace(answer, complaint=complaint)


def in_the_loop(coupling: Coupling) -> dict[str, Any]:
    """Try a pushed coupling with a hand on the emulated device; an unsupported trial is ``{"skipped": why}``."""
    from avc_hardware import tried_in_the_loop

    try:
        found: dict[str, Any] = plain(tried_in_the_loop(coupling).document())
    except avc.UnsupportedError as error:
        return {"skipped": str(error)}
    return found


@cli.verb(
    cli.argument(
        "subject", metavar="SUBJECT", text="device or problem; or a coupling file, for what runs beside its gains"
    ),
    cli.argument(
        "--board", required=True, text="a board (a wrong name lists them), or the folder of your own (PORTING.md)"
    ),
    cli.argument("--out", required=True, metavar="DIR", text="folder for the .elf, .bin and .hex file"),
    cli.argument("--baud", type=cli.positive_int, text="rate of its serial port; default 115200; push needs the same"),
)
def run_firmware(args: argparse.Namespace, console: Console) -> Answer:
    """Build firmware for a device, its sample time, encoder and force limit built in.

    No gains are in it: they are pushed (avc push). It needs the board's compiler: arm-none-eabi-gcc, or your folder's.
    """
    from avc_casadi.files.problem_file import is_device
    from avc_casadi.present.rows.deploy import firmware
    from avc_hardware import build_firmware

    subject: Coupling | avc.Problem | DeviceModel
    if cli.is_coupling(args.subject):
        subject = cli.read_wall(args.subject)
    else:
        subject = avc.load_device(args.subject).device if is_device(args.subject) else avc.load_problem(args.subject)
    with output_folder(args.out, "--out") as folder, console.step(f"firmware for {args.board}"):
        built = build_firmware(subject, args.board, folder, baud=args.baud)
    data: dict[str, Any] = plain(
        {
            "board": built.board,
            "build": built.build,
            "baud": args.baud or _USUAL_BAUD,
            "files": [str(Path(args.out) / path.name) for path in built.files],
            "address": built.address,
            "size_bytes": built.size,
            "limits": vars(built.limits),
            "figures": vars(built.figures),
            "commands": list(built.commands),
            "notes": _notes(subject, built.limits),
        }
    )
    at = "" if args.baud in (None, _USUAL_BAUD) else f" --baud {args.baud}"
    return firmware(data, built.title, subject.units, f"pushed: avc push{at}; estimator {built.figures.estimator}")


def _notes(subject: Coupling | avc.Problem | DeviceModel, limits: BoardLimits) -> list[str]:
    """Describe defaults of the image that the file does not give, and keys of the file that it ignores."""
    problem = getattr(subject, "problem", subject)
    device = getattr(problem, "device", problem)
    notes = []
    if getattr(problem, "detent", None) is not None:
        notes.append("[detent] has no place in what is pushed: export it (avc export)")
    for key, value in (("max_force_n", limits.max_force_n), ("encoder_resolution_m", limits.metres_per_count)):
        if not getattr(device, key):
            name = device.units.key(key)
            notes.append(f"the file has no device.{name}: {number(value)} is the board's own; give the device's")
    return notes
