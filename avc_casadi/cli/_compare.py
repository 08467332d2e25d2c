"""Put the methods side by side, frequency by frequency, with a verdict."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure
from avc_casadi.cli._subject import load_problem

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.model.schedule import GainSchedule


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
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


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Solve by all methods, compare, draw and show."""
    from avc_casadi.design.comparison.document import comparison_document
    from avc_casadi.present.pages.comparison import comparison_lines, comparison_page

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    comparison = compared(problem, args.mine, console)
    if plot is not None:
        from avc_casadi.present.figures.comparison import draw_comparison

        with console.step("figure"):
            write_figure(plot, draw_comparison(comparison))
    document = comparison_document(comparison)
    missing = infeasible(document)
    text = comparison_page(document, problem, console.page, args.problem, args.plot)
    more = "\n".join(comparison_lines(document))
    return Answer(document, text, code=1 if missing else 0, complaint=missing, more=more)


def compared(problem: avc.Problem, mine: tuple[float, float] | None, console: Console) -> Comparison:
    """Compare with progress."""

    def solve(problem: avc.Problem, method: str) -> GainSchedule:
        with console.step(f"{method}: {len(problem.frequencies_hz())} frequencies"):
            return avc.solve(problem, method, progress=console)

    return avc.compare(problem, mine=mine, solver=solve)


def infeasible(document: dict[str, Any]) -> str:
    """Describe where the optimiser has no gains; empty where it always has."""
    rows = [row for row, verdict in enumerate(document["verdict"]) if verdict == "infeasible"]
    if not rows:
        return ""
    first = rows[0]
    return (
        f"avc: {len(rows)} of {len(document['verdict'])} frequencies are infeasible, first at "
        f"{number(document['frequency_hz'][first])} Hz: {document['reason'][first]}"
    )
