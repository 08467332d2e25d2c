"""What a spectral radius must stay below: one limit for L5, the device let go, and deployment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.stability import RADIUS_TOLERANCE, rigid
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.loop import Hand
    from avc_casadi.passivity import Fractions
    from avc_casadi.problem import Device

# A device in no touch with anything has its place twice for an eigenvalue where nothing damps it: rounding moves a
# double one by its root, unless the matrix is triangular, as that of a rigid device is.
_FREE_TOLERANCE = 1e-7


def radius_limit(device: Device, parts: Fractions, hands: Hand) -> FloatArray:
    """Return the bound of the spectral radius of n renderings with h hands, shape (n, h).

    Below 1, where a spring of the wall or of the hand calls the device back. Without any it keeps its place, an
    eigenvalue of 1, which is no instability.
    """
    free = 1 + (RADIUS_TOLERANCE if rigid(device) else _FREE_TOLERANCE)
    held = np.broadcast_to(np.asarray(hands.stiffness_n_per_m) > 0, (len(hands),))
    called_back = (np.asarray(parts.integral) > 0)[:, None] | held[None, :]
    return np.where(called_back, 1 - RADIUS_TOLERANCE, free)
