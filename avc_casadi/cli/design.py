"""Verbs that design a coupling: new, recommend, run, solve, compare."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli.arguments import (
    add_unsafe,
    add_verbose,
    add_worded,
    check_worded,
    positive_int,
    refuse,
)
from avc_casadi.cli.console import (
    PICTURES,
    Console,
    output_file,
    output_folder,
    package_versions,
    write_figure,
    write_text,
)
from avc_casadi.design.registry import methods_help
from avc_casadi.files.new_options import DAMPING, EVERY, HANDS, HOLDS, MASS, RADIUS

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.files.new_problem import NewProblem
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.present.report import Picture
    from avc_casadi.present.row import Answer
    from avc_casadi.recommendation.recommendation import Recommendation

_NO_COMPILER = (
    "avc: no C compiler is found (cc, or what CC names): hands are simulated without one, which takes some fifteen "
    "times as long"
)


def add_new(parser: argparse.ArgumentParser) -> None:
    """Write a problem file from what you know of a device, its wall and what holds it.

    A value is typed with its unit, in any that fits ('55 um', '1 kHz', '4096 counts'; without one
    it is in SI units). Of a device that turns: --radius, --inertia, --max-torque, and units such as N.m/rad.
    """
    parser.add_argument("file", metavar="FILE", help="problem file to write, .toml")
    parser.add_argument("--like", metavar="D", help="device to begin from: a name of `avc list`, or a device file")
    parser.add_argument("--held", choices=tuple(HOLDS), default="grip", help="what holds it; default grip")
    for one in EVERY:
        text = f"{one.text}: {', '.join(dict.fromkeys(one.examples))}"
        if one.turning:
            add_worded(parser, one.option, one.turning, "V", text, str)
        else:
            parser.add_argument(one.option, metavar="V", help=text)
    parser.add_argument("--model", metavar="M", help="device of several axes, MJCF or URDF: mass from it (MuJoCo)")
    parser.add_argument("--tip", metavar="NAME", help="site, body or geom of the model that the hand holds")
    parser.add_argument("--force", action="store_true", help="write over a file that is there")


def run_new(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Take the options; write, read back and show."""
    from avc_casadi.files.new_problem import NewProblem
    from avc_casadi.files.problem_file import problem_document
    from avc_casadi.present.rows.design import new as answer

    path = output_file(args.file, "FILE", (".toml",))
    if path.exists() and not args.force:
        raise avc.InputError.of(f"{args.file!r} is there already; allowed: another name, or --force", key="FILE")
    typed = {one.key: text for one in EVERY if (text := getattr(args, one.option[2:].replace("-", "_"))) is not None}
    turned = RADIUS.key in typed or any(given != names[0] for given, names in getattr(args, "worded", {}).values())
    new = NewProblem(path, args.like or "", "rotary" if turned else "linear", args.held, typed)
    check_worded(args, new.units)
    known = {one.key for one in new.options()}
    of_hands = "goes with --held foot or --held other; leave it out"
    whys = {RADIUS.key: "is that of the device of --like; leave it out", **{one.key: of_hands for one in HANDS}}
    alien = [avc.Fault("", None, key, whys[key]) for key in new.typed if key not in known]
    if args.model is not None or args.tip is not None:
        new = _at_tip(new, args.model, args.tip)
    if faults := [*alien, *new.faults()]:
        names = {one.key: one.names[not new.units.linear] for one in EVERY}
        raise avc.InputError([replace(one, key=names.get(one.key, one.key)) for one in faults])
    write_text(path, new.text(), "FILE")
    problem = new.problem()
    data = {
        "file": str(path),
        "problem": problem_document(problem),
        "held": new.held,
        "assumed": new.assumed(),
        "not_known": [{"key": new.units.key(one.key), "message": one.cost} for one in new.unknown()],
        "warnings": [{"key": new.units.key(one.key), "message": one.message} for one in new.doubts()],
        "model": None if new.tip is None else {"file": args.model, "tip": args.tip, **asdict(new.tip)},
    }
    return answer(data, problem, args.file)


def _at_tip(new: NewProblem, model: str | None, tip: str | None) -> NewProblem:
    """Return a draft with the mass and the damping at the tip of a model."""
    from avc_casadi.files.model_file import tip_mass

    if model is None or tip is None:
        raise avc.InputError.of("goes with --model and --tip, both", key="--model" if model is None else "--tip")
    if not new.units.linear:
        raise avc.InputError.of("moves its tip in lines, and the device turns; leave one out", key="--model")
    if MASS.key in new.typed:
        raise avc.InputError.of("is that of --model; leave it out", key=MASS.option)
    found = tip_mass(Path(model), tip)
    typed = {MASS.key: f"{found.mass_kg:.4g} kg", **new.typed}
    if found.damping_ns_per_m > 0:
        typed.setdefault(DAMPING.key, f"{found.damping_ns_per_m:.4g} N.s/m")
    return replace(new, typed=typed, tip=found)


def add_recommend(parser: argparse.ArgumentParser) -> None:
    """Recommend the coupling to deploy: its gains, what it renders, what limits it.

    Exit code 1 if no coupling is deployable: linearly stable with every hand of [hands] and released.
    """
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
    parser.add_argument("--trade-off", action="store_true", help="tell what a disk margin costs in impedance error")
    parser.add_argument("--hands", type=positive_int, default=100, metavar="N", help="simulated hands (default 100)")
    add_verbose(parser)


def run_recommend(args: argparse.Namespace, console: Console) -> Answer:
    """Recommend, write and show; 1 if nothing can be deployed."""
    from avc_casadi.present.rows.recommend import recommendation, stiffest
    from avc_casadi.recommendation.stiffest import stiffest as search

    if args.stiffest:
        refuse(
            args,
            ("out", "prove", "trade_off"),
            "goes with a recommendation, not with --stiffest; leave one of them out",
        )
    out = None if args.out is None else output_file(args.out, "--out", (".json",))
    with console.step(args.problem):
        problem = avc.load_problem(args.problem)
    if problem.simulation is not None or problem.follower is not None:
        refuse(args, ("stiffest", "lean_on_friction", "prove", "trade_off"))
    lean = args.lean_on_friction
    if args.stiffest:
        _compiler(console)
        data = search(problem, args.hands, lean_on_friction=lean, progress=console)
        return stiffest(data, problem, args.problem)
    options = {"lean_on_friction": lean, "prove": args.prove}
    if args.trade_off:
        options["with_trade_off"] = True
    found = _recommended(problem, console, args.hands, **options)
    # What the trials refuse, other verbs would take: they judge linear stability alone.
    written = None
    if out is not None and found.coupling is not None and found.deployable:
        write_text(out, _coupling_text(found), "--out")
        written = str(out)
    return recommendation(found, args.problem, written)


def _compiler(console: Console) -> None:
    from avc_casadi.simulation.native import compiler

    if compiler() is None:
        console.notice(_NO_COMPILER)


def _recommended(problem: avc.Problem, console: Console, hands: int = 100, **options: Any) -> Recommendation:
    """Return the recommended coupling to any other end."""
    from avc_casadi._util.parallel import processors

    _compiler(console)
    if problem.simulation is None and problem.follower is None:
        options |= {"workers": min(2, processors())}
    with console.step(f"couplings with {hands} hands"):
        return avc.recommend(problem, hands, versions=package_versions(), progress=console, **options)


def _coupling_text(found: Recommendation) -> str:
    from avc_casadi._util.json_values import json_text
    from avc_casadi.files.coupling_file import coupling_document

    assert found.coupling is not None  # noqa: S101 - asked of those with one
    return json_text(coupling_document(found.coupling), found.coupling.units)


def add_solve(parser: argparse.ArgumentParser) -> None:
    """Compute the gains of a problem by one method.

    Exit code 1 if a frequency has no gains. Whether the gains may go into a device is said on one line; the verbs that
    deploy refuse those that may not.
    """
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--method", help=f"{methods_help()}; default direct")
    parser.add_argument(
        "--solver", help="of direct: sqpmethod-qrqp (default), sqpmethod, ipopt, or another nlpsol plugin of CasADi"
    )
    parser.add_argument("--tolerance", type=float, metavar="TOL", help="tolerance asked of the solver")
    parser.add_argument("--as-printed", action="store_true", help="closed form with the paper's errors; -v lists them")
    parser.add_argument(
        "--out", metavar="FILE", help="write the coupling: .json (everything), or .csv (the bare table)"
    )
    add_verbose(parser)


def run_solve(args: argparse.Namespace, console: Console) -> Answer:
    """Solve, write and show."""
    from avc_casadi._util.json_values import json_text
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.coupling_file import coupling_document
    from avc_casadi.files.gain_file import gain_csv
    from avc_casadi.present.rows import solution_data
    from avc_casadi.present.rows.design import solution

    method = args.method or ("closed-form" if args.as_printed else "direct")
    out = None if args.out is None else output_file(args.out, "--out", (".json", ".csv"))
    problem = avc.load_problem(args.problem)
    with console.step(f"{method}: {len(problem.frequencies_hz())} frequencies"):
        gains = avc.solve(
            problem, method, solver=args.solver, tolerance=args.tolerance, as_printed=args.as_printed, progress=console
        )
    with console.step("table that runs"):
        coupling = Coupling.of(problem, gains, versions=package_versions()) if gains.usable.any() else None
    with console.step(f"certificate of {gains.rows} rows"):
        data = solution_data(problem, gains, coupling, avc.certify(problem, gains, progress=console))
    if out is not None:
        text = json_text(data, problem.units)
        if out.suffix.lower() == ".csv":
            text = gain_csv(gains)
        elif coupling is not None:
            certificate = data["certificate"] | {"deployable": data["deployable"]}
            text = json_text(data | coupling_document(coupling.with_certificate(certificate)), problem.units)
        write_text(out, text, "--out")
    return solution(data, problem, args.problem, args.out)


def add_compare(parser: argparse.ArgumentParser) -> None:
    """Put the methods side by side, frequency by frequency, with a verdict."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument(
        "--mine",
        type=gain_pair,
        metavar="K,B",
        help="judge a constant pair too, for example 7000,10: N/m and N.s/m (of a knob N.m/rad and N.m.s/rad)",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the comparison: .png, .svg or .pdf")
    add_verbose(parser)


def gain_pair(text: str) -> tuple[float, float]:
    """Parse "K,B"."""
    try:
        k, b = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no pair K,B; allowed: stiffness in N/m and damping in N.s/m, as 7000,10"
        ) from None
    return k, b


def run_compare(args: argparse.Namespace, console: Console) -> Answer:
    """Solve by all methods, compare, draw and show."""
    from avc_casadi.design.comparison.document import comparison_document
    from avc_casadi.present.rows.design import comparison

    plot = None if args.plot is None else output_file(args.plot, "--plot", PICTURES)
    problem = avc.load_problem(args.problem)
    found = _compared(problem, args.mine, console)
    if plot is not None:
        from avc_casadi.present.figures.comparison import draw_comparison

        with console.step("figure"):
            write_figure(plot, draw_comparison(found))
    return comparison(comparison_document(found), problem, args.problem, args.plot)


def _compared(problem: avc.Problem, mine: tuple[float, float] | None, console: Console) -> Comparison:
    def solve(problem: avc.Problem, method: str) -> GainSchedule:
        with console.step(f"{method}: {len(problem.frequencies_hz())} frequencies"):
            return avc.solve(problem, method, progress=console)

    return avc.compare(problem, mine=mine, solver=solve)


def add_run(parser: argparse.ArgumentParser) -> None:
    """Do all of it: recommend a coupling, try it, report and push, and answer the paper's question.

    What goes into the device is the recommended coupling (coupling.json), or that of --method. The gains that answer
    the paper's question are for comparison (gains.json). Writes the figures and one self-contained report.html too. A
    [simulation] or a [follower] has no paper's question: the coupling, its certificate and figures alone.
    """
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--out", metavar="DIR", help="folder for the results; default avc-<name>")
    parser.add_argument(
        "--method",
        metavar="NAME",
        help=f"deploy the gains of this method, not the recommended coupling: {methods_help()}",
    )
    add_verbose(parser)
    add_unsafe(parser)


def run_run(args: argparse.Namespace, console: Console) -> Answer:
    """Run the main job."""
    with console.step(args.problem):
        problem = avc.load_problem(args.problem)
    wanted = f"avc-{problem.name.replace('/', '-')}" if args.out is None else args.out
    with output_folder(wanted, "--out") as folder:
        if problem.simulation is not None or problem.follower is not None:
            refuse(args, ("method", "unsafe"))
            return _run_pair(problem, args, console, folder, Path(wanted))
        return _run_wall(problem, args, console, folder, Path(wanted))


def _run_pair(problem: avc.Problem, args: argparse.Namespace, console: Console, folder: Path, shown: Path) -> Answer:
    """Recommend, certify, draw and report; there is no NLP for it."""
    from avc_casadi._util.files import write_file
    from avc_casadi.present.report import pair_pictures, report_html
    from avc_casadi.present.rows.recommend import recommendation

    found = _recommended(problem, console)
    files = ["report.html"]
    if found.coupling is not None:
        write_file(folder / "coupling.json", _coupling_text(found))
        files.append("coupling.json")
    with console.step("figures"):
        drawn = pair_pictures(found, console)
        files += _draw(drawn, folder)
    written = str(shown / "coupling.json") if found.coupling is not None else None
    answer = recommendation(found, args.problem, written)
    report = report_html(answer, problem, list(drawn.values()), package_versions())
    write_file(folder / "report.html", report)
    where = f"{shown / 'report.html'} and {len(files) - 1} files beside it"
    return _gathered(answer, shown, files, where, {})


def _gathered(answer: Answer, shown: Path, files: list[str], where: str, beside: dict[str, Any]) -> Answer:
    """Return the answer of a run: where its files are, with the recommendation."""
    from avc_casadi.present.row import row

    data = {"folder": str(shown), "files": sorted(files), "deploy": answer.data} | beside
    rows = [one for one in answer.rows if one.label != "Written"]
    first = sum(one.rank == 0 for one in rows)
    return replace(answer, kind="run", data=data, rows=(*rows[:first], row("Written", where), *rows[first:]))


def _run_wall(problem: avc.Problem, args: argparse.Namespace, console: Console, folder: Path, shown: Path) -> Answer:
    """Do all of it, writing to one folder and reporting another."""
    from avc_casadi._util.files import write_file
    from avc_casadi._util.json_values import json_text
    from avc_casadi.design.comparison.comparison import with_delivered
    from avc_casadi.design.comparison.document import comparison_document
    from avc_casadi.files.gain_file import gain_csv, gain_document
    from avc_casadi.present.report import paper_pictures, paper_sections, report_html, wall_pictures
    from avc_casadi.present.rows import design
    from avc_casadi.present.rows.recommend import recommendation

    found = _to_deploy(problem, args.method, console)
    answer, coupling = recommendation(found, args.problem), found.coupling
    comparison = _compared(problem, None, console)
    if comparison.scope != "pointwise":
        with console.step(f"schedule, scope {comparison.scope}"):
            comparison = with_delivered(comparison, problem, avc.solve(problem, "schedule", progress=console))
    gains = comparison.methods[comparison.delivered]
    certificate = comparison.judged[comparison.delivered].certificate.document()
    with console.step("device"):
        push = _pushed(found, unsafe=args.unsafe)
    with console.step("figures"):
        wall, paper = wall_pictures(found), paper_pictures(comparison)
    compare = comparison_document(comparison)
    beside = design.paper_data(comparison, gains) | {"push": push}
    files = {
        "gains.json": json_text(gain_document(gains) | {"certificate": certificate}, problem.units),
        "gains.csv": gain_csv(gains),
        "compare.json": json_text(compare, problem.units),
    }
    if coupling is not None and push.get("deployable") is not False:
        files["coupling.json"] = _coupling_text(found)
    question = [*design.paper(beside), design.device(push)]
    more = paper_sections(compare, certificate, problem, paper, question)
    files["report.html"] = report_html(answer, problem, list(wall.values()), package_versions(), more)
    for name, text in files.items():
        write_file(folder / name, text)
    written = sorted([*files, *_draw(wall | paper, folder)])
    where = f"{shown / 'report.html'} and {len(written) - 1} files beside it"
    answer = design.run({"folder": str(shown), "files": written, "deploy": answer.data} | beside, answer, where)
    missing = design.without_gains(gain_document(gains))
    complaints = [missing, _refused(problem.name, found, push)]
    complaint = "\n".join(filter(None, complaints))
    return replace(answer, code=1 if complaint else 0, complaint=complaint)


def _to_deploy(problem: avc.Problem, method: str | None, console: Console) -> Recommendation:
    """Return the recommended coupling, or that of a method, whatever the verdict."""
    from avc_casadi.recommendation.recommend import judged_as_recommended

    if method is None:
        return _recommended(problem, console)
    with console.step(f"coupling to deploy: {method}"):
        gains = avc.solve(problem, method, progress=console)
        return judged_as_recommended(problem, gains, versions=package_versions(), progress=console)


def _pushed(found: Recommendation, *, unsafe: bool) -> dict[str, Any]:
    """Push what is deployable; trials refuse what the push, which judges linear stability alone, would take."""
    from avc_casadi.cli.deploy import push_or_say

    coupling = found.coupling if found.coupling and found.coupling.end == "wall" else None
    if coupling is None or found.deployable:
        return push_or_say(coupling, unsafe=unsafe)
    if not unsafe:
        return {"refused": found.reason, "deployable": False}
    push = push_or_say(coupling, unsafe=True)
    return push | {"unsafe": push.get("unsafe") or f"UNSAFE, went on by request: {found.reason}"}


def _refused(name: str, found: Recommendation, push: dict[str, Any]) -> str:
    """Return why nothing runs on the device; empty where it does."""
    if not found.deployable and not push.get("unsafe"):
        what = "no coupling is deployable" if found.coupling is None else "not deployable, push refused"
        return f"avc: {name}: {what}"
    return f"avc: {name}: push refused" if "refused" in push else ""


def _draw(drawn: dict[str, Picture], folder: Path) -> list[str]:
    """Write each figure as PNG and SVG; return the names of the files."""
    from avc_casadi._util.files import write_file

    files = {
        f"{name}{end}": one for name, each in drawn.items() for end, one in ((".png", each.png), (".svg", each.svg))
    }
    for name, content in files.items():
        write_file(folder / name, content)
    return list(files)
