"""Measure what accuracy costs in time: solvers, gain tables, grids of frequencies, integrators."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from avc_casadi._util import units
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._text import number, table

if TYPE_CHECKING:
    from studies.accuracy.study import Accuracy


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Measure what accuracy costs in time: every method and solver over tolerances from 1e-2 to 1e-12 against the\n"
        "true optimum, gain tables of 10 to 1000 rows against solving between them, and grids of frequencies against\n"
        "the exact test of all frequencies; integrators of the problem's scene against the exact scheme. Takes one to\n"
        "three minutes."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--plot", metavar="FILE", help="draw the study: .png, .svg or .pdf")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Measure, draw and show."""
    from studies.accuracy.study import study_accuracy

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    with console.step("accuracy of solvers, tables, grids and the scene"):
        study = study_accuracy(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.layout import save_figure
        from studies.accuracy.figure import draw_accuracy

        with console.step("figure"):
            save_figure(draw_accuracy(study), plot)
    return Answer(study.document(), _text(study, args.plot))


def _text(study: Accuracy, plot: str | None) -> str:
    document = study.document()
    lines = [
        f"{study.problem}: what accuracy costs; the true optimum is that of {study.reference}",
        _solvers(document["solvers"]),
        "* is faster than all that are as near to the optimum, D is the default",
        f"default: {document['default']}",
        "",
        *_tables(document["tables"]),
        *_grids(document["grids"]),
        *_scenes(document["scenes"], document["without_scenes"]),
    ]
    if plot is not None:
        lines.append(f"drawn: {plot}")
    return "\n".join(lines)


def _solvers(costs: list[dict[str, Any]]) -> str:
    rows = [
        [
            cost["method"],
            cost["solver"] or "",
            "" if cost["tolerance"] is None else f"{cost['tolerance']:g}",
            number(1e6 * cost["seconds_first"], 3),
            number(1e6 * cost["seconds_per_frequency"], 3),
            number(cost["excess_error"], 2),
            number(cost["largest_excess_error"], 2),
            f"{100 * cost['optimal_share']:.0f} %",
            f"{100 * cost['solved_share']:.0f} %",
            ("*" if cost["pareto"] else "") + ("D" if cost["default"] else ""),
        ]
        for cost in costs
    ]
    head = ["\nmethod", "\nsolver", "\ntolerance", "first\nus/freq.", "steady\nus/freq.", "median\nexcess"]
    return table([*head, "largest\nexcess", "\noptimal", "\nsolved", ""], rows, left=(0, 1))


def _tables(errors: list[dict[str, Any]]) -> list[str]:
    if not errors:
        return ["no gain tables: a single frequency, or none with gains", ""]
    rows = [
        [
            str(error["rows"]),
            error["interpolation"],
            error["precision"],
            number(100 * error["median_error"], 3),
            number(100 * error["max_error"], 3),
            number(error["worst_real_part_ns_per_m"], 3),
        ]
        for error in errors
    ]
    head = [
        "\nrows",
        "\ninterpolation",
        "\nprecision",
        "median error\nof |Z_h| (%)",
        "largest\n(%)",
        "lowest Re Z_h\nbetween rows",
    ]
    return ["gain tables against solving at 4001 frequencies between their ends", table(head, rows, left=(1, 2)), ""]


def _grids(misses: list[dict[str, Any]]) -> list[str]:
    if not misses:
        return ["no grids: no frequency has gains", ""]
    rows = [[str(miss["points"]), number(miss["missed_violation"], 3), str(miss["missed_rows"])] for miss in misses]
    return [
        f"grids of frequencies against the exact test of all: {misses[0]['rows']} frozen gains violate the margin",
        table(["\npoints", f"violation not\nseen ({units.NS_PER_M})", "gains\ncalled passive"], rows, left=()),
        "",
    ]


def _scenes(costs: list[dict[str, Any]], why: str) -> list[str]:
    if not costs:
        return [f"no scene: {why}", ""]
    rows = [
        [
            cost["integrator"],
            str(cost["substeps"]),
            "diverges" if cost["error"] is None else number(1e6 * cost["error"], 3),
            number(1e3 * cost["seconds"], 3),
            str(cost["instructions"]),
        ]
        for cost in costs
    ]
    head = [
        "\nintegrator",
        "\nsubsteps",
        f"largest error of\nthe position ({units.UM})",
        "whole scene\n(ms)",
        "instructions\na sample",
    ]
    return ["integrators of the scene against the exact scheme", table(head, rows, left=(0,)), ""]
