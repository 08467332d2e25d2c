"""Rows of a recommendation about meeting the wall: where it begins, rebound of the released device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.terminal import Mark, Row
from avc_casadi.recommendation.contact_onset import REACHED_M
from avc_casadi.recommendation.told import begins_elsewhere

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# A rebound above that of a passive wall by more than an encoder's step makes of a speed.
_FASTER = 1.02


def contact_rows(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of a recommendation; none about what is as it should be.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
    """
    return [*_onset(document, problem), *_rebound(document, problem)]


def _onset(document: dict[str, Any], problem: Problem) -> list[Row]:
    felt, unit = document["felt"], problem.units.unit
    if not begins_elsewhere(felt):
        return []
    first = quantity(REACHED_M / problem.device.metres_per_unit, unit("m"))
    none = f"no {problem.units.key('force')} in the first {first}"
    parts = []
    for speed, depth in felt["edge_m"].items():
        side = "before" if (depth or 0.0) < 0 else "behind"
        place = none if depth is None else f"{quantity(abs(depth), unit('m'))} {side} the face"
        parts.append(f"{place} at {float(speed):.3g} {unit('m/s')}")
    return [Row("Contact onset", ", ".join(parts), Mark.CAUTION)]


def _rebound(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe strikes of the released device from which it returns faster than it came."""
    unit = problem.units.unit("m/s")
    told = [
        f"{share:.3g} times its {float(speed):.3g} {unit}"
        for speed, share in document["felt"]["rebound"].items()
        if share > _FASTER
    ]
    return [Row("Rebound", f"a released device leaves the wall at {', '.join(told)}", Mark.CAUTION)] if told else []
