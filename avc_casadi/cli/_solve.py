"""Compute the gains of a problem by one method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.text import number
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._versions import package_versions
from avc_casadi.design.registry import methods_help

if TYPE_CHECKING:
    import argparse

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.schedule import GainSchedule


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nExit code 1 if a frequency has no gains. Whether the gains may go into a device is said on"
        " one line; the verbs that deploy refuse those that may not."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--method", help=f"{methods_help()}; default direct")
    parser.add_argument(
        "--solver", help="of direct: sqpmethod-qrqp (default), sqpmethod, ipopt, or another nlpsol plugin of CasADi"
    )
    parser.add_argument("--tolerance", type=float, metavar="TOL", help="tolerance asked of the solver")
    parser.add_argument("--as-printed", action="store_true", help="closed form with the paper's errors; -v tells them")
    parser.add_argument(
        "--out", metavar="FILE", help="write the coupling: .json (everything), or .csv (the bare table)"
    )
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Solve, write and show."""
    from avc_casadi.coupling import Coupling
    from avc_casadi.files.gain_file import gain_csv
    from avc_casadi.present.pages.solution import solution_lines, solution_page

    method = args.method or ("closed-form" if args.as_printed else "direct")
    out = None if args.out is None else output_file(args.out, "--out", (".json", ".csv"))
    problem = load_problem(args.problem)
    with console.step(f"{method}: {len(problem.frequencies_hz())} frequencies"):
        gains = avc.solve(
            problem, method, solver=args.solver, tolerance=args.tolerance, as_printed=args.as_printed, progress=console
        )
    with console.step("table that runs"):
        coupling = Coupling.of(problem, gains, versions=package_versions()) if gains.usable.any() else None
    with console.step(f"certificate of {gains.rows} rows"):
        document = solve_document(problem, gains, console)
        document["deployable"] = None if coupling is None else avc.deployable(coupling, console).document()
    if args.as_printed:
        document["paper_errors"] = paper_errors()
    if out is not None:
        write_text(out, gain_csv(gains) if out.suffix.lower() == ".csv" else _file_text(document, coupling), "--out")
    complaint = without_gains(document)
    text = solution_page(document, problem, console.page, args.problem, args.out)
    more = "\n".join(solution_lines(document))
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint, more=more)


def _file_text(document: dict[str, Any], coupling: Coupling | None) -> str:
    """Return the text of the coupling file; where no row has gains, of the plain document."""
    from avc_casadi._util.json_values import json_text
    from avc_casadi.files.coupling_file import coupling_document

    if coupling is None:
        return json_text(document)
    certificate = document["certificate"] | {"deployable": document["deployable"]}
    return json_text(document | coupling_document(coupling.with_certificate(certificate)))


def solve_document(problem: avc.Problem, gains: GainSchedule, console: Console) -> dict[str, Any]:
    """Return the `solve` document with certificate, realism and the limit shown with every result."""
    from avc_casadi.files.gain_file import gain_document
    from avc_casadi.paper.realism import judge_realism

    certificate = avc.certify(problem, gains, progress=console).document()
    limit = certificate["passive_limit_n_per_m"]
    realism = judge_realism(problem, gains.impedance, gains.usable).document()
    return gain_document(gains) | {"certificate": certificate, "realism": realism, "passive_limit_n_per_m": limit}


def paper_errors() -> list[dict[str, str]]:
    """Return the paper's errors as JSON values."""
    from avc_casadi.paper.errata import PAPER_ERRORS

    return [vars(error) for error in PAPER_ERRORS]


def without_gains(document: dict[str, Any]) -> str:
    """Describe the rows without gains, with reasons; empty where all have."""
    states, reasons, frequency = document["status"], document["reason"], document["frequency_hz"]
    rows = [row for row, b in enumerate(document["damping_ns_per_m"]) if b is None]
    if not rows:
        return ""
    lines = [f"avc: {len(rows)} of {len(states)} frequencies have no gains ({document['method']})"]
    for state in dict.fromkeys(states[row] for row in rows):
        of_state = [row for row in rows if states[row] == state]
        ends = dict.fromkeys((of_state[0], of_state[-1]))
        lines += [f"  {state} at {number(frequency[row])} Hz: {reasons[row]}" for row in ends]
        if len(of_state) > 2:
            lines.append(f"  and {len(of_state) - 2} more {state} between")
    return "\n".join(lines)
