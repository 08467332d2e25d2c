"""Whether the force limit cuts a swing: what grows without it ends there in a limit cycle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Swing

# A force within this share of its limit stands at it.
_TOP = 0.999
# Where no limit was declared, a force that comes again and again is one: in this share of a swing over so many steps,
# over fewer of which all forces come again.
_AGAIN, _STEPS = 0.05, 14.0


def limited(log: Log, swing: Swing, limit_n: float | None) -> Swing:
    """Return a swing with its largest force, and the share of it in which the force stands at its limit.

    Args:
        log: on its grid.
        swing: its oscillation.
        limit_n: of the device; None where none was declared.
    """
    size = np.abs(log.force_n[swing.first : swing.last])
    largest = float(size.max(initial=0.0))
    if swing.found.kind == "none" or not largest:
        return swing
    share = float(np.mean(size > _TOP * (largest if limit_n is None else limit_n)))
    if limit_n is None and not (share > _AGAIN and swing.found.steps > _STEPS):
        share = 0.0
    return replace(swing, found=replace(swing.found, largest_force_n=largest, at_force_limit_share=share))
