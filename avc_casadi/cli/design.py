"""Verbs that design a coupling: new, recommend, run, solve, compare."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, output_folder, package_versions, write_figure
from avc_casadi.design.registry import methods_help
from avc_casadi.files.kinds import FileKind
from avc_casadi.files.new_options import DAMPING, EVERY, HANDS, HOLDS, MASS, RADIUS
from avc_casadi.present import rows
from avc_casadi.present.row import Answer, Mark, Row

if TYPE_CHECKING:
    from avc_casadi._util.units import MotionKind
    from avc_casadi.files.draft import Draft
    from avc_casadi.files.new_options import Option
    from avc_casadi.files.new_problem import NewProblem
    from avc_casadi.present.rows.deploy import PushOutcome

_STIFFEST = "find the stiffest wall (within a fifth) that this device renders well at 1 to 10 Hz"
_HANDS = (
    "try each candidate with N simulated hands, and the best coupling to a wall with 2N more "
    f"(default: {cli.RECOMMENDED_HANDS})"
)
_SOLVER = "choose the solver of `direct`: sqpmethod-qrqp (default), sqpmethod, ipopt, or another nlpsol plugin"
_MINE = "add your own constant gains: stiffness in N/m and damping in N.s/m, such as 7000,10"


def _value_options() -> Iterator[cli.Argument]:
    """Yield the options of values; the help lists those of a linear and of a rotary device in one entry."""
    first = {option.option: option for option in reversed(EVERY)}
    for option in (option for option in EVERY if first[option.option] is option):
        text = f"{option.text}: {', '.join(dict.fromkeys(option.examples))}{option.shown_default}"
        # The text of the first range names the other two, that of the verb those of an admittance device.
        listed = option.drive != "velocity" and option not in HANDS[1:]
        yield cli.argument(option.option, metavar="V", text=text if listed else argparse.SUPPRESS)
        if option.option_turning:
            yield cli.argument(option.option_turning, metavar="V", text=argparse.SUPPRESS)


_RUN_FILES = {
    "coupling.json": FileKind.COUPLING,
    "gains.csv": FileKind.COUPLING,
    "gains.json": FileKind.SOLUTION,
    "compare.json": FileKind.SOLUTION,
}
"""Files of `avc run` whose names a user may use too, and their kinds."""
_DRIVE = "choose what the device is commanded: force or velocity (default: force)"
_HELD = f"choose the grip: {', '.join(HOLDS)} (default: grip)"


@cli.verb(
    cli.output("file", "problem file to write (.toml)", {".toml": tuple(FileKind)}),  # --force decides
    cli.argument("--drive", choices=("force", "velocity"), default="force", metavar="WHAT", text=_DRIVE),
    cli.argument("--like", metavar="D", text="begin with a built-in device (avc list) or a device file"),
    cli.argument("--held", choices=tuple(HOLDS), default="grip", metavar="HOW", text=_HELD),
    *_value_options(),
    cli.argument("--model", metavar="M", text="read an MJCF or URDF model: mass at --tip NAME, or --joint NAME"),
    cli.argument("--tip", metavar="NAME", text=argparse.SUPPRESS),
    cli.argument("--joint", metavar="NAME", text=argparse.SUPPRESS),
    cli.flag("--force", "overwrite an existing file"),
)
def run_new(args: argparse.Namespace, console: Console) -> Answer:
    """Write a problem file from what you know of your device, its wall and its user.

    A value V has a unit, such as '55 um', '1 kHz' or '4096 counts'; without a unit V is in SI units.
    Options of --drive velocity: --drive-bandwidth, --max-speed, --sensor-stiffness, --handle-mass,
    --sensor-damping-ratio, --sensor-noise, --sensor-resolution, --contact, --contact-damping.
    """
    from avc_casadi.files.plausibility import plausibility

    if args.file.exists() and not args.force:
        message = f"{str(args.file)!r} exists; choose another name, or use --force"
        raise avc.InputError.of(message, key="FILE")
    if args.joint is not None:
        return _new_joint(args, console)
    if args.drive == "velocity":
        return _new_admittance(args, console)
    new = _force_draft(args)
    console.write(args.file, new.text())
    problem = new.problem()
    warnings = [rows.look.Doubt(fault.key, fault.message) for fault in plausibility(problem)]
    result = rows.design.Drafted(
        file=str(args.file),
        problem=problem,
        held=new.held,
        assumed=new.assumed(),
        proposed_damper=new.proposed_damper,
        unknown=tuple(new.unknown()),
        warnings=tuple(warnings),
        model=None if new.tip is None else rows.design.ModelledMass(args.model, args.tip, new.tip),
    )
    return rows.design.new(result, str(args.file))


def _force_draft(args: argparse.Namespace) -> NewProblem:
    """Return the draft of a device that is commanded a force; all faults of its options are refused at once."""
    from avc_casadi.files.new_problem import NewProblem

    typed = _typed(args)
    by_key = {option.key: value for (option, _), value in typed.items()}
    new = NewProblem(args.file, _motion(typed), args.held, by_key, like=args.like or "")
    if args.model is not None or args.tip is not None:
        new = _at_tip(new, args.model, args.tip)
    _refuse_faults(new, typed)
    return new


def _new_admittance(args: argparse.Namespace, console: Console) -> Answer:
    """Write the file of an admittance device."""
    from avc_casadi.files.new_admittance import NewAdmittance

    why = "is of devices that are commanded a force; leave it out, or leave out --drive velocity"
    cli.refuse(args, "like", "model", "tip", why=why)
    typed = _typed(args)
    by_key = {option.key: value for (option, _), value in typed.items()}
    new = NewAdmittance(args.file, _motion(typed), args.held, by_key)
    _refuse_faults(new, typed)
    console.write(args.file, new.text())
    return rows.admittance.drafted(new, str(args.file))


def _typed(args: argparse.Namespace) -> dict[tuple[Option, str], str]:
    """Return the values that were typed, by option and name; a name is that of the drive, if it has one."""
    ordered = sorted(EVERY, key=lambda option: option.drive == args.drive)
    options = {name: option for option in ordered for name in option.names}
    values = {(option, name): vars(args)[name[2:].replace("-", "_")] for name, option in options.items()}
    return {key: value for key, value in values.items() if value is not None}


def _motion(typed: Iterable[tuple[Option, str]]) -> MotionKind:
    """Return how a device moves of which some options were typed."""
    turned = any(option is RADIUS or name == option.option_turning for option, name in typed)
    return "rotary" if turned else "linear"


def _refuse_faults(new: Draft, typed: Iterable[tuple[Option, str]]) -> None:
    faults = _option_faults(new, typed) or new.faults()
    if faults:
        names = _names_of(new)
        raise avc.InputError([replace(fault, key=names.get(fault.key, fault.key)) for fault in faults])


def _new_joint(args: argparse.Namespace, console: Console) -> Answer:
    """Write the file of a joint of a model."""
    from avc_casadi.files.joint_model import modelled_joint

    of_device = [name for option in EVERY for name in option.names] + ["--like", "--tip"]
    for name in of_device:
        if vars(args)[name[2:].replace("-", "_")] is not None:
            raise avc.InputError.of("applies to a device, but an engine moves the --joint; leave it out", key=name)
    if args.model is None:
        raise avc.InputError.of("is missing; allowed: the model of the joint, MJCF or URDF", key="--model")
    joint = modelled_joint(Path(args.model), args.joint)
    console.write(args.file, joint.text())
    return rows.joint.drafted(joint, joint.problem(args.file), str(args.file))


def _names_of(new: Draft) -> dict[str, str]:
    """Return the option of each value, for the motion of the device."""
    return {option.key: option.names[0 if new.units.linear else 1] for option in EVERY}


def _option_faults(new: Draft, typed: Iterable[tuple[Option, str]]) -> list[avc.Fault]:
    """Return the faults of options that do not go with the motion of the device, its --like, or what holds it."""
    names = _names_of(new)
    kind, motion = ("linear", 0) if new.units.linear else ("rotary", 1)
    faults = []
    for option, name in typed:
        if name != names[option.key]:
            message = f"does not apply to a {kind} device; use {names[option.key]}, such as {option.examples[motion]}"
            faults.append(avc.Fault("", None, name, message))
    reasons = {RADIUS.key: "is known from the device of --like; leave it out"}
    of_force = "is of a device that is commanded a force; leave it out with --drive velocity"
    of_drive = {"force": of_force, "velocity": "applies with --drive velocity only; leave it out"}
    reasons |= {option.key: of_drive[option.drive] for option in EVERY if option.drive}
    reasons |= {option.key: "applies with --held foot or --held other only; leave it out" for option in HANDS}
    known = {option.key for option in new.options()}
    faults += [avc.Fault("", None, names[key], reasons[key]) for key in new.typed if key not in known]
    return faults


def _at_tip(new: NewProblem, model: str | None, tip: str | None) -> NewProblem:
    """Return a draft with the mass and the damping at the tip of a model."""
    from avc_casadi.files.model_file import tip_mass

    if model is None or tip is None:
        missing = "--model" if model is None else "--tip"
        raise avc.InputError.of("is missing; give both --model and --tip", key=missing)
    if not new.units.linear:
        message = "gives the mass of a tip that moves in a line, but this device is rotary; leave one out"
        raise avc.InputError.of(message, key="--model")
    if MASS.key in new.typed:
        raise avc.InputError.of("is computed from --model; leave it out", key=MASS.option)
    at_tip = tip_mass(Path(model), tip)
    typed = {MASS.key: f"{at_tip.mass_kg:.4g} kg", **new.typed}
    if at_tip.damping_ns_per_m > 0:
        typed.setdefault(DAMPING.key, f"{at_tip.damping_ns_per_m:.4g} N.s/m")
    return replace(new, typed=typed, tip=at_tip)


@cli.verb(
    cli.PROBLEM,
    cli.output(
        "--out",
        "write the coupling to this .json file; for an admittance device, the problem file with its law, .toml",
        {".json": (FileKind.COUPLING,), ".toml": (FileKind.PROBLEM,)},
        ending_by_problem=True,
    ),
    cli.flag("--stiffest", _STIFFEST),
    cli.flag("--lean-on-friction", "accept couplings that need the declared dry friction to settle"),
    cli.flag("--prove", "try to prove that the device comes to rest with the coupling (claim L7); may take minutes"),
    cli.flag("--trade-off", "list the impedance error at several disk margins"),
    cli.numeric("--hands", _HANDS, metavar="N"),
    cli.argument("--frequency", metavar="F", text='choose kp of a simulated joint for this frequency ("10 Hz")'),
    cli.VERBOSE,
)
def run_recommend(args: argparse.Namespace, console: Console) -> Answer:
    """Recommend the coupling to deploy, and report its gains, its stiffness and its limits.

    Exit code 1 if no coupling is deployable: linearly stable with every hand of [hands] and with
    the device released.
    For an admittance device (drive = "velocity") recommend chooses the virtual mass and damping that
    need the least force of the hand; --out then writes the problem with this law, as .toml.
    For a device with force feedback recommend chooses the largest gain with a disk margin of 0.2.
    For a joint of a simulated robot (a file with [simulation] and without [device]) recommend
    chooses kp and kd.
    """
    from avc_casadi.cli import admittance
    from avc_casadi.files.admittance_file import is_admittance

    if is_admittance(args.problem):
        return admittance.recommended(args, console)
    with console.step(args.problem):
        problem = avc.load_problem(args.problem)

    cli.require_ending(args.out, ".json", "a coupling")
    from avc_casadi.cli import ends

    return ends.recommended(problem.end, problem, args, console)


def _is_pair(problem: avc.Problem) -> bool:
    from avc_casadi.model.ends import Wall

    return not isinstance(problem.end, Wall)


@cli.verb(
    cli.PROBLEM,
    cli.argument("--method", metavar="NAME", text=f"choose {methods_help()} (default: direct)"),
    cli.argument("--solver", metavar="NAME", text=_SOLVER),
    cli.numeric("--tolerance", "set the tolerance of the solver", metavar="TOL"),
    cli.flag("--as-printed", "use the closed form with the paper's errors; -v lists the errors"),
    cli.output(
        "--out",
        "write the whole result (.json), or only the table of gains (.csv)",
        {".json": (FileKind.COUPLING, FileKind.SOLUTION), ".csv": (FileKind.COUPLING,)},
    ),
    cli.VERBOSE,
)
def run_solve(args: argparse.Namespace, console: Console) -> Answer:
    """Compute the gains of a problem by one method of the paper or of this project.

    One row of the answer says whether the gains are deployable.
    Exit code 1 if a frequency has no gains.
    """
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.solution import SolvedGains
    from avc_casadi.files.coupling_file import coupling_text, gain_csv

    method = args.method or ("closed-form" if args.as_printed else "direct")
    problem = avc.load_problem(args.problem)
    options = {"solver": args.solver, "tolerance": args.tolerance, "as_printed": args.as_printed}
    gains = avc.solve(problem, method, progress=console, **options)
    with console.step("table that runs"):
        coupling = Coupling.from_schedule(problem, gains, versions=package_versions()) if gains.usable.any() else None
    with console.step(f"certificate of {gains.rows} rows"):
        solution = SolvedGains.of(problem, gains, coupling, avc.certify(problem, gains, progress=console))
    if args.out is not None:
        if args.out.suffix.lower() == ".csv":
            text = gain_csv(gains)
        elif coupling is not None and solution.deployed_certificate is not None:
            text = coupling_text(coupling.with_certificate(solution.deployed_certificate), **solution.document())
        else:
            text = json_text(solution.document(), problem.units)
        console.write(args.out, text)
    return rows.design.solution(solution, args.problem, args.out and str(args.out))


def gain_pair(text: str) -> tuple[float, float]:
    """Parse "K,B"."""
    try:
        k, b = (float(part) for part in text.split(","))
    except ValueError:
        message = f"is {text!r}; it must be K,B: stiffness in N/m and damping in N.s/m, such as 7000,10"
        raise argparse.ArgumentTypeError(message) from None
    return k, b


@cli.verb(
    cli.PROBLEM,
    cli.argument("--mine", type=gain_pair, metavar="K,B", text=_MINE),
    cli.plot("the comparison"),
)
def run_compare(args: argparse.Namespace, console: Console) -> Answer:
    """Compare the gains of the paper's methods at each frequency, with a verdict on each method."""
    problem = avc.load_problem(args.problem)
    comparison = avc.compare(problem, mine=args.mine, progress=console)
    write_figure(console, args.plot, lambda: avc.figures.draw_comparison(comparison))
    return rows.design.comparison(comparison, args.problem)


@cli.verb(
    cli.PROBLEM,
    cli.argument("--out", metavar="DIR", text="write the results to this folder (default: avc-NAME)"),
    cli.argument("--method", metavar="NAME", text=f"deploy the gains of this method instead: {methods_help()}"),
    cli.VERBOSE,
    cli.UNSAFE,
)
def run_run(args: argparse.Namespace, console: Console) -> Answer:
    """Recommend, simulate, report and push a coupling, and solve the paper's problem.

    The recommended coupling, or that of --method, is tried on an emulated device (coupling.json).
    The gains of the paper's problem are for comparison only (gains.json).
    If recommend finds no coupling, coupling.json is missing, also with --unsafe: then add --method.
    `avc run` is for walls; for a [simulation] or [follower] use `avc recommend`.
    """
    from avc_casadi.files.coupling_file import coupling_text
    from avc_casadi.files.problem_file import require_device

    with console.step(args.problem):
        problem = require_device(args.problem)
    if _is_pair(problem):
        command = f"avc recommend {quote(args.problem)} --out coupling.json"
        raise avc.InputError.of(f"has no wall, which avc run needs; use {command}", key="P")
    shown = Path(args.out or f"avc-{problem.name.replace('/', '-')}")
    cli.keep_other_files(shown, _RUN_FILES)
    with output_folder(args.out or str(shown), "--out") as folder:
        console.notice(f"{args.problem} ... everything, into {shown}")
        recommendation = _to_deploy(problem, args.method, console)
        with console.step("device"):
            push = _pushed(recommendation, unsafe=args.unsafe)
            pushed = rows.deploy.pushed(push)
        comparison = _compared(recommendation, console)
        compare = comparison.document()
        deploys = recommendation.coupling is not None and not (
            isinstance(push, rows.deploy.Refused) and push.deployable is False
        )
        written = str(shown / "coupling.json") if deploys else None
        answer = rows.recommend.recommendation(recommendation, args.problem, written)
        files = _run_files(recommendation, comparison, compare, answer, pushed, console)
        if recommendation.coupling is not None and deploys:
            files["coupling.json"] = coupling_text(recommendation.coupling)
        for name, content in files.items():
            write_file(folder / name, content)
    data = {
        "folder": str(shown),
        "files": sorted(files),
        "deploy": answer.data,
        "push": push.document(),
        "compare": compare,
    }
    console.written.append(f"{shown / 'report.html'} and {len(files) - 1} more files in the same folder")
    answer = rows.design.run(data, answer, pushed, comparison)
    complaints = [rows.design.without_gains(comparison.methods[comparison.delivered])]
    if pushed.mark is Mark.FAIL:
        complaints.append(f"avc: {problem.name}: {pushed.text(problem.units)}")
    return replace(answer, complaint="\n".join(filter(None, complaints)))


def _to_deploy(problem: avc.Problem, method: str | None, console: Console) -> avc.Recommendation:
    """Return the recommended coupling, or that of a method judged in the same way."""
    # Slow to load: after the first line.
    from avc_casadi.recommendation.recommend import judged_as_recommended

    if method is None:
        return cli.recommended(problem, console)
    gains = avc.solve(problem, method, progress=console)
    with console.step(f"coupling to deploy: {method}"):
        return judged_as_recommended(problem, gains, versions=package_versions(), progress=console)


def _run_files(
    recommendation: avc.Recommendation,
    comparison: avc.Comparison,
    compare: dict[str, Any],
    answer: Answer,
    pushed: Row,
    console: Console,
) -> dict[str, str | bytes]:
    """Return the contents of the gains of the paper's question, the comparison, the pictures and the report.

    `compare` is the document of the comparison.
    """
    # Slow to load: after the first line.
    from avc_casadi.files.coupling_file import gain_csv
    from avc_casadi.present import report

    problem, delivered = recommendation.problem, comparison.delivered
    files: dict[str, str | bytes] = {
        "gains.json": json_text(compare["methods"][delivered], problem.units),
        "gains.csv": gain_csv(comparison.methods[delivered]),
        "compare.json": json_text(compare, problem.units),
    }
    with console.step("figures"):
        of_wall, of_paper = report.wall_pictures(recommendation), report.paper_pictures(comparison)
    sections = report.paper_sections(comparison, of_paper, pushed)
    pictures = list(of_wall.values())
    files["report.html"] = report.report_html(answer, recommendation, pictures, package_versions(), sections)
    for name, picture in (of_wall | of_paper).items():
        files |= {f"{name}.png": picture.png, f"{name}.svg": picture.svg}
    return files


def _compared(recommendation: avc.Recommendation, console: Console) -> avc.Comparison:
    """Solve the paper's problem, for comparison with the recommendation."""
    from avc_casadi.design.comparison.comparison import with_causal, with_delivered

    problem, coupling = recommendation.problem, recommendation.coupling
    comparison = avc.compare(problem, progress=console)
    if comparison.scope != "pointwise":
        comparison = with_delivered(comparison, problem, avc.solve(problem, "schedule", progress=console))
    if coupling is not None and coupling.table.constant:
        comparison = with_causal(comparison, coupling)
    return comparison


def _pushed(recommendation: avc.Recommendation, *, unsafe: bool) -> PushOutcome:
    """Push to the emulated device and try it there; a push that fails says why."""
    from avc_casadi.cli.deploy import in_the_loop

    coupling = recommendation.coupling
    if coupling is None:
        advice = "; --method NAME writes and pushes the gains of a method" if unsafe else ""
        return rows.deploy.Refused(f"no coupling is deployable{advice}")
    # Trials refuse what the push, which judges linear stability alone, would take.
    if not recommendation.deployable and not unsafe:
        return rows.deploy.Refused(recommendation.reason, deployable=False)
    note = "" if recommendation.deployable else f"UNSAFE, accepted by request: {recommendation.reason}"
    try:
        done = avc_hardware.push(coupling, "emulator", unsafe=unsafe)
        return rows.deploy.Tried(done, note, in_the_loop(coupling))
    except (avc.LinkError, avc.NotDeployableError) as error:
        return rows.deploy.Refused(str(error))
    except (avc.MissingExtraError, avc.UnsupportedError) as error:
        return rows.deploy.NotTried(str(error))
