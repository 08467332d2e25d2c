"""The frozen loop from sample to sample: mechanics propagated exactly, force held, wall on both sides.

The coupling force comes from the sampled position and its backward difference and is held for T: the sampled-data loop,
whatever model the gains were designed for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from avc_casadi.passivity import Fractions
    from avc_casadi.passivity._sampled import Values
    from avc_casadi.problem import Device
    from avc_casadi.stability._hands import FloatArray, HandSet

_TAYLOR_TERMS = 14


def mechanics(mass_kg: Values, damping_ns_per_m: Values, stiffness_n_per_m: Values, sample_time_s: float) -> FloatArray:
    """Propagate position and velocity exactly over one sample with a held force.

    Args:
        mass_kg: total moving mass; 0 is a first-order device. All broadcast to shape (h,).
        damping_ns_per_m: total damping.
        stiffness_n_per_m: spring to the resting point.
        sample_time_s: T.

    Returns:
        Shape (h, 2, 3): rows x and v T after the sample, columns x, v T and force (N) before it; not a number where
        mass, damping and stiffness are all 0.
    """
    m, b, k = (
        np.ravel(v)
        for v in np.broadcast_arrays(
            *(np.asarray(v, dtype=float) for v in (mass_kg, damping_ns_per_m, stiffness_n_per_m))
        )
    )
    t = sample_time_s
    step = np.zeros((len(m), 2, 3))
    light = m == 0
    if light.any():
        step[light, 0, :] = _first_order(b[light], k[light], t)
    if not light.all():
        heavy = ~light
        rate = np.zeros((int(heavy.sum()), 3, 3))
        rate[:, 0, 1] = 1.0
        rate[:, 1, 0] = -k[heavy] * t**2 / m[heavy]
        rate[:, 1, 1] = -b[heavy] * t / m[heavy]
        rate[:, 1, 2] = t**2 / m[heavy]
        step[heavy] = _exponential(rate)[:, :2, :]
    return step


def _first_order(b: FloatArray, k: FloatArray, t: float) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        decay = np.where(b > 0, k * t / np.where(b > 0, b, 1.0), np.where(k > 0, np.inf, np.nan))
        moved = np.where(k > 0, -np.expm1(-decay) / np.where(k > 0, k, 1.0), np.where(b > 0, t / b, np.nan))
    return np.stack([np.exp(-decay), np.zeros_like(b), moved], axis=1)


def _exponential(rate: FloatArray) -> FloatArray:
    """Matrix exponential of each (3, 3) matrix: Taylor series of a scaled matrix, squared back."""
    # The force column is scaled to the others; it only enters linearly.
    scale = np.maximum(np.abs(rate[:, 1, 2]), np.finfo(np.float64).tiny)
    scaled = rate.copy()
    scaled[:, 1, 2] = np.sign(rate[:, 1, 2])
    norm = np.max(np.sum(np.abs(scaled), axis=2))
    halvings = int(np.clip(np.ceil(np.log2(max(norm, 1e-300))) + 3, 0, 200))
    small = scaled / 2.0**halvings
    term = np.broadcast_to(np.eye(3), rate.shape).copy()
    total = term.copy()
    for order in range(1, _TAYLOR_TERMS):
        term = term @ small / order
        total = total + term
    for _ in range(halvings):
        total = total @ total
    total[:, :2, 2] *= scale[:, None]
    return np.asarray(total)


def transition(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: FloatArray,
    hands: HandSet,
    damping_shift_ns_per_m: float = 0.0,
) -> FloatArray:
    """Transition matrices of every frozen row with every hand.

    Args:
        device: mass, damping, sample time, delay.
        parts: partial fractions of n rows in the sampled-data model.
        contact_damping_ns_per_m: b_p, shape (n,).
        hands: h hands.
        damping_shift_ns_per_m: added to the damping of the device.

    Returns:
        Shape (n, h, 4 + d, 4 + d). States: x, v T, the x before, the coupling's own state, and d forces under way.
    """
    t, d = device.sample_time_s, device.delay_samples
    step = mechanics(
        device.mass_kg + hands.mass_kg,
        device.damping_ns_per_m + damping_shift_ns_per_m + hands.damping_ns_per_m,
        hands.stiffness_n_per_m,
        t,
    )
    n, h, size = len(parts.direct), len(hands), 4 + d
    force = np.zeros((n, size))
    damper = (parts.direct + contact_damping_ns_per_m) / t
    force[:, 0], force[:, 2], force[:, 3] = damper, parts.integral / t - damper, parts.decaying / t
    matrix = np.zeros((n, h, size, size))
    matrix[:, :, :2, :2] = step[None, :, :, :2]
    matrix[:, :, 2, 0] = 1.0
    matrix[:, :, 3, 0], matrix[:, :, 3, 2], matrix[:, :, 3, 3] = 1.0, -1.0, parts.pole[:, None]
    push = step[None, :, :, 2, None]
    if d == 0:
        matrix[:, :, :2, :] -= push * force[:, None, None, :]
        return matrix
    matrix[:, :, 4, :] = force[:, None, :]
    matrix[:, :, np.arange(5, size), np.arange(4, size - 1)] = 1.0
    matrix[:, :, :2, size - 1] -= push[..., 0]
    return matrix
