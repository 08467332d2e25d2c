"""Leave out each effect of a scene in turn and say which ones it needs."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._simulate import gains_of
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._text import nanoseconds, number, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--gains", metavar="GAINS", help="gain file in place of the scene's own coupling")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.01,
        metavar="TOL",
        help="largest relative change of position, force and stiffness that does not count (default 0.01)",
    )


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Screen and show."""
    from avc_casadi.model.gains import NO_COUPLING
    from avc_casadi.simulation.screen import screen

    problem = load_problem(args.problem)
    gains, notes = gains_of(args.gains, problem, console)
    with console.step("the scene without each of its effects"):
        chosen = NO_COUPLING if gains is None else gains
        document = screen(problem, chosen, tolerance=args.tolerance, progress=console).document()
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
