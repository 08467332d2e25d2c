"""Linear stability of frozen gains with hands: the spectral radius of the exactly discretised loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.passivity import SampledLoop, fractions
from avc_casadi.stability._transition import fraction_rendering, frozen_transition
from avc_casadi.support import SILENT, BoolArray, FloatArray, Progress, chunks

if TYPE_CHECKING:
    from avc_casadi.loop import Hand
    from avc_casadi.passivity import (
        Fractions,
        Values,
    )
    from avc_casadi.problem import Device, Problem
    from avc_casadi.stability._transition import Rendering

# Some seconds for a table of 200 rows and 32 hands.
MAX_DELAY_SAMPLES = 32
# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is not told from none.
RADIUS_TOLERANCE = 1e-10
_NUMBERS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class LinearStability:
    """Spectral radii of n rows with h hands.

    Attributes:
        radius: largest modulus of an eigenvalue, shape (n, h); infinite where the mechanics is undefined.
        frequency_hz: frequency of that eigenvalue, shape (n, h).
    """

    radius: FloatArray
    frequency_hz: FloatArray

    @property
    def stable(self) -> BoolArray:
        """Whether each row is stable with every hand, shape (n,)."""
        return np.asarray(np.max(self.radius, axis=1) < 1 - RADIUS_TOLERANCE)


def linear_stability(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: Values,
    hands: Hand,
    damping_shift_ns_per_m: float = 0.0,
    progress: Progress = SILENT,
) -> LinearStability:
    """Spectral radius of each frozen rendering with each hand, on the loop that runs on a device.

    Args:
        device: mass, damping, sample time, delay.
        parts: partial fractions of n renderings in the sampled-data model; the wall acts on both sides.
        contact_damping_ns_per_m: b_p, broadcast to shape (n,).
        hands: h hands.
        damping_shift_ns_per_m: added to the damping of the device.
        progress: told of the rows.

    Raises:
        UnsupportedError: more than `MAX_DELAY_SAMPLES` samples of delay.
    """
    if device.delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {device.delay_samples}"
        )
    n = len(parts.direct)
    contact = np.broadcast_to(np.asarray(contact_damping_ns_per_m, dtype=np.float64), (n,))
    rendering = fraction_rendering(parts, contact, device.sample_time_s)
    size = 4 + math.ceil(device.delay_samples)
    rows_at_once = max(1, _NUMBERS_AT_ONCE // (len(hands) * size * size))
    radius, frequency = np.empty((n, len(hands))), np.empty((n, len(hands)))
    for some in chunks(n, rows_at_once, progress, "spectral radius") if n else ():
        matrices = frozen_transition(device, rendering.pick(some), hands, damping_shift_ns_per_m)
        defined = np.asarray(np.isfinite(matrices).all(axis=(2, 3)))
        values = np.linalg.eigvals(np.where(defined[..., None, None], matrices, 0.0))
        largest = np.argmax(np.abs(values), axis=-1)[..., None]
        value = np.take_along_axis(values, largest, axis=-1)[..., 0]
        radius[some] = np.where(defined, np.abs(value), np.inf)
        frequency[some] = np.abs(np.angle(value)) / (2 * np.pi * device.sample_time_s)
    return LinearStability(radius, frequency)


def frozen_parts(problem: Problem, damping_ns_per_m: Values, stiffness_n_per_m: Values) -> Fractions:
    """Partial fractions, n rows, of frozen gains before the problem's wall, as a device computes them."""
    b, k = np.broadcast_arrays(damping_ns_per_m, stiffness_n_per_m)
    return fractions(SampledLoop.of(problem, "sampled-data"), np.ravel(b), np.ravel(k))


def frozen_rendering(
    problem: Problem, damping_ns_per_m: Values, stiffness_n_per_m: Values, contact_damping_ns_per_m: Values = 0.0
) -> Rendering:
    """Frozen gains before the problem's wall as a device renders them; contact_damping is broadcast to n rows."""
    parts = frozen_parts(problem, damping_ns_per_m, stiffness_n_per_m)
    contact = np.broadcast_to(np.asarray(contact_damping_ns_per_m, dtype=np.float64), parts.direct.shape)
    return fraction_rendering(parts, contact, problem.device.sample_time_s)
