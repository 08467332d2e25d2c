"""Verbs that judge a coupling: certify, simulate, trial, zwidth."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder, write_figure
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.scene_coupling import SimulatedPair
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.model.gains import Gains


@cli.verb(
    cli.argument("problem", metavar="P", text="problem to judge against; or a coupling file, which has its own"),
    cli.argument("gains", metavar="GAINS", nargs="?", text="coupling or gain file, .json or .csv"),
    cli.flag("--prove", "ask for a proof of rest (L7), seconds a row: proved, refuted (with the hand) or open (why)"),
    cli.argument("--proof-out", metavar="DIR", text="--prove, and write proofs and witnesses"),
    cli.argument("--k", "--kp", type=float, metavar="K", text="own law: spring, N/m; N.m/rad of a device that turns"),
    cli.argument("--b", "--kd", type=float, metavar="B", text="own law: damper in the wall, N.s/m or N.m.s/rad"),
    cli.argument("--b-p", type=float, metavar="B", text="own law: damper that acts outside the wall too"),
    cli.argument("--cutoff-hz", type=float, metavar="F", text="own law: first-order filter of the velocity (none)"),
    cli.VERBOSE,
)
def run_certify(args: argparse.Namespace, console: Console) -> Answer:
    """Say whether a coupling may be deployed, and which stability claims it meets.

    It may where it is stable with every hand of [hands] and released; exit code 1 if not. Or of your own law in place
    of GAINS, force = -(k x + (b + b_p) v): avc certify P --k 230 --b 1.2; what is left out is 0, the wall of P is not
    used, P may be a device file, and to another end they are K, B and the damper of the device's own loop. --prove
    proves rest (L7) over the device's ranges, without friction.
    """
    law = {key: getattr(args, key) for key in ("k", "b", "b_p", "cutoff_hz") if getattr(args, key) is not None}
    if law:
        return _certify_own_law(args, law, console)
    problem, coupling, notes = cli.subject(args.problem, args.gains)
    if coupling is None:
        allowed = f"a file of gains (avc recommend {quote(args.problem)} --out c.json), or a law: --k K --b B"
        raise avc.InputError.of(f"is missing; allowed: {allowed}", key="GAINS")
    if coupling.end != "wall":
        cli.refuse(args, "prove", "proof_out", why=cli.OF_WALLS)
        return _certify_pair(problem, coupling.gains, args.gains or args.problem, console)
    from avc_casadi.claims.certify import proof_files

    proofs: dict[str, Any] = {}
    with nullcontext() if args.proof_out is None else output_folder(args.proof_out, "--proof-out") as folder:
        with console.step(f"certificate of {coupling.schedule.rows} rows"):
            certificate = avc.certify(problem, coupling, prove=args.prove or folder is not None, progress=console)
        if folder is not None:
            proofs = proof_files(problem, certificate)
            console.written += [str(Path(args.proof_out) / name) for name in proofs]
            for name, proof in proofs.items():
                write_file(folder / name, json_text(proof, problem.units))
    with console.step("table that runs"):
        result = rows.answers.certified(certificate, console)
    result = replace(result, file=args.gains or args.problem, notes=(*notes, *result.notes), proof_files=tuple(proofs))
    return rows.judge.certificate(result, args.problem if args.gains else "")


def _certify_own_law(args: argparse.Namespace, law: dict[str, Any], console: Console) -> Answer:
    """Judge a law of one's own before a wall, or K, B and the local damper to another end."""
    from avc_casadi.claims.own_law import Law, law_problem, valid_law
    from avc_casadi.model.ends import ToolGains

    cli.refuse(args, "prove", "proof_out", "gains", why="goes with a file of gains, not with --k, --b")
    problem = law_problem(args.problem)
    if problem.simulation is None and problem.follower is None:
        with console.step("your own law"):
            return rows.judge.own_law(avc.certify_law(problem, **law), args.problem)
    cli.refuse(args, "cutoff_hz", why=cli.OF_WALLS)
    pair = ToolGains(
        stiffness_n_per_m=law.get("k", 0.0),
        damping_ns_per_m=law.get("b", 0.0),
        local_damping_ns_per_m=law.get("b_p", 0.0),
    )
    own_law = Law(
        stiffness_n_per_m=pair.stiffness_n_per_m,
        damping_ns_per_m=pair.damping_ns_per_m,
        local_damping_ns_per_m=pair.local_damping_ns_per_m,
    )
    valid_law(own_law, problem.device)
    return _certify_pair(problem, pair, args.problem, console)


def _certify_pair(problem: avc.Problem, gains: ToolGains, file: str, console: Console) -> Answer:
    from avc_casadi.design.virtual_tool import FollowerSearch, ToolSearch, certify_pair
    from avc_casadi.recommendation.preconditions import not_used

    with console.step("certificate"):
        search = FollowerSearch(problem) if problem.simulation is None else ToolSearch(problem)
        certificate, why = certify_pair(problem, gains, search), search.why_not(gains)
    verdict = {"pass": not why, "sentence": why or "linearly stable"}
    data = {"problem": problem.name, "gains": file, **vars(gains), "deployable": verdict, **certificate}
    return rows.judge.pair_certificate(data | {"not_used": list(not_used(problem))}, problem, file)


@cli.verb(
    cli.argument("problem", metavar="P", text="problem file or name of the catalogue; or a coupling file"),
    cli.argument("--gains", metavar="GAINS", text="coupling or gain file in place of the scene's own coupling"),
    cli.argument("--against", metavar="C1,C2", text="draw others too: up to 3 of none and the methods"),
    cli.argument("--seed", type=int, default=0, metavar="S", text="other draws of all noises (default 0)"),
    cli.output("--trace", "write all traces (.npz) and a manifest beside them (.json)", ".npz"),
    cli.plot("the run"),
    cli.VERBOSE,
)
def run_simulate(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate the scene of a problem: whether the device settles, and what is rendered.

    With its listed effects, or a hand, a wall and all that the device declares; -v tells what each adds. Exit code 1
    if it does not settle.
    """
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.scene_coupling import SimulatedScene, scene_coupling, scene_notes
    from avc_casadi.model.gains import NO_COUPLING, GainSchedule, missing_rest_gains
    from avc_casadi.simulation.screen import explain

    problem, gains, notes = cli.subject(args.problem, args.gains)
    if problem.simulation is not None:
        cli.refuse(args, "against", why=cli.OF_WALLS)
        return rows.judge.pair_scene(_simulated_pair(problem, gains, args, console), problem, args.problem)
    given: Coupling | GainSchedule | Gains | None = gains
    if given is None:
        with console.step(f"coupling: {problem.scene.coupling}"):
            given, notes = scene_coupling(problem), scene_notes(problem)
    compared = [] if args.against is None else args.against.split(",")
    if len(compared) > 3:  # a figure holds four runs that one can tell apart
        raise avc.InputError.of(f"names {len(compared)}; allowed: at most 3", key="against")
    table = given.schedule if isinstance(given, Coupling) else given
    why = missing_rest_gains(table) if isinstance(table, GainSchedule) else ""
    if why:
        raise avc.NotDeployableError(f"{args.gains or f'{problem.name}: scene.coupling'}: {why}")
    with console.step(f"{problem.scene.duration_s:g} s of the scene"):
        laws = [given, *(NO_COUPLING if method == "none" else avc.solve(problem, method) for method in compared)]
        runs = [avc.simulate(problem, law, seed=args.seed) for law in laws]
        result = SimulatedScene.of(runs[0])
    if args.verbose or args.json:
        with console.step("cost of each effect"):
            result = replace(result, cost=explain(problem, given))
    write_figure(console, args.plot, lambda: avc.figures.draw_scene(runs))
    trace = _trace(runs[0], args, console)
    result = replace(result, notes=tuple(notes), trace=trace, against=tuple(runs[1:]))
    return rows.judge.scene(result, problem, args.problem)


def _trace(run: avc.Run, args: argparse.Namespace, console: Console) -> Path | None:
    """Write the traces of a run, if asked for, and return their file."""
    path: Path | None = args.trace
    if path is not None:
        console.written.append(f"{run.save(path)} and its manifest")
    return path


def _simulated_pair(
    problem: avc.Problem, coupling: Coupling | None, args: argparse.Namespace, console: Console
) -> SimulatedPair:
    """Simulate a coupling to a simulation, the recommended one where none is given."""
    from avc_casadi.design.scene_coupling import SimulatedPair
    from avc_casadi.model.declared import with_gains

    gains = (coupling or cli.recommended_coupling(problem, console)).gains
    staged = with_gains(problem, gains)
    with console.step(f"{staged.scene.duration_s:g} s of the scene"):
        run = avc.simulate(staged, seed=args.seed)
    write_figure(console, args.plot, lambda: avc.figures.draw_scene([run], ["coupling to the simulation"]))
    return SimulatedPair(run, gains, given=coupling is not None, trace=_trace(run, args, console))


@cli.verb(
    cli.argument("coupling", metavar="COUPLING", text="coupling file, of `avc recommend P --out`"),
    cli.argument("--hands", type=cli.positive_int, default=10_000, metavar="N", text="hands (default 10000)"),
    cli.argument("--seed", type=int, default=0, metavar="S", text="the same seed, the same hands (default 0)"),
    cli.flag("--without-friction", "leave the declared dry friction out"),
    *cli.WORKERS,
)
def run_trial(args: argparse.Namespace, console: Console) -> Answer:
    """Try a coupling with any number of simulated hands: how many settle, with the exact interval.

    Hands are drawn uniformly from [hands]; each presses, taps and holds, with all that is declared of the device.
    """
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.simulation.population.trial import count_at_rest

    coupling = cli.read_wall(args.coupling)
    with cluster(args.scheduler) as executor, console.step(f"{args.hands} hands"):
        trial = count_at_rest(
            coupling,
            args.hands,
            args.seed,
            friction=not args.without_friction,
            workers=args.workers or processors(),
            executor=executor,
            progress=console,
        )
    return rows.judge.trial(trial, coupling.problem.units, args.coupling)


@cli.verb(cli.PROBLEM, cli.plot("the region"))
def run_zwidth(args: argparse.Namespace, console: Console) -> Answer:
    """Show which walls the device can render without coupling; of a [simulation] which K and B are stable."""
    from avc_casadi.claims.zwidth import zwidth
    from avc_casadi.design.tool_region import tool_region

    problem = avc.load_problem(args.problem)
    if problem.simulation is not None:
        with console.step("region"):
            pairs = tool_region(problem, console)
        write_figure(console, args.plot, lambda: avc.figures.draw_tool_region(pairs))
        return rows.judge.region(pairs, problem, args.problem)
    with console.step("region"):
        walls = zwidth(problem, console)
    write_figure(console, args.plot, lambda: avc.figures.draw_zwidth(walls))
    return rows.judge.walls(walls, args.problem)
