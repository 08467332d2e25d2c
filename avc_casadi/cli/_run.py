"""Do everything: solve, compare, certify, draw, report, and push to the emulated device.

Writes gains.json, gains.csv, compare.json, the figures and one self-contained report.html.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._certify import not_met
from avc_casadi.cli._compare import compared, infeasible
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_folder, write_text
from avc_casadi.cli._solve import json_text, without_gains
from avc_casadi.cli._versions import package_versions

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule
    from avc_casadi.study.comparison import Comparison

_CAPTIONS = {
    "boundaries": "The range of impedance that feels real, the desired impedance, and the wall without coupling.",
    "perceived": "Perceived impedance with an enlarged part, the gains, and the real part that (12) constrains.",
    "comparison": "Errors of the methods and the verdict at each frequency.",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--out", metavar="DIR", help="folder for the results; default avc-<name>")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Run the main job."""
    problem = avc.load_problem(args.problem)
    asked = f"avc-{problem.name.replace('/', '-')}" if args.out is None else args.out
    with output_folder(asked, "--out") as folder:
        return _worked_through(problem, console, folder, Path(asked))


def _worked_through(problem: avc.Problem, console: Console, folder: Path, shown: Path) -> Answer:
    """Do all of it, with files in one folder, told as files of another."""
    from avc_casadi.coupling import gain_csv, gain_document
    from avc_casadi.report import ReportContents, report_html, summarise, summary_lines
    from avc_casadi.study.comparison import comparison_document, with_delivered

    comparison = compared(problem, None, console)
    if comparison.scope != "pointwise":
        with console.step(f"direct, scope {comparison.scope}"):
            comparison = with_delivered(comparison, problem, avc.solve(problem))
    gains = comparison.methods[comparison.delivered]
    with console.step("certificate"):
        certificate = avc.certify(problem, gains).document()
    compare = comparison_document(comparison)
    files = {
        "gains.json": json_text(gain_document(gains) | {"certificate": certificate}),
        "gains.csv": gain_csv(gains),
        "compare.json": json_text(compare),
    }
    with console.step("figures"):
        figures = _draw(comparison, folder)
    with console.step("device"):
        push = _push(problem, gains)
    summary = summarise(problem, comparison, gains, certificate, push)
    contents = ReportContents(problem, comparison, summary, certificate, figures, package_versions())
    files["report.html"] = report_html(contents)
    for name, text in files.items():
        write_text(folder / name, text, "--out")
    written = sorted([*files, *(f"{name}{ending}" for name in _CAPTIONS for ending in (".png", ".svg"))])
    document = {"schema": "avc-run/1", "folder": str(shown), "files": written} | summary
    lines = [*summary_lines(summary), f"written: {shown / 'report.html'} and {len(written) - 1} files beside it"]
    scoped = comparison.delivered != comparison.optimum
    missing = without_gains(gain_document(gains)) if scoped else infeasible(compare)
    complaint = missing or not_met(problem, certificate)
    if "refused" in push:
        complaint = f"{complaint}\navc: push refused: {push['refused']}".lstrip()
    return Answer(document, "\n".join(lines), code=1 if complaint else 0, complaint=complaint)


def _draw(comparison: Comparison, folder: Path) -> list[tuple[str, str]]:
    """Write each figure as PNG and SVG; return captions with SVG texts for the report."""
    from avc_casadi.figures import draw_boundaries, draw_comparison, draw_perceived, figure_svg, save_figure

    drawn = {
        "boundaries": draw_boundaries(comparison),
        "perceived": draw_perceived(comparison),
        "comparison": draw_comparison(comparison),
    }
    texts = []
    for name, figure in drawn.items():
        svg = figure_svg(figure)
        save_figure(figure, folder / f"{name}.png")
        write_text(folder / f"{name}.svg", svg, "--out")
        texts.append((_CAPTIONS[name], svg))
    return texts


def _push(problem: avc.Problem, gains: GainSchedule) -> dict[str, Any]:
    """Push to the emulated device; a push that cannot be made is no reason to lose the rest."""
    from avc_casadi.cli._push import wall_of
    from avc_hardware import push

    if not gains.usable.any():
        return {"skipped": "no frequency has gains"}
    try:
        return push(gains, "emulator", settings=wall_of(problem)).document()
    except avc.MissingExtraError as error:
        return {"skipped": str(error)}
    except avc.LinkError as error:
        return {"refused": str(error)}
