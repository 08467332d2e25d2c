"""Where a sample cut more finely would put a fit: an amplifier bends the velocity that dry friction looks at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi.identification.fit import Fit, Window, judged
from avc_casadi.identification.linear import PARTS
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.uncertainty import Spread, moves_of

_TIMES = 2
# What parts leave out falls with the square of their number: of the move to as many as one likes, the finer ones show
# all but a quarter; how far that law itself is off is known to as much.
_WHOLE = _TIMES**2 / (_TIMES**2 - 1.0)
_UNSURE = 1.0 / _TIMES**2


def finer(predictor: Predictor, fit: Fit, spread: Spread, window: Window) -> tuple[Fit, Spread]:
    """Move a fit to where ever finer parts of a sample put it; its interval holds what is left of the law of the move.

    Args:
        predictor: of the records.
        fit: at its best.
        spread: its uncertainty.
        window: of the fit.
    """
    if not (fit.structure.present("amplifier_bandwidth_hz") and fit.structure.present("coulomb_friction_n")):
        return fit, spread
    fine = predictor.of(predictor.records, parts=_TIMES * PARTS)
    close = judged(fine, fit.structure, fit.search, fit.observer, window)
    low, high = fit.structure.bounds()
    move = (moves_of(close) - moves_of(fit)).sum(axis=0)
    search = np.clip(fit.search + _WHOLE * move, low, high)
    moved = np.abs(search - fit.search)
    return replace(fit, search=search), replace(spread, half_width=spread.half_width + _UNSURE * moved)
