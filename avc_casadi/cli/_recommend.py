"""Recommend the coupling to deploy: its gains, what it renders, what limits it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._versions import package_versions

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from avc_casadi.recommendation.recommend import Recommendation

_PHYSICAL_WALL = (
    "the physical wall, which does not know of samples: Z = m s + b_d + b_e + k_e/s at s = j omega, relative to |Z|"
)
_NO_COMPILER = (
    "avc: no C compiler is found (cc, or what CC names): hands are simulated without one, which takes some fifteen "
    "times as long"
)
_HANDS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nExit code 1 if no coupling is deployable: linearly stable with every hand of [hands] and released."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--out", metavar="FILE", help="write the coupling, .json: for push, stream, export, simulate")
    parser.add_argument(
        "--stiffest",
        action="store_true",
        help="search the stiffest wall that the device can give, and what would help",
    )
    parser.add_argument(
        "--lean-on-friction",
        action="store_true",
        help="take the stiffest coupling with which hands settle by the declared dry friction, if not without it",
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help="prove what is chosen, as avc certify --prove does: minutes where it is robust",
    )
    parser.add_argument("--hands", type=positive_int, metavar="N", help=f"simulated hands (default {_HANDS})")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Recommend, write and show; 1 if nothing can be deployed."""
    if args.stiffest and args.out is not None:
        raise avc.InputError.of("goes with a recommendation, not with --stiffest; leave one of them out", key="--out")
    if args.stiffest and args.prove:
        raise avc.InputError.of("goes with a recommendation, not with --stiffest; leave one of them out", key="--prove")
    hands = _HANDS if args.hands is None else args.hands
    out = None if args.out is None else output_file(args.out, "--out", (".json",))
    with console.step(args.problem):
        problem = load_problem(args.problem)
    if problem.simulation is not None or problem.follower is not None:
        return _to_other_end(args, console, problem, hands, out)
    return _before_wall(args, console, problem, hands, out)


def _before_wall(
    args: argparse.Namespace, console: Console, problem: avc.Problem, hands: int, out: Path | None
) -> Answer:
    """Recommend a coupling to a wall, or find the stiffest one, write and show it; 1 if none can be deployed."""
    from avc_casadi._util.json_values import json_text
    from avc_casadi._util.parallel import processors
    from avc_casadi.files.coupling_file import coupling_document
    from avc_casadi.present.pages.recommendation import recommendation_page
    from avc_casadi.present.pages.recommendation_lines import recommendation_lines, stiffest_lines
    from avc_casadi.present.pages.stiffest import stiffest_page
    from avc_casadi.recommendation.recommend import recommend
    from avc_casadi.recommendation.stiffest import stiffest
    from avc_casadi.simulation.native import compiler

    if compiler() is None:
        console.notice(_NO_COMPILER)
    workers = min(2, processors())
    if args.stiffest:
        document = stiffest(problem, hands, lean_on_friction=args.lean_on_friction, workers=workers, progress=console)
        text = stiffest_page(document, problem, console.page, args.problem)
        return Answer(document, text, more="\n".join(stiffest_lines(document)))
    with console.step(f"candidates with {hands} hands"):
        found = recommend(
            problem,
            hands,
            lean_on_friction=args.lean_on_friction,
            prove=args.prove,
            versions=package_versions(),
            workers=workers,
            progress=console,
        )
    written = None
    # What the trials refuse, other verbs would take: they judge linear stability alone.
    if out is not None and found.coupling is not None and found.deployable:
        write_text(out, json_text(coupling_document(found.coupling)), "--out")
        written = str(out)
    document = recommend_document(found)
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    text = recommendation_page(document, problem, console.page, args.problem, written)
    more = "\n".join(recommendation_lines(document))
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint, more=more)


def _to_other_end(
    args: argparse.Namespace, console: Console, problem: avc.Problem, hands: int, out: Path | None
) -> Answer:
    """Recommend a coupling to a [simulation] or a [follower], write and show it; 1 if none can be deployed."""
    from avc_casadi.files.other_end_coupling_file import write_other_end
    from avc_casadi.present.pages.virtual_tool import tool_page
    from avc_casadi.recommendation.virtual_tool import recommend_tool

    alien = [option for option in ("stiffest", "lean_on_friction", "prove") if getattr(args, option)]
    if alien:
        key = f"--{alien[0].replace('_', '-')}"
        raise avc.InputError.of("is asked of walls, and the other end is none; leave it out", key=key)
    if problem.follower is not None:
        return _to_follower(args, console, problem, hands, out)
    with console.step(f"couplings with {hands} hands"):
        found = recommend_tool(problem, hands, versions=package_versions(), progress=console)
    if out is not None and found.coupling is not None:
        write_other_end(found.coupling, out)
    document = found.document()
    text = tool_page(document, problem, console.page, args.problem, args.out, verbose=args.verbose)
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint)


def _to_follower(
    args: argparse.Namespace, console: Console, problem: avc.Problem, hands: int, out: Path | None
) -> Answer:
    """Recommend the coupling of a teleoperator, write and show it; 1 if none can be deployed."""
    from avc_casadi.files.other_end_coupling_file import write_other_end
    from avc_casadi.present.pages.bilateral import bilateral_page
    from avc_casadi.recommendation.bilateral import recommend_bilateral

    with console.step(f"couplings with {hands} hands"):
        found = recommend_bilateral(problem, hands, versions=package_versions(), progress=console)
    if out is not None and found.coupling is not None:
        write_other_end(found.coupling, out)
    document = found.document()
    written = None if found.coupling is None else args.out
    text = bilateral_page(document, problem, console.page, args.problem, written, verbose=args.verbose)
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint)


def recommend_document(found: Recommendation) -> dict[str, Any]:
    """Return the `recommend` document, with the reference of its impedance error."""
    document = found.document()
    if "complex_error" in document["felt"]:
        document["felt"]["complex_error_from"] = _PHYSICAL_WALL
    return document
