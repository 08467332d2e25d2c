"""Levels L0 to L4 on the device as declared: amplifier, resonance, any delay, at every corner of its ranges.

L0 and L1 take the paper's impedance at one frequency, Z_h = Z_d + tau t H A e Z_eavc/(1 + H A e Z_eavc Y), with the
frequency responses of resonance (tau, Y, t: `avc_casadi.passivity.HandlePort`), amplifier (A) and delay (e) in it.
L3 and L4 take the sampled loop with all its aliases. L2, and L4 with the paper's hold, are refused: the paper's hold is
an approximation at one frequency, which gives no loop from sample to sample on such a device, and so no proof.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.certificate._levels import Rows, level_result, own_frequencies
from avc_casadi.loop import LINEAR_KEYS, Hand, device_corners
from avc_casadi.passivity import (
    CouplingSlack,
    Fractions,
    PortWorst,
    RenderingSlack,
    SampledLoop,
    fractions,
    perceived_worst,
    port_worst,
)
from avc_casadi.stability import RADIUS_TOLERANCE, rigid, whole_stability
from avc_casadi.support import SILENT, BoolArray, FloatArray, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Level, LevelResult
    from avc_casadi.problem import Device, Model


def ideal(device: Device) -> bool:
    """Whether a device is rigid, with an ideal amplifier and whole samples of delay: the levels are then closed."""
    delays = [corner.delay_samples for corner in device_corners(device, ("delay_samples",))]
    return rigid(device) and all(delay == int(delay) for delay in delays)


def device_level(rows: Rows, level: Level, model: Model, progress: Progress = SILENT) -> LevelResult:
    """Judge L0 to L4 on a device that is not `ideal`.

    Raises:
        UnsupportedError: a level that has no proof on such a device.
    """
    if level == "L2" or (level == "L4" and model == "paper"):
        what = what_is_declared(rows.problem.device)
        raise UnsupportedError(
            f"{level} with the paper's hold has no proof on a device with {what}: that hold "
            "gives no loop from sample to sample; L3 judges the device as declared, and L4 with stability.model = "
            '"sampled-data"'
        )
    return _own_frequency(rows, level, model) if level in {"L0", "L1"} else _all_frequencies(rows, level, progress)


def what_is_declared(device: Device) -> str:
    """Name what makes the device more than ideal."""
    found = {
        "device.amplifier_bandwidth_hz": device.amplifier_bandwidth_hz is not None,
        "device.resonance": device.resonance is not None,
    }
    named = [key for key, there in found.items() if there]
    if any(corner.delay_samples % 1 for corner in device_corners(device, ("delay_samples",))):
        named.append("part of a sample of delay (device.delay_samples)")
    return " and ".join(named)


def _own_frequency(rows: Rows, level: Level, model: Model) -> LevelResult:
    low, high, where = own_frequencies(rows, level)
    parts = fractions(SampledLoop.of(rows.problem, model), rows.b, rows.k)
    corners = device_corners(rows.problem.device, LINEAR_KEYS)
    worst = perceived_worst(corners, parts, rows.contact, low, high, model)
    hold = "the paper's hold" if model == "paper" else "the sampled-data hold"
    claim = f"Re Z_h >= 0 {where}, under {hold}, with the device as declared{_at_corners(corners)}"
    return _result(rows, level, model, claim, worst, worst.passed, None)


def _all_frequencies(rows: Rows, level: Level, progress: Progress) -> LevelResult:
    # A constant coupling has the same row many times.
    (b, k, contact), back = np.unique(np.stack([rows.b, rows.k, rows.contact]), axis=1, return_inverse=True)
    back = back.ravel()
    parts = fractions(SampledLoop.of(rows.problem, "sampled-data"), b, k)
    corners = device_corners(rows.problem.device, LINEAR_KEYS)
    time = rows.problem.device.sample_time_s
    slack = RenderingSlack(parts, contact) if level == "L3" else CouplingSlack(b, k, contact, time)
    worst = port_worst(corners, slack, len(b), progress).pick(back)
    stiffness = (parts.integral / time)[back]
    sound = stable_with_one_hand(corners, parts, contact)[back]
    # Before any passive wall the DC stiffness of this one is no condition.
    sound &= (stiffness >= 0) | (level == "L4")
    faults = [_fault(level, bool(lacks), float(dc)) for lacks, dc in zip(~worst.passed, stiffness, strict=True)]
    claim = "each frozen row meets Llewellyn's condition (6) for any passive environment"
    if level == "L3":
        claim = "each frozen row is passive with this environment at every frequency up to Nyquist"
    claim += f", under the sampled-data hold, with the device as declared{_at_corners(corners)}"
    return _result(rows, level, "sampled-data", claim, worst, worst.passed & sound, faults)


def _result(
    rows: Rows, level: Level, model: Model, claim: str, worst: PortWorst, passed: BoolArray, faults: list[str] | None
) -> LevelResult:
    margin = worst.margin_ns_per_m
    return level_result(rows, level, model, claim, passed, margin, worst.frequency_hz, worst.tolerance_ns_per_m, faults)


def _at_corners(corners: list[Device]) -> str:
    return "" if len(corners) == 1 else f" at {len(corners)} corners of [device.range]"


def _fault(level: Level, lacks_damping: bool, dc_n_per_m: float) -> str:
    """Say what is wrong beside a lack of damping at the handle."""
    if lacks_damping:
        return ""
    if level == "L3" and dc_n_per_m < 0:
        return f"a negative DC stiffness of {dc_n_per_m:.4g} N/m"
    return "a pole outside the unit circle"


def stable_with_one_hand(corners: list[Device], parts: Fractions, contact: FloatArray) -> BoolArray:
    """Whether each row is stable with one passive hand; where the port is passive, it then is with any."""
    stable = np.array(parts.stable, dtype=bool)
    for device in corners:
        time = device.sample_time_s
        mass = max(device.mass_kg, device.damping_ns_per_m * time, 1e-6)
        hand = Hand(*(np.array([value]) for value in (mass, mass / (10 * time), mass / (10 * time) ** 2)))
        radius = whole_stability(device, parts, contact, hand).radius[:, 0]
        stable &= radius < 1 - RADIUS_TOLERANCE
    return stable
