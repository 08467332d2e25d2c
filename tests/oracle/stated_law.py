"""A law of a table [law] sample by sample, its filters as difference equations by SciPy: no code shared.

`drawn_law` draws laws of every piece.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import signal


def coefficients(item, period):
    """Numerator and denominator in 1/z of a filter of the command, or of what follows a difference."""
    kind = item.kind
    if kind == "low-pass":
        angles = [1.0] if item.order == 1 else [0.75, -0.75]
        poles = np.exp(2 * np.pi * item.cutoff_hz * period * np.exp(1j * np.pi * np.array(angles)))
        below = np.poly(poles).real
        return np.array([below.sum()]), below
    if kind == "kalman":
        size = math.exp(-math.sqrt(2) * math.pi * item.bandwidth_hz * period)
        beta = 2 * (1 - size) ** 2
        return np.array([beta]), np.array([1.0, beta - 1 - size**2, size**2])
    if kind == "transfer":
        below = np.array(item.denominator)
        return np.pad(item.numerator, (len(below) - len(item.numerator), 0)), below
    warped = 2 / period * math.tan(math.pi * item.frequency_hz * period)
    if kind == "notch":
        above, below = ([1, 2 * by * item.width * warped, warped**2] for by in (item.depth, 1.0))
    else:
        sine = math.sin(math.radians(item.phase_deg))
        ratio = math.sqrt((1 + sine) / (1 - sine))
        above, below = [ratio / warped, 1], [1 / (ratio * warped), 1]
    return signal.bilinear(above, below, 1 / period)


class Equation:
    """A difference equation with its past written out."""

    def __init__(self, above, below):
        self.above, self.below = np.asarray(above) / below[0], np.asarray(below) / below[0]
        self.inputs, self.outputs = [0.0] * len(self.above), [0.0] * (len(self.below) - 1)

    def __call__(self, value):
        self.inputs = [value, *self.inputs[:-1]]
        out = math.fsum(np.array(self.inputs) * self.above) - math.fsum(np.array(self.outputs) * self.below[1:])
        self.outputs = [out, *self.outputs[:-1]][: len(self.below) - 1]
        return out


@dataclass
class StatedLaw:
    """The force of a law on a device that rested at `start`."""

    law: object
    sample_time_s: float
    one_sided: bool
    start: float = 0.0
    integral: float = 0.0
    count: int = 0
    force_n: float = 0.0
    past: list = field(default_factory=list)

    def __post_init__(self):
        self.period = self.law.rate_divider * self.sample_time_s
        kind = self.law.velocity.kind
        smooth = kind in ("low-pass", "kalman")
        self.smooth = Equation(*coefficients(self.law.velocity, self.period)) if smooth else None
        self.filters = [Equation(*coefficients(item, self.period)) for item in self.law.filters]
        self.past = [self.start] * (1 + (self.law.velocity.samples if kind == "window" else 1))
        self.speed = 0.0
        self.changed_at, self.place, self.ticks = -(10**9), self.start, 0

    def velocity(self, x):
        kind = self.law.velocity.kind
        self.past = [x, *self.past[:-1]]
        if kind == "ticks":
            timeout = max(1, round(self.law.velocity.timeout_s / self.period))
            self.ticks += 1
            waited = min(self.ticks - self.changed_at, timeout + 1)
            if x != self.place:
                speed = (x - self.place) / (waited * self.period)
                self.place, self.changed_at = x, self.ticks
                return speed
            return self.speed if waited <= timeout else 0.0
        change = (x - self.past[-1]) / ((len(self.past) - 1) * self.period)
        return change if self.smooth is None else self.smooth(change)

    def force(self, x):
        """The force at a sample, positive against +x."""
        if self.count % self.law.rate_divider == 0:
            self.force_n = self.run(x)
        self.count += 1
        return self.force_n

    def run(self, x):
        law = self.law
        before, self.speed = self.speed, self.velocity(x)
        v = self.speed
        beyond = math.copysign(max(abs(x) - law.dead_zone_m, 0.0), x)
        most = math.inf if law.integral_limit_n is None else law.integral_limit_n
        self.integral = min(max(self.integral + law.integral_n_per_m_s * self.period * x, -most), most)
        wall = law.stiffness_n_per_m * beyond + law.damping_ns_per_m * v + self.integral
        if self.one_sided and x <= 0:
            wall = self.integral = 0.0
        wall = max(wall, 0.0) if self.one_sided else wall
        force = wall + law.local_damping_ns_per_m * v + law.virtual_mass_kg * (v - before) / self.period
        own = law.friction_compensation
        if own is not None:
            force -= own.force_n * min(max(v / own.velocity_m_per_s, -1.0), 1.0)
        for item in self.filters:
            force = item(force)
        return force


VELOCITIES = ("difference", "window", "low-pass", "butterworth", "kalman", "ticks")


def drawn_velocity(kind, draw, period):
    """The table of an estimator at the period of a law."""
    of_kind = {
        "difference": {},
        "window": {"samples": int(draw.integers(2, 8))},
        "low-pass": {"cutoff_hz": draw.uniform(0.05, 0.2) / period},
        "butterworth": {"kind": "low-pass", "cutoff_hz": draw.uniform(0.05, 0.2) / period, "order": 2},
        "kalman": {"bandwidth_hz": draw.uniform(0.03, 0.2) / period},
        "ticks": {"timeout_s": int(draw.integers(5, 40)) * period},
    }
    return {"kind": kind, **of_kind[kind]}


def drawn_law(seed, sample_time_s=1e-3, mass_kg=0.1):
    """The tables of a device and of a law, every piece in turn; and whether there is a wall."""
    draw = np.random.default_rng(seed)
    divider = int(draw.choice([1, 1, 1, 2, 3]))
    period = divider * sample_time_s
    damper = 0.05 * mass_kg / period * draw.uniform(0.3, 1.0)
    spring = damper / period * 10 ** draw.uniform(-2.0, -1.5)
    law = {"stiffness_n_per_m": spring, "damping_ns_per_m": damper, "rate_divider": divider}
    law["velocity"] = drawn_velocity(VELOCITIES[seed % len(VELOCITIES)], draw, period)
    if draw.random() < 0.5:
        law["dead_zone_m"] = 10 ** draw.uniform(-5, -3.5)
    if draw.random() < 0.5:
        law["integral_n_per_m_s"] = spring * draw.uniform(0.3, 3.0)
        if draw.random() < 0.7:
            law["integral_limit_n"] = draw.uniform(0.2, 2.0)
    if draw.random() < 0.5:
        law["friction_compensation"] = {"force_n": draw.uniform(0.02, 0.2), "velocity_m_per_s": draw.uniform(0.01, 0.1)}
    if draw.random() < 0.4:
        law["local_damping_ns_per_m"] = damper * draw.uniform(-0.05, 0.3)
    if draw.random() < 0.4:
        law["virtual_mass_kg"] = mass_kg * draw.uniform(-0.03, 0.1)
    filters = [
        {"kind": "notch", "frequency_hz": draw.uniform(0.05, 0.4) / period, "depth": 0.2, "width": 0.3},
        {"kind": "low-pass", "cutoff_hz": draw.uniform(0.1, 0.3) / period, "order": int(draw.integers(1, 3))},
        {"kind": "lead", "frequency_hz": 0.1 / period, "phase_deg": 20.0},
        {"kind": "transfer", "numerator": [0.6, 0.2], "denominator": [1.0, -0.3, 0.1]},
    ]
    law["filters"] = [item for item in filters if draw.random() < 0.25]
    device = {
        "mass_kg": mass_kg,
        "damping_ns_per_m": 0.5,
        "sample_time_s": sample_time_s,
        "delay_samples": float(draw.choice([0, 1, 1.4])),
        "encoder_resolution_m": float(draw.choice([5e-6, 2e-5])),
        "coulomb_friction_n": float(draw.choice([0.0, 0.1])),
        "max_force_n": 8.0,
    }
    tables = {"device": device, "law": law}
    if draw.random() < 0.5:
        tables["environment"] = {"stiffness_n_per_m": spring, "damping_ns_per_m": 0.0}
    return tables


def wandering(seed, samples, step_m):
    """Positions of a handle that wanders in and out of a wall, rounded to steps of an encoder."""
    draw = np.random.default_rng(seed)
    time = np.arange(samples) * 1e-3
    swings = sum(
        draw.uniform(0.5, 2.0) * 1e-3 * np.sin(2 * np.pi * hz * time + draw.uniform(0, 6))
        for hz in draw.uniform(0.1, 6.0, 6)
    )
    return step_m * np.round(swings / step_m)
