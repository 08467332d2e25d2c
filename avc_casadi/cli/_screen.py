"""A scene without each of its effects in turn: which ones it needs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import nanoseconds, number, table

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.schedule import GainSchedule


def screened(
    problem: Problem,
    gains: Coupling | GainSchedule | None,
    notes: list[str],
    tolerance: float,
    console: Console,
) -> Answer:
    """Screen and show.

    Args:
        problem: with the scene.
        gains: what its loop runs with; None is no coupling.
        notes: to be told of the gains.
        tolerance: largest relative change of position, force and stiffness that does not count.
        console: is told how far it is.
    """
    from avc_casadi.model.gains import NO_COUPLING
    from avc_casadi.simulation.screen import screen

    with console.step("the scene without each of its effects"):
        chosen = NO_COUPLING if gains is None else gains
        document = screen(problem, chosen, tolerance=tolerance, progress=console).document()
    document["notes"] = notes
    return Answer(document, "\n".join([_text(document), *(f"note: {note}" for note in notes)]))


def _text(document: dict[str, Any]) -> str:
    head = (
        "without",
        "position\n%",
        "force\n%",
        "stiffness\n%",
        "outcome",
        "saves\ninstructions",
        "saves\nns a sample",
        "needed",
    )
    rows = [
        [
            effect["kind"],
            *_changes(effect),
            effect["outcome"],
            str(effect["instructions"]),
            nanoseconds(effect["ns_per_step"], document["scatter_ns"]),
            "yes" if effect["needed"] else "no",
        ]
        for effect in document["effects"]
    ]
    tolerance = f"{100 * document['tolerance']:g} %"
    lines = [
        f"{document['problem']}: coupling {document['coupling']}, {document['outcome']} with all effects",
        table(head, rows, left=(0, 4, 7)),
        "changes are relative: rms over the run for position and force",
    ]
    if document["essential"]:
        lines.append(f"cannot be left out: {', '.join(document['essential'])} (the only mass)")
    together = document["together"]
    if together is None:
        lines.append(f"the scene needs all of them at a tolerance of {tolerance}")
    else:
        position, force, stiffness = _changes(together)
        lines.append(
            f"not needed at a tolerance of {tolerance}: {', '.join(document['unneeded'])}; without all of these: "
            f"position {position} %, force {force} %, stiffness {stiffness} %, {together['outcome']}"
        )
    return "\n".join(lines)


def _changes(found: dict[str, Any]) -> list[str]:
    values = (found["position_change"], found["force_change"], found["stiffness_change"])
    return [number(None if value is None else 100 * value, 3) for value in values]
