"""A spring to ground beside a resonance: a log of the motor's position does not tell on which side of it the spring is.

With masses m1 (motor) and m2, stiffness K between them and a spring k at m2, force to position of m1 is

    (m2 s^2 + K + k) / ((m1 s^2 + K)(m2 s^2 + K + k) - K^2),

the same as with a spring k' = K k/(K + k) at m1, K' = K^2/(K + k) and m2' = m2 K^2/(K + k)^2.
"""

from __future__ import annotations

import math

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit

_SPRING, _RATIO, _FREQUENCY = "stiffness_n_per_m", "resonance.mass_ratio", "resonance.frequency_hz"
# What the damping of both moves the equivalent by, as a share.
_DAMPED = 0.1


def at_the_other_side(fit: Fit) -> dict[str, float]:
    """Return the values of the same device with its spring at the motor; none where nothing is to be told apart."""
    terms, values = fit.structure.terms, fit.values
    if not {"resonance", "stiffness"} <= set(terms) or fit.structure.encoder_at != "motor" or not values[_SPRING] > 0:
        return {}
    mass, ratio, spring = values["mass_kg"], values[_RATIO], values[_SPRING]
    motor, handle = (1 - ratio) * mass, ratio * mass
    between = (2 * math.pi * values[_FREQUENCY]) ** 2 * motor * handle / mass
    left = between / (between + spring)
    other, link = handle * left**2, between * left
    return {
        "mass_kg": motor + other,
        _RATIO: other / (motor + other),
        _FREQUENCY: math.sqrt(link * (1 / motor + 1 / other)) / (2 * math.pi),
        _SPRING: spring * left,
    }


def moved(fit: Fit) -> FloatArray:
    """Return how far the other side may lie from the estimate, down and up, in the search, shape (2, free)."""
    found = np.zeros((2, len(fit.structure.free)))
    for key, value in at_the_other_side(fit).items():
        for index, one in enumerate(fit.structure.free):
            if one.name == key:
                step = (1 + _DAMPED) * (fit.structure.inward(one, value) - fit.search[index])
                found[:, index] = max(-step, 0.0), max(step, 0.0)
    return found
