"""Put the methods side by side, frequency by frequency, with a verdict."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._text import counts, number, sample_rows, table

if TYPE_CHECKING:
    from avc_casadi.comparison import Comparison
    from avc_casadi.design import GainSchedule

_SHORT = {"closed-form": "closed form"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument(
        "--mine", type=gain_pair, metavar="K,B", help="judge a constant pair too: N/m and N.s/m, for example 7000,10"
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the comparison: .png, .svg or .pdf")


def gain_pair(text: str) -> tuple[float, float]:
    """Read "K,B"."""
    try:
        k, b = (float(part) for part in text.split(","))
    except ValueError:
        k = b = math.nan
    if not (math.isfinite(k) and math.isfinite(b) and k >= 0 and b >= 0):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no pair K,B; allowed: stiffness in N/m and damping in N.s/m, finite and >= 0, as 7000,10"
        )
    return k, b


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Solve by all methods, compare, draw and show."""
    from avc_casadi.comparison import comparison_document

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = avc.load_problem(args.problem)
    comparison = compared(problem, args.mine, console)
    if plot is not None:
        from avc_casadi.figures import draw_comparison, save_figure

        with console.step("figure"):
            save_figure(draw_comparison(comparison), plot)
    document = comparison_document(comparison)
    missing = infeasible(document)
    return Answer(document, comparison_text(document, args.plot), code=1 if missing else 0, complaint=missing)


def compared(problem: avc.Problem, mine: tuple[float, float] | None, console: Console) -> Comparison:
    """Compare with progress."""

    def solve(problem: avc.Problem, method: str) -> GainSchedule:
        with console.step(f"{method}: {len(problem.frequencies_hz())} frequencies"):
            return avc.solve(problem, method)

    return avc.compare(problem, mine=mine, solver=solve)


def infeasible(document: dict[str, Any]) -> str:
    """Say where the optimiser has no gains; empty where it always has."""
    rows = [row for row, verdict in enumerate(document["verdict"]) if verdict == "infeasible"]
    if not rows:
        return ""
    first = rows[0]
    return (
        f"avc: {len(rows)} of {len(document['verdict'])} frequencies are infeasible, first at "
        f"{number(document['frequency_hz'][first])} Hz: {document['reason'][first]}"
    )


def comparison_text(document: dict[str, Any], plot: str | None = None) -> str:
    """Return the comparison as a table of some frequencies, counts with reasons, and what the closed form is."""
    lines = [
        f"{document['problem']}: {document['title']}",
        f"structure {document['structure']}, model {document['model']}",
        _table(document),
        "",
        *_verdicts(document),
        "",
        *_injection(document),
        *_cross_check(document),
        *_mine(document),
        (
            "no passive linear rendering on this device exceeds "
            f"{number(document['passive_limit_n_per_m'])} N/m at DC (sampled-data)"
        ),
    ]
    if plot is not None:
        lines.append(f"drawn: {plot}")
    return "\n".join(lines)


def _table(document: dict[str, Any]) -> str:
    head = ["f\nHz"]
    columns = [document["frequency_hz"]]
    for method in ("closed-form", document["optimum"]):
        name, gains = _SHORT.get(method, method), document["methods"][method]
        for title, key in (
            ("b N.s/m", "requested_damping_ns_per_m" if method == "closed-form" else "damping_ns_per_m"),
            ("k N/m", "requested_stiffness_n_per_m" if method == "closed-form" else "stiffness_n_per_m"),
            ("|Z| err.", "magnitude_error"),
            ("Re Z_h", "real_part"),
        ):
            head.append(f"{name}\n{title}")
            columns.append(gains[key])
    if document["structure"] == "damped":
        head.append(f"{document['optimum']}\nb_p N.s/m")
        columns.append(document["methods"][document["optimum"]]["contact_damping_ns_per_m"])
    rows = [
        [*(number(column[row], 3) for column in columns), document["verdict"][row]]
        for row in sample_rows(len(document["frequency_hz"]))
    ]
    return table([*head, "\nverdict"], rows, left=(len(head),))


def _verdicts(document: dict[str, Any]) -> list[str]:
    lines = [f"{len(document['verdict'])} frequencies: {counts(document['counts'])}"]
    for verdict, count in document["counts"].items():
        if count:
            row = document["verdict"].index(verdict)
            where = number(document["frequency_hz"][row])
            lines.append(f"  {verdict}, first at {where} Hz: {document['reason'][row]}")
    return lines


def _injection(document: dict[str, Any]) -> list[str]:
    injection = document["damping_injection"]
    delta = injection["injected_damping_ns_per_m"]
    needed = [row for row, value in enumerate(delta) if value > 0]
    if not needed:
        return ["the desired wall meets (12) everywhere: the closed form projects nothing"]
    worst = max(needed, key=delta.__getitem__)
    lines = [
        "what the closed form is: the desired wall with a damper and a small virtual mass beside it",
        (
            f"  damper {number(delta[worst])} N.s/m and mass {number(injection['virtual_mass_kg'][worst])} kg at worst "
            f"({number(document['frequency_hz'][worst])} Hz), needed at {len(needed)} frequencies"
        ),
    ]
    errors = [(injection["residual_error"][row], row) for row in needed]
    known = [(error, row) for error, row in errors if error is not None]
    if known:
        error, row = max(known)
        lines.append(
            '  with structure = "damped" a contact damper of at most '
            f"{number(max(injection['contact_damper_ns_per_m'][r] for _, r in known))} N.s/m renders it without the "
            f"mass, to {100 * error:.2g} % at worst ({number(document['frequency_hz'][row])} Hz)"
        )
    return lines


def _cross_check(document: dict[str, Any]) -> list[str]:
    check = document["cross_check"]
    if check is None:
        return []
    word = "agree" if check["agree"] else "DISAGREE"
    return [
        (
            f"direct and exact {word}: magnitude errors within {check['magnitude_error']:.1e}, distances within "
            f"{check['distance']:.1e} (relative), {check['only_one']} frequencies solved by one alone"
        )
    ]


def _mine(document: dict[str, Any]) -> list[str]:
    mine = document["mine"]
    if mine is None:
        return []
    meets = mine["meets_margin"]
    lowest = min(range(len(meets)), key=mine["real_part"].__getitem__)
    ours = document["methods"][mine["compared"]]
    return [
        f"mine ({number(mine['stiffness_n_per_m'])} N/m, {number(mine['damping_ns_per_m'])} N.s/m): meets (12) at "
        f"{sum(meets)} of {len(meets)} frequencies, lowest Re Z_h {number(mine['real_part'][lowest])} N.s/m at "
        f"{number(document['frequency_hz'][lowest])} Hz"
        + ("" if mine["inside_box"] else "; outside the problem's gain box"),
        (
            f"  median error of |Z| {number(_median(mine['magnitude_error']))} N.s/m, {mine['compared']} "
            f"{number(_median(ours['magnitude_error']))}; {mine['compared']} is better at "
            f"{100 * mine['share_schedule_better']:.3g} % of the frequencies, mine at "
            f"{100 * mine['share_pair_better']:.3g} %"
        ),
    ]


def _median(values: list[float | None]) -> float | None:
    known = sorted(value for value in values if value is not None)
    if not known:
        return None
    middle = len(known) // 2
    return known[middle] if len(known) % 2 else (known[middle - 1] + known[middle]) / 2
