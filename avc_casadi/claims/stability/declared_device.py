"""Linear stability on the device as declared: with amplifier, resonance and delay, of whole samples or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.claims.stability.frozen_loop import (
    MAX_DELAY_SAMPLES,
    LinearStability,
    Rendering,
    fraction_rendering,
    linear_stability,
)
from avc_casadi.loops.spectrum import largest_eigenvalue
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi.claims.passivity.sampled_loop import Fractions, Values
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.sampled_plant import SampledPlant

_NUMBERS_AT_ONCE = 4_000_000


def rigid(device: Device) -> bool:
    """Return whether mechanics and amplifier are ideal, so that `linear_stability` covers the device."""
    return device.amplifier_bandwidth_hz is None and device.resonance is None


def closed_loop(matrix: FloatArray, push: FloatArray, measured: FloatArray, rendering: Rendering) -> FloatArray:
    """Close n renderings around p plants.

    Args:
        matrix: A of each plant with its delayed forces, shape (p, s, s).
        push: B, shape (p, s).
        measured: row of the measured position, shape (s,).
        rendering: n renderings.

    Returns:
        Shape (n, p, s + 2, s + 2). States: those of the plant, the previous measured position, the rendering's own.
    """
    every = Rendering(rendering.force[:, None], rendering.state[:, None])
    return _closed(matrix, push, measured, every)


def paired_loop(matrix: FloatArray, push: FloatArray, measured: FloatArray, rendering: Rendering) -> FloatArray:
    """Close n renderings, each around its own plant, shape (n, s + 2, s + 2)."""
    return _closed(matrix, push, measured, rendering)


def _closed(matrix: FloatArray, push: FloatArray, measured: FloatArray, rendering: Rendering) -> FloatArray:
    s = len(measured)
    reads = np.zeros((3, s + 2))
    reads[0, :s] = measured
    reads[1, s] = reads[2, s + 1] = 1.0
    loop = np.zeros((*np.broadcast_shapes(rendering.force.shape[:-1], matrix.shape[:-2]), s + 2, s + 2))
    loop[..., :s, :s] = matrix
    loop[..., :s, :] += push[..., None] * (rendering.force @ reads)[..., None, :]
    loop[..., s, :] = reads[0]
    loop[..., s + 1, :] = rendering.state @ reads
    return loop


def plants_with_forces(plant: SampledPlant) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (p, s, s), B (p, s) and the measured row (s,) of every device with every hand, devices first.

    Velocities are scaled by the sample time, which keeps the digits of the eigenvalues.
    """
    matrix, push = plant.with_forces_under_way()
    s = push.shape[-1]
    scale = np.ones(s)
    for index, name in enumerate(plant.names):
        scale[index] = plant.sample_time_s if name.endswith("_per_s") else 1.0
    measured = np.zeros(s)
    measured[: len(plant.measured)] = plant.measured
    matrix = matrix * scale[:, None] / scale
    return matrix.reshape(-1, s, s), (push * scale).reshape(-1, s), measured


def whole_stability(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: Values,
    hands: Hand,
    damping_shift_ns_per_m: float = 0.0,
    progress: Progress = SILENT,
) -> LinearStability:
    """Return the spectral radius of each frozen rendering with each hand, on the device as declared.

    Args:
        device: mass, damping, sample time, delay, amplifier, resonance, side of the encoder.
        parts: as in `linear_stability`.
        contact_damping_ns_per_m: b_p, broadcast to shape (n,).
        hands: h hands.
        damping_shift_ns_per_m: added to the damping of the device.
        progress: reported over the rows.

    Raises:
        UnsupportedError: more than `MAX_DELAY_SAMPLES` samples of delay.
    """
    if rigid(device):
        return linear_stability(device, parts, contact_damping_ns_per_m, hands, damping_shift_ns_per_m, progress)
    return sampled_stability(device, parts, contact_damping_ns_per_m, hands, damping_shift_ns_per_m, progress)


def sampled_stability(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: Values,
    hands: Hand,
    damping_shift_ns_per_m: float = 0.0,
    progress: Progress = SILENT,
) -> LinearStability:
    """Return the same from the sampled plant, for a rigid device with an ideal amplifier too."""
    if device.delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {device.delay_samples}"
        )
    n, h = len(parts.direct), len(hands)
    radius, frequency = np.full((n, h), np.inf), np.zeros((n, h))
    moved = np.flatnonzero(device.mass_kg + np.broadcast_to(hands.mass_kg, (h,)) > 0)
    if len(moved) == 0:
        return LinearStability(radius, frequency)
    contact = np.broadcast_to(np.asarray(contact_damping_ns_per_m, dtype=np.float64), (n,))
    rendering = fraction_rendering(parts, contact, device.sample_time_s)
    plant = sampled_plant(device, hands.pick(moved), damping_shift_ns_per_m)
    matrix, push, measured = plants_with_forces(plant)
    # A light device with its damping reduced may overflow within a sample.
    finite = np.isfinite(matrix).all(axis=(-2, -1)) & np.isfinite(push).all(axis=-1)
    matrix, push, moved = matrix[finite], push[finite], moved[finite]
    if len(moved) == 0:
        return LinearStability(radius, frequency)
    rows_at_once = max(1, _NUMBERS_AT_ONCE // (len(moved) * (len(measured) + 2) ** 2))
    for some in chunks(n, rows_at_once, progress, "spectral radius") if n else ():
        value = largest_eigenvalue(closed_loop(matrix, push, measured, rendering.pick(some)))
        radius[some, moved] = np.abs(value)
        frequency[some, moved] = np.abs(np.angle(value)) / (2 * np.pi * device.sample_time_s)
    return LinearStability(radius, frequency)
