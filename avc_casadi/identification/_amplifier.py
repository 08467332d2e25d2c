"""An amplifier as a lag of the first order, or as a current loop of the second: each is told from the other."""

from __future__ import annotations

import math
from dataclasses import replace

from avc_casadi.identification._fit import Fit, Window
from avc_casadi.identification._near import closely, rms_m_of, roughly
from avc_casadi.identification._predictor import Predictor
from avc_casadi.loop import CURRENT_LOOP_DAMPING_RATIO

# How much of delay and lag together may be lag, where a search begins.
_SHARES = (0.2, 0.5, 0.9)
_RATE_PER_S = 60.0
# The lag at low frequencies, in radians at the bandwidth.
_LAG = {1: 1.0, 2: 2 * CURRENT_LOOP_DAMPING_RATIO}


def of_the_other_order(predictor: Predictor, found: Fit, window: Window) -> Fit:
    """Return a model with an amplifier of the other order at its best.

    Args:
        predictor: of the records.
        found: the model with an amplifier of one order.
        window: of the fits.
    """
    order = found.structure.amplifier_order
    structure = replace(found.structure, amplifier_order=1 if order == 2 else 2)
    turn = 2 * math.pi * predictor.sample_time_s
    values = found.values
    late = values["delay_samples"] + _LAG[order] / (turn * values["amplifier_bandwidth_hz"])
    starts = [
        {
            **values,
            "delay_samples": (1 - share) * late,
            "amplifier_bandwidth_hz": _LAG[structure.amplifier_order] / (turn * share * late),
        }
        for share in _SHARES
    ]
    rough = [roughly(predictor, structure, start, _RATE_PER_S) for start in starts]
    return closely(predictor, min(rough, key=rms_m_of), window)
