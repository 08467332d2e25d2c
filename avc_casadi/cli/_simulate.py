"""Simulate the scene of a problem: whether the device settles, and what is rendered."""

from __future__ import annotations

import argparse
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure, writing
from avc_casadi.cli._foreign import gains_for
from avc_casadi.cli._screen import screened
from avc_casadi.cli._simulate_tool import simulate_tool
from avc_casadi.cli._subject import is_coupling, load_problem, read_subject
from avc_casadi.cli._to_simulation import couples_to_simulation

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.schedule import GainSchedule

_TOLERANCE = 0.01
_OF_RUNS = ("against", "explain", "seed", "trace", "plot")
# A figure holds four distinguishable runs.
_MOST_OTHERS = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Simulate the scene of a problem file and say what the hand would feel: with its listed effects only, or with\n"
        "none listed with a hand, a wall and all that the device declares.\n"
        "Exit code 1 if the device does not settle."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue; or a coupling file")
    parser.add_argument("--gains", metavar="GAINS", help="coupling or gain file in place of the scene's own coupling")
    parser.add_argument(
        "--against", metavar="C1,C2", help="simulate and draw other couplings too: up to 3 of none and the methods"
    )
    parser.add_argument("--explain", action="store_true", help="show what each effect adds, and which are absent")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="other draws of all noises (default 0)")
    parser.add_argument("--trace", metavar="FILE", help="write all traces (.npz) and a manifest beside them (.json)")
    parser.add_argument("--plot", metavar="FILE", help="draw the run: .png, .svg or .pdf")
    parser.add_argument(
        "--screen", action="store_true", help="leave out each effect in turn instead, and say which ones it needs"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=None,
        metavar="TOL",
        help="of --screen: largest relative change of position, force and stiffness that does not count "
        f"(default {_TOLERANCE})",
    )
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate, measure the cost of each effect, write and show; 1 if the device does not settle."""
    if couples_to_simulation(args.problem):
        return simulate_tool(args, console)
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.scene_coupling import compared, told_beside
    from avc_casadi.model.gains import NO_COUPLING, missing_rest_gains
    from avc_casadi.present.pages.scene import explanation_lines, outcome, scene_lines, scene_page
    from avc_casadi.simulation.screen import explain

    if args.screen:
        wrong = [key for key in _OF_RUNS if getattr(args, key)]
        if wrong:
            raise avc.InputError.of("does not go with --screen", key=f"--{wrong[0]}")
        tolerance = _TOLERANCE if args.tolerance is None else args.tolerance
        return screened(*_subject(args, console), tolerance, console, args.problem)
    if args.tolerance is not None:
        raise avc.InputError.of("goes with --screen alone", key="--tolerance")
    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    trace = None if args.trace is None else output_file(args.trace, "--trace", (".npz",))
    if trace is not None:
        output_file(str(trace.with_suffix(".json")), "--trace", (".json",))  # the manifest
    problem, gains, notes = _subject(args, console)
    others = _others(args.against)
    why = "" if gains is None else missing_rest_gains(gains.schedule if isinstance(gains, Coupling) else gains)
    if why:
        file, key = (problem.name, "scene.coupling") if args.gains is None else (args.gains, "--gains")
        no = avc.InputError.of(why, file=file, key=key)
        return Answer(avc.fault_document(no), "", code=1, complaint=f"avc: {no}")
    with console.step(f"{problem.scene.duration_s:g} s of the scene"):
        found = avc.simulate(problem, gains, seed=args.seed)
        told = told_beside(found)
        beside = [avc.simulate(problem, _gains_by(name, problem), seed=args.seed) for name in others]
    with console.step("cost of each effect"):
        parts = explain(problem, NO_COUPLING if gains is None else gains)
    if trace is not None:
        with writing(trace, "--trace"):
            trace = found.save(trace)
    if plot is not None:
        from avc_casadi.present.figures.scene import draw_scene

        with console.step("figure"):
            write_figure(plot, draw_scene([found, *beside]))
    document = found.document(trace) | told | parts.document() | {"notes": notes}
    if beside:
        document["against"] = [compared(run) for run in beside]
    complaint = "" if found.stable else f"avc: {problem.name}: the device {outcome(document)}"
    text = scene_page(document, problem, console.page, args.problem, args.plot)
    if args.explain:
        text = "\n".join([text, "", *explanation_lines(document)])
    more = "" if args.explain else "\n".join(scene_lines(document))
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint, more=more)


def _subject(
    args: argparse.Namespace, console: Console
) -> tuple[avc.Problem, Coupling | GainSchedule | None, list[str]]:
    """Return the problem, the gains of its scene, and notes; None for a scene without coupling."""
    if not is_coupling(args.problem):
        problem = load_problem(args.problem)
        return problem, *gains_of(args.gains, problem, console)
    if args.gains is not None:
        raise avc.InputError.of("does not go with a coupling file; give the problem instead", key="--gains")
    coupling = read_subject("simulate", args.problem, beside=f"avc simulate P --gains {quote(args.problem)}")
    return coupling.problem, coupling, []


def _others(text: str | None) -> list[str]:
    """Split the couplings of --against and check them."""
    from avc_casadi.design.registry import METHODS

    names = [] if text is None else [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in ("none", *METHODS)]
    if wrong or len(names) > _MOST_OTHERS:
        what = f"{', '.join(wrong)}: no coupling" if wrong else f"{len(names)} couplings"
        allowed = f"none, {', '.join(METHODS)}; at most {_MOST_OTHERS}, separated by commas"
        raise avc.InputError.of(f"{what}; allowed: {allowed}", key="--against")
    return names


def _gains_by(name: str, problem: avc.Problem) -> Gains | GainSchedule:
    from avc_casadi.model.gains import NO_COUPLING

    return NO_COUPLING if name == "none" else avc.solve(problem, name)


def gains_of(
    file: str | None, problem: avc.Problem, console: Console
) -> tuple[Coupling | GainSchedule | None, list[str]]:
    """Return the content of a file, or the gains of the scene's coupling, and notes; None for a scene without any."""
    from avc_casadi.design.scene_coupling import scene_gains, scene_notes

    if file is not None:
        return gains_for(problem, file)
    method = problem.scene.coupling
    if method == "none":
        return None, []
    with console.step(f"coupling: {method}"):
        return scene_gains(problem, method), scene_notes(problem)
