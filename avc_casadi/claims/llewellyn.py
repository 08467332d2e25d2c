"""Llewellyn's condition (4) to (6): a coupling that is safe for any passive environment and hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.worst_frequency import refine_minima
from avc_casadi.loops.wall import RIGID, SampledLoop
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.law import Values

# Frequencies that resolve each half-wave of the hold.
_POINTS_PER_HALF_WAVE = 24
# Margins that differ by less than this share are equal.
_EQUAL = 1e-15
# Represents the limit of zero frequency: small enough for every term, large enough to divide by.
_ZERO_TURNS = 1e-150
# Angles per sample at which two devices are judged: from a share of the delay's own angle to where both spacings meet.
_SLOW_SHARE = 1e-3
_MEETING_ANGLE = 0.1
_SLOW_ANGLES = 1000
_FAST_ANGLES = 2000


def llewellyn_margin(
    loop: SampledLoop, damping_ns_per_m: Values, stiffness_n_per_m: Values, contact_damping_ns_per_m: Values = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the device damping to spare in (6) at the worst of all frequencies, N.s/m, and that frequency, Hz.

    It is b_d + b_p Re H - (|H| - Re H)(a + (kT/2)^2 cot^2(phi)/a)/2 with a = b + kT/2 and phi = omega T/2, H hold and
    delay of phase -psi, so that |H| - Re H = 2|H| sin^2(psi/2).
    """
    columns = (damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m, loop.device_damping_ns_per_m)
    b, k, contact, b_d = (
        np.ravel(column)[:, None] for column in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in columns))
    )
    within = (np.abs(b) <= RIGID) & (np.abs(k) <= RIGID)
    b = np.where(within, b, 0.0)
    half = np.where(within, k, 0.0) * loop.sample_time_s / 2
    lead = b + half
    valid = within & ((lead > 0) | ((b == 0) & (half == 0)))
    lead = np.where(valid, lead, 1.0)
    half = np.where(valid, half, 0.0)
    spring = half * np.where(lead > 0, half / np.where(lead > 0, lead, 1.0), 0.0)

    def value(frequency_hz: FloatArray) -> FloatArray:
        hold = _hold(loop, frequency_hz)
        loss = lead * hold.lag**2 + spring * hold.steep**2
        return np.asarray(b_d + hold.amplitude * (contact * (1 - 2 * hold.lag**2) - loss))

    half_waves = loop.whole_delay("Llewellyn's condition over all frequencies") + 2
    points = np.linspace(0.0, loop.nyquist_hz, _POINTS_PER_HALF_WAVE * half_waves + 1)
    frequency = refine_minima(value, np.broadcast_to(points, (len(b), len(points))), half_waves)
    values = value(frequency)
    # Among equal values the first: a refinement within rounding is no other frequency.
    least = values.min(axis=1, keepdims=True)
    lowest = np.argmax(values <= least + _EQUAL * (b_d + np.abs(least)), axis=1)[:, None]
    margin = np.take_along_axis(values, lowest, axis=1)
    worst_hz = np.take_along_axis(frequency, lowest, axis=1)
    return np.where(valid, margin, -np.inf)[:, 0], worst_hz[:, 0]


@dataclass(frozen=True)
class _Hold:
    """H = |H| exp(-j psi) at frequencies: |H|, sin(psi/2) and sin(psi/2) cot(phi)."""

    amplitude: FloatArray
    lag: FloatArray
    steep: FloatArray


def _hold(loop: SampledLoop, hz: FloatArray) -> _Hold:
    """Return |H|, sin(psi/2) and sin(psi/2) cot(phi) of hold and delay H = |H| exp(-j psi), phi = omega T/2.

    Frequencies are from 0 to Nyquist, Hz.
    """
    turns = np.maximum(hz * loop.sample_time_s, _ZERO_TURNS)
    paper = loop.model == "paper"
    half_turns = 2 * loop.delay_samples + (1 if paper else 2)
    sine = np.sin(np.pi * turns)
    cosine = np.sin(np.pi * (0.5 - turns))
    amplitude = cosine if paper else np.ones_like(cosine)
    lag = np.sin(np.pi * half_turns * turns / 2)
    return _Hold(amplitude, lag, lag * cosine / sine)


@dataclass(frozen=True)
class Teleoperator:
    """Parameters of two devices of one sample time, in the leader's units.

    Attributes:
        leader_damping_ns_per_m: damping of the leader.
        follower_damping_ns_per_m: damping of the follower.
        sample_time_s: sample time of both.
        there_samples: delay from leader to follower.
        back_samples: delay from follower to leader.
        leader_delay_samples: delay of the leader's own force.
        follower_delay_samples: delay of the follower's own force.
    """

    leader_damping_ns_per_m: float
    follower_damping_ns_per_m: float
    sample_time_s: float
    there_samples: float
    back_samples: float
    leader_delay_samples: float = 0.0
    follower_delay_samples: float = 0.0


def passivity_margin(device: Teleoperator, gains: ToolGains) -> tuple[float, float]:
    """Return the least eigenvalue of the two-port's condition, N.s/m, and its frequency, Hz; 0 or more is passive.

    The two-port is a teleoperator, leader to follower; its Hermitian part is looked at over angles omega T.
    """
    # Springs are worst where the delay is a small angle, dampers where it is many turns.
    slowest = _SLOW_SHARE / (1 + device.there_samples + device.back_samples)
    slow = np.geomspace(slowest, _MEETING_ANGLE, _SLOW_ANGLES)
    theta = np.concatenate([slow, np.linspace(_MEETING_ANGLE, math.pi, _FAST_ANGLES)])
    lowest = np.linalg.eigvalsh(_matrix(device, gains, theta))[:, 0]
    place = int(np.argmin(lowest))
    return float(lowest[place]), float(theta[place] / (2 * math.pi * device.sample_time_s))


def least_damping_ns_per_m(device: Teleoperator, gains: ToolGains) -> float:
    """Return the damping that both devices need for passivity, the same at both ends."""
    bare = replace(device, leader_damping_ns_per_m=0.0, follower_damping_ns_per_m=0.0)
    return max(0.0, -passivity_margin(bare, gains)[0])


def _matrix(device: Teleoperator, gains: ToolGains, theta: FloatArray) -> ComplexArray:
    """Return the condition's Hermitian matrix at angles (m,), shape (m, 2, 2): leader and follower, N.s/m.

    It is diag(b_1, b_2) - (P + P*)/2, P = C T/(1 - z), with s = (1 - 1/z)/T and C of K + (B + B_local) s from each
    device to itself and -(K + B s) z^-there or z^-back to the other, each row times its device's own delay.
    """
    t = device.sample_time_s
    turn = np.exp(-1j * theta)
    change = 2j * np.sin(theta / 2) * np.exp(-0.5j * theta)
    rate = change / t
    spring = gains.stiffness_n_per_m + gains.damping_ns_per_m * rate
    with_local = spring + gains.local_damping_ns_per_m * rate
    leader_late = turn**device.leader_delay_samples
    follower_late = turn**device.follower_delay_samples
    held = np.empty((len(theta), 2, 2), dtype=complex)
    held[:, 0, 0] = with_local * leader_late
    held[:, 0, 1] = -spring * turn**device.back_samples * leader_late
    held[:, 1, 1] = with_local * follower_late
    held[:, 1, 0] = -spring * turn**device.there_samples * follower_late
    held *= (t * change / (4 * np.sin(theta / 2) ** 2))[:, None, None]
    hermitian = (held + np.conj(np.swapaxes(held, 1, 2))) / 2
    damping = np.diag([device.leader_damping_ns_per_m, device.follower_damping_ns_per_m])
    return np.asarray(damping - hermitian)
