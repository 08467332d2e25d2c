"""Practical identifiability: parameters that a log does not determine are refused, with the excitation that would."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi._util.units import FORCE, FORCES, MASS, spoken_key
from avc_casadi.identification.closed_loop import coloured
from avc_casadi.identification.fit import Fit
from avc_casadi.identification.model import Refusal
from avc_casadi.identification.terms import (
    DEAD_ZONE,
    DRAG,
    HIGHEST_SEEN,
    LOOP_DAMPING,
    LOOP_RATIO,
    PARAMETERS,
    SIZE_OF,
    TERMS,
)

# Half widths in search coordinates beyond which a parameter is not identifiable.
_WIDEST = {
    "mass_kg": 0.35,
    "delay_samples": 1.0,
    "resonance.frequency_hz": 0.15,
    "resonance.damping_ratio": 1.4,
    "resonance.mass_ratio": 1.7,
    "amplifier_bandwidth_hz": 0.7,
    LOOP_RATIO: 0.5,
    "stribeck_speed_m_per_s": 1.4,
    "force_scale": 0.35,
    # In units of the force of the log.
    "damping_ns_per_m": 0.4,
    "coulomb_friction_n": 0.4,
    "breakaway_excess_n": 0.4,
    "offset_n": 0.4,
    DEAD_ZONE: 0.4,
    DRAG: 0.4,
}


def excitation(key: str) -> str:
    """Return the log that would identify a parameter."""
    return {
        "mass_kg": f"a multisine of 1 to 30 Hz with several times the {FORCE} of the friction",
        "damping_ns_per_m": "long strokes at several speeds, such as a slow sine of large amplitude, several "
        "periods of it",
        "delay_samples": f"a chirp or multisine up to a fifth of the sample rate, or steps of {FORCE}",
        "offset_n": "strokes both ways",
        "coulomb_friction_n": f"slow strokes with many reversals, the {FORCE} twice the friction or more",
        "friction_asymmetry_n": (
            "a second log with the device turned over, which reverses gravity and not the friction: the mean of the "
            f"two constant {FORCES} is the asymmetry"
        ),
        "damping_asymmetry_ns_per_m": "fast strokes both ways",
        "breakaway_excess_n": "reversals at a few millimetres a second of the hand, slow enough that the device sticks",
        "stribeck_speed_m_per_s": "strokes at speeds from 1 to 50 millimetres a second of the hand",
        "resonance.mass_ratio": "a log of a position at the motor, or the handle weighed",
        "resonance": "a chirp or multisine of 20 Hz to a third of the sample rate, strong enough to move several "
        "encoder "
        "steps",
        "amplifier_bandwidth_hz": "a chirp to a third of the sample rate at a higher sample rate, or a log of the "
        "current",
        LOOP_RATIO: "a step of the current, measured; or a chirp to a third of the sample rate at a higher sample rate",
        "stiffness_n_per_m": "slow strokes over the whole travel",
        "offset_drift_n_per_s": "a longer log",
        "force_scale": (
            f"two logs, one with a known {MASS} on the device (--added-mass 0,VALUE), or --known "
            f"{spoken_key('mass_kg')}=VALUE"
        ),
        "position_noise_rms_m": "a log in motion; at rest the encoder's step hides it",
        "encoder_resolution_m": "the encoder's own counts, unfiltered",
        DEAD_ZONE: f"a {FORCE} that goes through 0 often and slowly beside a fast motion, or a log of the current",
        DRAG: "long strokes at several speeds",
        "backlash_m": (
            f"strokes with many reversals, the {FORCE} several times the friction; for play beyond the encoder, the "
            "position measured at the handle"
        ),
        "max_force_n": "the amplifier's data sheet; a log does not tell what was not commanded",
    }[key]


def refusals(fit: Fit, half_width: Sequence[float] | FloatArray, normal: FloatArray) -> dict[str, Refusal]:
    """Return the refusals of a fit's parameters that are not identifiable, by key.

    Args:
        fit: the fitted model.
        half_width: of the interval of each coordinate, shape (free,).
        normal: correlations of the sensitivities, shape (free, free).
    """
    found = {}
    names = [one.name for one in fit.structure.free]
    for index, one in enumerate(fit.structure.free):
        widest = _WIDEST.get(one.name)
        half = float(half_width[index])
        if widest is None or half <= widest:
            continue
        others = np.abs(np.delete(normal[index], index))
        like = names[index + 1 if (at := int(np.argmax(others))) >= index else at] if others.size else ""
        alike = float(others.max(initial=0.0))
        why = f"its interval is too wide ({_width(one.kind, half)})"
        if alike > 0.9:
            why += f"; the log changes with it as with {spoken_key(like)} (correlation {number(alike, 3)})"
        key = one.name if one.name == "resonance.mass_ratio" else one.name.partition(".")[0]
        q = float(fit.search[index])
        value, *ends = (fit.structure.outward(one, at) for at in (q, q - half, q + half))
        low, high = (min(max(end, one.lowest), one.highest) for end in ends)
        found[key] = Refusal(key, why, excitation(key), (value, low, high))
    return found


def not_of_one_kind(fit: Fit, half_width: Sequence[float]) -> dict[str, Refusal]:
    """Return the refusal of an amplifier's bandwidth where another order or damping ratio fits as well.

    The sum of lag and delay is identified all the same.

    Args:
        fit: the fitted model.
        half_width: of the interval of each coordinate, rivals included.
    """
    key = "amplifier_bandwidth_hz"
    for one, half in zip(fit.structure.free, half_width, strict=True):
        if one.name == key and half > _WIDEST[key]:
            why = f"a lag, or a current loop of another damping ratio, does as well ({_width(one.kind, half)})"
            return {key: Refusal(key, why, excitation(key))}
    return {}


def never_told(
    fit: Fit,
    estimates: Mapping[str, object],
    excited: tuple[float, float] | None,
    absent: set[str],
    inseparable: set[str],
    lags: FloatArray,
) -> dict[str, Refusal]:
    """Return the refusals of what no fit of these logs could identify, and of what they show no trace of.

    Args:
        fit: of the logs.
        estimates: the identified parameters.
        excited: lowest and highest frequency at which force and motion are coherent, Hz.
        absent: terms that the model does not have.
        inseparable: terms that the evidence supports but that are confounded with the rest of the model.
        lags: autocorrelation of the error.
    """
    found = {}
    if "coulomb_friction_n" not in estimates:
        found["coulomb_friction_n"] = beyond_force("coulomb_friction_n")
    band = "at no frequency" if excited is None else f"up to {number(excited[1], 2)} Hz"
    if "resonance" in absent:
        why = f"no trace of one; {FORCE} and motion are coherent {band}"
        if "resonance" in inseparable:
            why = (
                f"the log bears one out beyond what it excites, or an amplifier; {FORCE} and motion are coherent {band}"
            )
        found["resonance"] = Refusal("resonance", why, excitation("resonance"))
    if "amplifier" in absent:
        why = "its lag cannot be distinguished from delay; the delay given holds both"
        found["amplifier_bandwidth_hz"] = Refusal("amplifier_bandwidth_hz", why, excitation("amplifier_bandwidth_hz"))
    if "scale" not in fit.structure.terms:
        why = f"{MASS}, damping and friction all scale with the {FORCE}; the commanded {FORCE} is taken as true"
        found["force_scale"] = Refusal("force_scale", why, excitation("force_scale"))
    if "coulomb" in fit.structure.terms:
        why = (
            f"friction that differs between the directions is the same as a constant {FORCE} ({spoken_key('offset_n')})"
        )
        found["friction_asymmetry_n"] = Refusal("friction_asymmetry_n", why, excitation("friction_asymmetry_n"))
    hidden = "it is below what the encoder's step hides"
    if coloured(lags):
        hidden = "the prediction error is not white: what the model does not know is in it"
    for key, why in (
        ("encoder_resolution_m", "the positions lie on no lattice"),
        ("position_noise_rms_m", hidden),
        ("backlash_m", "no trace of any that the encoder stands behind; a log of one position does not show another"),
        ("max_force_n", "it is not seen in a log"),
    ):
        if key not in estimates:
            found[key] = Refusal(key, why, excitation(key))
    return found


def not_told_apart(key: str) -> Refusal:
    """Return why friction is refused that the log bears out beside damping and mass, and not apart from them."""
    why = f"the log bears it out, and does not tell it from damping and {MASS}, whose intervals hold it"
    return Refusal(key, why, excitation(key))


def beyond_force(key: str) -> Refusal:
    """Return why a force is refused whose upper bound exceeds the force of the log."""
    return Refusal(key, f"the log bounds it by more than the {FORCE} that acted", excitation(key))


def _width(kind: str, half: float) -> str:
    if kind == "log":
        return f"a factor of {number(float(np.exp(min(half, 50.0))), 2)} either way"
    return f"+-{number(half, 2)} " + ("in its logit" if kind == "share" else "of the size that would matter")


def cannot_tell(records_force_rms: float, motion_in_steps: float) -> list[Refusal]:
    """Return why a log identifies nothing at all, before any fit.

    Args:
        records_force_rms: change of the force, N.
        motion_in_steps: travel in steps of the encoder, or infinite.
    """
    found = []
    if records_force_rms < 1e-9:
        found.append(Refusal("mass_kg", f"the commanded {FORCE} never changes", excitation("mass_kg")))
    if motion_in_steps < 12:
        why = f"the position moves over {number(motion_in_steps, 2)} steps of the encoder only"
        found.append(Refusal("mass_kg", why, f"more {FORCE}, or lower frequencies: a travel of 50 steps and more"))
    return found


_RATIO, _NO_MODE = "resonance.damping_ratio", 0.99


def vague_terms(fit: Fit, half_width: Sequence[float], refused: Container[str]) -> list[str]:
    """Return the terms too uncertain to stand in a model: refused, or perhaps absent.

    Args:
        fit: the fitted model.
        half_width: of the interval of each coordinate, rivals included.
        refused: keys of parameters that are not identifiable.
    """
    found: list[str] = [
        term
        for term in (LOOP_DAMPING, "amplifier", "resonance", "stribeck")
        if term in fit.structure.terms and any(one.name.partition(".")[0] in refused for one in TERMS[term].parameters)
    ]
    if fit.structure.present("resonance.frequency_hz"):
        # At its bound the damping is that of no mode: two real poles, which any small misfit has.
        no_mode = fit.values[_RATIO] > _NO_MODE * PARAMETERS[_RATIO].highest
        beyond = fit.values["resonance.frequency_hz"] * fit.sample_time_s > HIGHEST_SEEN
        found += ["resonance"] if beyond or no_mode else []
    names = [one.name for one in fit.structure.free]
    for term, key in SIZE_OF.items():
        # The evidence for dry friction was weighed with the term, and its interval may end at 0.
        if term in fit.structure.terms and term != "coulomb":
            place = names.index(key)
            # A half width that was widened to the value itself may fall a rounding error short of it.
            found += [term] if fit.search[place] <= (1 + 1e-9) * half_width[place] else []
    return found
