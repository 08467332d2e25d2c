"""The tables that a comparison is told in, made from its document; command and page render the same ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from avc_casadi.certificate import TITLES
from avc_casadi.support import Cell, Table, counts_text, number, sample_rows

_SHORT = {"closed-form": "closed form"}
_MARK = {True: "pass", False: "fail", None: "refused"}


class ComparisonTables(NamedTuple):
    """All of them, in the order in which they are told."""

    frequencies: Table
    verdicts: Table
    safety: Table
    realism: Table


def comparison_tables(document: Mapping[str, Any]) -> ComparisonTables:
    """Return the tables of a `compare` document."""
    return ComparisonTables(_frequencies(document), _verdicts(document), _safety(document), _realism(document))


def _frequencies(document: Mapping[str, Any]) -> Table:
    """What the closed form asks for and what the optimiser gives at some of the frequencies."""
    header, columns = ["f\nHz"], [document["frequency_hz"]]
    for method in ("closed-form", document["optimum"]):
        asked = "requested_" if method == "closed-form" else ""
        keys = {
            "b N.s/m": f"{asked}damping_ns_per_m",
            "k N/m": f"{asked}stiffness_n_per_m",
            "|Z| err. N.s/m": "magnitude_error",
            "Re Z_h N.s/m": "real_part",
        }
        if method != "closed-form" and document["structure"] == "damped":
            keys["b_p N.s/m"] = "contact_damping_ns_per_m"
        header += [f"{_SHORT.get(method, method)}\n{title}" for title in keys]
        columns += [document["methods"][method][key] for key in keys.values()]
    shown = sample_rows(len(document["frequency_hz"]))
    rows = tuple((*(column[row] for column in columns), document["verdict"][row]) for row in shown)
    return Table(
        (*header, "\nverdict"), rows, left=(len(header),), digits=3, title="what each asks for, at some frequencies"
    )


def _verdicts(document: Mapping[str, Any]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for verdict, count in document["counts"].items():
        row = document["verdict"].index(verdict) if count else None
        where, why = (None, "") if row is None else (document["frequency_hz"][row], document["reason"][row])
        rows.append((verdict, count, where, why))
    return Table(
        ("verdict", "frequencies", "first at\nHz", "why there"),
        tuple(rows),
        left=(0, 3),
        title=f"{len(document['verdict'])} frequencies, pointwise: {counts_text(document['counts'])}",
    )


def _judged(document: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Every method, and the hand-tuned pair, by the names that people read."""
    judged = {name: (_SHORT.get(name, name), gains) for name, gains in document["methods"].items()}
    if document["mine"] is not None:
        judged["mine"] = ("mine", document["mine"])
    return {short: {**gains, "safety": document["safety"][name]} for name, (short, gains) in judged.items()}


def _safety(document: Mapping[str, Any]) -> Table:
    """What each is safe for; passivity and stability are different claims."""
    rows = []
    for name, gains in _judged(document).items():
        safety = gains["safety"]
        marks = [_MARK[passed] for passed in safety["levels"].values()]
        rows.append((name, *marks, _MARK[safety["let_go"]], safety["deployable"]))
    models = {
        level: found["model"]
        for level, found in document["methods"][document["optimum"]]["certificate"]["levels"].items()
    }
    return Table(
        ("certificate", *models, "let go", "deployable"),
        tuple(rows),
        left=(0,),
        title="what each is safe for",
        notes=(
            *(f"{level}: {TITLES[level]} ({model} model)" for level, model in models.items()),
            "deployable: linearly stable with every hand (L5) and with the device let go",
        ),
    )


def _realism(document: Mapping[str, Any]) -> Table:
    """How often each feels real; counts only among those that are equally safe."""
    jnd = 100 * document["methods"][document["optimum"]]["realism"]["jnd"]
    rows = tuple(
        (name, *(100 * gains["realism"][key] for key in ("share_inside_bounds", "share_inside_jnd")))
        for name, gains in _judged(document).items()
    )
    head = (
        "realism",
        "between U and L\n% of frequencies",
        f"complex error within {number(jnd, 3)} %\n% of frequencies",
    )
    return Table(head, rows, left=(0,), digits=3, title="how often each feels real")
