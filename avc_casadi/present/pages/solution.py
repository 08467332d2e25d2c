"""Summary of the gains of one method, and the rows of their table."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number, percent, quantity, sample_rows, text_table
from avc_casadi._util.units import N_PER_M, NS_PER_M
from avc_casadi.claims.certificate import levels_table
from avc_casadi.present.pages.subject import (
    counts,
    deployable,
    gains_text,
    headline,
    passive_limit,
    quantities,
)
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def solution_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, written: str | None) -> str:
    """Return the `solve` document as a headline and rows.

    Args:
        document: of `avc solve --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        written: file that holds the gains, if one was written.
    """
    status, solver = document["status"], document["solver"]
    have = sum(b is not None for b in document["damping_ns_per_m"])
    seconds = quantity(document["seconds"]["build"] + document["seconds"]["solve"], "s", 2)
    by = document["method"] + (f" ({solver})" if solver else "")
    rows = [
        Row(
            "Gains",
            f"{by}: at {have} of {len(status)} frequencies in {seconds}",
            Mark.PASS if have == len(status) else Mark.FAIL,
        ),
        *([Row("Coupling", gains_text(document, problem))] if have else []),
        Row("Status", counts(document["counts"])),
        *_errors(document, problem),
        _realism(document["realism"]),
        deployable(document["deployable"]),
        passive_limit(document["passive_limit_n_per_m"], problem.units),
    ]
    if "paper_errors" in document:
        told = f"{len(document['paper_errors'])} in the printed paper; these gains have those of (10) and (17)"
        rows.append(Row("Paper's errors", told, Mark.CAUTION))
    printed = " --as-printed" if "paper_errors" in document else ""
    again = f"avc solve {quote(shown)} --method {document['method']}{printed}"
    if written is None:
        return page.rendered(headline(problem, shown), rows, [f"{again} --out gains.json", f"{again} -v"])
    rows.append(Row("Written", written))
    return page.rendered(headline(problem, shown), rows, [f"avc certify {quote(written)}", f"{again} -v"])


def _errors(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe the largest errors of magnitude and impedance, and their frequencies."""
    told, frequency, rows = quantities(problem.units), document["frequency_hz"], []
    for label, key in (("Error of |Z|", "magnitude_error"), ("Impedance error", "complex_error")):
        found = zip(document[key], frequency, document["damping_ns_per_m"], strict=True)
        known = [(error, at) for error, at, b in found if None not in (error, b)]
        if known:
            error, at = max(known)
            value = told(error, "N.s/m") if key == "magnitude_error" else percent(error)
            rows.append(Row(label, f"at most {value}, at {quantity(at, 'Hz')}"))
    return rows


def _realism(realism: dict[str, Any]) -> Row:
    told = f"between U and L at {percent(realism['share_inside_bounds'])} of the frequencies"
    near = f"within {percent(realism['jnd'])} of the desired impedance at {percent(realism['share_inside_jnd'])}"
    return Row("Realism", f"{told}, {near}")


def solution_lines(document: dict[str, Any]) -> list[str]:
    """Return the full `solve` document: rows of gains, notes, levels, and the paper's errors.

    Args:
        document: of `avc solve --json`.
    """
    keys = ["frequency_hz", "damping_ns_per_m", "stiffness_n_per_m"]
    head = ["f\nHz", f"b\n{NS_PER_M}", f"k\n{N_PER_M}"]
    if document["structure"] == "damped":
        keys.append("contact_damping_ns_per_m")
        head.append(f"b_p\n{NS_PER_M}")
    keys += ["magnitude_error", "complex_error", "real_part"]
    head += [f"error of |Z|\n{NS_PER_M}", "impedance error\nto Z_h_ds", f"Re Z_h\n{NS_PER_M}", "\nstatus"]
    rows = [
        [*(number(document[key][row]) for key in keys), document["status"][row]]
        for row in sample_rows(len(document["status"]))
    ]
    lines = [
        f"structure {document['structure']}, model {document['model']}",
        text_table(head, rows, left=(len(head) - 1,)),
        *document["notes"],
        levels_table(document["certificate"]).text(),
    ]
    if "paper_errors" in document:
        lines += ["", "errors of the printed paper (these gains have those of (10) and (17)):"]
        for error in document["paper_errors"]:
            lines += [
                f"  {error['equation']}: {error['as_printed']}",
                f"      correct: {error['correct']}",
                f"      effect:  {error['effect']}",
            ]
    return lines
