"""Screening of a scene: it is run without each effect in turn, to find those that it needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi.cli._console import Answer, Console

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
    shown: str,
) -> Answer:
    """Screen and show.

    Args:
        problem: with the scene.
        gains: of its loop; None is no coupling.
        notes: on the gains.
        tolerance: largest negligible relative change of position, force and stiffness.
        console: shows the progress.
        shown: the problem or coupling as the user names it.
    """
    from avc_casadi.model.gains import NO_COUPLING
    from avc_casadi.present.pages.scene import screening_lines, screening_page
    from avc_casadi.simulation.screen import screen

    with console.step("the scene without each of its effects"):
        chosen = NO_COUPLING if gains is None else gains
        document = screen(problem, chosen, tolerance=tolerance, progress=console).document()
    document["notes"] = notes
    text = screening_page(document, problem, console.page, shown)
    return Answer(document, text, more="\n".join(screening_lines(document)))
