"""Passivity of a sampled position-position teleoperator with delay, for any operator and any environment.

Colgate and Schenkel's condition (1997), b > T/2 Re{(1 - e^{-j theta}) H}/(1 - cos theta), for two ports: the Hermitian
part of diag(b_l, b_f) - T/(2 (1 - cos theta)) (1 - e^{-j theta}) C(e^{j theta}) must not be negative at any theta, C
the matrix from sampled positions to held forces (Jazayeri and Tavakoli, IEEE Trans. Haptics 6(3), 2013). Without B it
ends at (b_l - K T/2)(b_f - K T/2) >= (K (tau + T)/2)^2 with tau the delay of a round trip, and for T -> 0 at
4 b_l b_f >= (K tau)^2: Nuno, Ortega, Barabanov and Basanez, IEEE Trans. Robotics 24(3), 2008, and with b_l = b_f Lee
and Spong, IEEE Trans. Robotics 22(2), 2006.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.model.ends import ToolGains

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
