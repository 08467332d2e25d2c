"""Llewellyn's condition (4) to (6): a coupling that is safe for any passive environment and hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.worst_frequency import has_roots, quadratic_stretch, real_parts_of_roots, refine_minima, seeds_hz
from avc_casadi.loops.wall import RIGID

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.loops.wall import SampledLoop, Values
    from avc_casadi.model.ends import ToolGains


_ZERO_TURNS = 1e-150

_ROUNDING = 1e-14

_A_HALF_WAVE = 24


def llewellyn_margin(
    loop: SampledLoop,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
    *,
    refine: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return the device damping to spare in (6) at the worst of all frequencies."""
    given = (damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m, loop.device_damping_ns_per_m)
    b, k, contact, b_d = (
        np.ravel(column) for column in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in given))
    )
    within = (np.abs(b) <= RIGID) & (np.abs(k) <= RIGID)
    b, k = np.where(within, b, np.inf), np.where(within, k, 0.0)
    half = k * loop.sample_time_s / 2
    lead = b + half
    valid = np.isfinite(lead) & ((lead > 0) | ((b == 0) & (k == 0)))
    lead, half = np.where(valid, lead, 1.0), np.where(valid, half, 0.0)
    spring = half * np.where(lead > 0, half / np.where(lead > 0, lead, 1.0), 0.0)

    def value(frequency_hz: FloatArray) -> FloatArray:
        return _margin_at(loop, b_d[:, None], lead[:, None], spring[:, None], contact[:, None], frequency_hz)

    degree = loop.whole_delay("Llewellyn's condition over all frequencies") + 2
    seeds = seeds_hz(degree, loop.nyquist_hz)
    points = np.broadcast_to(seeds, (len(b), len(seeds)))
    if has_roots(degree):
        points = np.sort(np.concatenate([points, _stationary_hz(loop, lead, spring, contact)], axis=1), axis=1)
    frequency = refine_minima(value, points, degree) if refine else points
    values = value(frequency)
    lowest = np.argmin(values, axis=1)[:, None]
    margin = np.take_along_axis(values, lowest, axis=1)[:, 0]
    return np.where(valid, margin, -np.inf), np.take_along_axis(frequency, lowest, axis=1)[:, 0]


def _margin_at(
    loop: SampledLoop,
    b_d: FloatArray,
    lead: FloatArray,
    spring: FloatArray,
    contact: FloatArray,
    hz: FloatArray,
) -> FloatArray:
    """b_d + b_p Re H - (|H| - Re H)(a + (kT/2)^2 cot^2(phi)/a)/2, a = b + kT/2, |H| - Re H = 2|H| sin^2(psi/2)."""
    amplitude, lag, steep = _hold(loop, hz)
    loss = lead * lag**2 + spring * steep**2
    return np.asarray(b_d + amplitude * (contact * (1 - 2 * lag**2) - loss))


def _hold(loop: SampledLoop, hz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return |H|, sin(psi/2) and sin(psi/2) cot(phi)."""
    turns = np.maximum(hz * loop.sample_time_s, _ZERO_TURNS)
    paper = loop.model == "paper"
    half_turns = 2 * loop.delay_samples + (1 if paper else 2)
    sine, cosine = np.sin(np.pi * turns), np.sin(np.pi * (0.5 - turns))
    amplitude = cosine if paper else np.ones_like(cosine)
    lag = np.sin(np.pi * half_turns * turns / 2)
    return amplitude, lag, lag * cosine / sine


def _stationary_hz(loop: SampledLoop, lead: FloatArray, spring: FloatArray, contact: FloatArray) -> FloatArray:
    """Return the stationary points, shape (n, m): polynomials in cos(omega T), or in cos(phi) for the paper's hold."""
    paper = loop.model == "paper"
    delay = loop.whole_delay("the polynomial of stationary points")
    order = 2 * delay + 1 if paper else delay + 1
    turned = np.eye(order + 1)[order]
    # (1 - T_n(x))/(1 - x) = n + 2 sum (n - i) T_i(x).
    ratio = np.array([order, *(2.0 * (order - i) for i in range(1, order))], dtype=np.float64)
    if paper:
        # cos(phi) cot^2(phi) (1 - T_n) = B/(1 + x), B = x^3 ratio; the derivative times (1 + x)^2.
        lead_shape = chebyshev.chebmulx(chebyshev.chebsub([1.0], turned)) / 2
        contact_shape = chebyshev.chebmulx(turned)
        square = chebyshev.chebmul([1.0, 1.0], [1.0, 1.0])
        cubic = chebyshev.chebmulx(chebyshev.chebmulx(chebyshev.chebmulx(ratio))) / 2
        from_spring = chebyshev.chebsub(chebyshev.chebmul(chebyshev.chebder(cubic), [1.0, 1.0]), cubic)
        from_lead = chebyshev.chebmul(chebyshev.chebder(lead_shape), square)
        from_contact = chebyshev.chebmul(chebyshev.chebder(contact_shape), square)
    else:
        from_lead = -chebyshev.chebder(turned) / 2
        from_contact = chebyshev.chebder(turned)
        from_spring = chebyshev.chebder(chebyshev.chebmul([1.0, 1.0], ratio)) / 2
    width = max(len(from_lead), len(from_contact), len(from_spring), 2)
    shapes = [np.pad(shape, (0, width - len(shape))) for shape in (from_contact, from_lead, from_spring)]
    rows = contact[:, None] * shapes[0] - lead[:, None] * shapes[1] - spring[:, None] * shapes[2]
    angle = np.arccos(np.clip(real_parts_of_roots(rows), 0.0 if paper else -1.0, 1.0))
    return np.asarray(angle * (2 if paper else 1) / np.pi * loop.nyquist_hz)


def largest_llewellyn_stiffness(
    loop: SampledLoop,
    damping_ns_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
    margin_ns_per_m: float = 0.0,
) -> FloatArray:
    """Return the largest k that (6) allows at given b, N/m; not a number where it allows none. Shape (n,)."""
    b, contact = (
        np.ravel(v).astype(np.float64) for v in np.broadcast_arrays(damping_ns_per_m, contact_damping_ns_per_m)
    )
    feasible = llewellyn_margin(loop, b, 0.0, contact)[0] >= margin_ns_per_m
    b, contact = b[:, None], contact[:, None]

    def largest(frequency_hz: FloatArray) -> FloatArray:
        amplitude, lag, steep = _hold(loop, frequency_hz)
        loss = amplitude * lag**2
        given = loop.device_damping_ns_per_m - margin_ns_per_m + contact * (amplitude - 2 * loss)
        bend, slope, free = -(loss + amplitude * steep**2), given - 2 * b * loss, b * (given - b * loss)
        # Where b alone exhausts the margin, the rest is rounding.
        free = np.where(np.abs(free) <= _ROUNDING * b * given, 0.0, free)
        return quadratic_stretch(bend + 0 * free, slope, free)[1] * 2 / loop.sample_time_s

    degree = loop.whole_delay("Llewellyn's condition over all frequencies") + 2
    seeds = np.linspace(0.0, loop.nyquist_hz, _A_HALF_WAVE * degree + 1)
    points = np.broadcast_to(seeds, (len(b), len(seeds)))
    found = largest(refine_minima(largest, points, degree)).min(axis=1)
    return np.where(feasible, found, np.nan)


_POINTS = 2000


@dataclass(frozen=True)
class Teleoperator:
    """Parameters of two devices of one sample time, in the leader's units."""

    leader_damping_ns_per_m: float
    follower_damping_ns_per_m: float
    sample_time_s: float
    there_samples: float
    back_samples: float
    leader_delay_samples: float = 0.0
    follower_delay_samples: float = 0.0


def passivity_margin(device: Teleoperator, gains: ToolGains) -> tuple[float, float]:
    """Return the smallest eigenvalue of the condition's matrix, N.s/m, and its frequency, Hz; 0 or more is passive."""
    # Springs are worst where the delay is a small angle, dampers where it is many turns.
    slow = 1e-3 / (1 + device.there_samples + device.back_samples)
    theta = np.concatenate([np.geomspace(slow, 0.1, _POINTS // 2), np.linspace(0.1, math.pi, _POINTS)])
    lowest = np.linalg.eigvalsh(_matrix(device, gains, theta))[:, 0]
    place = int(np.argmin(lowest))
    return float(lowest[place]), float(theta[place] / (2 * math.pi * device.sample_time_s))


def damping_needed_ns_per_m(device: Teleoperator, gains: ToolGains) -> float:
    """Return the damping that both devices need for passivity, the same at both ends."""
    bare = replace(device, leader_damping_ns_per_m=0.0, follower_damping_ns_per_m=0.0)
    return max(0.0, -passivity_margin(bare, gains)[0])


def _matrix(device: Teleoperator, gains: ToolGains, theta: FloatArray) -> ComplexArray:
    t, turn = device.sample_time_s, np.exp(-1j * theta)
    change = 2j * np.sin(theta / 2) * np.exp(-0.5j * theta)
    rate = change / t
    spring = gains.stiffness_n_per_m + gains.damping_ns_per_m * rate
    own = spring + gains.local_damping_ns_per_m * rate
    late = turn**device.leader_delay_samples, turn**device.follower_delay_samples
    held = np.empty((len(theta), 2, 2), dtype=complex)
    held[:, 0, 0], held[:, 0, 1] = own * late[0], -spring * turn**device.back_samples * late[0]
    held[:, 1, 1], held[:, 1, 0] = own * late[1], -spring * turn**device.there_samples * late[1]
    held *= (t * change / (4 * np.sin(theta / 2) ** 2))[:, None, None]
    hermitian = (held + np.conj(np.swapaxes(held, 1, 2))) / 2
    damping = np.diag([device.leader_damping_ns_per_m, device.follower_damping_ns_per_m])
    return np.asarray(damping - hermitian)
