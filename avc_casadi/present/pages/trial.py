"""Summary of a trial: how many simulated hands settle."""

from __future__ import annotations

from typing import Any

from avc_casadi.present.terminal import Mark, Page, Row


def trial_page(document: dict[str, Any], page: Page, shown: str) -> str:
    """Return the `trial` document as a headline and rows.

    Args:
        document: of `avc trial --json`.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    hands, settled, moving = document["hands"], document["at_rest"], document["moving"]
    low, high = (f"{100 * end:.4g}" for end in document["at_rest_interval"])
    interval = f"{100 * document['confidence']:g} % interval {low} to {high} %"
    motions = ", ".join(f"{name} {count}" for name, count in document["by_motion"].items())
    rows = [
        Row(
            "Settle",
            f"{settled} of {hands} hands in every motion ({interval})",
            Mark.PASS if settled == hands else Mark.CAUTION,
        ),
        Row("By motion", motions),
        Row("Simulated", ", ".join(document["effects"])),
    ]
    if moving:
        more = " and others" if hands - settled > len(moving) else ""
        rows.append(
            Row("Do not settle", f"by their number in the draw: {', '.join(map(str, moving))}{more}", Mark.FAIL)
        )
    friction = "" if document["friction"] else ", without dry friction"
    headline = f"{shown}   coupling {document['coupling']} · {hands} hands, seed {document['seed']}{friction}"
    return page.rendered(headline, rows)
