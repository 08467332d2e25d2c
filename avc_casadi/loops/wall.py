"""The loop of a wall in the device's own loop, with each hand: frozen gains, and an observer with state feedback.

Quantiser and dead zone are a constant sector gain from 0 to 1 on the innovation, necessary against limit cycles alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.loops.loop import Body, Loop
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model.corners import device_corners
from avc_casadi.model.device import Device, whole_delay
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Model, Problem
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.paper.rows import force_behind


def passive_limit_n_per_m(device: Device) -> float:
    """Return 2 b_d/((1 + d) T): no passive linear time-invariant rendering has a larger DC stiffness."""
    # F(z) = b_d + z^-(1+d) Z(z) is positive real; the d coefficients of its expansion in 1/z after b_d vanish, so that
    # of its measure, b_d in all, z = 1 carries b_d/(1 + d) at most, and that is half the residue K T.
    corners = device_corners(device, ("damping_ns_per_m", "delay_samples"))
    if not rigid(device) or any(corner.delay_samples != int(corner.delay_samples) for corner in corners):
        return float("nan")
    return min(2 * corner.damping_ns_per_m / ((1 + corner.delay_samples) * corner.sample_time_s) for corner in corners)


Values = float | FloatArray
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
    values = (np.asarray(value, dtype=np.float64) for value in (damping_ns_per_m, stiffness_n_per_m, *wall))
    b, k, b_e, k_e = np.broadcast_arrays(*values)
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


def rigid(device: Device) -> bool:
    """Return whether mechanics and amplifier are ideal."""
    return device.amplifier_bandwidth_hz is None and device.resonance is None


@dataclass(frozen=True)
class Rendering:
    """How n frozen renderings turn sampled positions into force, with one state of their own."""

    force: FloatArray
    state: FloatArray

    def pick(self, some: slice | IndexArray) -> Rendering:
        """Return some of the rows."""
        return Rendering(self.force[some], self.state[some])

    @property
    def column(self) -> Rendering:
        """The rows along a first axis of two, the other that of plants."""
        return Rendering(self.force[..., None, :], self.state[..., None, :])


def fraction_rendering(parts: Fractions, contact_damping_ns_per_m: Values, sample_time_s: float) -> Rendering:
    """Return the rendering of partial fractions; a fraction without residue keeps a state that vanishes at once."""
    damper = (parts.direct + contact_damping_ns_per_m) / sample_time_s
    force = np.stack([damper, parts.integral / sample_time_s - damper, parts.decaying / sample_time_s], axis=-1)
    one = np.ones_like(damper)
    return Rendering(force, np.stack([one, -one, parts.pole + 0 * one], axis=-1))


# Takes seconds for a table of 200 rows and 32 hands.
MAX_DELAY_SAMPLES = 32
# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
RADIUS_TOLERANCE = 1e-10


@dataclass(frozen=True)
class LinearStability:
    """Spectral radii of n rows with h hands."""

    radius: FloatArray
    frequency_hz: FloatArray


def wall(body: Body, rendering: Rendering) -> ClosedLoops:
    """Return the loops of renderings (..., 3) around plants, of s + 2 states: both broadcast."""
    loop = Loop(plant=body.size, before=1, own=1)
    inputs = np.concatenate([(body.output_row @ loop["plant"])[None], loop["before"], loop["own"]])
    plant = body.next_state(loop["plant"], rendering.force @ inputs)
    maps = loop.event(plant=plant, before=inputs[:1], own=(rendering.state @ inputs)[..., None, :])
    return ClosedLoops(maps, loop.rests({"plant": body.shift, "before": 1.0}))


def observer_wall(
    body: Body, law: StateFeedback, rendering: Rendering, shares: Values = 1.0, of_force: Values = 1.0
) -> ClosedLoops:
    """Return the loops of p plants with a law, shares of innovation and force, (a, p) of s + n + 2 states."""
    (now, before, own), dynamic = rendering.force[0], int(rendering.force[0, 1:].any())
    loop = Loop(plant=body.size, observer=law.states, before=dynamic, own=dynamic)
    observer = loop["observer"]
    error = body.output_row @ loop["plant"] - observer[law.measures]
    corrected = observer + np.multiply.outer(np.atleast_1d(shares), np.array(law.innovation))[..., None] * error
    spring_m = (np.array(law.feedback) @ corrected)[:, None]
    force, new = now * spring_m, {}
    if dynamic:
        force = force + before * loop["before"] + own * loop["own"]
        first, past, self_ = rendering.state[0]
        new = {
            "before": spring_m[:, None],
            "own": (first * spring_m + past * loop["before"] + self_ * loop["own"])[:, None],
        }
    force = np.reshape(of_force, (-1, 1, 1)) * force
    prediction = (np.array(law.state) @ corrected + np.array(law.force_m_per_n)[:, None] * force)[:, None]
    return ClosedLoops(
        loop.event(plant=body.next_state(loop["plant"], force), observer=prediction, **new), loop.unit[:0]
    )


def closed(body: Body, rendering: Rendering, law: StateFeedback | None = None) -> ClosedLoops:
    """Return the loops of one rendering, with an observer or without, around p plants."""
    if law is None:
        return wall(body, rendering.pick(slice(0, 1)))
    loops = observer_wall(body, law, rendering)
    return replace(loops, maps=loops.maps[0])


def plants_of(devices: Sequence[Device], hands: Hand | StylusHand) -> SampledPlant:
    """Return every device with every hand; a rigid one without any mass is of first order, another not a number."""
    light = np.array([np.broadcast_to(one.mass_kg + np.asarray(hands.mass_kg) == 0, len(hands)) for one in devices])
    if isinstance(hands, StylusHand) or not light.any():
        return sampled_plant(devices, hands)
    heavy = [Hand(np.where(row, 1.0, hands.mass_kg), *list(vars(hands).values())[1:]) for row in light]
    plant = sampled_plant(devices, heavy)
    drag = np.array([one.damping_ns_per_m for one in devices])[:, None]
    k, b = (np.broadcast_to(one, light.shape) for one in (hands.stiffness_n_per_m, drag + hands.damping_ns_per_m))
    late = np.array([one.delay_samples % 1 for one in devices])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        whole, part = (
            np.where(k > 0, -np.expm1(-k * step_s / b) / k, step_s / b)
            for step_s in (plant.sample_time_s, (1 - late) * plant.sample_time_s)
        )
        decay = np.exp(-k * plant.sample_time_s / b)
        parts = part, whole - part
    first = np.zeros_like(plant.matrix)
    first[..., 0, 0] = decay if plant.matrix.shape[-1] == 2 else np.nan
    pushes = [np.pad(-one[..., None], ((0, 0), (0, 0), (0, plant.new.shape[-1] - 1))) for one in parts]
    new, old = (np.where(light[..., None], mine, its) for mine, its in zip(pushes, (plant.new, plant.old), strict=True))
    return replace(plant, matrix=np.where(light[..., None, None], first, plant.matrix), new=new, old=old)


def linear_stability(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: Values,
    hands: Hand,
    progress: Progress = SILENT,
) -> LinearStability:
    """Return the spectral radius of each frozen rendering with each hand, on the device as declared."""
    if device.delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {device.delay_samples}"
        )
    n, h = len(parts.direct), len(hands)
    rendering = fraction_rendering(parts, contact_damping_ns_per_m, device.sample_time_s)
    body = Body.of(plants_of([device], hands)).flat()
    # Nothing moves without mass, damping and spring; a light device with its damping reduced may overflow in a sample.
    defined = np.isfinite(body.a).all(axis=(-2, -1)) & np.isfinite(body.b).all(axis=-1)
    body = replace(body, a=np.where(defined[:, None, None], body.a, 0.0), b=np.where(defined[:, None], body.b, 0.0))
    rows_at_once = max(1, 4_000_000 // (h * (body.size + 2) ** 2))
    radius, frequency = np.empty((n, h)), np.empty((n, h))
    for some in chunks(n, rows_at_once, progress, "spectral radius") if n else ():
        value = wall(body, rendering.pick(some).column).leading
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
    return fraction_rendering(parts, contact_damping_ns_per_m, problem.device.sample_time_s)


def force_over_position(rendering: Rendering, z: ComplexArray, law: StateFeedback | None = None) -> ComplexArray:
    """Return the force of one rendering over the measured position, N/m; behind an observer without dead zone."""
    now, before, own = rendering.force[0]
    state = rendering.state[0]
    inner = (state[0] + state[1] / z) / (z - state[2]) if own else 0.0
    stiffness = np.asarray(now + before / z + own * inner)
    return stiffness if law is None else force_behind(law, stiffness, z)
