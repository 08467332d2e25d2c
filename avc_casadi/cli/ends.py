"""What verbs do with a coupling by the kind of its end: a function of each verb, registered by this type.

Verbs load this module when they run, so that `avc --help` is quick.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import singledispatch
from pathlib import Path
from typing import Any

import avc_casadi as avc
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text
from avc_casadi._util.progress import Stages
from avc_casadi.claims.certify import proof_files
from avc_casadi.claims.deployable import require_deployable
from avc_casadi.claims.joint import certify_joint
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.claims.law_analysis import SpringDamper
from avc_casadi.claims.law_region import law_region
from avc_casadi.claims.own_law import valid_law
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder, write_figure
from avc_casadi.cli.law import TYPED, faults_of_keys, hertz, number_named
from avc_casadi.coupling import Coupling
from avc_casadi.design.pair_certificate import certify_pair
from avc_casadi.design.registry import METHODS
from avc_casadi.design.scene_coupling import SimulatedPair, SimulatedScene, law_scene, scene_coupling, scene_notes
from avc_casadi.design.tool_region import tool_region
from avc_casadi.design.virtual_tool import search_of
from avc_casadi.files.coupling_file import coupling_text
from avc_casadi.files.problem_file import require_device
from avc_casadi.model.declared import with_gains
from avc_casadi.model.ends import End, Simulation, ToolGains, Wall
from avc_casadi.model.gains import NO_COUPLING, Gains, GainSchedule, missing_rest_gains
from avc_casadi.model.joint import Joint
from avc_casadi.present import rows
from avc_casadi.present.row import Answer
from avc_casadi.present.rows.deploy import Deployment
from avc_casadi.recommendation.preconditions import not_used
from avc_casadi.simulation.screen import explain
from avc_hardware.codegen.pair_export import pair_verdict

_OF_DEVICES = "is an option of devices, and P is a joint that an engine moves; leave it out"

_NO_COUPLING = "none"
"""Name of the motion without a coupling in --against."""


@dataclass(frozen=True)
class DeploymentNote:
    """Whether a coupling is exported by request alone, and why; what it is judged for; the verdict of one to a wall."""

    unsafe: str
    judged_for: JudgedFor
    deployment: Deployment | None = None


@singledispatch
def judged(end: End, coupling: Coupling, *, unsafe: bool) -> DeploymentNote:  # noqa: ARG001
    """Return the verdict on a coupling to an end that is exported; raise where it may not be."""
    _, stable = pair_verdict(coupling, unsafe=unsafe)
    note = "" if stable else "UNSAFE, went on by request: a loop is linearly unstable"
    return DeploymentNote(note, JudgedFor.of_coupling(coupling))


@judged.register
def _judged_at_wall(end: Wall, coupling: Coupling, *, unsafe: bool) -> DeploymentNote:  # noqa: ARG001
    deploys = deployment(coupling, unsafe=unsafe)
    return DeploymentNote(deploys.unsafe, deploys.judged_for, deploys)


def deployment(coupling: Coupling, *, unsafe: bool) -> Deployment:
    """Return what is told of a coupling to a wall that is deployed; raise where it may not be."""
    verdict = require_deployable(coupling, unsafe=unsafe)
    note = "" if verdict.passed else f"UNSAFE, went on by request: {verdict.sentence}"
    holes = rows.answers.holes(coupling.schedule) or None
    return Deployment(coupling.id, verdict, note, coupling.lacks, holes, JudgedFor.of_coupling(coupling))


@dataclass(frozen=True)
class GivenCoupling:
    """A problem, the coupling of a file for it, and what is to be said of the two."""

    problem: avc.Problem
    coupling: Coupling | None
    notes: list[str]


@singledispatch
def certified(
    end: End,  # noqa: ARG001
    coupling: Coupling,
    subject: GivenCoupling,
    args: argparse.Namespace,
    console: Console,
) -> Answer:
    """Return the answer of `certify` of a coupling to an end."""
    cli.refuse(args, "prove", "proof_out", why=cli.OF_WALLS)
    return _pair_certified(subject.problem, coupling.gains, args.gains or args.problem, console, subject.notes)


@certified.register
def _certified_at_wall(
    end: Wall,  # noqa: ARG001
    coupling: Coupling,
    subject: GivenCoupling,
    args: argparse.Namespace,
    console: Console,
) -> Answer:
    """Answer `certify` of a coupling to a wall: its certificate, the table that runs, and the files of its proof."""
    problem, proofs = subject.problem, dict[str, Any]()
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
    notes = (*subject.notes, *result.notes)
    result = replace(result, file=args.gains or args.problem, notes=notes, proof_files=tuple(proofs))
    return rows.judge.certificate(result, args.problem if args.gains else "")


@singledispatch
def law_certified(
    end: End,  # noqa: ARG001
    problem: avc.Problem,
    law: dict[str, Any],
    args: argparse.Namespace,
    console: Console,
) -> Answer:
    """Return the answer of `certify` of a law of one's own: to another end K, B and the device's local damper."""
    of_walls = ("cutoff_hz", "ki", "virtual_mass", "velocity", "notch", "friction_compensation", "lean_on_friction")
    cli.refuse(args, *of_walls, why=cli.OF_WALLS)
    own_law = SpringDamper(
        stiffness_n_per_m=law.get("k", 0.0),
        damping_ns_per_m=law.get("b", 0.0),
        local_damping_ns_per_m=law.get("b_p", 0.0),
    )
    valid_law(own_law, problem)
    pair = ToolGains(
        stiffness_n_per_m=own_law.stiffness_n_per_m,
        damping_ns_per_m=own_law.damping_ns_per_m,
        local_damping_ns_per_m=own_law.local_damping_ns_per_m,
    )
    return _pair_certified(problem, pair, args.problem, console)


@law_certified.register
def _law_certified_at_wall(
    end: Wall,  # noqa: ARG001
    problem: avc.Problem,
    law: dict[str, Any],
    args: argparse.Namespace,
    console: Console,
) -> Answer:
    with console.step("your own law"):
        judged_law = avc.certify_law(problem, **law, lean_on_friction=args.lean_on_friction, progress=console)
        return rows.judge.own_law(judged_law, args.problem)


@law_certified.register
def _law_certified_of_joint(
    end: Joint,  # noqa: ARG001
    problem: avc.Problem,
    law: dict[str, Any],
    args: argparse.Namespace,
    console: Console,
) -> Answer:
    of_devices = ("b_p", "cutoff_hz", "ki", "virtual_mass", "notch", "friction_compensation", "lean_on_friction")
    cli.refuse(args, *of_devices, why=_OF_DEVICES)
    velocity = problem.law is not None and "velocity" in problem.law.model_fields_set
    typed = {problem.units.key(key): option for option, key in TYPED.items() if option in law}
    with console.step("kp and kd of the joint"), faults_of_keys(typed):
        result = certify_joint(problem, law.get("k"), law.get("b"), difference=velocity)
    return rows.joint.certificate(result, args.problem)


@singledispatch
def recommended(end: End, problem: avc.Problem, args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `recommend`."""
    cli.refuse(args, "frequency", why="applies to a joint that an engine moves, but P has a device; leave it out")
    if not isinstance(end, Wall):
        cli.refuse(args, "stiffest", "lean_on_friction", "prove", "trade_off", why=cli.OF_WALLS)
    options = {"stiffest": args.stiffest, "lean_on_friction": args.lean_on_friction, "prove": args.prove}
    hands = args.hands or cli.RECOMMENDED_HANDS
    recommendation = cli.recommended(problem, console, hands, with_trade_off=args.trade_off, **options)
    written = None
    # What the trials refuse, other verbs would take: they judge linear stability alone.
    if args.out is not None and recommendation.coupling is not None and recommendation.deployable:
        console.write(args.out, coupling_text(recommendation.coupling))
        written = str(args.out)
    return rows.recommend.recommendation(recommendation, args.problem, written)


@recommended.register
def _recommended_of_joint(end: Joint, problem: avc.Problem, args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    cli.refuse(args, "out", "stiffest", "lean_on_friction", "prove", "trade_off", "hands", why=_OF_DEVICES)
    frequency_hz = None if args.frequency is None else hertz(args.frequency, "frequency")
    with console.step("kp and kd of the joint"), cli.faults_of("frequency"):
        return rows.joint.recommendation(avc.recommend_joint(problem, frequency_hz), args.problem)


def _pair_certified(
    problem: avc.Problem, gains: ToolGains, file: str, console: Console, notes: Sequence[str] = ()
) -> Answer:
    with console.step("certificate"):
        search = search_of(problem.end, problem)
        stages = Stages(console, search.stages_of_verdict)
        certificate = certify_pair(problem, gains, search, stages)
        fault = search.fault(gains, stages)
    result = rows.judge.CertifiedPair(problem, gains, file, certificate, fault, not_used(problem), tuple(notes))
    return rows.judge.pair_certificate(result)


@singledispatch
def simulated(end: End, subject: GivenCoupling, args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Return the answer of `simulate`: of an end that no scene has, the scene of the device with its wall."""
    compared = _compared(args)
    problem, notes = require_device(subject.problem), subject.notes
    given: Coupling | GainSchedule | Gains | None = subject.coupling
    if given is None and problem.law is not None:
        cli.refuse(args, "against", why="compares couplings, but P has a table [law], which runs instead of a coupling")
        problem, given = law_scene(problem), NO_COUPLING
    if given is None:
        with console.step(f"coupling: {problem.scene.coupling}"):
            given, notes = scene_coupling(problem), scene_notes(problem)
    table = given.schedule if isinstance(given, Coupling) else given
    why = missing_rest_gains(table) if isinstance(table, GainSchedule) else ""
    if why:
        raise avc.NotDeployableError(f"{args.gains or f'{problem.name}: scene.coupling'}: {why}")
    with console.step(f"{problem.scene.duration_s:g} s of the scene"):
        laws = [given, *(NO_COUPLING if method == _NO_COUPLING else avc.solve(problem, method) for method in compared)]
        runs = [avc.simulate(problem, law, seed=args.seed) for law in laws]
        result = SimulatedScene.of(runs[0])
    if args.verbose or args.json:
        with console.step("cost of each effect"):
            result = replace(result, cost=explain(problem, given))
    write_figure(console, args.plot, lambda: avc.figures.draw_scene(runs))
    trace = _trace(runs[0], args, console)
    result = replace(result, notes=tuple(notes), trace=trace, against=tuple(runs[1:]))
    return rows.judge.scene(result, problem, args.problem)


def _compared(args: argparse.Namespace) -> list[str]:
    """Return the couplings of --against: `none`, or names of methods."""
    compared = [] if args.against is None else [name.strip() for name in args.against.split(",")]
    if len(compared) > 3:  # a figure holds four runs that one can tell apart
        raise avc.InputError.of(f"names {len(compared)}; allowed: at most 3", key="against")
    for name in compared:
        if name != _NO_COUPLING:
            METHODS.named(name, key="against", also=(_NO_COUPLING,))
    return compared


@simulated.register
def _simulated_with_tool(end: Simulation, subject: GivenCoupling, args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    cli.refuse(args, "against", why=cli.OF_WALLS)
    problem = subject.problem
    gains = (subject.coupling or cli.recommended_coupling(problem, console)).gains
    staged = with_gains(problem, gains)
    with console.step(f"{staged.scene.duration_s:g} s of the scene"):
        run = avc.simulate(staged, seed=args.seed)
    write_figure(console, args.plot, lambda: avc.figures.draw_scene([run], ["coupling to the simulation"]))
    given, trace = subject.coupling is not None, _trace(run, args, console)
    result = SimulatedPair(run, gains, given=given, trace=trace, notes=tuple(subject.notes))
    return rows.judge.pair_scene(result, problem, args.problem)


def _trace(run: avc.Run, args: argparse.Namespace, console: Console) -> Path | None:
    """Write the traces of a run, if asked for, and return their file."""
    path: Path | None = args.trace
    if path is not None:
        console.written.append(f"{run.save(path)} and its manifest")
    return path


def region_of_law(problem: avc.Problem, args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `zwidth --over`: the stable k of a stated law over another number."""
    with console.step(f"stable gains over {args.over}"), cli.faults_of("over"):
        stable = law_region(problem, number_named(args.over), console)
    write_figure(console, args.plot, lambda: avc.figures.draw_law_region(stable))
    return rows.law_region.law_region(stable, args.problem)


@singledispatch
def region(end: End, problem: avc.Problem, args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Return the answer of `zwidth`: the walls that the device renders without coupling."""
    with console.step("region"):
        walls = zwidth(problem, console)
    write_figure(console, args.plot, lambda: avc.figures.draw_zwidth(walls))
    return rows.judge.walls(walls, args.problem)


@region.register
def _region_of_tool(end: Simulation, problem: avc.Problem, args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    with console.step("region"):
        pairs = tool_region(problem, console)
    write_figure(console, args.plot, lambda: avc.figures.draw_tool_region(pairs))
    return rows.judge.region(pairs, problem, args.problem)
