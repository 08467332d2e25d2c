"""In words: of which device a proof of rest is made, and what of the declared one is no part of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avc_casadi.problem import Device

_LEFT_OUT = {
    "coulomb_friction_n": ("dry friction", "N"),
    "encoder_resolution_m": ("encoder", "m"),
    "position_noise_rms_m": ("noise", "m rms"),
}


def covered(device: Device) -> str:
    """Say which device a proof of rest covers: mechanics, amplifier and delay as declared, and what is left out.

    Args:
        device: as declared, with its ranges.
    """
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
    declared = [
        f"{name} ({value:.4g} {unit})"
        for key, (name, unit) in _LEFT_OUT.items()
        if (value := max(getattr(device, key), *(getattr(spread, key) or (0.0,)))) > 0
    ]
    beside = f"; left out: {', '.join(declared)}" if declared else ", without friction and measured exactly"
    return f"of {mechanics}, {amplifier}, {delay}{beside}"


def _between(value: float, ends: tuple[float, float] | None) -> str:
    return f"{value:g}" if ends is None else f"{ends[0]:g} to {ends[1]:g}"
