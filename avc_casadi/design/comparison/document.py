"""The JSON document of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from avc_casadi._util.arrays import ComplexArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import Cell, Table, counts_text, number, sample_rows
from avc_casadi.claims.registry import CLAIMS
from avc_casadi.files.gain_file import gain_document

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison


_SHORT = {"closed-form": "closed form"}
_MARK = {True: "pass", False: "fail", None: "refused"}


class ComparisonTables(NamedTuple):
    """All tables, in the order in which they are printed."""

    frequencies: Table
    verdicts: Table
    safety: Table
    realism: Table


def comparison_tables(document: Mapping[str, Any]) -> ComparisonTables:
    """Return the tables of a `compare` document."""
    return ComparisonTables(_frequencies(document), _verdicts(document), _safety(document), _realism(document))


def _frequencies(document: Mapping[str, Any]) -> Table:
    """Return the table of closed form and optimum at some of the frequencies."""
    header, columns = ["f\nHz"], [document["frequency_hz"]]
    for method in ("closed-form", document["optimum"]):
        asked = "requested_" if method == "closed-form" else ""
        keys = {
            "b": f"{asked}damping_ns_per_m",
            "k": f"{asked}stiffness_n_per_m",
            "|Z| err.": "magnitude_error",
            "Re Z_h": "real_part",
        }
        if method != "closed-form" and document["structure"] == "damped":
            keys["b_p"] = "contact_damping_ns_per_m"
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
    """Return the evaluations of every method and of the hand-tuned pair, by printed name."""
    judged = {name: (_SHORT.get(name, name), gains) for name, gains in document["methods"].items()}
    if document["mine"] is not None:
        judged["mine"] = ("mine", document["mine"])
    return {short: {**gains, "safety": document["safety"][name]} for name, (short, gains) in judged.items()}


def _safety(document: Mapping[str, Any]) -> Table:
    """Return the safety table; passivity and stability are different claims."""
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
            *(f"{level}: {CLAIMS[level].title} ({model} model)" for level, model in models.items()),
            "deployable: linearly stable with every hand (L5) and with the device released",
        ),
    )


def _realism(document: Mapping[str, Any]) -> Table:
    """Return the realism table, which matters only among equally safe ones."""
    jnd = 100 * document["methods"][document["optimum"]]["realism"]["jnd"]
    rows = tuple(
        (name, *(100 * gains["realism"][key] for key in ("share_inside_bounds", "share_inside_jnd")))
        for name, gains in _judged(document).items()
    )
    head = (
        "realism",
        "between U and L\n% of frequencies",
        f"impedance error within {number(jnd, 3)} %\n% of frequencies",
    )
    return Table(head, rows, left=(0,), digits=3, title="how often each feels real")


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """Return the `compare` document: JSON values only, null where a number is undefined."""
    return {
        "schema": "avc-compare/1",
        "problem": comparison.problem,
        "title": comparison.title,
        "model": comparison.model,
        "structure": comparison.structure,
        "scope": "pointwise",
        "problem_scope": comparison.scope,
        "margin_ns_per_m": comparison.margin_ns_per_m,
        "frequency_hz": plain(comparison.frequency_hz),
        "methods": {
            name: gain_document(gains) | comparison.judged[name].document()
            for name, gains in comparison.methods.items()
        },
        "optimum": comparison.optimum,
        "delivered": comparison.delivered,
        "verdict": [verdict.value for verdict in comparison.verdict],
        "reason": list(comparison.reason),
        "counts": comparison.counts(),
        **_parts("without_coupling", comparison.without_coupling),
        **_parts("target", comparison.target),
        **_parts("upper", comparison.upper),
        **_parts("lower", comparison.lower),
        "damping_injection": plain(vars(comparison.injection)),
        "safety": {name: judged.safety.document() for name, judged in comparison.judged.items()},
        "cross_check": None if comparison.cross_check is None else comparison.cross_check.document(),
        "mine": _mine(comparison),
        "passive_limit_n_per_m": plain(comparison.passive_limit_n_per_m),
    }


def _parts(name: str, impedance: ComplexArray) -> dict[str, Any]:
    return {f"{name}_re": plain(impedance.real), f"{name}_im": plain(impedance.imag)}


def _mine(comparison: Comparison) -> dict[str, Any] | None:
    mine = comparison.mine
    if mine is None:
        return None
    values = {name: value for name, value in vars(mine).items() if name != "impedance"}
    return {
        **plain(values),
        "better": mine.better,
        **_parts("impedance", mine.impedance),
        **comparison.judged["mine"].document(),
    }
