"""Laws of any pieces in time, around a device in time: shares no code with the package but what a table states."""

import math
from dataclasses import dataclass, field

import numpy as np
from sampled_wall import mechanics
from scipy import optimize, signal
from scipy.linalg import expm

from avc_casadi.model.control_law import ControlLaw

NOBODY = (0.0, 0.0, 0.0)


def coefficients(item, period):
    """Numerator and denominator in 1/z of a filter, by SciPy."""
    if item.kind == "low-pass":
        poles = [-1] if item.order == 1 else np.exp(1j * np.pi * np.array([0.75, -0.75]))
        there = np.poly(np.exp(2 * np.pi * item.cutoff_hz * period * np.array(poles))).real
        return np.array([there.sum()]), there
    if item.kind == "transfer":
        below = np.array(item.denominator)
        return np.pad(item.numerator, (len(below) - len(item.numerator), 0)), below
    warped = 2 / period * math.tan(math.pi * item.frequency_hz * period)
    if item.kind == "notch":
        above, below = ([1, 2 * by * item.width * warped, warped**2] for by in (item.depth, 1.0))
    else:
        sine = math.sin(math.radians(item.phase_deg))
        ratio = math.sqrt((1 + sine) / (1 - sine))
        above, below = [ratio / warped, 1], [1 / (ratio * warped), 1]
    return signal.bilinear(above, below, 1 / period)


def velocity_coefficients(law, period):
    item = law.velocity
    if item.kind == "window":
        return np.array([1.0, *[0.0] * (item.samples - 1), -1.0]) / (item.samples * period), np.ones(1)
    difference = np.array([1.0, -1.0]) / period
    if item.kind == "difference":
        return difference, np.ones(1)
    above, below = coefficients(item, period)
    return np.convolve(above, difference), below


@dataclass
class Controller:
    """The law in time: SciPy's filters, one sample after the other, all states in one vector."""

    law: ControlLaw
    period: float
    outside: bool = False
    chains: list = field(default_factory=list)

    def __post_init__(self):
        law = self.law
        self.k, self.b, self.ki = law.stiffness_n_per_m, law.damping_ns_per_m, law.integral_n_per_m_s
        if self.outside:
            self.k = self.b = self.ki = 0.0
        damper = self.b + law.local_damping_ns_per_m
        above, below = velocity_coefficients(law, self.period)
        # Each part of the force is a transfer function of its own; the filters follow their sum.
        mass = np.array([1.0, -1.0]) * law.virtual_mass_kg / self.period
        size = max(len(above), 1)
        motion = np.convolve(np.pad(damper * above, (0, 1)) + np.convolve(mass, above), [1.0])
        assert len(motion) == size + 1
        self.parts = [(np.array([self.k]), np.ones(1)), (motion, below)]
        if self.ki:
            self.parts.append((np.array([self.ki * self.period]), np.array([1.0, -1.0])))
        self.after = [coefficients(item, self.period) for item in law.filters]
        self.sizes = [max(len(a), len(b)) - 1 for a, b in (*self.parts, *self.after)]
        self.states = sum(self.sizes)

    def step(self, state, x):
        """The force and the next state."""
        pieces = np.split(state, np.cumsum(self.sizes)[:-1])
        later, force = [], 0.0
        for (above, below), old in zip(self.parts, pieces, strict=False):
            (value,), new = filtered(above, below, x, old)
            force, later = force + value, [*later, new]
        for (above, below), old in zip(self.after, pieces[len(self.parts) :], strict=True):
            (force,), new = filtered(above, below, force, old)
            later.append(new)
        return force, np.concatenate(later)


def filtered(above, below, value, state):
    if not len(state):
        return np.array([above[0] / below[0] * value]), state
    return signal.lfilter(above, below, [value], zi=state)


def radius(device, hand, controller, springless=False):
    """The spectral radius of one sample of device and law as a matrix, the sample split where a force arrives."""
    a, b, measured = mechanics(device, hand)
    n, period = len(b), device.sample_time_s
    whole, late = int(device.delay_samples), device.delay_samples % 1

    def moved(duration):
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = a * duration, b * duration
        return expm(both)[:n]

    before_arrival, after_arrival = moved(late * period), moved((1 - late) * period)

    def tick(state):
        x, line, inner = state[:n], state[n : n + whole + 1], state[n + whole + 1 :]
        force, inner = controller.step(inner, x[measured])
        forces = [force, *line]
        x = before_arrival @ [*x, forces[whole + 1]] if late else x
        x = after_arrival @ [*x, forces[whole]]
        return np.concatenate([x, forces[: whole + 1], inner])

    size = n + whole + 1 + controller.states
    poles = np.linalg.eigvals(np.stack([tick(unit) for unit in np.eye(size)], axis=1))
    if springless:  # it rests anywhere
        poles = np.delete(poles, np.abs(poles - 1).argmin())
    return np.abs(poles).max()


def worst(problem, law, hand, one_sided):
    places = [(False, law.stiffness_n_per_m == 0)] + [(True, True)] * one_sided
    return max(
        radius(
            problem.device, held, Controller(law, problem.device.sample_time_s, outside), not spring and held[2] == 0
        )
        for outside, springless in places
        for held in (hand, NOBODY)
        for spring in [not springless]
    )


def drawn(seed):
    """A device, a hand and a law whose pieces are drawn; stable more often than not."""
    draw = np.random.default_rng(seed)
    period, mass = 10 ** draw.uniform(-3.7, -2.7), 10 ** draw.uniform(-2, 0.3)
    delay = float(draw.choice([0, 1, 1.3, 2]))
    device = {"mass_kg": mass, "damping_ns_per_m": mass / period * 0.005, "sample_time_s": period}
    device["delay_samples"] = delay
    if draw.random() < 0.3:
        device["amplifier_bandwidth_hz"] = 0.3 / period
    hand = mass * draw.uniform(0.1, 2), mass / period * 10 ** draw.uniform(-3, -2), mass * draw.uniform(3, 30) ** 2
    damper = mass / period * 10 ** draw.uniform(-1.6, -1.0) / (1 + delay)
    spring = damper / period * 10 ** draw.uniform(-2.0, -1.2)
    law = {"stiffness_n_per_m": spring, "damping_ns_per_m": damper}
    velocities = [
        {"kind": "difference"},
        {"kind": "window", "samples": int(draw.integers(1, 6))},
        {"kind": "low-pass", "cutoff_hz": 0.15 / period, "order": int(draw.integers(1, 3))},
    ]
    law["velocity"] = velocities[draw.integers(3)]
    if draw.random() < 0.5:
        law["integral_n_per_m_s"] = spring * spring / damper * 10 ** draw.uniform(-2, -0.5)
    if draw.random() < 0.5:
        law["local_damping_ns_per_m"] = device["damping_ns_per_m"] * draw.uniform(-0.9, 2)
    if draw.random() < 0.5:
        law["virtual_mass_kg"] = mass * draw.uniform(-0.4, 0.15)
    filters = [
        {"kind": "notch", "frequency_hz": draw.uniform(0.1, 0.4) / period, "depth": 0.2, "width": 0.3},
        {"kind": "low-pass", "cutoff_hz": 0.25 / period, "order": int(draw.integers(1, 3))},
        {"kind": "lead", "frequency_hz": 0.1 / period, "phase_deg": 20.0},
        {"kind": "transfer", "numerator": [0.6, 0.2], "denominator": [1.0, -0.3, 0.1]},
    ]
    chosen = [item for item in filters if draw.random() < 0.3]
    law["filters"] = chosen or filters[:1]
    return device, hand, law, bool(draw.random() < 0.5)


def stated(seed):
    device, hand, law, walled = drawn(seed)
    names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
    tables = {"device": device, "law": law, "hands": {name: [one, one] for name, one in zip(names, hand, strict=True)}}
    if walled:
        tables["environment"] = {"stiffness_n_per_m": 1e3, "damping_ns_per_m": 0.0}
    return tables, hand, walled


def _held(device, hand):
    """A, B and output of the device over a sample, and the sample split where a force arrives."""
    a, b, measured = mechanics(device, hand)
    n, period, late = len(b), device.sample_time_s, device.delay_samples % 1

    def moved(duration):
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = a * duration, b * duration
        return expm(both)[:n]

    before, after = moved(late * period), moved((1 - late) * period)
    whole = after[:, :n] @ before[:, :n]
    older = after[:, :n] @ before[:, n]
    return whole, after[:, n], older if late else 0 * older, measured


def open_loop(device, hand, controller, z):
    """L(z): the law in transfer functions times the device with its delay."""
    whole, new, old, measured = _held(device, hand)
    delay = int(device.delay_samples)
    push = new[:, None] * z**-delay + old[:, None] * z ** -(delay + 1)
    pencil = z[:, None, None] * np.eye(len(new)) - whole
    position = np.linalg.solve(pencil, push.T[..., None])[..., 0][:, measured]

    def of(above, below):
        size = max(len(above), len(below))
        above, below = (np.pad(part, (0, size - len(part))) for part in (above, below))
        return np.polyval(above, z) / np.polyval(below, z)

    law = sum(of(above, below) for above, below in controller.parts)
    for above, below in controller.after:
        law = law * of(above, below)
    return -law * position


def disk_margin(device, hand, controller):
    """2/max |(1 - L)/(1 + L)|: a dense grid of angles, the largest refined."""

    def swing(turn):
        gain = open_loop(device, hand, controller, np.exp(1j * np.atleast_1d(turn)))
        return np.abs((1 - gain) / (1 + gain))

    turns = np.union1d(np.geomspace(1e-5, np.pi, 6000), np.linspace(1e-3, np.pi, 6000))
    sizes = swing(turns)
    best = sizes.max()
    for place in np.argsort(sizes)[-12:]:
        low, high = turns[max(place - 1, 0)], turns[min(place + 1, len(turns) - 1)]
        found = optimize.minimize_scalar(
            lambda turn: -swing(turn)[0], bounds=(low, high), method="bounded", options={"xatol": 1e-12}
        )
        best = max(best, -found.fun)
    return 2 / best
