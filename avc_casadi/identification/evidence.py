"""Whether a richer model is worth it: prediction errors of stretches that were held out of its fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit

# A richer model must better the held-out error by this many standard errors, and by this share of it.
SURE = 3.0
WORTH = 2e-3


@dataclass(frozen=True)
class Trial:
    """What came of trying a term.

    Attributes:
        term: its name.
        taken: whether the model has it.
        held_out_change: relative change of the held-out squared error; negative is better.
        standard_errors: that change in its own standard errors.
        why: in words.
        inseparable: whether the rest of the model could do the same: the log bears it out, and does not tell it.
    """

    term: str
    taken: bool
    held_out_change: float
    standard_errors: float
    why: str
    inseparable: bool = False

    @property
    def worth(self) -> bool:
        """Whether the held-out error falls by more than nothing."""
        return -self.held_out_change > WORTH


def held_out(fit: Fit) -> FloatArray:
    """Return the squared error of each block as the fit without it predicts it, shape (blocks,), m^2.

    The fit without a block is one Gauss-Newton step away, from the fit with all or from a point beside it.

    Args:
        fit: at its best or near it.
    """
    whole = np.sum([block.curvature for block in fit.blocks], axis=0)
    gradient = np.sum([block.gradient for block in fit.blocks], axis=0)
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    squares = []
    for block in fit.blocks:
        rest = (whole - block.curvature) / scale / scale[:, None]
        step = -np.linalg.lstsq(rest, (gradient - block.gradient) / scale, rcond=1e-10)[0] / scale
        squares.append(block.square + 2 * block.gradient @ step + step @ block.curvature @ step)
    return np.array(squares) * fit.unit_m**2


def _sure(gain: FloatArray) -> float:
    """Return a mean in its own standard errors."""
    return float(np.mean(gain)) / (float(np.std(gain, ddof=1) / np.sqrt(gain.size)) or 1e-300)


def compared(simple: Fit, rich: Fit, term: str) -> Trial:
    """Say whether a richer model predicts what it has not seen better.

    Args:
        simple: without the term.
        rich: with it, on the same blocks.
        term: its name.
    """
    one, other = held_out(simple), held_out(rich)
    gain = one - other
    size = float(np.sum(one))
    # Where a simple model fails in a few stretches, their gains differ by orders: then the logarithm decides.
    # Where the device stands still both may be exact.
    least = 1e-12 * size / one.size or 1e-300
    sure = max(_sure(gain), _sure(np.log((one + least) / (other + least))))
    change = -float(np.sum(gain)) / (size or 1.0)
    taken = sure > SURE and -change > WORTH
    if taken:
        why = "the error on held-out stretches falls"
    elif change < 0:
        why = "the error on held-out stretches falls too little to be sure"
    else:
        why = "the error on held-out stretches does not fall"
    return Trial(term, taken, change, sure, why)
