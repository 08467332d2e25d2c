"""Do all of it: answer the paper's question, recommend a coupling, try it, report and push.

The gains that answer the paper's question are for comparison (gains.json). What goes into the device is the recommended
coupling (coupling.json), or that of --method. Writes the figures and one self-contained report.html too. A [simulation]
or a [follower] has no paper's question: the coupling, its certificate and figures alone.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._compare import compared, infeasible
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._deploy import push_or_say
from avc_casadi.cli._files import output_folder
from avc_casadi.cli._recommend import recommend_document
from avc_casadi.cli._run_other_end import run_to_other_end
from avc_casadi.cli._solve import without_gains
from avc_casadi.cli._subject import add_unsafe, load_problem
from avc_casadi.cli._versions import package_versions
from avc_casadi.design.registry import methods_help

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.present.report.frame import Picture

_CAPTIONS = {
    "boundaries": "The range of impedance that feels real, the desired impedance, and the wall without coupling.",
    "perceived": "Perceived impedance with an enlarged part, the gains, and the real part that (12) constrains.",
    "comparison": "Errors of the methods and the verdict at each frequency.",
}
_OF_COUPLING = ("rendered", "loop")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--out", metavar="DIR", help="folder for the results; default avc-<name>")
    parser.add_argument(
        "--method",
        metavar="NAME",
        help=f"deploy the gains of this method, not the recommended coupling: {methods_help()}",
    )
    add_verbose(parser)
    add_unsafe(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Run the main job."""
    with console.step(args.problem):
        problem = load_problem(args.problem)
    asked = f"avc-{problem.name.replace('/', '-')}" if args.out is None else args.out
    with output_folder(asked, "--out") as folder:
        if problem.simulation is not None or problem.follower is not None:
            return run_to_other_end(problem, args, console, folder, Path(asked))
        return _worked_through(problem, args, console, folder, Path(asked))


def _worked_through(
    problem: avc.Problem, args: argparse.Namespace, console: Console, folder: Path, shown: Path
) -> Answer:
    """Do all of it, writing to one folder and reporting another."""
    from avc_casadi._util.files import write_file
    from avc_casadi._util.json_values import json_text
    from avc_casadi._util.parallel import Crew
    from avc_casadi.design.comparison.comparison import with_delivered
    from avc_casadi.design.comparison.document import comparison_document
    from avc_casadi.files.coupling_file import coupling_document
    from avc_casadi.files.gain_file import gain_document
    from avc_casadi.present.pages.run import run_page
    from avc_casadi.present.report.page import ReportContents, report_html
    from avc_casadi.present.report.summary import summarise, summary_lines
    from avc_casadi.recommendation.told import conclusion_lines

    comparison = compared(problem, None, console)
    if comparison.scope != "pointwise":
        with console.step(f"schedule, scope {comparison.scope}"):
            comparison = with_delivered(comparison, problem, avc.solve(problem, "schedule", progress=console))
    gains = comparison.methods[comparison.delivered]
    with Crew(2) as crew:
        drawn = crew.begin(partial(_drawn, comparison))
        with console.step("certificate"):
            certificate = avc.certify(problem, gains, progress=console).document()
        with console.step(f"coupling to deploy: {args.method or 'recommended'}"):
            deployment = (
                _recommended(problem, console) if args.method is None else _by_method(problem, args.method, console)
            )
        coupling: Coupling | None = deployment.pop("of")
        also_drawn = crew.begin(partial(_deployed, deployment, coupling))
        with console.step("figures"):
            figures = _written(drawn(), folder)
        with console.step("device"):
            push = _pushed(deployment, coupling, unsafe=args.unsafe)
            deployed = _written(also_drawn(), folder)
    compare = comparison_document(comparison)
    files = _tables(gains, certificate, compare)
    if coupling is not None and push.get("deployable") is not False:
        files["coupling.json"] = json_text(coupling_document(coupling))
    summary = summarise(problem, comparison, gains, certificate, push)
    conclusion = [*conclusion_lines(deployment), *([push["unsafe"]] if push.get("unsafe") else [])]
    contents = ReportContents(
        problem, comparison, summary, certificate, figures, package_versions(), conclusion, deployment, deployed
    )
    files["report.html"] = report_html(contents)
    for name, text in files.items():
        write_file(folder / name, text)
    names = [*_CAPTIONS, *(_OF_COUPLING if coupling is not None else ())]
    written = sorted([*files, *(f"{name}{ending}" for name in names for ending in (".png", ".svg"))])
    document = {"schema": "avc-run/2", "folder": str(shown), "files": written, "deploy": deployment} | summary
    where = f"{shown / 'report.html'} and {len(written) - 1} files beside it"
    text = run_page(document, problem, console.page, args.problem, where)
    more = "\n".join([": ".join(filter(None, (problem.name, problem.title))), *conclusion, *summary_lines(summary)[1:]])
    scoped = comparison.delivered != comparison.optimum
    by_frequency = without_gains(gain_document(gains)) if scoped else infeasible(compare)
    complaint = "\n".join(filter(None, [by_frequency, _refused(problem.name, deployment, coupling, push)]))
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint, more=more)


def _pushed(deployment: dict[str, Any], coupling: Coupling | None, *, unsafe: bool) -> dict[str, Any]:
    """Push what is deployable; trials refuse what the push, which judges linear stability alone, would take."""
    if coupling is None or deployment["deployable"]:
        return push_or_say(coupling, unsafe=unsafe)
    if not unsafe:
        return {"refused": deployment["reason"], "deployable": False}
    push = push_or_say(coupling, unsafe=True)
    return push | {"unsafe": push.get("unsafe") or f"UNSAFE, went on by request: {deployment['reason']}"}


def _refused(name: str, deployment: dict[str, Any], coupling: Coupling | None, push: dict[str, Any]) -> str:
    """Return why nothing runs on the device; empty where it does."""
    if not deployment["deployable"] and not push.get("unsafe"):
        what = "no coupling is deployable" if coupling is None else "not deployable, push refused"
        return f"avc: {name}: {what}"
    return f"avc: {name}: push refused" if "refused" in push else ""


def _tables(gains: avc.GainSchedule, certificate: dict[str, Any], compare: dict[str, Any]) -> dict[str, str]:
    """Return the texts of the gain files by frequency."""
    from avc_casadi._util.json_values import json_text
    from avc_casadi.files.gain_file import gain_csv, gain_document

    return {
        "gains.json": json_text(gain_document(gains) | {"certificate": certificate}),
        "gains.csv": gain_csv(gains),
        "compare.json": json_text(compare),
    }


def _recommended(problem: avc.Problem, console: Console) -> dict[str, Any]:
    """Return the `recommend` document, and the coupling itself as ``of``."""
    from avc_casadi._util.parallel import processors
    from avc_casadi.recommendation.recommend import recommend

    found = recommend(problem, versions=package_versions(), workers=min(2, processors()), progress=console)
    return recommend_document(found) | {"of": found.coupling}


def _by_method(problem: avc.Problem, method: str, console: Console) -> dict[str, Any]:
    """Return the results of a method's coupling, in the keys of the `recommend` document."""
    from avc_casadi.recommendation.recommend import judged_as_recommended

    gains = avc.solve(problem, method, progress=console)
    found = judged_as_recommended(problem, gains, versions=package_versions(), progress=console)
    return recommend_document(found) | {"of": found.coupling}


def _drawn(comparison: Comparison) -> dict[str, tuple[bytes, Picture]]:
    """Return each figure as PNG, and for the page."""
    from avc_casadi.present.figures.comparison import draw_boundaries, draw_comparison
    from avc_casadi.present.figures.perceived import draw_perceived
    from avc_casadi.present.report.frame import Picture
    from avc_casadi.present.report.page import picture_words

    words = picture_words(comparison)
    draws = {"boundaries": draw_boundaries, "perceived": draw_perceived, "comparison": draw_comparison}
    return {name: Picture.with_png(draw, comparison, _CAPTIONS[name], words[name]) for name, draw in draws.items()}


def _deployed(deployment: dict[str, Any], coupling: Coupling | None) -> dict[str, tuple[bytes, Picture]]:
    """Return the figures of the coupling to deploy in the same way; none without one."""
    from avc_casadi.present.figures.deployed import draw_loop, draw_rendered
    from avc_casadi.present.report.frame import Picture
    from avc_casadi.present.report.page import deployed_words
    from avc_casadi.recommendation.deployed import deployed

    if coupling is None:
        return {}
    found = deployed(coupling)
    words = deployed_words(deployment, found)
    return {
        name: Picture.with_png(draw, found, *words[name])
        for name, draw in zip(_OF_COUPLING, (draw_rendered, draw_loop), strict=True)
    }


def _written(drawn: dict[str, tuple[bytes, Picture]], folder: Path) -> list[Picture]:
    """Write each figure; return those of the report."""
    from avc_casadi._util.files import write_file

    for name, (png, picture) in drawn.items():
        write_file(folder / f"{name}.png", png)
        write_file(folder / f"{name}.svg", picture.wide)
    return [picture for _, picture in drawn.values()]
