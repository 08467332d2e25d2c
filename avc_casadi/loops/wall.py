"""The loop of a law around sampled plants, and the law of frozen gains in series with a wall.

Quantiser, dead zone and force limit are sectors of the law, slopes from 0 to 1: necessary against limit cycles alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import plants_of
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model.corners import device_corners
from avc_casadi.model.device import Device, whole_delay
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law, Values
from avc_casadi.model.problem import Model, Problem


def passive_limit_n_per_m(device: Device) -> float:
    """Return 2 b_d/((1 + d) T): no passive linear time-invariant rendering has a larger DC stiffness."""
    # F(z) = b_d + z^-(1+d) Z(z) is positive real; the d coefficients of its expansion in 1/z after b_d vanish, so that
    # of its measure, b_d in all, z = 1 carries b_d/(1 + d) at most, and that is half the residue K T.
    corners = device_corners(device, ("damping_ns_per_m", "delay_samples"))
    if not rigid(device) or any(corner.delay_samples != int(corner.delay_samples) for corner in corners):
        return float("nan")
    return min(2 * corner.damping_ns_per_m / ((1 + corner.delay_samples) * corner.sample_time_s) for corner in corners)


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

    def whole_delay(self, taker: str) -> int:
        """Return the delay for what takes whole samples only."""
        return whole_delay(self.delay_samples, taker)

    @property
    def nyquist_hz(self) -> float:
        """Half the sampling frequency."""
        return 0.5 / self.sample_time_s


@dataclass(frozen=True)
class PartialFractions:
    """Z_eavc = g + r w/(1 - w) + c w/(1 - rho w), w = 1/z, of coupling and environment in series, shape (n,).

    Attributes:
        direct: g, N.s/m.
        integral: r, N.s/m.
        decaying: c, N.s/m.
        pole: rho, 0 where c is 0.
        pole_gap: 1 - rho, with all its digits.
        stable: whether every pole lies inside the unit circle, but for that of the spring at 1.
    """

    direct: FloatArray
    integral: FloatArray
    decaying: FloatArray
    pole: FloatArray
    pole_gap: FloatArray
    stable: BoolArray

    def pick(self, index: Any) -> PartialFractions:
        """Index every array alike: some rows, or a new axis."""
        return PartialFractions(
            direct=self.direct[index],
            integral=self.integral[index],
            decaying=self.decaying[index],
            pole=self.pole[index],
            pole_gap=self.pole_gap[index],
            stable=self.stable[index],
        )

    def law(self, contact_damping_ns_per_m: Values, sample_time_s: float) -> Law:
        """Return the laws of n rows, with a damper b_p beside: F/x = (Z_eavc + b_p) (1 - w)/T.

        The states are the position before, and what the decaying part keeps of its growth; a state that no row reads
        is left out.
        """
        rows = len(self.direct)
        damper = (self.direct + contact_damping_ns_per_m) / sample_time_s
        a = np.zeros((rows, 2, 2))
        a[:, 1, 0] = -1.0
        a[:, 1, 1] = self.pole
        c = np.stack([self.integral / sample_time_s - damper, self.decaying / sample_time_s], axis=-1)[:, None, :]
        states = 2 if self.decaying.any() else int(c.any())
        b = np.ones((rows, states, 1))
        return Law(a[:, :states, :states], b, c[..., :states], damper[:, None, None], sample_time_s)


def fractions(loop: SampledLoop, damping_ns_per_m: Values, stiffness_n_per_m: Values) -> PartialFractions:
    """Return the partial fractions of coupling and environment in series, Z_eavc; gains above `RIGID` are infinite.

    With the backward difference a coupling b, k and a wall b_e, k_e, T the sample time, have the pole rho with

        1 - rho = T (k + k_e)/(b + k T + b_e + k_e T)

    and the static part k k_e/(k + k_e). The paper's model has b_e + k_e T/2 in place of b_e + k_e T.
    """
    sampled = loop.model == "sampled-data"
    given = (
        damping_ns_per_m,
        stiffness_n_per_m,
        loop.environment_damping_ns_per_m,
        loop.environment_stiffness_n_per_m,
    )
    b, k, b_e, k_e = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in given))
    rigid = (b > RIGID) | (k > RIGID)
    b = np.where(rigid, 1.0, np.maximum(b, -RIGID))
    kt = np.where(rigid, 1.0, np.maximum(k, -RIGID)) * loop.sample_time_s
    ket = k_e * loop.sample_time_s
    # The environment's derivative is the backward difference, or in the paper's model Tustin's.
    lead_e = b_e + ket if sampled else b_e + ket / 2
    cross = kt * b_e - b * ket - (0.0 if sampled else kt * ket / 2)
    total = b + kt + lead_e
    spring = kt + ket
    plain = (total != 0) & (spring != 0)
    total_or_1 = np.where(total != 0, total, 1.0)
    spring_or_1 = np.where(spring != 0, spring, 1.0)
    direct = np.where(total != 0, (b + kt) * (lead_e / total_or_1), 0.0)
    integral = np.where(spring != 0, kt * (ket / spring_or_1), 0.0)
    decaying = np.where(plain, (cross / total_or_1) ** 2 / spring_or_1, 0.0)
    # A pole without residue is no pole; 0 excludes it from every test.
    real_pole = (decaying != 0) & ~rigid
    gap = np.where(real_pole, spring / total_or_1, 1.0)
    double = (spring == 0) & (kt != 0)
    improper = (total == 0) & ((b != 0) | (kt != 0) | (lead_e != 0))
    return PartialFractions(
        direct=np.where(rigid, lead_e, direct),
        integral=np.where(rigid, ket, integral),
        decaying=np.where(real_pole, decaying, 0.0),
        pole=1.0 - gap,
        pole_gap=gap,
        stable=rigid | ((gap > 0) & (gap < 2) & ~double & ~improper),
    )


def rigid(device: Device) -> bool:
    """Return whether mechanics and amplifier are ideal."""
    return device.amplifier_bandwidth_hz is None and device.resonance is None


# Takes seconds for a table of 200 rows and 32 hands.
MAX_DELAY_SAMPLES = 32


@dataclass(frozen=True)
class LinearStability:
    """The leading poles of n laws with h hands, (n, h); infinite where a plant has no equation of motion."""

    pole: ComplexArray

    @property
    def radius(self) -> FloatArray:
        """Spectral radii."""
        return np.asarray(np.abs(self.pole))


def closed(body: Body, law: Law) -> ClosedLoops:
    """Return the loops of laws around plants, of s + n states; their leading axes broadcast.

    With the plant p+ = A p + B u, y = C p and the law s+ = a s + b y, u = c s + d y, y the position and the force of a
    sensor where there is one:

        p+ = (A + B d C) p + B c s,   s+ = b C p + a s.
    """
    linear = law.linear
    states = body.size
    measured = body.measured
    push = body.b[..., None]
    shape = np.broadcast_shapes(body.a.shape[:-2], linear.shape)
    maps = np.empty((*shape, states + linear.states, states + linear.states))
    maps[..., :states, :states] = body.a + push @ (linear.d @ measured)
    maps[..., :states, states:] = push @ linear.c
    maps[..., states:, :states] = linear.b @ measured
    maps[..., states:, states:] = linear.a
    shift = np.broadcast_to(body.shift, (*linear.rest.shape[:-1], states))
    return ClosedLoops(maps, np.concatenate([shift, linear.rest], axis=-1)[None])


def linear_stability(device: Device, law: Law, hands: Hand, progress: Progress = SILENT) -> LinearStability:
    """Return the leading pole of the loop of each of n laws with each of h hands, on a device as declared.

    Raises:
        UnsupportedError: more than `MAX_DELAY_SAMPLES` samples of delay.
    """
    if device.delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {device.delay_samples}"
        )
    (rows,) = law.shape
    h = len(hands)
    body = Body.of(plants_of([device], hands)).flat()
    # Nothing moves without mass, damping and spring; a light device with its damping reduced may overflow in a sample.
    defined = np.isfinite(body.a).all(axis=(-2, -1)) & np.isfinite(body.b).all(axis=-1)
    body = replace(body, a=np.where(defined[:, None, None], body.a, 0.0), b=np.where(defined[:, None], body.b, 0.0))
    rows_at_once = max(1, 4_000_000 // (h * (body.size + 2) ** 2))
    pole = np.empty((rows, h), dtype=np.complex128)
    for chosen in chunks(rows, rows_at_once, progress, "spectral radius") if rows else ():
        pole[chosen] = np.where(defined, closed(body, law.pick((chosen, None))).leading, np.inf)
    return LinearStability(pole)


def frozen_parts(problem: Problem, damping_ns_per_m: Values, stiffness_n_per_m: Values) -> PartialFractions:
    """Return partial fractions, n rows, of frozen gains in series with the wall, as a device computes them."""
    b, k = np.broadcast_arrays(damping_ns_per_m, stiffness_n_per_m)
    return fractions(SampledLoop.of(problem, "sampled-data"), np.ravel(b), np.ravel(k))


def frozen_law(
    problem: Problem, damping_ns_per_m: Values, stiffness_n_per_m: Values, contact_damping_ns_per_m: Values = 0.0
) -> Law:
    """Return the laws of n rows of frozen gains in series with the wall, b_p beside, as a device computes them."""
    parts = frozen_parts(problem, damping_ns_per_m, stiffness_n_per_m)
    return parts.law(contact_damping_ns_per_m, problem.device.sample_time_s)


def law_at_rest(coupling: Coupling) -> Law:
    """Return the law of a coupling's gains at rest in contact, behind its observer where it has one."""
    gains = coupling.table.at_rest
    rows = frozen_law(coupling.problem, gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    return rows.pick(0).behind(coupling.runtime.state_feedback)
