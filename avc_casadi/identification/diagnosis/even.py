"""An oscillation that nothing limits: all in contact and below the force limit, where a loop that grows would grow."""

from __future__ import annotations

import math

import numpy as np

from avc_casadi.identification.diagnosis.answer import Answer
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.loop import worst_mode
from avc_casadi.identification.diagnosis.oscillation import Oscillation

GROWN = 4.0
"""By how many factors of e a loop would grow where the log swings evenly, that is then not its oscillation."""
_ALWAYS = 0.97
_TOP = 0.999
# A position that toggles has its largest force at one of its counts, which is no limit.
_ONE_COUNT = 1.5
_FEW_STEPS = 3.0
# Between two counts an encoder takes the force of a motion that is up to a count high for that of this share of it, and
# holds a loop there that grows without its steps.
_LEAST_GAIN = 0.5


def unlimited(log: Log, found: Oscillation, limit_n: float | None) -> bool:
    """Return whether an oscillation neither leaves contact nor reaches a largest force.

    Args:
        log: on its grid.
        found: its oscillation.
        limit_n: force limit of the device, None where none was declared.
    """
    size = np.abs(log.force_n)
    top = size > _TOP * size.max()
    cut = limit_n is not None and size.max() >= _TOP * limit_n
    limited = np.mean(top) > 1 - _ALWAYS and (cut or np.ptp(log.position_m[top]) > _ONE_COUNT * log.encoder_m)
    return bool(found.contact_share > _ALWAYS and not limited)


def outgrows(answer: Answer, law: Law, log: Log, found: Oscillation, limit_n: float | None) -> bool:
    """Return whether a loop would long have grown beyond the few counts over which a log swings evenly.

    Args:
        answer: device and hand.
        law: what the computer makes of the position.
        log: on its grid.
        found: its oscillation.
        limit_n: force limit of the device, None where none was declared.
    """
    few = found.kind == "limit cycle" and found.steps < _FEW_STEPS
    if not few or not unlimited(log, found, limit_n):
        return False
    grows = worst_mode(answer, law, stiffness=_LEAST_GAIN, damping=_LEAST_GAIN).growth_per_s
    return math.isfinite(grows) and grows * (found.ends_s - found.begins_s) > GROWN
