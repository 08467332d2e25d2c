"""The sampled loop in numbers: partial fractions of the rendered impedance and its exact real part.

With w = 1/z, every spring and damper is (p - q w)/(1 - w), so that coupling and environment in series are

    Z_eavc = g + r w/(1 - w) + c w/(1 - rho w),    g, c >= 0 and |rho| <= 1 for admissible gains,

with r = T k k_e/(k + k_e): the DC stiffness. Terms of the real part cancel for physical reasons only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.model.corners import device_corners
from avc_casadi.model.device import whole_delay

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Model, Problem


def passive_limit_n_per_m(device: Device) -> float:
    """Return 2 b_d/((1 + d) T): no passive linear time-invariant rendering has a larger DC stiffness."""
    # F(z) = b_d + z^-(1+d) Z(z) is positive real; the d coefficients of its expansion in 1/z after b_d vanish, so that
    # of its measure, b_d in all, z = 1 carries b_d/(1 + d) at most, and that is half the residue K T.
    if device.amplifier_bandwidth_hz is not None or device.resonance is not None:
        return float("nan")
    corners = device_corners(device, ("damping_ns_per_m", "delay_samples"))
    if any(corner.delay_samples != int(corner.delay_samples) for corner in corners):
        return float("nan")
    return min(2 * corner.damping_ns_per_m / ((1 + corner.delay_samples) * corner.sample_time_s) for corner in corners)


Values = float | FloatArray

# Represents the limit of zero frequency: small enough for every term, large enough to divide by.
_ZERO_TURNS = 1e-150
# Gains beyond this equal a rigid coupling in double precision, whatever the wall.
RIGID = 1e40


@dataclass(frozen=True)
class SampledLoop:
    """Parameters of the conditions; device and environment values may be arrays."""

    device_damping_ns_per_m: Values
    environment_damping_ns_per_m: Values
    environment_stiffness_n_per_m: Values
    sample_time_s: float
    delay_samples: float
    model: Model

    @classmethod
    def of(cls, problem: Problem, model: Model | None = None) -> SampledLoop:
        """Return the loop of a problem, in its own model or in a given one."""
        return cls(
            problem.device.damping_ns_per_m,
            problem.environment.damping_ns_per_m,
            problem.environment.stiffness_n_per_m,
            problem.device.sample_time_s,
            problem.device.delay_samples,
            model or problem.stability.model,
        )

    def whole_delay(self, what: str) -> int:
        """Return the delay for `what`, which covers whole samples only."""
        return whole_delay(self.delay_samples, what)

    @property
    def nyquist_hz(self) -> float:
        """Half the sampling frequency."""
        return 0.5 / self.sample_time_s


@dataclass(frozen=True)
class Fractions:
    """Z_eavc = g + r w/(1 - w) + c w/(1 - rho w); arrays that broadcast together."""

    direct: FloatArray
    integral: FloatArray
    decaying: FloatArray
    pole: FloatArray
    pole_gap: FloatArray
    stable: BoolArray

    def pick(self, index: Any) -> Fractions:
        """Index every array alike: some rows, or a new axis."""
        return Fractions(*(values[index] for values in vars(self).values()))


def fractions(loop: SampledLoop, damping_ns_per_m: Values, stiffness_n_per_m: Values) -> Fractions:
    """Return the partial fractions of coupling and environment in series."""
    t = loop.sample_time_s
    wall = loop.environment_damping_ns_per_m, loop.environment_stiffness_n_per_m
    given = (np.asarray(value, dtype=np.float64) for value in (damping_ns_per_m, stiffness_n_per_m, *wall))
    b, k, b_e, k_e = np.broadcast_arrays(*given)
    rigid = (b > RIGID) | (k > RIGID)
    b, k = (np.where(rigid, 1.0, np.maximum(gain, -RIGID)) for gain in (b, k))
    kt, ket = k * t, k_e * t
    lead_e = b_e + ket if loop.model == "sampled-data" else b_e + ket / 2
    cross = kt * b_e - b * ket - (kt * ket / 2 if loop.model == "paper" else 0.0)
    total, spring = b + kt + lead_e, kt + ket
    plain = (total != 0) & (spring != 0)
    total_or_1, spring_or_1 = np.where(total != 0, total, 1.0), np.where(spring != 0, spring, 1.0)
    direct = np.where(total != 0, (b + kt) * (lead_e / total_or_1), 0.0)
    integral = np.where(spring != 0, kt * (ket / spring_or_1), 0.0)
    decaying = np.where(plain, (cross / total_or_1) ** 2 / spring_or_1, 0.0)
    # A pole without residue is no pole; 0 excludes it from every test.
    real_pole = (decaying != 0) & ~rigid
    gap = np.where(real_pole, spring / total_or_1, 1.0)
    double = (spring == 0) & (kt != 0)
    improper = (total == 0) & ((b != 0) | (kt != 0) | (lead_e != 0))
    return Fractions(
        direct=np.where(rigid, lead_e, direct),
        integral=np.where(rigid, ket, integral),
        decaying=np.where(real_pole, decaying, 0.0),
        pole=1.0 - gap,
        pole_gap=gap,
        stable=rigid | ((gap > 0) & (gap < 2) & ~double & ~improper),
    )


def real_part(
    loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: Values, frequency_hz: Values
) -> FloatArray:
    """Re Z_h at 0 <= frequency_hz <= Nyquist, N.s/m; at 0 its limit; all arguments broadcast.

    With H = h exp(-j psi): Re Z_h = b_d + h {(g + b_p) cos psi - r sin(psi + phi)/(2 sin phi)
    + c [(1 - rho) cos psi - 2 sin phi sin(psi + phi)]/[(1 - rho)^2 + 4 rho sin^2 phi]}.
    """
    amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
    return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(terms))


def size_of_terms(
    loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: Values, frequency_hz: Values | None = None
) -> FloatArray:
    """Sum of the magnitudes of the terms of Re Z_h, N.s/m: rounding errors are a multiple of it."""
    if frequency_hz is not None:
        amplitude, terms = _terms(loop, parts, contact_damping_ns_per_m, frequency_hz)
        return np.asarray(loop.device_damping_ns_per_m + amplitude * sum(np.abs(term) for term in terms))
    reach = loop.delay_samples + 1.5
    decay = np.abs(parts.decaying) / np.maximum(np.abs(parts.pole_gap), np.finfo(np.float64).tiny)
    steady = np.abs(parts.direct) + np.abs(contact_damping_ns_per_m) + reach * np.abs(parts.integral)
    return np.asarray(loop.device_damping_ns_per_m + steady + decay)


def _terms(
    loop: SampledLoop, parts: Fractions, contact: Values, frequency_hz: Values
) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Return h and the terms of Re Z_h in the braces of `real_part`, those of opposite sign separate."""
    turns = np.maximum(np.asarray(frequency_hz, dtype=np.float64) * loop.sample_time_s, _ZERO_TURNS)
    sine, cosine = np.sin(np.pi * turns), np.sin(np.pi * (0.5 - turns))
    half_turns = 2 * loop.delay_samples + (1 if loop.model == "paper" else 2)
    amplitude = cosine if loop.model == "paper" else np.ones_like(cosine)
    cos_psi = _cos_half_turns(half_turns, turns)
    sin_next = np.sin(np.pi * (half_turns + 1) * turns)
    distance2 = parts.pole_gap**2 + 4 * parts.pole * sine**2
    decaying = parts.decaying / np.where(distance2 == 0, np.finfo(np.float64).tiny, distance2)
    return amplitude, (
        parts.direct * cos_psi,
        contact * cos_psi,
        -parts.integral * (sin_next / (2 * sine)),
        decaying * parts.pole_gap * cos_psi,
        -decaying * (2 * sine * sin_next),
    )


def _cos_half_turns(count: float, turns: FloatArray) -> FloatArray:
    """cos(count phi), accurate at its zero at Nyquist where ``count`` is odd."""
    if count % 2 == 1:
        sign = 1.0 if count % 4 == 1 else -1.0
        return np.asarray(sign * np.sin(np.pi * count * (0.5 - turns)))
    return np.asarray(np.cos(np.pi * count * turns))
