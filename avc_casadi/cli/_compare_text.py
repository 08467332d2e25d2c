"""A comparison as text for people: a table of some frequencies, the counts with reasons, what the closed form is."""

from __future__ import annotations

from typing import Any

from avc_casadi.cli._text import number, passive_limit

_PARTINGS = 5
"""Frequencies at which direct and exact part that are listed."""


def comparison_text(document: dict[str, Any], plot: str | None = None) -> str:
    """Return the comparison as a table of some frequencies, counts with reasons, and what the closed form is."""
    from avc_casadi.design.comparison.document import comparison_tables

    tables = comparison_tables(document)
    lines = [
        f"{document['problem']}: {document['title']}",
        f"structure {document['structure']}, model {document['model']}, pointwise: each frequency on its own",
        *_other_scope(document),
        tables.frequencies.text(),
        "",
        tables.verdicts.title,
        tables.verdicts.text(),
        "",
        *_injection(document),
        *_cross_check(document),
        "",
        tables.safety.text(),
        *(f"  {note}" for note in tables.safety.notes),
        "",
        tables.realism.text(),
        *_mine(document),
        passive_limit(document["passive_limit_n_per_m"]),
    ]
    if plot is not None:
        lines.append(f"drawn: {plot}")
    return "\n".join(lines)


def _other_scope(document: dict[str, Any]) -> list[str]:
    if document["problem_scope"] == document["scope"]:
        return []
    return [f"not compared: the gains of the problem's own scope, {document['problem_scope']} (avc run, avc solve)"]


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
            "  a contact damper of at most "
            f"{number(max(injection['contact_damper_ns_per_m'][r] for _, r in known))} N.s/m beside that wall does it "
            f"without the mass, to {100 * error:.2g} % at worst ({number(document['frequency_hz'][row])} Hz)"
        )
    can = injection["damped_realisable"]
    line = f'  structure = "damped" can be built so at {sum(can)} of {len(can)} frequencies'
    if not all(can):
        row = can.index(False)
        line += f"; at {number(document['frequency_hz'][row])} Hz it {injection['damped_reason'][row]}"
    return [*lines, line]


def _cross_check(document: dict[str, Any]) -> list[str]:
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


def _mine(document: dict[str, Any]) -> list[str]:
    mine = document["mine"]
    if mine is None:
        return []
    meets = mine["meets_margin"]
    lowest = min(range(len(meets)), key=mine["real_part"].__getitem__)
    ours = document["methods"][mine["compared"]]
    return [
        f"{mine['safety_reason']}; realism:",
        f"  mine ({number(mine['stiffness_n_per_m'])} N/m, {number(mine['damping_ns_per_m'])} N.s/m): meets (12) at "
        f"{sum(meets)} of {len(meets)} frequencies, lowest Re Z_h {number(mine['real_part'][lowest])} N.s/m at "
        f"{number(document['frequency_hz'][lowest])} Hz"
        + ("" if mine["inside_box"] else "; outside the problem's gain box"),
        (
            f"  median error of |Z| {number(_median(mine['magnitude_error']))} N.s/m, {mine['compared']} "
            f"{number(_median(ours['magnitude_error']))}; {mine['compared']} is nearer or alone meets (12) at "
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
