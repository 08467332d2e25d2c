"""A common quadratic Lyapunov function of neighbouring rows: gains may then switch between them at any sample."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.claims.passivity.sampled_loop import RIGID
from avc_casadi.claims.stability.frozen_loop import frozen_transition, joint_rendering

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem

_DOUBLINGS = 40
_SWEEPS = 12
# Share of each member's decay (in logarithms) that its own solution must show in every direction.
_EVEN_DECAY = 0.75
# The cost grows with the cube of the number of states, two neighbours and all hands: about 1 s at this size.
_MAX_DELAY_SAMPLES = 8
# Pairs of matrices held at a time.
_PAIRS_AT_ONCE = 10_000


@dataclass(frozen=True)
class SwitchingProof:
    """Pairs of neighbouring rows for which a common Lyapunov function was found with every hand.

    Attributes:
        pairs: number of pairs.
        proved: number of pairs proved; the others are open, not refuted.
        hands: number of hands tried.
    """

    pairs: int
    proved: int
    hands: int


def switching_proof(
    problem: Problem,
    damping_ns_per_m: FloatArray,
    stiffness_n_per_m: FloatArray,
    contact_damping_ns_per_m: FloatArray,
    hands: Hand,
    progress: Progress = SILENT,
) -> SwitchingProof | None:
    """Look for a common Lyapunov function of each pair of neighbouring rows, one function for each hand.

    Args:
        problem: device and environment.
        damping_ns_per_m: b of n rows in order of frequency.
        stiffness_n_per_m: k.
        contact_damping_ns_per_m: b_p.
        hands: hands at the device, each constant in time.
        progress: reported over the pairs.

    Returns:
        The count, or None where the search is not offered: fewer than two rows, infinite gains, no spring at all, or
        more than 8 samples of delay.
    """
    gains = np.stack([damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m])
    springs = stiffness_n_per_m + problem.environment.stiffness_n_per_m
    device = problem.device
    offered = gains.shape[1] > 1 and (np.abs(gains) <= RIGID).all() and device.delay_samples <= _MAX_DELAY_SAMPLES
    if not offered or (springs <= 0).any():
        return None
    # Delayed forces are scaled to the displacement that they cause.
    mass = max(device.mass_kg + float(np.mean(hands.mass_kg)), np.finfo(np.float64).tiny)
    unit = np.ones(4 + math.ceil(device.delay_samples))
    unit[4:] = device.sample_time_s**2 / mass
    pairs, proved = gains.shape[1] - 1, 0
    for some in chunks(pairs, max(1, _PAIRS_AT_ONCE // len(hands)), progress, "switching"):
        rows = gains[:, some.start : some.stop + 1]
        matrices = frozen_transition(device, joint_rendering(problem, *rows), hands)
        if not np.isfinite(matrices).all():
            return None
        matrices = matrices * unit[:, None] / unit[None, :]
        neighbours = np.stack([matrices[:-1], matrices[1:]], axis=2).reshape(-1, 2, *matrices.shape[2:])
        proved += int(np.count_nonzero(common_lyapunov(neighbours).reshape(-1, len(hands)).all(axis=1)))
    return SwitchingProof(pairs, proved, len(hands))


def lyapunov(matrices: FloatArray, decrease: FloatArray) -> FloatArray:
    """Return P = A'PA + Q for stable A, by doubling; all of shape (..., s, s); not finite where A is unstable."""
    total, power = decrease, matrices
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            total = total + np.swapaxes(power, -1, -2) @ total @ power
            power = power @ power
    return np.asarray(total)


def common_lyapunov(matrices: FloatArray) -> BoolArray:
    """Return whether one P > 0 with A_i' P A_i < P was found for all matrices of a group.

    P is sought among weighted means of the members' own solutions, which decrease almost evenly in all directions; the
    weights move towards the member that decreases least. The search is quick and not complete: True is a proof (every
    decrease is checked by eigenvalues), False says that none was found.

    Args:
        matrices: shape (groups, m, s, s).

    Returns:
        Shape (groups,).
    """
    decay = np.abs(np.linalg.eigvals(matrices)).max(axis=-1) ** _EVEN_DECAY
    even = matrices / np.maximum(decay, np.finfo(np.float64).tiny)[..., None, None]
    own = lyapunov(even, np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape))
    trace = np.trace(own, axis1=-2, axis2=-1)
    open_groups = np.flatnonzero(np.isfinite(trace).all(axis=1) & (trace > 0).all(axis=1))
    own = own[open_groups] / trace[open_groups][..., None, None]
    weight = np.full(own.shape[:2], 1.0 / matrices.shape[1])
    found = np.zeros(len(matrices), dtype=bool)
    for _ in range(_SWEEPS):
        if len(open_groups) == 0:
            break
        growth = _growth(np.einsum("gm,gmij->gij", weight, own), matrices[open_groups])
        proved = growth.max(axis=1) < -1e-12
        found[open_groups[proved]] = True
        rest = ~proved & np.isfinite(growth).all(axis=1)
        open_groups, own, growth = open_groups[rest], own[rest], growth[rest]
        lag = growth - growth.min(axis=1, keepdims=True)
        weight = weight[rest] * (1 + lag / np.maximum(lag.max(axis=1, keepdims=True), np.finfo(np.float64).tiny))
        weight = weight / weight.sum(axis=1, keepdims=True)
    return found


def _growth(candidate: FloatArray, matrices: FloatArray) -> FloatArray:
    """Largest relative growth x'(A'PA - P)x / x'Px of each member, shape (g, m); infinite where P is not positive."""
    values, vectors = np.linalg.eigh(candidate)
    positive = values[:, 0] > 1e-14 * values[:, -1]
    root = vectors / np.sqrt(np.maximum(values, np.finfo(np.float64).tiny))[:, None, :]
    change = np.swapaxes(matrices, -1, -2) @ candidate[:, None] @ matrices - candidate[:, None]
    scaled = np.swapaxes(root, -1, -2)[:, None] @ change @ root[:, None]
    usable = positive & np.isfinite(scaled).all(axis=(1, 2, 3))
    growth = np.linalg.eigvalsh(np.where(usable[:, None, None, None], scaled, 0.0))[..., -1]
    return np.asarray(np.where(usable[:, None], growth, np.inf))
