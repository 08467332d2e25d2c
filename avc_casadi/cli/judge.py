"""Verbs that judge a coupling: certify, simulate, trial, zwidth."""

from __future__ import annotations

import argparse
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli.arguments import (
    add_verbose,
    add_workers,
    couples_to_simulation,
    gains_for,
    is_coupling,
    pair_of,
    positive_int,
    read_subject,
    refuse,
)
from avc_casadi.cli.console import PICTURES, Console, output_file, output_folder, write_figure, writing
from avc_casadi.design.registry import methods_help

if TYPE_CHECKING:
    from pathlib import Path

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.present.row import Answer

_TOLERANCE = 0.01
_OF_LAW = ("k", "b", "b_p", "cutoff_hz")
_OF_RUNS = ("against", "explain", "seed", "trace", "plot")
# A figure holds four distinguishable runs.
_MOST_OTHERS = 3


def add_certify(parser: argparse.ArgumentParser) -> None:
    """Say whether a coupling may be deployed, and which stability claims it meets.

    Each claim is given with its worst margin and where that stands. A coupling may go into a device where it is stable
    with every hand of [hands] and released. Or your own spring and damper: avc certify P --k 230 --b 1.2. Exit code 1
    if it may not.
    """
    parser.add_argument("problem", metavar="P", help="problem to judge against; or a coupling file, which has its own")
    parser.add_argument("gains", metavar="GAINS", nargs="?", help="coupling or gain file, .json or .csv")
    parser.add_argument(
        "--prove",
        action="store_true",
        help="ask for a proof of rest (L7), seconds a row: proved, refuted (with the hand) or open (with the reason)",
    )
    parser.add_argument("--proof-out", metavar="DIR", help="with --prove: write proofs and witnesses")
    group = parser.add_argument_group(
        "your own law in place of GAINS",
        "force = -(k x + (b + b_p) v); what is left out is 0. The wall of P is not used; P may be a device file.",
    )
    group.add_argument("--k", "--kp", type=float, metavar="K", help="spring, N/m; N.m/rad of a device that turns")
    group.add_argument("--b", "--kd", type=float, metavar="B", help="damper in the wall, N.s/m or N.m.s/rad")
    group.add_argument("--b-p", type=float, metavar="B", help="damper that acts outside the wall too")
    group.add_argument(
        "--cutoff-hz", type=float, metavar="F", help="first-order filter of the velocity (default: none)"
    )
    add_verbose(parser)
    parser.epilog = (
        "--prove proves rest (L7) with every hand, making and breaking contact, of the device as declared in its\n"
        "ranges: delay, amplifier and resonance too, without friction; gains, each row held, with or without state\n"
        'feedback, contact = "clip-last"; not with its dead zone, with an observer between encoder steps, or a guard'
    )


def run_certify(args: argparse.Namespace, console: Console) -> Answer:
    """Certify; 1 if the coupling is not deployable."""
    law = {key: value for key in _OF_LAW if (value := getattr(args, key)) is not None}
    if law:
        from avc_casadi.present.rows.own_law import own_law

        why = "goes with a file of gains, not with --k, --b"
        if args.gains is not None:
            raise avc.InputError.of(why, key="GAINS")
        refuse(args, ("prove", "proof_out"), why)
        with console.step("your own law"):
            return own_law(avc.certify_law(args.problem, **law), args.problem)
    if couples_to_simulation(args.problem):
        refuse(args, ("prove", "proof_out"))
        return _certify_pair(args, console)
    if args.proof_out is None:
        return _certify_wall(args, console, None)
    if not args.prove:
        raise avc.InputError.of("writes what --prove finds; give --prove too", key="--proof-out")
    with output_folder(args.proof_out, "--proof-out") as folder:
        return _certify_wall(args, console, folder)


def _certify_pair(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.design.tool_certificate import tool_certificate
    from avc_casadi.present.rows.judge import pair_certificate
    from avc_casadi.recommendation.preconditions import not_used

    problem, gains = pair_of(args.problem, args.gains)
    if gains is None:
        make = f"avc recommend {quote(args.problem)} --out c.json"
        raise avc.InputError.of(f"is missing; give a coupling to the simulation: {make}", key="GAINS")
    file = args.problem if args.gains is None else args.gains
    with console.step("certificate"):
        found = tool_certificate(problem, gains)
    passed = {"pass": found["stable"], "sentence": "linearly stable" if found["stable"] else "linearly unstable"}
    data = {"problem": problem.name, "gains": file, **vars(gains), "deployable": passed, **found}
    return pair_certificate(data | {"not_used": list(not_used(problem))}, problem, file)


def _certify_wall(args: argparse.Namespace, console: Console, proofs: Path | None) -> Answer:
    from avc_casadi._util.files import write_file
    from avc_casadi._util.json_values import json_text
    from avc_casadi.claims.proof_levels import proof_files
    from avc_casadi.claims.registry import asked_for
    from avc_casadi.files.catalogue import catalogue_names
    from avc_casadi.present.rows import holes
    from avc_casadi.present.rows.judge import certificate

    problem, coupling, notes = _subject_of_certify(args)
    with console.step(f"certificate of {coupling.schedule.rows} rows"):
        found = avc.certify(problem, coupling, prove=args.prove, progress=console)
    written = {} if proofs is None else proof_files(problem, found)
    for name, one in written.items():
        assert proofs is not None  # noqa: S101 - written to it alone
        write_file(proofs / name, json_text(one, problem.units))
    with console.step("table that runs"):
        verdict = avc.deployable(coupling, console).document()
    data = found.document() | {
        "claimed": asked_for(problem),
        "gains": args.problem if args.gains is None else args.gains,
        "notes": [*notes, *filter(None, [holes(coupling.schedule)])],
        "proof_files": list(written),
        "deployable": verdict,
    }
    # A coupling file names its problem, whose own file is not known here.
    named = problem.name if problem.name in catalogue_names() else "P"
    return certificate(data, problem, named if args.gains is None else args.problem)


def _subject_of_certify(args: argparse.Namespace) -> tuple[avc.Problem, Coupling, list[str]]:
    """Return the problem, the coupling and notes."""
    if args.gains is not None:
        problem = avc.load_problem(args.problem)
        return problem, *gains_for(problem, args.gains)
    if not is_coupling(args.problem):
        raise avc.InputError.of("is missing; give a coupling or gain file, .json or .csv", key="GAINS")
    coupling = read_subject("certify", args.problem, beside=f"avc certify P {quote(args.problem)}")
    return coupling.problem, coupling, []


def add_simulate(parser: argparse.ArgumentParser) -> None:
    """Simulate the scene of a problem: whether the device settles, and what is rendered.

    With its listed effects only, or with none listed with a hand, a wall and all that the device declares.
    Exit code 1 if the device does not settle.
    """
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


def run_simulate(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate, measure the cost of each effect, write and show; 1 if the device does not settle."""
    if args.tolerance is not None and not args.screen:
        raise avc.InputError.of("goes with --screen alone", key="--tolerance")
    if couples_to_simulation(args.problem):
        refuse(args, ("against", "explain", "screen"))
        return _simulate_pair(args, console)
    return _screen(args, console) if args.screen else _simulate_wall(args, console)


def _screen(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.model.gains import NO_COUPLING
    from avc_casadi.present.rows.judge import screening
    from avc_casadi.simulation.screen import screen

    refuse(args, _OF_RUNS, "does not go with --screen")
    problem, gains, notes = _subject_of_scene(args, console)
    tolerance = _TOLERANCE if args.tolerance is None else args.tolerance
    with console.step("the scene without each of its effects"):
        chosen = NO_COUPLING if gains is None else gains
        data = screen(problem, chosen, tolerance=tolerance, progress=console).document()
    return screening(data | {"notes": notes}, problem, args.problem)


def _outputs(args: argparse.Namespace) -> tuple[Path | None, Path | None]:
    plot = None if args.plot is None else output_file(args.plot, "--plot", PICTURES)
    trace = None if args.trace is None else output_file(args.trace, "--trace", (".npz",))
    if trace is not None:
        output_file(str(trace.with_suffix(".json")), "--trace", (".json",))  # the manifest
    return plot, trace


def _saved(
    runs: list[avc.Run], labels: list[str] | None, outputs: tuple[Path | None, Path | None], console: Console
) -> Path | None:
    """Write trace and figure of runs, and return the file of the trace."""
    plot, trace = outputs
    if trace is not None:
        with writing(trace, "--trace"):
            trace = runs[0].save(trace)
    if plot is not None:
        from avc_casadi.present.figures.scene import draw_scene

        with console.step("figure"):
            write_figure(plot, draw_scene(runs) if labels is None else draw_scene(runs, labels))
    return trace


def _simulate_wall(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.scene_coupling import compared, told_beside
    from avc_casadi.model.gains import NO_COUPLING, missing_rest_gains
    from avc_casadi.present.row import Answer as Result
    from avc_casadi.present.rows.judge import scene
    from avc_casadi.simulation.screen import explain

    outputs = _outputs(args)
    problem, gains, notes = _subject_of_scene(args, console)
    others = _others(args.against)
    why = "" if gains is None else missing_rest_gains(gains.schedule if isinstance(gains, Coupling) else gains)
    if why:
        file, key = (problem.name, "scene.coupling") if args.gains is None else (args.gains, "--gains")
        no = avc.InputError.of(why, file=file, key=key)
        return Result("refused", avc.fault_document(no), code=1, complaint=f"avc: {no}")
    with console.step(f"{problem.scene.duration_s:g} s of the scene"):
        found = avc.simulate(problem, gains, seed=args.seed)
        facts = told_beside(found)
        beside = [avc.simulate(problem, _gains_by(name, problem), seed=args.seed) for name in others]
    with console.step("cost of each effect"):
        parts = explain(problem, NO_COUPLING if gains is None else gains)
    trace = _saved([found, *beside], None, outputs, console)
    data = found.document(trace) | facts | parts.document() | {"notes": notes}
    if beside:
        data["against"] = [compared(run) for run in beside]
    answer = scene(data, problem, args.problem, args.plot)
    if args.explain:
        names = ("Effect", "Whole sample", "States", "Absent")
        rows = [replace(one, rank=0) if one.label.startswith(names) else one for one in answer.rows]
        keep = [one for one in rows if one.label == "Outcome" or one.label.startswith(names)]
        answer = replace(answer, rows=tuple(keep))
    return answer


def _simulate_pair(args: argparse.Namespace, console: Console) -> Answer:
    from avc_casadi.model.declared import with_gains
    from avc_casadi.present.rows.judge import scene

    outputs = _outputs(args)
    problem, gains = pair_of(args.problem, args.gains, console)
    assert gains is not None  # noqa: S101 - recommended where none were given
    staged = with_gains(problem, gains)
    with console.step(f"{staged.scene.duration_s:g} s of the scene"):
        found = avc.simulate(staged, seed=args.seed)
    trace = _saved([found], ["coupling to the simulation"], outputs, console)
    given = args.gains is not None or is_coupling(args.problem)
    data = found.document(trace) | {
        "coupling": "given" if given else "recommended",
        "effects": [{"kind": kind} for kind in found.effects],
        "contact_damping_ns_per_m": None,
        **vars(gains),
    }
    return scene(data, problem, args.problem, args.plot)


def _subject_of_scene(
    args: argparse.Namespace, console: Console
) -> tuple[avc.Problem, Coupling | GainSchedule | None, list[str]]:
    """Return the problem, the gains of its scene, and notes; None for a scene without coupling."""
    from avc_casadi.design.scene_coupling import scene_gains, scene_notes

    if is_coupling(args.problem):
        if args.gains is not None:
            raise avc.InputError.of("does not go with a coupling file; give the problem instead", key="--gains")
        coupling = read_subject("simulate", args.problem, beside=f"avc simulate P --gains {quote(args.problem)}")
        return coupling.problem, coupling, []
    problem = avc.load_problem(args.problem)
    if args.gains is not None:
        return problem, *gains_for(problem, args.gains)
    if (method := problem.scene.coupling) == "none":
        return problem, None, []
    with console.step(f"coupling: {method}"):
        return problem, scene_gains(problem, method), scene_notes(problem)


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


def add_trial(parser: argparse.ArgumentParser) -> None:
    """Try a coupling with any number of simulated hands: how many settle, with the exact interval.

    Hands are drawn uniformly from [hands] of the coupling's problem; each presses, taps and holds, with all that the
    problem declares of the device. No trace is kept: a million hands take some minutes on two cores.
    """
    parser.add_argument("coupling", metavar="COUPLING", help="coupling file, of `avc recommend P --out`")
    parser.add_argument("--hands", type=positive_int, default=10_000, metavar="N", help="hands (default 10000)")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the hands; the same seed, the same hands (default 0)"
    )
    parser.add_argument("--without-friction", action="store_true", help="leave the declared dry friction out")
    add_workers(parser)


def run_trial(args: argparse.Namespace, console: Console) -> Answer:
    """Try all hands and count."""
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.present.rows.judge import trial
    from avc_casadi.simulation.population.settled import settled_hands

    coupling = read_subject("trial", args.coupling)
    workers = processors() if args.workers is None else args.workers
    with cluster(args.scheduler) as executor, console.step(f"{args.hands} hands"):
        found = settled_hands(
            coupling,
            args.hands,
            args.seed,
            friction=not args.without_friction,
            workers=workers,
            executor=executor,
            progress=console,
        )
    return trial(found.document(), coupling.problem.units, args.coupling)


def add_zwidth(parser: argparse.ArgumentParser) -> None:
    """Show which walls the device can render, without coupling and with a constant one."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--method", help=f"place the walls that its gains render in the region: {methods_help()}")
    parser.add_argument("--plot", metavar="FILE", help="draw the region: .png, .svg or .pdf")
    add_verbose(parser)


def run_zwidth(args: argparse.Namespace, console: Console) -> Answer:
    """Compute the region, draw and show."""
    plot = None if args.plot is None else output_file(args.plot, "--plot", PICTURES)
    if couples_to_simulation(args.problem):
        refuse(args, ("method",))
        return _region_of_pairs(args, plot, console)
    return _region_of_walls(args, plot, console)


def _region_of_pairs(args: argparse.Namespace, plot: Path | None, console: Console) -> Answer:
    from avc_casadi.design.tool_region import tool_region
    from avc_casadi.present.rows.judge import region

    problem, _ = pair_of(args.problem, None)
    with console.step("region"):
        found = tool_region(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.tool_region import draw_tool_region

        with console.step("figure"):
            write_figure(plot, draw_tool_region(found))
    return region(found.document(), problem, args.problem, args.plot)


def _region_of_walls(args: argparse.Namespace, plot: Path | None, console: Console) -> Answer:
    import numpy as np

    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.levels import ideal
    from avc_casadi.claims.zwidth import llewellyn_table, rendered_wall, zwidth
    from avc_casadi.design.constant.static import static_coupling
    from avc_casadi.present.rows.judge import walls

    problem = avc.load_problem(args.problem)
    with console.step("region"):
        found = zwidth(problem, console)
    gains, rendered = None, {}
    if args.method is not None:
        with console.step(f"{args.method}: {len(problem.frequencies_hz())} frequencies"):
            gains = avc.solve(problem, args.method, progress=console)
            rendered[args.method] = rendered_wall(problem, gains)
    known, refused = ideal(problem.device), list(found.refused)
    whole = problem.device.damping_ns_per_m > 0 and known
    with console.step("static couplings"):
        llewellyn = llewellyn_table(problem) if whole else None
        kinds = [(condition, model) for condition in ("llewellyn", "all") for model in ("paper", "sampled-data")]
        static = [static_coupling(problem, condition, model) for condition, model in kinds] if whole else []  # type: ignore[arg-type]
    if not known:
        refused.append("constant couplings: known for a rigid device, ideal amplifier and whole samples of delay")
    if plot is not None:
        from avc_casadi.present.figures.zwidth import draw_zwidth

        with console.step("figure"):
            drawn = llewellyn_table(problem, np.linspace(0.0, 8.0, 401)) if llewellyn is not None else None
            write_figure(plot, draw_zwidth(found, drawn, rendered))
    data = found.document() | {
        "llewellyn": None
        if llewellyn is None
        else plain({"delay_samples": llewellyn.delay_samples} | llewellyn.to_dict()),
        "static": [plain(vars(coupling)) for coupling in static],
        "refused": refused,
    }
    if gains is not None:
        (b, k), frequency = rendered[args.method], gains.frequency_hz
        columns = {"frequency_hz": frequency, "wall_damping_ns_per_m": b, "wall_stiffness_n_per_m": k}
        data["gains"] = {"method": args.method} | plain(columns)
    return walls(data, problem, args.problem, args.plot)
