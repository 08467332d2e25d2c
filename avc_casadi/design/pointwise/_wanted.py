"""Impedances that an optimum wants if the gain box allows them, and how far inside Re Z = margin to place them."""

from __future__ import annotations

import numpy as np

from avc_casadi.loop import Loop
from avc_casadi.support import ComplexArray, FloatArray

_GUARD = 4 * float(np.finfo(np.float64).eps)
"""A point meant to lie on Re Z = margin is placed this far inside it, relative to the terms of Re Z: their rounding."""


def guarded_margin(device: ComplexArray, hold: ComplexArray, rendered: ComplexArray, margin: float) -> FloatArray:
    """The margin plus the rounding of Re(device + hold * rendered)."""
    terms = np.abs(device.real) + np.abs(hold.real * rendered.real) + np.abs(hold.imag * rendered.imag)
    guarded: FloatArray = margin + _GUARD * terms
    return guarded


def wanted_points(loop: Loop, radius: FloatArray, margin: float) -> tuple[ComplexArray, ComplexArray]:
    """Z_eavc and Z_e - Z_eavc, (4, n): at the goal, where |Z| = R crosses Re Z = margin (2), at Z = margin."""
    target = loop.target
    at_goal = np.where(target.real >= margin, 0, np.nan)
    # Both parts of Z_eavc may be as large as this; on the circle a larger guard moves no error.
    sizes = (1 + 1j) * (np.abs(loop.desired) + np.abs(target / loop.hold))
    guarded = guarded_margin(loop.device, loop.hold, sizes, margin)
    with np.errstate(invalid="ignore", divide="ignore"):
        height = np.sqrt(radius * radius - guarded * guarded)
        # Towards the goal's side the two heights nearly cancel; the difference of squares does not.
        side = np.where(target.imag < 0, -1.0, 1.0)
        near = (target.real - guarded) * (target.real + guarded) / (height + np.abs(target.imag))
        shift = (
            np.stack(
                (
                    at_goal + 0j,
                    guarded - target.real + 1j * side * near,
                    guarded - target.real - 1j * (side * height + target.imag),
                    guarded - target.real - 1j * target.imag,
                )
            )
            / loop.hold
        )
    return loop.desired + shift, loop.desired_gap - shift
