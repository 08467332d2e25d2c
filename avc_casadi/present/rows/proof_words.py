"""English of the grounds of a proof of rest."""

from __future__ import annotations

from functools import singledispatch

from avc_casadi._util.text import quantity
from avc_casadi._util.units import Units
from avc_casadi.claims.prove.grounds import (
    BeyondProof,
    Ground,
    NoMultiplier,
    NoMultiplierBecause,
    Nonlinearity,
    NotCovered,
    Open,
    Settles,
    Stated,
    UnstableInContact,
)
from avc_casadi.model.device import Device
from avc_casadi.model.hands import hand_text


@singledispatch
def ground_clauses(ground: Ground, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what a proof of rest proves, what refutes it, or why it is open."""
    raise TypeError(f"no words for {type(ground).__name__}")


@ground_clauses.register
def _settles(ground: Settles, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    settles = "settles with every hand of the range, wherever it rests and from any state, making and breaking contact"
    proof = f"one multiplier of {ground.taps} taps, verified in {ground.cells} cells"
    return (f"{settles} ({_coverage(ground.device)}): {proof}",)


def _coverage(device: Device) -> str:
    """Return what a proof of rest covers: mechanics, amplifier and delay as declared, and what is omitted."""
    mode, spread = device.resonance, device.range
    mechanics = "a rigid device"
    if mode is not None:
        known = _between(mode.frequency_hz, spread.resonance.frequency_hz)
        mechanics = f"a device with its resonance at {known} Hz"
    amplifier = "an ideal amplifier"
    if device.amplifier_bandwidth_hz is not None:
        amplifier = f"an amplifier of {_between(device.amplifier_bandwidth_hz, spread.amplifier_bandwidth_hz)} Hz"
    late = _between(device.delay_samples, spread.delay_samples)
    delay = f"{late} sample{'' if late == '1' else 's'} of delay"
    left_out = {
        "coulomb_friction_n": "dry friction",
        "encoder_resolution_m": "encoder",
        "position_noise_rms_m": "noise",
    }
    largest = {name: max(getattr(device, key), *(getattr(spread, key) or (0.0,))) for key, name in left_out.items()}
    declared = [f"{name} ({value:.4g})" for name, value in largest.items() if value > 0]
    omitted = f"; left out: {', '.join(declared)}" if declared else ", without friction and measured exactly"
    return f"of {mechanics}, {amplifier}, {delay}{omitted}"


def _between(value: float, ends: tuple[float, float] | None) -> str:
    """Return a number, or its range."""
    return f"{value:g}" if ends is None else f"{ends[0]:g} to {ends[1]:g}"


@ground_clauses.register
def _unstable_in_contact(ground: UnstableInContact, units: Units) -> tuple[str, ...]:
    unstable = f"the loop is unstable in contact, with a spectral radius of {ground.spectral_radius:.6g}"
    return (f"{unstable} with {hand_text(ground.hand, units.unit)}",)


@ground_clauses.register
def _open(ground: Open, units: Units) -> tuple[str, ...]:
    reasons = [_not_covered(nonlinearity, units) for nonlinearity in ground.not_covered]
    if ground.no_multiplier is None:
        return *reasons, "without this effect rest is proved"
    return *reasons, _no_multiplier(ground.no_multiplier)


def _not_covered(not_covered: NotCovered, units: Units) -> str:
    """Return why a nonlinearity leaves a proof open."""
    if not_covered.nonlinearity is Nonlinearity.GATED_CONTACT:
        return 'contact = "gated" cannot be proved: only "clip-last" is a single nonlinearity with a slope from 0 to 1'
    name = "play" if not_covered.nonlinearity is Nonlinearity.PLAY else "dead zone"
    width = quantity(not_covered.width_m, units.unit("m"))
    return f"the {name} of {width} is a second nonlinearity, which the proof does not cover"


def _no_multiplier(reason: NoMultiplier) -> str:
    """Return why no multiplier proves rest."""
    because = reason.because
    if because is NoMultiplierBecause.UNSTABLE_LAW:
        return "the law has a pole on or outside the unit circle while it gives no force"
    if because is NoMultiplierBecause.UNSUPPORTED:
        return reason.message
    if because is NoMultiplierBecause.NONE_SERVES:
        return f"no multiplier of {reason.number} taps serves all hands"
    if because is NoMultiplierBecause.STOPPED:
        return f"verification stopped after {reason.number} cells"
    return "the multiplier failed six times between the hands for which it was found"


@ground_clauses.register
def _beyond_proof(ground: BeyondProof, units: Units) -> tuple[str, ...]:
    """Return what of a runtime the proof of rest does not know, and its outcome without it."""
    not_known = []
    if ground.observer:
        not_known.append("the observer between encoder steps is not linear")
    if ground.guard is not None:
        not_known.append(f"the guard {ground.guard} changes the force as it measures energy")
    first, *more = ground_clauses(ground.without, units)
    is_open = "open, " if ground.outcome == "open" else ""
    return *not_known, f"without it: {is_open}{first}", *more


@ground_clauses.register
def _stated(ground: Stated, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (ground.sentence,)
