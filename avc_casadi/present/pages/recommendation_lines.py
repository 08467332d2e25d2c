"""Full text of a recommendation, and of the stiffest wall: conclusion, claims, assumptions."""

from __future__ import annotations

from typing import Any

from avc_casadi._util.text import number, text_table
from avc_casadi._util.units import N_PER_M, NS_PER_M
from avc_casadi.recommendation.told import conclusion_lines

_RESTING = ("at_rest", "at_rest_without_friction")


def recommendation_lines(document: dict[str, Any]) -> list[str]:
    """Return the full text of a recommendation, the conclusion first.

    Args:
        document: of `avc recommend --json`.
    """
    lines = [*conclusion_lines(document), ""]
    if document["what_would_help"]:
        rows = [[one["change"], number(one["stiffest_wall_n_per_m"])] for one in document["what_would_help"]]
        lines += [
            (
                f"a plain spring and damper: {number(document['plain_wall_n_per_m'])} {N_PER_M} for every hand, by "
                "linear stability alone: no hand tries it, with encoder, friction or bouncing, so what is deployed may "
                "be softer (--stiffest: the stiffest wall at which simulated hands settle, and its sensitivity)"
            ),
            text_table(["what would help", f"plain wall,\nlinear alone\n{N_PER_M}"], rows, left=(0,)),
        ]
    if document["certificate"]:
        lines += [f"claim: {claim['sentence']}" for claim in document["certificate"]["deployable"]["claims"]]
    if document["trial"] is not None:
        lines.append(
            f"simulated only: {', '.join(document['trial']['effects'])}; {', '.join(document['trial']['motions'])}"
        )
    if "complex_error_from" in document["felt"]:
        lines.append(f"impedance error: distance from {document['felt']['complex_error_from']}")
    lines += [f"assumed: {gap}" for gap in document["assumed"]]
    return lines


def stiffest_lines(document: dict[str, Any]) -> list[str]:
    """Return the full text of the stiffest wall.

    Args:
        document: of `avc recommend --stiffest --json`.
    """
    low, high = document["damping_ns_per_m"]
    wall = document["stiffest_wall_n_per_m"]
    rows = [
        [
            one["change"],
            "none" if one["stiffest_wall_n_per_m"] is None else number(one["stiffest_wall_n_per_m"]),
            *("" if one[key] is None else f"{one[key]} of {one['hands']}" for key in _RESTING),
        ]
        for one in (document | {"change": "as it is"}, *document["what_would_help"])
    ]
    found = f"{number(wall)} {N_PER_M} ({document['by']})" if wall is not None else "none was found"
    asked = f", tried by {document['hands']} simulated hands" if wall is not None else ""
    return [
        f"{document['problem']}: stiffest wall: {found}, linearly stable with every hand and released{asked}",
        *_confirmed(document["confirmed"]),
        (
            f"a plain spring and damper: {number(document['plain_wall_n_per_m'])} {N_PER_M}, with {number(low)} to "
            f"{number(high)} {NS_PER_M} of wall and contact damping together, by linear stability alone: where hands "
            "settle may be softer"
            if document["plain_wall_n_per_m"]
            else "a plain spring and damper: no wall is linearly stable with every hand and released"
        ),
        text_table(["what would help", f"stiffest wall\n{N_PER_M}", "settle", "without\nfriction"], rows, left=(0,)),
        *(f"assumed: {gap}" for gap in document["assumed"]),
        *(f"not used: {what}" for what in document["not_used"]),
    ]


def _confirmed(others: dict[str, int] | None) -> list[str]:
    if others is None:
        return []
    return [
        (
            f"of {others['hands']} hands that had no part in the choice {others['at_rest']} settle, "
            f"{others['at_rest_without_friction']} without friction, {others['quiet']} below the vibrotactile threshold"
        )
    ]
