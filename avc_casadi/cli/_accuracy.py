"""Measure what accuracy costs in time: methods and solvers over tolerances against the true optimum."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi._util.text import number, text_table
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure
from avc_casadi.cli._subject import load_problem


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Measure what accuracy costs in time: every method, and every solver over tolerances from 1e-2 to 1e-12,\n"
        "against the true optimum of each frequency, which `exact` finds by geometry. Takes about a minute."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--plot", metavar="FILE", help="draw time against error: .png, .svg or .pdf")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Measure, draw and show."""
    from avc_casadi.design.comparison.accuracy import accuracy_document, solver_costs

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    with console.step("time and error of each solver"):
        costs = solver_costs(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.accuracy import draw_accuracy

        with console.step("figure"):
            write_figure(plot, draw_accuracy(costs))
    document = accuracy_document(problem, costs)
    lines = [
        f"{problem.name}: time a frequency and error of |Z_h| beyond the optimum of `exact`, relative to |Z_h_ds|",
        _solvers(document["solvers"]),
        "* is faster than all that are as near to the optimum, D is the default",
    ]
    return Answer(document, "\n".join([*lines, *([] if plot is None else [f"drawn: {args.plot}"])]))


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
    return text_table([*head, "largest\nexcess", "\noptimal", "\nsolved", ""], rows, left=(0, 1))
