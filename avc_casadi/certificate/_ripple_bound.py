"""L9: how far encoder, noise and friction move device and force in kept contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.certificate._proof_level import proof_level
from avc_casadi.proof import Outcome, Rest, bound_ripple
from avc_casadi.support import SILENT, Progress, plain

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import LevelResult
    from avc_casadi.coupling import Coupling


def ripple_level(coupling: Coupling, found: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Bound the ripple of gains that do not vary: half an encoder step, noise of four times its rms, dry friction.

    Args:
        coupling: what runs.
        found: its rows with what is known of their rest.
        progress: told of the boxes.
    """

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        return proof_level("L9", outcome, claim, np.full(len(found), outcome == "proved"), detail)

    if len(found) > 1:
        return told("open", "gains that vary are not bounded: a change of gains is a disturbance of its own", {})
    if coupling.runtime.observer_mass_kg is not None:
        return told("open", "the observer between encoder steps is not linear", {})
    try:
        bound = bound_ripple(found[0].law, coupling.problem.device, found[0].hand, progress)
    except UnsupportedError as refusal:
        return told("open", str(refusal), {})
    low, high = bound.press_n
    claim = (
        f"in kept contact errors of {1e6 * bound.error_m:.3g} um and friction of {bound.friction_n:.3g} N move every "
        f"hand by at most {1e6 * bound.position_m:.3g} um and the force by at most {bound.force_n:.3g} N (worst "
        f"corner: {1e6 * bound.corners_position_m:.3g} um, {bound.corners_force_n:.3g} N)"
    )
    detail = {"ripple": plain(vars(bound))}
    if high is not None and high <= low:
        return told("open", f"{claim}; at no press are contact and force limit both kept by this bound", detail)
    upper = "" if high is None else f" and below {high:.3g} N"
    return told("proved", f"{claim}; for presses above {low:.3g} N{upper}", detail)
