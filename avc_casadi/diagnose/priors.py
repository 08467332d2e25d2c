"""What is known of a device, a hand and a delay before a log is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi.diagnose.plant import IntendedLaw
from avc_casadi.model.hands import hand_ranges

# Priors of the unknowns: spreads are standard deviations, those of masses, dampings and stiffnesses of their ln.

_DELAY_SPREAD = 0.15
"""Spread of a declared delay, samples of the device."""

_LATE_SPREAD = 4.0
"""Spread of a delay that is longer than declared, ticks of the law."""

_LEAST_HAND = np.array([[1e-3], [0.1], [5.0]])
"""Least mass, kg, damping, N.s/m, and stiffness, N/m, of a hand at 1 m from the axis, or on a device that slides."""

_HAND_SPREAD = 0.4
"""Least spread of a hand on a declared device."""

_HAND_SPREAD_ASSUMED = 1.1
"""Least spread of a hand on an assumed device, whose mass it makes up for."""

MASS_SPREAD = 0.06
"""Spread of a declared mass of a device."""

DAMPING_SPREAD = 0.5
"""Spread of a declared damping of a device."""

ASSUMED_SPREAD = 2.0
"""Spread of mass and damping of an assumed device."""

_MODE_LEAST_PRIOR_HZ = 40.0
"""Least frequency of the prior of a resonance, Hz; its middle is the frequency of the swing above that."""

_MODE_SPREAD = 0.6
"""Spread of frequency and damping ratio of a resonance."""

_MODE_DAMPING_RATIO = 0.03
"""Middle of the prior of the damping ratio of a resonance."""

_MODE_MASS_RATIO = 0.4
"""Middle of the prior of the share of the device's mass behind a resonance."""
_MODE_MASS_SPREAD = 0.15
"""Spread of that share."""

_SHAKE_SPREAD = 0.01
"""Spread of the frequency of a shaking, as a share of that of the swing: its cycles are counted to about that."""


@dataclass(frozen=True)
class Grid:
    """What structures are fitted to: the ticks of a law, or the samples where its ticks are none of them."""

    period_s: float
    a_tick: float
    """Periods in a tick of the law."""


@dataclass(frozen=True)
class Unknown:
    """An unknown of a structure with its prior."""

    name: str
    middle: float
    spread: float


def hand_unknowns(design: IntendedLaw) -> list[Unknown]:
    """Return ln of mass, damping and stiffness of a hand, by the ranges of the declared hands."""
    least = design.device.metres_per_unit**2 * _LEAST_HAND
    box = np.log(np.maximum(hand_ranges(design.hands), least))
    spread = np.maximum((box[:, 1] - box[:, 0]) / 2, _HAND_SPREAD if design.known else _HAND_SPREAD_ASSUMED)
    names = ("hand_mass", "hand_damping", "hand_stiffness")
    priors = zip(names, box.mean(axis=1).tolist(), spread.tolist(), strict=True)
    return [Unknown(name, middle, deviation) for name, middle, deviation in priors]


def mode_unknowns(swing_hz: float) -> list[Unknown]:
    """Return ln of frequency, with the mass of a hand at the handle, and damping ratio, and share of the mass."""
    return [
        Unknown("mode_frequency", math.log(max(swing_hz, _MODE_LEAST_PRIOR_HZ)), _MODE_SPREAD),
        Unknown("mode_damping_ratio", math.log(_MODE_DAMPING_RATIO), _MODE_SPREAD),
        Unknown("mode_mass_ratio", _MODE_MASS_RATIO, _MODE_MASS_SPREAD),
    ]


def shake_unknown(swing_hz: float) -> Unknown:
    """Return ln of the frequency at which something outside shakes the device: that of the swing."""
    return Unknown("shake_frequency", math.log(swing_hz), _SHAKE_SPREAD)


def delays_of(design: IntendedLaw, grid: Grid, lag: float) -> tuple[Unknown, Unknown]:
    """Return the priors of the delay beside the lag of the law, periods of the grid: as declared, and longer."""
    ticks_a_sample = design.device.sample_time_s / grid.period_s
    least, most = design.delay_samples
    spread = math.hypot(_DELAY_SPREAD, (most - least) / math.sqrt(12))
    middle = max((least + most) / 2 * ticks_a_sample - lag, 0.0)
    longest = max(most * ticks_a_sample - lag, 0.0)
    punctual = Unknown("delay", middle, max(spread * ticks_a_sample, spread))
    return punctual, Unknown("delay", longest, _LATE_SPREAD * grid.a_tick)
