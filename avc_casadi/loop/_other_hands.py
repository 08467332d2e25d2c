"""Hands that hold a device otherwise than [hands] says: by a stylus, and with one fingertip."""

from __future__ import annotations

from itertools import product

import numpy as np

from avc_casadi.loop._hands import StylusHand
from avc_casadi.problem import Hands

STYLUS_RANGES: dict[str, tuple[float, float]] = {
    "mass_kg": (0.016, 0.57),
    "grip_damping_ns_per_m": (0.3, 4.6),
    "grip_stiffness_n_per_m": (228.0, 1043.0),
    "arm_damping_ns_per_m": (3.7, 27.6),
    "arm_stiffness_n_per_m": (63.0, 533.0),
}
"""Lowest and highest of the 15 subjects of Fu and Cavusoglu (2012)."""

FINGERTIP = Hands(mass_kg=(0.02, 0.1), damping_ns_per_m=(1.0, 5.0), stiffness_n_per_m=(100.0, 500.0))
"""One finger that touches the handle: assumed, lighter and less damped than a hand that holds it."""


def stylus_corners() -> StylusHand:
    """Return every corner of the ranges of hands on a stylus."""
    corners = np.array(list(product(*STYLUS_RANGES.values())))
    return StylusHand(**dict(zip(STYLUS_RANGES, corners.T, strict=True)))
