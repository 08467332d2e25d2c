"""Ambiguities of a log of one position: the mass ratio of a resonance, and the side of it on which a spring acts.

With the encoder at the handle the response has the poles of the resonance and none of its zeros; the mass ratio then
affects little but the damping that the viscous friction of the motor lends to the resonance. It is fixed at a usual
value, and the intervals of the other parameters cover every usual ratio under which the log is predicted as well.

With masses m1 (motor) and m2, stiffness K between them and a spring k at m2, force to position of m1 is

    (m2 s^2 + K + k) / ((m1 s^2 + K)(m2 s^2 + K + k) - K^2),

as with a spring k' = K k/(K + k) at m1, K' = K^2/(K + k) and m2' = m2 K^2/(K + k)^2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit, Window, fit
from avc_casadi.identification.identifiability import excitation
from avc_casadi.identification.model import Refusal
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.uncertainty import compared

SHARE = "resonance.mass_ratio"
# Usual range.
_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)


def shared(predictor: Predictor, found: Fit, window: Window, tolerance: float) -> Fit:
    """Return a model whose mass fraction at the handle is fixed at the estimate, clipped to the usual range.

    Args:
        predictor: of the records.
        found: the model with the mass fraction free.
        window: of the fit.
        tolerance: of the fit.
    """
    share = float(np.clip(found.values[SHARE], _SHARES[0], _SHARES[-1]))
    structure = replace(found.structure, assumed={SHARE: share})
    return fit(predictor, structure, found.values, found.observer, window, tolerance=tolerance)


def share_assumed(found: Fit) -> bool:
    """Return whether a model has a resonance whose mass fraction is fixed."""
    return SHARE in found.structure.assumed and found.structure.present(SHARE)


def other_shares(predictor: Predictor, found: Fit, window: Window) -> tuple[FloatArray, tuple[float, float]]:
    """Return the shifts of the other parameters under other mass fractions, shape (2, free), and the admissible range.

    Args:
        predictor: of the records.
        found: the fitted model, its mass fraction fixed.
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
    """Return the refusal of the mass fraction as not identifiable.

    Args:
        share: assumed mass fraction at the handle.
        ends: of the range that is both usual and compatible with the log.
    """
    low, high = ends
    why = f"the log hardly changes with it; {share:.2g} is taken, and the intervals hold for {low:.2g} to {high:.2g}"
    return Refusal(SHARE, why, excitation(SHARE))


_SPRING, _RATIO, _FREQUENCY = "stiffness_n_per_m", "resonance.mass_ratio", "resonance.frequency_hz"
# Share by which the damping of both sides perturbs the equivalence.
_DAMPED = 0.1


def at_the_other_side(fit: Fit) -> dict[str, float]:
    """Return the equivalent device with its spring at the motor; None where the two are not ambiguous."""
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
    """Return the shifts to the equivalent on the other side, down and up, in search coordinates, shape (2, free)."""
    found = np.zeros((2, len(fit.structure.free)))
    for key, value in at_the_other_side(fit).items():
        for index, one in enumerate(fit.structure.free):
            if one.name == key:
                step = (1 + _DAMPED) * (fit.structure.inward(one, value) - fit.search[index])
                found[:, index] = max(-step, 0.0), max(step, 0.0)
    return found
