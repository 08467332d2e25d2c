"""Linear stability of frozen gains with hands: the spectral radius of the exactly discretised loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.claims.passivity.sampled_loop import SampledLoop, fractions
from avc_casadi.model.plant import expm

if TYPE_CHECKING:
    from avc_casadi.claims.passivity.sampled_loop import Fractions, Values
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem


def mechanics(mass_kg: Values, damping_ns_per_m: Values, stiffness_n_per_m: Values, sample_time_s: float) -> FloatArray:
    """Return the exact propagation of position and velocity over one sample with a held force.

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
    """Matrix exponential of each (3, 3) matrix."""
    # The force column is scaled to the others; it only enters linearly.
    scale = np.maximum(np.abs(rate[:, 1, 2]), np.finfo(np.float64).tiny)
    scaled = rate.copy()
    scaled[:, 1, 2] = np.sign(rate[:, 1, 2])
    total = expm(scaled)
    total[:, :2, 2] *= scale[:, None]
    return np.asarray(total)


@dataclass(frozen=True)
class Rendering:
    """How n frozen renderings turn sampled positions into force, with one state of their own.

    Attributes:
        force: shape (n, 3): force (N) from x, the x before and the state.
        state: shape (n, 3): the next state from the same.
    """

    force: FloatArray
    state: FloatArray

    def pick(self, some: slice) -> Rendering:
        """Return some of the rows."""
        return Rendering(self.force[some], self.state[some])


def fraction_rendering(parts: Fractions, contact_damping_ns_per_m: FloatArray, sample_time_s: float) -> Rendering:
    """Return the rendering of partial fractions; a fraction without residue keeps a state that vanishes at once."""
    damper = (parts.direct + contact_damping_ns_per_m) / sample_time_s
    force = np.stack([damper, parts.integral / sample_time_s - damper, parts.decaying / sample_time_s], axis=-1)
    one = np.ones_like(damper)
    return Rendering(force, np.stack([one, -one, parts.pole + 0 * one], axis=-1))


def joint_rendering(
    problem: Problem, damping_ns_per_m: FloatArray, stiffness_n_per_m: FloatArray, contact_damping_ns_per_m: FloatArray
) -> Rendering:
    """Return the rendering of gains with the joint between coupling and wall as state, as on a device.

    This state keeps its meaning when the gains switch. The gains must not leave the joint undefined (all of b, k, b_e
    and k_e zero); where b or k is infinite the joint moves with the device.
    """
    t, wall = problem.device.sample_time_s, problem.environment
    rigid = np.isinf(damping_ns_per_m) | np.isinf(stiffness_n_per_m)
    b, k = (np.where(rigid, 1.0, gain) for gain in (damping_ns_per_m, stiffness_n_per_m))
    contact = contact_damping_ns_per_m
    lead, wall_lead = b + k * t, wall.damping_ns_per_m + wall.stiffness_n_per_m * t
    total = lead + wall_lead
    joint = np.stack([lead / total, -b / total, (b + wall.damping_ns_per_m) / total], axis=-1)
    joint[rigid] = (1.0, 0.0, 0.0)
    force = wall_lead / t * joint
    force[:, 2] -= wall.damping_ns_per_m / t
    force[:, 0] += contact / t
    force[:, 1] -= contact / t
    return Rendering(force, joint)


def frozen_transition(
    device: Device, rendering: Rendering, hands: Hand, damping_shift_ns_per_m: float = 0.0
) -> FloatArray:
    """Return the transition matrices of every frozen rendering with every hand.

    Args:
        device: mass, damping, sample time, delay.
        rendering: n renderings.
        hands: h hands.
        damping_shift_ns_per_m: added to the damping of the device.

    Returns:
        Shape (n, h, 4 + d, 4 + d), d the samples of delay, rounded up. States: x, v T, the previous x, the rendering's
        own state, and d delayed forces. A fractional delay lets the newer force arrive inside the sample.
    """
    every = Rendering(rendering.force[:, None], rendering.state[:, None])
    return _with_hands(device, every, hands, damping_shift_ns_per_m)


def paired_transition(
    device: Device, rendering: Rendering, hands: Hand, damping_shift_ns_per_m: float = 0.0
) -> FloatArray:
    """Return those of n renderings, each with its own hand, shape (n, 4 + d, 4 + d)."""
    return _with_hands(device, rendering, hands, damping_shift_ns_per_m)


def _with_hands(device: Device, rendering: Rendering, hands: Hand, damping_shift_ns_per_m: float) -> FloatArray:
    """Return the transition matrices of renderings broadcast against the hands."""
    d = math.ceil(device.delay_samples)
    before = device.delay_samples - (d - 1) if d else 0.0
    moving = (
        device.mass_kg + hands.mass_kg,
        device.damping_ns_per_m + damping_shift_ns_per_m + hands.damping_ns_per_m,
        hands.stiffness_n_per_m,
    )
    step = mechanics(*moving, device.sample_time_s)
    size = 4 + d
    force = np.zeros((*rendering.force.shape[:-1], size))
    force[..., [0, 2, 3]] = rendering.force
    matrix = np.zeros((*np.broadcast_shapes(rendering.force.shape[:-1], step.shape[:1]), size, size))
    matrix[..., :2, :2] = step[:, :, :2]
    matrix[..., 2, 0] = 1.0
    matrix[..., 3, [0, 2, 3]] = rendering.state
    push = step[:, :, 2]
    if d == 0:
        matrix[..., :2, :] -= push[..., None] * force[..., None, :]
        return matrix
    matrix[..., 4, :] = force
    matrix[..., np.arange(5, size), np.arange(4, size - 1)] = 1.0
    if before == 1:
        matrix[..., :2, size - 1] -= push
        return matrix
    # The newer force acts for the rest of the sample only; until then the previous one does.
    later = mechanics(*moving, (1 - before) * device.sample_time_s)[:, :, 2]
    later[:, 1] /= 1 - before
    matrix[..., :2, size - 1] -= push - later
    if d == 1:
        matrix[..., :2, :] -= later[..., None] * force[..., None, :]
    else:
        matrix[..., :2, size - 2] -= later
    return matrix


# Takes seconds for a table of 200 rows and 32 hands.
MAX_DELAY_SAMPLES = 32
# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
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
    """Return the spectral radius of each frozen rendering with each hand, on the implemented loop.

    Args:
        device: mass, damping, sample time, delay.
        parts: partial fractions of n renderings in the sampled-data model; the wall acts on both sides.
        contact_damping_ns_per_m: b_p, broadcast to shape (n,).
        hands: h hands.
        damping_shift_ns_per_m: added to the damping of the device.
        progress: reported over the rows.

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
    """Return partial fractions, n rows, of frozen gains in series with the wall, as a device computes them."""
    b, k = np.broadcast_arrays(damping_ns_per_m, stiffness_n_per_m)
    return fractions(SampledLoop.of(problem, "sampled-data"), np.ravel(b), np.ravel(k))


def frozen_rendering(
    problem: Problem, damping_ns_per_m: Values, stiffness_n_per_m: Values, contact_damping_ns_per_m: Values = 0.0
) -> Rendering:
    """Return the rendering of frozen gains in series with the wall; contact_damping is broadcast to n rows."""
    parts = frozen_parts(problem, damping_ns_per_m, stiffness_n_per_m)
    contact = np.broadcast_to(np.asarray(contact_damping_ns_per_m, dtype=np.float64), parts.direct.shape)
    return fraction_rendering(parts, contact, problem.device.sample_time_s)
