"""Llewellyn's condition (4) to (6): a coupling that is safe for any passive environment and hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.worst_frequency import refine_minima
from avc_casadi.loops.wall import RIGID, SampledLoop, Values
from avc_casadi.model.ends import ToolGains


def llewellyn_margin(
    loop: SampledLoop, damping_ns_per_m: Values, stiffness_n_per_m: Values, contact_damping_ns_per_m: Values = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the device damping to spare in (6) at the worst of all frequencies, and that frequency.

    It is b_d + b_p Re H - (|H| - Re H)(a + (kT/2)^2 cot^2(phi)/a)/2 with a = b + kT/2, |H| - Re H = 2|H| sin^2(psi/2).
    """
    columns = (damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m, loop.device_damping_ns_per_m)
    b, k, contact, b_d = (
        np.ravel(column)[:, None] for column in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in columns))
    )
    within = (np.abs(b) <= RIGID) & (np.abs(k) <= RIGID)
    b, half = np.where(within, b, 0.0), np.where(within, k, 0.0) * loop.sample_time_s / 2
    lead = b + half
    valid = within & ((lead > 0) | ((b == 0) & (half == 0)))
    lead, half = np.where(valid, lead, 1.0), np.where(valid, half, 0.0)
    spring = half * np.where(lead > 0, half / np.where(lead > 0, lead, 1.0), 0.0)

    def value(frequency_hz: FloatArray) -> FloatArray:
        amplitude, lag, steep = _hold(loop, frequency_hz)
        loss = lead * lag**2 + spring * steep**2
        return np.asarray(b_d + amplitude * (contact * (1 - 2 * lag**2) - loss))

    # Frequencies that resolve the half-waves of the hold.
    half_waves = loop.whole_delay("Llewellyn's condition over all frequencies") + 2
    points = np.linspace(0.0, loop.nyquist_hz, 24 * half_waves + 1)
    frequency = refine_minima(value, np.broadcast_to(points, (len(b), len(points))), half_waves)
    values = value(frequency)
    # Among equal values the first: a refinement within rounding is no other frequency.
    least = values.min(axis=1, keepdims=True)
    lowest = np.argmax(values <= least + 1e-15 * (b_d + np.abs(least)), axis=1)[:, None]
    margin, at = (np.take_along_axis(each, lowest, axis=1) for each in (values, frequency))
    return np.where(valid, margin, -np.inf)[:, 0], at[:, 0]


def _hold(loop: SampledLoop, hz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return |H|, sin(psi/2) and sin(psi/2) cot(phi)."""
    turns = np.maximum(hz * loop.sample_time_s, 1e-150)
    paper = loop.model == "paper"
    half_turns = 2 * loop.delay_samples + (1 if paper else 2)
    sine, cosine = np.sin(np.pi * turns), np.sin(np.pi * (0.5 - turns))
    amplitude = cosine if paper else np.ones_like(cosine)
    lag = np.sin(np.pi * half_turns * turns / 2)
    return amplitude, lag, lag * cosine / sine


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
    theta = np.concatenate([np.geomspace(slow, 0.1, 1000), np.linspace(0.1, math.pi, 2000)])
    lowest = np.linalg.eigvalsh(_matrix(device, gains, theta))[:, 0]
    place = int(np.argmin(lowest))
    return float(lowest[place]), float(theta[place] / (2 * math.pi * device.sample_time_s))


def least_damping_ns_per_m(device: Teleoperator, gains: ToolGains) -> float:
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
