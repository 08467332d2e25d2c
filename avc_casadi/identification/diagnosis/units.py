"""Positions or forces that look like another unit: plausible on their own, but not beside what is known of the loop."""

from __future__ import annotations

import math

from avc_casadi._util.text import number
from avc_casadi.coupling import Coupling
from avc_casadi.identification.diagnosis.declared import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation

# A length as declared over the same length as read, and how one comes to be the other.
_FACTORS = {
    1e-2: ("100 times too large", "cm read as m"),
    1e-3: ("1000 times too large", "mm read as m, or um as mm"),
    1e-6: ("a million times too large", "um read as m"),
    1e2: ("100 times too small", "m read as cm"),
    1e3: ("1000 times too small", "mm read as um, or m as mm"),
    1e6: ("a million times too small", "m read as um"),
}
_ANGLE_FACTORS = {
    math.pi / 180: ("57 times too large", "degrees read as rad"),
    180 / math.pi: ("57 times too small", "rad read as degrees"),
    1e-3: ("1000 times too large", "mrad read as rad"),
    1e-6: ("a million times too large", "urad read as rad"),
    1e3: ("1000 times too small", "rad read as mrad"),
    1e6: ("a million times too small", "rad read as urad"),
}
_LENGTHS = (1.0, 1e-2, 1e-3, 1e-6, 1e-9)
_ANGLES = (1.0, math.pi / 180, 1e-3, 1e-6)
# A ratio within this share of a unit's is that unit.
_NEAR = 0.05
# Mass that swings over the mass declared with the heaviest hand, or the lightest device: beyond this it cannot be.
_ABSURD = 50.0
# Share of the time in contact above which the force is what swings the mass.
_TOUCHING = 0.2


def other_unit(
    log: Log,
    found: Oscillation,
    law: Law | None,
    declared: Declared,
    coupling: Coupling | None,
    stiffness_n_per_m: float | None,
) -> str:
    """Return why the positions look like another unit than the one they were read in, or nothing.

    Args:
        log: on its grid.
        found: the oscillation.
        law: what the log shows.
        declared: the loop as it was meant.
        coupling: what was meant to run, or None.
        stiffness_n_per_m: k that was meant to run, or None.
    """
    turns = not declared.device.units.linear
    meant = stiffness_n_per_m
    if coupling is not None and coupling.runtime.state_feedback is None:
        meant = coupling.table.at_rest.stiffness_n_per_m
    signs = []
    if law is not None and law.told and meant and law.stiffness_n_per_m > 0:
        # A length read in metres that is one in millimetres makes a spring a thousand times softer.
        factor = _factor(law.stiffness_n_per_m / meant, turns)
        if factor:
            signs.append((factor, f"k = {number(law.stiffness_n_per_m, 3)} N/m ran and {number(meant, 3)} was meant"))
    step = declared.device.encoder_resolution_m
    if step and log.encoder_m:
        told = f"their step is {number(log.encoder_m, 3)} m and {number(step, 3)} m is declared"
        factor = _factor(step / log.encoder_m, turns)
        if factor:
            signs.append((factor, told))
        elif abs(math.log(log.encoder_m / step)) > math.log(_ABSURD) and _whole(log.encoder_m, turns):
            return f"the positions look like counts of the encoder: {told}; a count times the step is a position"
    if signs:
        (size, how), told = signs[0]
        return f"the positions look {size} ({how}): {told}; --units position=... tells the right one"
    if math.isfinite(found.frequency_hz) and found.force_peak_to_peak_n > 0 and found.contact_share > _TOUCHING:
        swings = found.force_peak_to_peak_n / found.peak_to_peak_m / (2 * math.pi * found.frequency_hz) ** 2
        heaviest = declared.device.mass_kg + declared.hands.mass_kg[1]
        told = f"at {number(found.frequency_hz, 3)} Hz their force swings {number(swings, 2)} kg"
        if swings < declared.device.mass_kg / _ABSURD:
            told = f"{told}, the device has {number(declared.device.mass_kg, 3)} kg"
            kinds = "degrees or counts read as rad" if turns else "mm, um or counts read as m"
            return f"the positions look like {kinds}: {told}"
        if swings > heaviest * _ABSURD:
            return f"the positions look too small, or the force too large, by a unit: {told}"
    return ""


def _factor(ratio: float, turns: bool) -> tuple[str, str] | None:
    """Return the words for the factor that a ratio is, or nothing."""
    return next(
        (
            words
            for size, words in (_ANGLE_FACTORS if turns else _FACTORS).items()
            if abs(math.log(ratio / size)) < _NEAR
        ),
        None,
    )


def _whole(step: float, turns: bool) -> bool:
    """Whether a step is 1 in some unit of length, or of an angle."""
    return any(abs(step / size - 1) < 1e-3 for size in (_ANGLES if turns else _LENGTHS))
