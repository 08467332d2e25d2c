"""Detents: a force that goes up and down along the way, as of the notches of a knob."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BeforeValidator

from avc_casadi.problem._quantity import Damping, ForceLimit, Position, Quantity
from avc_casadi.problem._table import Table

_Pitch = Annotated[float, BeforeValidator(Quantity("m", 1e-6, 10, zero=False))]
_Width = Annotated[float, BeforeValidator(Quantity("", 1e-2, 1, zero=False))]


class Detent(Table):
    """Valleys at equal distances: F = force sin(2 pi u/width), u from the nearest valley, as a share of the pitch.

    Beyond half the width there is no force. The steepest slope, 2 pi force/(width pitch), is that of a spring in the
    valleys, and with the other sign at the tops, where it drives the device away.

    Attributes:
        force_n: its largest.
        pitch_m: from one valley to the next.
        width: share of the pitch on which there is a force.
        centre_m: one of the valleys, from the wall: that is at 0, and is the end stop of a knob.
        damping_ns_per_m: of a damper beside it, everywhere.
    """

    force_n: ForceLimit
    pitch_m: _Pitch
    width: _Width = 1.0
    centre_m: Position = 0.0
    damping_ns_per_m: Damping = 0.0

    @property
    def slope_n_per_m(self) -> float:
        """The steepest slope: the stiffness in the valleys, and with the other sign at the tops."""
        return 2 * math.pi * self.force_n / (self.width * self.pitch_m)
