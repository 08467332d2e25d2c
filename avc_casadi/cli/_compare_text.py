"""A comparison as text for people: a table of some frequencies, the counts with reasons, what the closed form is."""

from __future__ import annotations

from typing import Any

from avc_casadi.cli._text import counts, number, passive_limit, sample_rows, table

_SHORT = {"closed-form": "closed form"}


def comparison_text(document: dict[str, Any], plot: str | None = None) -> str:
    """Return the comparison as a table of some frequencies, counts with reasons, and what the closed form is."""
    lines = [
        f"{document['problem']}: {document['title']}",
        f"structure {document['structure']}, model {document['model']}, pointwise: each frequency on its own",
        *_other_scope(document),
        _table(document),
        "",
        *_verdicts(document),
        "",
        *_injection(document),
        *_cross_check(document),
        "",
        *_judged(document),
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
    lines = [f"{len(document['verdict'])} frequencies, pointwise: {counts(document['counts'])}"]
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
    word = "agree" if check["agree"] else "DISAGREE"
    return [
        (
            f"direct and exact {word}, pointwise: magnitude errors within {check['magnitude_error']:.1e}, distances "
            f"within {check['distance']:.1e} (relative), {check['only_one']} frequencies solved by one alone"
        )
    ]


def _judged(document: dict[str, Any]) -> list[str]:
    """Certificate levels and realism of each method; passivity and stability are different claims."""
    judged = {_SHORT.get(name, name): gains for name, gains in document["methods"].items()}
    if document["mine"] is not None:
        judged["mine"] = document["mine"]
    rows = []
    for name, gains in judged.items():
        realism = gains["realism"]
        marks = ["pass" if found["pass"] else "fail" for found in gains["certificate"]["levels"].values()]
        shares = (realism["share_inside_bounds"], realism["share_inside_jnd"])
        rows.append([name, *marks, *(number(100 * share, 3) for share in shares)])
    optimum = document["methods"][document["optimum"]]
    levels, jnd = optimum["certificate"]["levels"], 100 * optimum["realism"]["jnd"]
    head = ("certificate", *levels, "between U, L\n% of f", f"within {jnd:.3g} %\n% of f")
    names = [f"  {level}: {found['title']} ({found['model']} model)" for level, found in levels.items()]
    return [table(head, rows, left=(0,)), *names]


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
