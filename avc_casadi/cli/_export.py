"""Write a coupling as C for firmware of your own: avc_coupling.h and avc_coupling.c."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_folder
from avc_casadi.cli._subject import (
    add_problem_of_gains,
    add_unsafe,
    faults_of,
    read_subject,
    unsafe_note,
)

# Names of `avc_casadi.present.pages.engines`.
ENGINES = ("mujoco", "chai3d", "unity", "sofa", "openhaptics", "imstk", "ros2", "pybullet")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nThe whole coupling at its own sample time: wall, look-up, estimator, adaptation, observer, guard\n"
        "and force limit, in C99 that is also C++11 and later. A coupling that is not deployable is refused with exit\n"
        "code 1; --unsafe overrides. Of a coupling to a [simulation] both ends, the device's and the engine's; or its\n"
        "numbers in the parameters of an engine (--parameters). Of a coupling to a [follower] one source for both ends."
    )
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


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Write both files, or print the parameters."""
    from avc_casadi.claims.deployable import require_deployable
    from avc_casadi.files.other_end_coupling_file import is_teleoperator_coupling, is_tool_coupling
    from avc_casadi.present.pages.bench import export_page
    from avc_casadi.present.pages.subject import holes
    from avc_hardware import export_c

    if is_tool_coupling(args.gains):
        return _to_simulation(args, console)
    if is_teleoperator_coupling(args.gains):
        return _to_follower(args, console)
    if args.parameters is not None:
        raise avc.InputError.of(
            "is of a coupling to a [simulation], and this file holds none; for C: --c DIR",
            file=args.gains,
            key="--parameters",
        )
    coupling = read_subject("export", args.gains, args.problem)
    verdict = require_deployable(coupling, unsafe=args.unsafe)
    with faults_of(args.gains, args), console.step("C"):
        files = export_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    written = _written(args.c, files)
    document: dict[str, Any] = {
        "schema": "avc-export/2",
        "coupling": coupling.id,
        "files": written,
        "rows": len(coupling.table),
        "sample_time_s": coupling.sample_time_s,
        "precision": args.precision,
        "deployable": verdict.document(),
        "unsafe": unsafe_note(verdict),
        "lacks": list(coupling.lacks),
    }
    document["holes"] = holes(coupling.schedule) or None
    return Answer(document, export_page(document, coupling, console.page, args.gains), more="\n".join(written))


def _written(to: str, files: dict[str, str]) -> list[str]:
    """Write files into a folder; returns their paths."""
    from avc_casadi._util.files import write_file

    with output_folder(to, "--c") as folder:
        for name, text in files.items():
            write_file(folder / name, text)
    return [str(Path(to) / name) for name in files]


def _to_simulation(args: argparse.Namespace, console: Console) -> Answer:
    """Write both ends of a coupling to a [simulation], or print its parameters for an engine."""
    from avc_casadi.claims.stability.tool_loop import ToolLoops
    from avc_casadi.cli._to_simulation import read_tool
    from avc_casadi.present.pages import engines
    from avc_hardware import export_tool_c
    from avc_hardware.codegen.other_end_export import verdict

    if args.problem:
        raise avc.InputError.of("is of couplings to a wall; leave it out", file=args.gains, key="--problem")
    coupling = read_tool(args.gains)
    loops = ToolLoops(coupling.problem)
    if args.parameters is not None:
        judged = verdict(coupling.problem, loops, coupling.gains, unsafe=args.unsafe)
        found = engines.tool_parameters(coupling, args.parameters)
        if not loops.stable(coupling.gains):
            found["traps"].insert(0, judged)
        return Answer(found, engines.parameters_page(found, coupling, console.page, args.gains))
    with faults_of(args.gains, args), console.step("C"):
        files = export_tool_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    written, stable = _written(args.c, files), loops.stable_over_ranges(coupling.gains)
    document = {
        "schema": "avc-export-tool/1",
        "coupling": coupling.id,
        "files": written,
        "sample_time_s": coupling.problem.device.sample_time_s,
        "step_s": list(coupling.tool.step_s),
        "exchange": coupling.tool.exchange,
        "precision": args.precision,
        "unsafe": "" if stable else "UNSAFE, went on by request: a loop is linearly unstable",
    }
    return Answer(document, engines.tool_export_page(document, coupling, console.page, args.gains))


def _to_follower(args: argparse.Namespace, console: Console) -> Answer:
    """Write both ends of a teleoperator's coupling."""
    from avc_casadi._util.units import speak
    from avc_casadi.claims.stability.bilateral import BilateralLoops
    from avc_casadi.files.other_end_coupling_file import read_teleoperator_coupling
    from avc_casadi.present.pages.bilateral import bilateral_export_page
    from avc_hardware import export_teleoperator_c

    alien = [option for option in ("problem", "parameters") if getattr(args, option)]
    if alien:
        message = "is of couplings to something else than a [follower]; for C: --c DIR alone"
        raise avc.InputError.of(message, file=args.gains, key=f"--{alien[0]}")
    coupling = read_teleoperator_coupling(args.gains)
    speak(coupling.problem.units)
    with faults_of(args.gains, args), console.step("C"):
        files = export_teleoperator_c(coupling, precision=args.precision, name=args.name, unsafe=args.unsafe)
    written, stable = _written(args.c, files), BilateralLoops(coupling.problem).stable_over_ranges(coupling.gains)
    document = {
        "schema": "avc-export-teleoperator/1",
        "coupling": coupling.id,
        "files": written,
        "sample_time_s": coupling.problem.device.sample_time_s,
        "follower_sample_time_s": coupling.follower.sample_time_s,
        "precision": args.precision,
        "unsafe": "" if stable else "UNSAFE, went on by request: a loop is linearly unstable",
    }
    return Answer(document, bilateral_export_page(document, coupling, console.page, args.gains))
