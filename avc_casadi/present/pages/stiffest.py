"""Summary of the stiffest wall that a device can give, and of what would help."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi.present.pages.recommendation import change_text, settled_mark
from avc_casadi.present.pages.subject import Quantities, headline, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def stiffest_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `recommend --stiffest` document as a headline and rows, a change of the device each.

    Args:
        document: of `avc recommend --stiffest --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    told, plain, others = quantities(problem.units), document["plain_wall_n_per_m"], document["confirmed"]
    rows = [_stiffest("Stiffest wall", document, told, document["by"] or "")]
    limited, limit = document["at_force_limit"], problem.device.max_force_n
    if limited:
        what = f"{limited} of {document['hands']} presses end at the {told(limit, 'N')} limit, not on a stiffness"
        rows.append(Row(problem.units.key("force").capitalize(), what, Mark.CAUTION))
    if others is not None:
        settled, free, hands = (others[key] for key in ("at_rest", "at_rest_without_friction", "hands"))
        quiet = f"{others['quiet']} below the vibrotactile threshold"
        what = f"{settled} of {hands} other draws of hands settle, {free} without friction; {quiet}"
        rows.append(Row("Confirmed", what, settled_mark(settled, free, hands)))
    helps = document["what_would_help"]
    rows += [_stiffest(_capital(change_text(one)), one, told) for one in helps]
    if plain:
        low, high = (told(one, "N.s/m") for one in document["damping_ns_per_m"])
        rows.append(Row("Linear limit", f"plain coupling {told(plain, 'N/m')}, with {low} to {high} of damping"))
    else:
        rows.append(Row("Linear limit", "a plain coupling is stable at no wall", Mark.CAUTION))
    onwards = [f"avc recommend {quote(shown)} --out coupling.json", f"avc recommend {quote(shown)} --stiffest -v"]
    return page.rendered(headline(problem, shown), rows, onwards)


def _capital(text: str) -> str:
    """Return a text that begins with a capital; the rest keeps those it has: T is the sample time."""
    return text[:1].upper() + text[1:]


def _stiffest(label: str, found: dict[str, Any], told: Quantities, by: str | None = None) -> Row:
    if found["stiffest_wall_n_per_m"] is None:
        return Row(label, "none was found", Mark.NONE if by is None else Mark.FAIL)
    wall = told(found["stiffest_wall_n_per_m"], "N/m") + (f" ({by})" if by else "")
    settled, free = found["at_rest"], found["at_rest_without_friction"]
    if settled is None:
        return Row(label, wall)
    mark = settled_mark(settled, free, found["hands"]) if by else Mark.NONE
    return Row(label, f"{wall}: {settled} of {found['hands']} hands settle, {free} without friction", mark)
