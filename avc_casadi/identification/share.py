"""The share of the mass at the handle, where a log shows a resonance but not how the mass divides.

With the encoder at the handle the response has the poles of the resonance and none of its zeros; the share then moves
little but the damping that the viscous friction of the motor lends to the resonance. It is held at what is usual, and
the other numbers get the intervals that any usual share gives them with which the log is predicted as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.evidence import compared
from avc_casadi.identification.fit import Fit, Window, fit
from avc_casadi.identification.model import Refusal
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.refuse import EXCITATION

SHARE = "resonance.mass_ratio"
# What is usual.
_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)


def shared(predictor: Predictor, found: Fit, window: Window, tolerance: float) -> Fit:
    """Return a model with a resonance whose share is held at the one found, moved into what is usual.

    Args:
        predictor: of the records.
        found: the model with the share free.
        window: of the fit.
        tolerance: of the fit.
    """
    share = float(np.clip(found.values[SHARE], _SHARES[0], _SHARES[-1]))
    structure = replace(found.structure, assumed={SHARE: share})
    return fit(predictor, structure, found.values, found.observer, window, tolerance=tolerance)


def share_assumed(found: Fit) -> bool:
    """Return whether a model has a resonance whose share is held.

    Args:
        found: the model.
    """
    return SHARE in found.structure.assumed and found.structure.present(SHARE)


def other_shares(predictor: Predictor, found: Fit, window: Window) -> tuple[FloatArray, tuple[float, float]]:
    """Return how far other shares move the other numbers down and up, shape (2, free), and the shares that may be.

    Args:
        predictor: of the records.
        found: the model at its best, its share held.
        window: of the fit.
    """
    share = found.values[SHARE]
    moved, ends = np.zeros((2, found.search.size)), []
    for side in ([one for one in _SHARES if one < share][::-1], [one for one in _SHARES if one > share]):
        end, last = share, found
        for at in side:
            structure = replace(found.structure, assumed={SHARE: at})
            other = fit(predictor, structure, last.values, found.observer, window, steps=15, tolerance=1e-5)
            if compared(other, found, "resonance").taken:
                break
            moved = np.maximum(moved, [found.search - other.search, other.search - found.search])
            end, last = at, other
        ends.append(end)
    return moved, (ends[0], ends[1])


def share_refused(share: float, ends: tuple[float, float]) -> Refusal:
    """Return that the share is not told.

    Args:
        share: assumed.
        ends: of what the log allows and is usual.
    """
    low, high = ends
    why = f"the log hardly changes with it; {share:.2g} is taken, and the intervals hold for {low:.2g} to {high:.2g}"
    return Refusal(SHARE, why, EXCITATION[SHARE])
