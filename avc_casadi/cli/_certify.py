"""Say whether a coupling may be deployed, and which stability claims it meets."""

from __future__ import annotations

import argparse
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi._util.text import rows_text
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._certify_law import add_law, certify_law, has_law
from avc_casadi.cli._certify_tool import certify_tool
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_folder
from avc_casadi.cli._foreign import gains_for
from avc_casadi.cli._subject import is_coupling, load_problem, read_subject
from avc_casadi.cli._to_simulation import couples_to_simulation

if TYPE_CHECKING:
    from pathlib import Path

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.schedule import GainSchedule


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Say which stability claims a coupling meets, with the worst margin of each and where it stands, and whether\n"
        "it may go into a device: stable with every hand of [hands] and released. Or your own spring and damper:\n"
        "avc certify P --k 230 --b 1.2. Exit code 1 if it may not."
    )
    parser.add_argument("problem", metavar="P", help="problem to judge against; or a coupling file, which has its own")
    parser.add_argument("gains", metavar="GAINS", nargs="?", help="coupling or gain file, .json or .csv")
    parser.add_argument(
        "--requested", action="store_true", help="judge what unrealisable rows asked for in place of missing gains"
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help="ask for a proof of rest (L7), seconds a row: proved, refuted (with the hand) or open (with the reason)",
    )
    parser.add_argument(
        "--proof-out",
        metavar="DIR",
        help="with --prove: write proofs and witnesses",
    )
    add_law(parser)
    add_verbose(parser)
    parser.epilog = _PROVABLE


_PROVABLE = """\
--prove proves rest (L7) with every hand, making and breaking contact, of the device as declared in its ranges: delay,
amplifier and resonance too, without friction; gains, each row held, with or without state feedback, contact =
"clip-last"; not with its dead zone, with an observer between encoder steps, or a guard
"""


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Certify; 1 if the coupling is not deployable."""
    if has_law(args):
        return certify_law(args, console)
    if couples_to_simulation(args.problem):
        return certify_tool(args, console)
    if args.proof_out is None:
        return _certify(args, console, None)
    if not args.prove:
        raise avc.InputError.of("writes what --prove finds; give --prove too", key="--proof-out")
    with output_folder(args.proof_out, "--proof-out") as folder:
        return _certify(args, console, folder)


def _certify(args: argparse.Namespace, console: Console, proofs: Path | None) -> Answer:
    from avc_casadi._util.files import write_file
    from avc_casadi._util.json_values import json_text
    from avc_casadi.claims.proof_levels import proof_files
    from avc_casadi.claims.registry import asked_for
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.catalogue import catalogue_names
    from avc_casadi.present.pages.certificate import certificate_lines, certificate_page
    from avc_casadi.present.pages.subject import holes

    problem, gains, coupling, notes = _judged(args)
    file = args.problem if args.gains is None else args.gains
    with console.step(f"certificate of {rows_text(gains.rows)}"):
        found = avc.certify(problem, coupling or gains, requested=args.requested, prove=args.prove, progress=console)
    if coupling is None and gains.usable.any():
        coupling = Coupling.of(problem, gains)
    notes = [*notes, *filter(None, [holes(gains)])]
    certificate = found.document()
    written: list[str] = []
    if proofs is not None:
        for name, one in proof_files(problem, found).items():
            write_file(proofs / name, json_text(one))
            written.append(name)
    with console.step("table that runs"):
        verdict = None if coupling is None else avc.deployable(coupling, console)
    claimed = asked_for(problem)
    deployment = (
        {"pass": False, "sentence": "not deployable: no row has gains"} if verdict is None else verdict.document()
    )
    document = {
        "schema": "avc-certify/1",
        "claimed": claimed,
        "gains": file,
        "notes": notes,
        "proof_files": written,
        "deployable": deployment,
    } | certificate
    # A coupling file names its problem, whose own file is not known here.
    named = problem.name if problem.name in catalogue_names() else "P"
    shown = named if args.gains is None else args.problem
    complaint = "" if deployment["pass"] else f"avc: {problem.name}: {file} is not deployable"
    return Answer(
        document,
        certificate_page(document, problem, console.page, shown),
        code=1 if complaint else 0,
        complaint=complaint,
        more="\n".join(certificate_lines(document, problem)),
    )


def _judged(args: argparse.Namespace) -> tuple[avc.Problem, GainSchedule, Coupling | None, list[str]]:
    """Return the problem, the gains, the coupling if a file of one was given, and notes."""
    from avc_casadi.coupling import Coupling

    if args.gains is not None:
        problem = load_problem(args.problem)
        found, notes = gains_for(problem, args.gains)
        return (problem, found.schedule, found, notes) if isinstance(found, Coupling) else (problem, found, None, notes)
    if not is_coupling(args.problem):
        raise avc.InputError.of("is missing; give a coupling or gain file, .json or .csv", key="GAINS")
    coupling = read_subject("certify", args.problem, beside=f"avc certify P {quote(args.problem)}")
    return coupling.problem, coupling.schedule, coupling, []
