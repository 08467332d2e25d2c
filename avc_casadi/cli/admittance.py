"""What verbs do with a device with a force sensor: an admittance device, or one that is commanded a force."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, write_figure
from avc_casadi.cli.law import faults_of_keys, read_numbers
from avc_casadi.files.admittance_file import dump_admittance, load_sensor_problem
from avc_casadi.present import rows
from avc_casadi.present.row import Answer
from avc_casadi.recommendation.admittance import AdmittanceRecommendation
from avc_casadi.recommendation.force_feedback import ForceFeedbackRecommendation

_LAW = {"virtual_mass": "mass_kg", "b": "damping_ns_per_m", "k": "stiffness_n_per_m", "cutoff_hz": "cutoff_hz"}
"""Options that state an admittance law, and its keys."""
_OPTIONS = "--virtual-mass, --b, --k and --cutoff-hz"
_OF_FORCES = f"is an option of devices that are commanded a force; an admittance law is {_OPTIONS}"


def checked(source: str) -> Answer:
    """Return the answer of `check`."""
    from avc_casadi.recommendation.admittance import why_no_law

    problem = load_sensor_problem(source)
    if isinstance(problem, avc.ForceFeedbackProblem):
        return rows.force_feedback.checked(problem, source)
    refused = why_no_law(problem)
    return rows.admittance.checked(problem, rows.admittance.doubts_of(problem), source, refused)


def certified(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `certify` of the law of the file, or of that with values that are typed."""
    problem = load_sensor_problem(args.problem)
    pieces = ("b_p", "ki", "velocity", "notch", "friction_compensation")
    others = ("prove", "proof_out", "lean_on_friction", *pieces)
    cli.refuse_file(args, "gains", why="does not apply to a device with a force sensor; leave it out")
    if isinstance(problem, avc.ForceFeedbackProblem):
        cli.refuse(
            args, *others, *_LAW, why="does not apply to a device with a force sensor; state the device's law in [law]"
        )
        with console.step("force feedback"):
            return rows.force_feedback.certificate(avc.certify_force_feedback(problem), args.problem)
    cli.refuse(args, *others, why=_OF_FORCES)
    read_numbers(args, problem.units, problem.device.handle_radius_m)
    typed = {key: getattr(args, option) for option, key in _LAW.items() if getattr(args, option) is not None}
    options = {problem.units.key(key): option for option, key in _LAW.items() if key in typed}
    with console.step("admittance law"), faults_of_keys(options):
        return rows.admittance.certificate(avc.certify_admittance(problem, law=typed, progress=console), args.problem)


def recommended(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `recommend`, and write the file with the law."""
    problem = load_sensor_problem(args.problem)
    refused = "is an option of devices that are commanded a force and have no force sensor; leave it out"
    cli.refuse(args, "stiffest", "lean_on_friction", "prove", "trade_off", why=refused)
    cli.refuse(args, "hands", why="is of simulated hands, which choose no law for a force sensor; leave it out")
    cli.refuse(args, "frequency", why="applies to a joint that an engine moves, but P has a device; leave it out")
    cli.require_ending(args.out, ".toml", "the file of the device with its law")
    if isinstance(problem, avc.ForceFeedbackProblem):
        with console.step("gain of the force"):
            lightened = avc.recommend_force_feedback(args.problem, progress=console)
        return rows.force_feedback.recommendation(lightened, args.problem, _written(lightened, args, console))
    with console.step("virtual mass and damping"):
        found = avc.recommend_admittance(args.problem, progress=console)
    return rows.admittance.recommendation(found, args.problem, _written(found, args, console))


def _written(
    found: AdmittanceRecommendation | ForceFeedbackRecommendation, args: argparse.Namespace, console: Console
) -> str | None:
    """Write the file with a recommended law, and return its name; None where there is no law or no file to write."""
    if args.out is None or not found.passed:
        return None
    console.write(args.out, dump_admittance(found.problem))
    return str(args.out)


def tried(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `trial`: simulated hands that guide, hold, release and push against contacts."""
    from avc_casadi._util.parallel import processors
    from avc_casadi.simulation.population.admittance_trial import ADMITTANCE_HANDS, try_admittance

    cli.refuse(args, "without_friction", why="does not apply: an admittance device states no friction; leave it out")
    hands = args.hands or ADMITTANCE_HANDS
    with cli.executor_of(args) as executor, console.step(f"{hands} hands"):
        trial = try_admittance(
            args.coupling,
            hands,
            args.seed,
            workers=args.workers or processors(),
            executor=executor,
            progress=console,
        )
    return rows.tried.admittance_trial(trial, args.coupling)


def region(args: argparse.Namespace, console: Console) -> Answer:
    """Return the answer of `zwidth`: masses over dampings."""
    with console.step("region"):
        found = avc.mass_width(args.problem, progress=console)
    write_figure(console, args.plot, lambda: avc.figures.draw_mass_width(found))
    return rows.admittance.region(found, args.problem)
