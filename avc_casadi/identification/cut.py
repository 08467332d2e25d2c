"""A force that is cut off seldom: too little of it to refuse the log, and enough to lean the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.identification.evidence import compared
from avc_casadi.identification.fit import Fit, Window, judged
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.record import Record

# Shares of the samples in which the force may have been cut.
_SHARES = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08)
# The best of several limits is borne out where it betters the prediction by so many standard errors, and by this share.
# Few samples tell, so that neither is large; to leave out a force that acts makes the error's square larger by far.
_SURE, _WORTH = 2.0, 0.02


def cut_notes(predictor: Predictor, fit: Fit, window: Window, radius_m: float) -> list[str]:
    """Say where the force seems to be cut off; nothing where it acts as it is logged.

    Args:
        predictor: of the records.
        fit: of their forces as they were logged.
        window: of the fit.
        radius_m: how far the handle goes for a unit of the position.
    """
    size = np.abs(np.concatenate([record.force_n for record in predictor.records]))
    best: Fit | None = None
    limit_n = 0.0
    for share in _SHARES:
        limit = float(np.quantile(size, 1 - share))
        cut = judged(predictor.of(_cut(predictor.records, limit)), fit.structure, fit.search, fit.observer, window)
        if best is None or cut.rms_m < best.rms_m:
            best, limit_n = cut, limit
    trial = None if best is None else compared(fit, best, "cut")
    if trial is None or trial.standard_errors < _SURE or -trial.held_out_change < _WORTH:
        return []
    beyond = number(100 * float(np.mean(size > limit_n)), 1)
    most = number(limit_n * radius_m, 2)
    note = (
        f"the device seems to follow the force up to about {most} N only, and the log asks for more in {beyond} % of "
        "its samples: mass and damping lean by more than their intervals. Better: a log below that force "
        "(max_force_n), or the force as the amplifier gives it"
    )
    return [note]


def _cut(records: Sequence[Record], limit_n: float) -> list[Record]:
    return [replace(record, force_n=np.clip(record.force_n, -limit_n, limit_n)) for record in records]
