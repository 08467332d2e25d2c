"""Whether an oscillation is that of a touch: a few cycles, and long contact after them."""

from __future__ import annotations

import numpy as np

from avc_casadi.identification.diagnosis.log import Log

# So few cycles are those of a touch, where contact goes on for so long after them, and for as many of their cycles.
_FEW_CYCLES, _AFTER_S = 8.0, 1.0


def passes(log: Log, begins_s: float, ends_s: float, last: int, hertz: float) -> bool:
    """Return whether a few cycles, as of a touch, are followed by long contact.

    Args:
        log: on its grid, without a tick missed.
        begins_s: of the oscillation.
        ends_s: of the oscillation.
        last: sample at which it ends.
        hertz: of the oscillation.
    """
    touching = np.count_nonzero(log.force_n[last:]) * log.ticks.period_s
    few = hertz * (ends_s - begins_s) < _FEW_CYCLES
    return bool(log.ticks.missed_share == 0 and few and touching > _AFTER_S and touching * hertz > _FEW_CYCLES)
