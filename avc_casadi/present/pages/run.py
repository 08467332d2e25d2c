"""Summary of a run: answers to the paper's question, the recommended coupling, what the device received."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.pages.recommendation import recommendation_rows
from avc_casadi.present.pages.subject import headline
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def run_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, written: str) -> str:
    """Return the `run` document as a headline and about a dozen rows.

    Args:
        document: of `avc run --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        written: files by purpose.
    """
    rows = [
        *_question(document, problem),
        *recommendation_rows(document["deploy"], problem, briefly=True),
        _device(document["push"]),
        Row("Written", written),
    ]
    return page.rendered(headline(problem, shown), rows, spare=("Margins",))


def _question(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Answer the paper's question: CasADi's NLP, the closed form, the exact optimum, the verdict."""
    unit, rows, closed, check = problem.units.unit, document["rows"], document["closed_form"], document["cross_check"]
    gains = document["rows_with_gains"]
    spans = ", ".join(
        f"{symbol} {quantity(ends[0], unit(of))} to {quantity(ends[1], unit(of))}"
        for symbol, of, ends in (
            ("b", "N.s/m", document["damping_ns_per_m"]),
            ("k", "N/m", document["stiffness_n_per_m"]),
        )
        if ends is not None
    )
    solved = f"gains at {gains} of {rows} frequencies in {quantity(document['seconds']['solve'], 's', 2)}"
    if document["scope"] != "pointwise":
        solved += f", scope {document['scope']}"
    realisable = closed.get("solved", 0) + closed.get("active-bound", 0)
    found = [
        Row(
            f"CasADi, {document['method']}",
            f"{solved}{f': {spans}' if spans else ''}",
            Mark.PASS if gains == rows else Mark.FAIL,
        ),
        Row(
            "Closed form",
            f"realisable at {realisable} of {rows} frequencies",
            Mark.PASS if realisable == rows else Mark.CAUTION,
        ),
    ]
    if check is not None:
        parted = f", parts at {len(check['partings'])} frequencies: -v" if check["partings"] else ""
        told = f"agrees with direct within {check['magnitude_error']:.1g} of |Z|{parted}"
        disagrees = f"DISAGREES with direct{parted}"
        mark = Mark.PASS if check["agree"] and not parted else Mark.CAUTION if check["agree"] else Mark.FAIL
        found.append(Row("Exact optimum", told if check["agree"] else disagrees, mark))
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in document["counts"].items() if count)
    return [*found, Row("Verdicts", f"{verdicts or 'none'}, pointwise")]


def _device(push: dict[str, Any]) -> Row:
    """Describe the result of the push."""
    if "skipped" in push:
        return Row("Device", f"push skipped; {push['skipped']}", Mark.CAUTION)
    if push.get("deployable") is False:
        return Row("Device", "push refused, as the coupling is not deployable; --unsafe overrides", Mark.FAIL)
    if "refused" in push:
        return Row("Device", f"push refused; {push['refused']}", Mark.FAIL)
    tried, equal = push.get("in_the_loop"), "read back equal" if push["readback_equal"] else "read back NOT EQUAL"
    settled = tried is not None and tried.get("at_rest") is True
    loop = "" if tried is None else "; the hand in the loop settles" if settled else "; see -v for the loop with a hand"
    unsafe = f"; {push['unsafe']}" if push.get("unsafe") else ""
    mark = Mark.FAIL if not push["readback_equal"] else Mark.PASS if settled and not unsafe else Mark.CAUTION
    return Row("Device", f"coupling {push['coupling_id']} on {push['port']}, {equal}{loop}{unsafe}", mark)
