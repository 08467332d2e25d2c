"""Summary of a comparison: the closed form, CasADi and the exact optimum; and all of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from shlex import quote
from statistics import median
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number, percent, quantity
from avc_casadi._util.units import KG, MASS, NS_PER_M
from avc_casadi.design.comparison.document import comparison_tables
from avc_casadi.present.pages.subject import counts, headline, passive_limit, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# Number of listed frequencies at which the direct and the exact solution differ.
_PARTINGS = 5


def comparison_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, drawn: str | None) -> str:
    """Return the `compare` document as a headline and rows.

    Args:
        document: of `avc compare --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        drawn: file of the picture, if one was drawn.
    """
    rows = [
        *(_method(name, gains, document) for name, gains in document["methods"].items()),
        Row("Verdicts", f"{counts(document['counts'])}, pointwise"),
        *_deployable(document),
        *_realism(document),
        *_injection(document, problem),
        *_mine(document, problem),
        passive_limit(document["passive_limit_n_per_m"], problem.units),
    ]
    if document["problem_scope"] != document["scope"]:
        own = f"gains of the problem's own scope, {document['problem_scope']} (avc run, avc solve)"
        rows.append(Row("Not compared", own, Mark.CAUTION))
    if drawn is not None:
        rows.append(Row("Drawn", drawn))
    return page.rendered(
        headline(problem, shown), rows, [f"avc recommend {quote(shown)}", f"avc compare {quote(shown)} -v"]
    )


def _method(name: str, gains: dict[str, Any], document: dict[str, Any]) -> Row:
    """Describe where a method has gains, and the first reason why not, or its distance from the other optimum."""
    damping, check = gains["damping_ns_per_m"], document["cross_check"]
    missing = [row for row, b in enumerate(damping) if b is None]
    told = f"at {len(damping) - len(missing)} of {len(damping)} frequencies"
    mark = Mark.PASS if not missing else Mark.FAIL if name == document["optimum"] else Mark.CAUTION
    if name == "exact" and check is not None:
        agrees = f"agrees with direct within {check['magnitude_error']:.1g} of |Z|"
        told += f"; {agrees if check['agree'] else 'DISAGREES with direct'}"
        told += f", parts at {len(check['partings'])} frequencies" if check["partings"] else ""
        mark = Mark.FAIL if not check["agree"] else Mark.CAUTION if check["partings"] else mark
    elif missing:
        why = gains["reason"][missing[0]]
        # A closed form asks for something; of an optimum a sentence tells what cannot be met.
        who = "it " if why.startswith("asks") else ""
        told += f"; at {quantity(document['frequency_hz'][missing[0]], 'Hz')} {who}{why}"
    return Row(name.replace("-", " ").capitalize(), told, mark)


def _deployable(document: dict[str, Any]) -> list[Row]:
    rows = {str(row[0]): row[-1] for row in comparison_tables(document).safety.rows}
    passing = [name for name, verdict in rows.items() if verdict in ("yes", True)]
    if len(passing) == len(rows):
        return [Row("Deployable", f"all: {', '.join(passing)}", Mark.PASS)]
    failing = ", ".join(name for name in rows if name not in passing)
    if not passing:
        return [Row("Deployable", f"none of {failing}: not stable with every hand and released", Mark.FAIL)]
    return [Row("Deployable", f"{', '.join(passing)}; not {failing}", Mark.CAUTION)]


def _realism(document: dict[str, Any]) -> list[Row]:
    realism = {name: gains["realism"] for name, gains in document["methods"].items()}
    if document["mine"] is not None:
        realism["mine"] = document["mine"]["realism"]
    jnd = next(iter(realism.values()))["jnd"]
    between, near = (
        ", ".join(f"{name.replace('-', ' ')} {percent(one[key])}" for name, one in realism.items())
        for key in ("share_inside_bounds", "share_inside_jnd")
    )
    return [
        Row("Between U, L", f"of the frequencies: {between}"),
        Row("Impedance error", f"within {percent(jnd)}: {near}"),
    ]


def _injection(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe what the closed form adds to the desired wall."""
    injection, told = document["damping_injection"], quantities(problem.units)
    delta = injection["injected_damping_ns_per_m"]
    needed = [row for row, value in enumerate(delta) if value > 0]
    if not needed:
        return [Row("Injected", "nothing: the desired wall meets (12) everywhere")]
    worst = max(needed, key=delta.__getitem__)
    what = f"damper {told(delta[worst], 'N.s/m')}, {MASS} {told(injection['virtual_mass_kg'][worst], 'kg')} at most"
    return [Row("Injected", f"by the closed form at {len(needed)} frequencies: {what}")]


def _mine(document: dict[str, Any], problem: Problem) -> list[Row]:
    mine, told = document["mine"], quantities(problem.units)
    if mine is None:
        return []
    meets = mine["meets_margin"]
    pair = f"{told(mine['stiffness_n_per_m'], 'N/m')}, {told(mine['damping_ns_per_m'], 'N.s/m')}"
    outside = "" if mine["inside_box"] else "; outside the gain box"
    nearer = f"{mine['compared']} better at {percent(mine['share_schedule_better'])}"
    mark = Mark.PASS if all(meets) else Mark.CAUTION
    return [Row("Mine", f"{pair}: meets (12) at {sum(meets)} of {len(meets)} frequencies; {nearer}{outside}", mark)]


def comparison_lines(document: dict[str, Any]) -> list[str]:
    """Return the full `compare` document: tables, counts with reasons, the nature of the closed form.

    Args:
        document: of `avc compare --json`.
    """
    tables = comparison_tables(document)
    return [
        f"structure {document['structure']}, model {document['model']}, pointwise: each frequency on its own",
        tables.frequencies.text(),
        "",
        tables.verdicts.title,
        tables.verdicts.text(),
        "",
        *_injection_lines(document),
        *_cross_check_lines(document),
        "",
        tables.safety.text(),
        *(f"  {note}" for note in tables.safety.notes),
        "",
        tables.realism.text(),
        *_mine_lines(document),
    ]


def _injection_lines(document: dict[str, Any]) -> list[str]:
    injection, frequency = document["damping_injection"], document["frequency_hz"]
    delta = injection["injected_damping_ns_per_m"]
    needed = [row for row, value in enumerate(delta) if value > 0]
    if not needed:
        return ["the desired wall meets (12) everywhere: the closed form projects nothing"]
    worst = max(needed, key=delta.__getitem__)
    lines = [
        f"what the closed form is: the desired wall with a damper and a small virtual {MASS} beside it",
        (
            f"  damper {number(delta[worst])} {NS_PER_M} and {MASS} {number(injection['virtual_mass_kg'][worst])} {KG} "
            f"at worst ({number(frequency[worst])} Hz), needed at {len(needed)} frequencies"
        ),
    ]
    known = [(injection["residual_error"][row], row) for row in needed if injection["residual_error"][row] is not None]
    if known:
        error, row = max(known)
        lines.append(
            f"  a contact damper of at most {number(max(injection['contact_damper_ns_per_m'][r] for _, r in known))} "
            f"{NS_PER_M} beside that wall does it without the {MASS}, to {100 * error:.2g} % at worst "
            f"({number(frequency[row])} Hz)"
        )
    can = injection["damped_realisable"]
    line = f'  structure = "damped" can be built so at {sum(can)} of {len(can)} frequencies'
    if not all(can):
        row = can.index(False)
        line += f"; at {number(frequency[row])} Hz it {injection['damped_reason'][row]}"
    return [*lines, line]


def _cross_check_lines(document: dict[str, Any]) -> list[str]:
    check = document["cross_check"]
    if check is None:
        return []
    word, partings = "agree" if check["agree"] else "DISAGREE", check["partings"]
    return [
        (
            f"direct and exact {word}, pointwise: magnitude errors within {check['magnitude_error']:.1e}, distances "
            f"within {check['distance']:.1e} (relative), {check['only_one']} frequencies solved by one alone"
        ),
        *(f"  {number(each['frequency_hz'])} Hz: {each['reason']}" for each in partings[:_PARTINGS]),
        *([f"  and {len(partings) - _PARTINGS} more"] if len(partings) > _PARTINGS else []),
    ]


def _mine_lines(document: dict[str, Any]) -> list[str]:
    mine = document["mine"]
    if mine is None:
        return []
    ours = document["methods"][mine["compared"]]
    lowest = min(zip(mine["real_part"], document["frequency_hz"], strict=True))
    return [
        mine["safety_reason"],
        f"mine: lowest Re Z_h {number(lowest[0])} {NS_PER_M} at {number(lowest[1])} Hz",
        (
            f"mine: median error of |Z| {number(_median(mine['magnitude_error']))} {NS_PER_M}, {mine['compared']} "
            f"{number(_median(ours['magnitude_error']))}; {mine['compared']} is nearer or alone meets (12) at "
            f"{100 * mine['share_schedule_better']:.3g} % of the frequencies, mine at "
            f"{100 * mine['share_pair_better']:.3g} %"
        ),
    ]


def _median(values: Sequence[float | None]) -> float:
    return median([value for value in values if value is not None] or [math.nan])
