"""What a log of one position does not tell: how the mass divides, and on which side of a resonance a spring is.

With the encoder at the handle the response has the poles of the resonance and none of its zeros; the share then moves
little but the damping that the viscous friction of the motor lends to the resonance. It is held at what is usual, and
the other numbers get the intervals that any usual share gives them with which the log is predicted as well.

With masses m1 (motor) and m2, stiffness K between them and a spring k at m2, force to position of m1 is

    (m2 s^2 + K + k) / ((m1 s^2 + K)(m2 s^2 + K + k) - K^2),

the same as with a spring k' = K k/(K + k) at m1, K' = K^2/(K + k) and m2' = m2 K^2/(K + k)^2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit, Window, fit
from avc_casadi.identification.identifiability import EXCITATION
from avc_casadi.identification.model import Refusal
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.uncertainty import compared

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
    """Return whether a model has a resonance whose share is held."""
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
