"""One law of the search space: a Kalman filter with a believed hand, and a linear regulator on what it believes.

The observer knows both bodies, amplifier, delay and the force that it commands itself; the push of the hand is a state
that walks. The regulator brings the device to the place where wall and push balance, which the push tells: the
stiffness at rest is the wall's, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import DEVICE, Hand, device_plant, device_with, sampled_plant, transition
from avc_casadi.runtime import StateFeedback
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Device, Hands

DEAD_ZONE_STEPS = 0.75
"""Half width of the dead zone: half a step is what an encoder leaves open, a quarter is for the model."""

# Regularises states without weight or noise.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Knob:
    """One number of the search, told by its logarithm.

    Attributes:
        name: what it is; of the regulator or the filter.
        start: where the search begins.
        low: lower bound.
        high: upper bound.
    """

    name: str
    start: float
    low: float
    high: float


@dataclass(frozen=True)
class Space:
    """The numbers of the search, in units of the device.

    Weights are relative to that of the force. Velocities are weighted by sqrt(K m), noises by the force that moves the
    lightest device and hand by one unit of the encoder's noise in a sample: only ratios matter.

    Attributes:
        device: the device.
        hands: ranges of the hands.
    """

    device: Device
    hands: Hands

    @cached_property
    def knobs(self) -> tuple[Knob, ...]:
        """The numbers, those of a resonance only where there is one."""
        hands = self.hands
        light, middle = self._light_kg, [sum(getattr(hands, name)) / 2 for name in _HAND]
        found = [
            Knob("position weight", 2.2, 0.1, 20.0),
            Knob("velocity weight", 0.4, 0.008, 13.0),
            Knob("walk of the push", 0.009, 1e-4, 3.5),
            Knob("force on the motor", 0.6, 1e-3, 60.0),
        ]
        if self.device.resonance is not None:
            found += [
                Knob("force on the handle", 0.23, 1e-3, 60.0),
                Knob("believed damping of the resonance", 0.16, 0.01, 0.7),
                Knob("believed frequency of the resonance", 0.87, 0.75, 1.3),
            ]
        mass, damping, stiffness = (max(value, least) for value, least in zip(middle, _LEAST, strict=True))
        return (
            *found,
            Knob("believed mass", 0.43 * mass, min(0.4 * light, 0.1 * mass), 3.0 * mass),
            Knob("believed damping", 1.4 * damping, 0.17 * damping, 3.5 * damping),
            Knob("believed stiffness", 3.8 * stiffness, 0.1 * stiffness, 6.0 * stiffness),
        )

    @property
    def start(self) -> FloatArray:
        """Logarithms of the start."""
        return np.log([knob.start for knob in self.knobs])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Logarithms of the bounds."""
        return np.log([knob.low for knob in self.knobs]), np.log([knob.high for knob in self.knobs])

    @property
    def _light_kg(self) -> float:
        return self.device.mass_kg + self.hands.mass_kg[0]

    def law(self, logarithms: FloatArray, stiffness_n_per_m: float) -> StateFeedback:
        """Return the law of one point.

        Args:
            logarithms: of the knobs.
            stiffness_n_per_m: K of the wall as it is rendered.

        Raises:
            numpy.linalg.LinAlgError: the point has no law.
        """
        value = dict(zip([knob.name for knob in self.knobs], np.exp(logarithms), strict=True))
        device, t = self.device, self.device.sample_time_s
        believed = device
        if device.resonance is not None:
            frequency = device.resonance.frequency_hz * value["believed frequency of the resonance"]
            damping = value["believed damping of the resonance"]
            mode = {"resonance.frequency_hz": frequency, "resonance.damping_ratio": damping}
            believed = device_with(device, mode)
        hand = Hand(*(value[f"believed {name}"] for name in ("mass", "damping", "stiffness")))
        model = _Model.of(believed, hand, stiffness_n_per_m)
        speed = value["velocity weight"] * np.sqrt(self._light_kg / stiffness_n_per_m) / t
        feedback = model.feedback(value["position weight"], float(speed))
        unit = self._light_kg / t**2 / stiffness_n_per_m
        motor = unit * value["force on the motor"]
        handle = unit * value.get("force on the handle", 0.0)
        innovation = model.innovation(unit * value["walk of the push"], motor, handle)
        known = device.range.encoder_resolution_m
        coarsest = device.encoder_resolution_m if known is None else known[1]
        return model.law(innovation, feedback, coarsest * DEAD_ZONE_STEPS)


_HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
_LEAST = (0.01, 1.0, 10.0)


@dataclass(frozen=True)
class _Model:
    """What the observer believes: s+ = A s + B u in metres; rates times T, forces over K. The push comes last.

    Attributes:
        state: A, shape (n, n).
        asked: B of u = F/K, shape (n,).
        names: of the states.
        measured: place of the measured position.
        kicks: what a force of K times a metre on motor and handle for a sample leaves behind, shape (2, n).
        stiffness_n_per_m: K.
    """

    state: FloatArray
    asked: FloatArray
    names: tuple[str, ...]
    measured: int
    kicks: FloatArray
    stiffness_n_per_m: float

    @classmethod
    def of(cls, device: Device, hand: Hand, stiffness_n_per_m: float) -> _Model:
        t, k = device.sample_time_s, stiffness_n_per_m
        plant = device_plant(device, hand)
        linear = plant.linear()
        sampled = sampled_plant(device, hand)
        matrix, push = (part[0, 0] for part in sampled.with_forces_under_way())
        s, n = len(linear.names), len(push) + 1
        names = (*linear.names, *(f"force_under_way_{place + 1}_n" for place in range(len(push) - s)), "push_n")
        # The hand's spring turns a target that is moved by 1/k_h into a push of 1 N.
        pushed = transition(linear, t).target.reshape(s, 2)[:, 0] / float(hand.stiffness_n_per_m)
        state, asked = np.zeros((n, n)), np.zeros(n)
        state[:-1, :-1], state[:s, -1], state[-1, -1], asked[:-1] = matrix, pushed, 1.0, push
        unit = np.array([_unit(name, t, k) for name in names])
        half = transition(linear, t / 2).matrix.reshape(s, s)
        kicks = np.zeros((2, n))
        for row, body in enumerate((DEVICE, plant.grip)):
            place = names.index(f"{body}_velocity_m_per_s")
            kicks[row, :s] = half[:, place] * t / float(np.ravel(plant.mass_kg(body))[0]) * k
        return cls(
            state * unit[:, None] / unit,
            asked * unit * k,
            names,
            int(np.argmax(sampled.measured)),
            kicks * unit,
            stiffness_n_per_m,
        )

    def feedback(self, position: float, velocity: float) -> FloatArray:
        """Return R: the regulator towards the place of rest that belongs to the push."""
        from scipy.linalg import solve_discrete_are  # noqa: PLC0415

        a, b, n = self.state[:-1, :-1], self.asked[:-1], len(self.asked)
        seen = np.zeros(n - 1)
        seen[self.measured] = 1.0
        # Where u = the measured position holds the push: the wall's own stiffness.
        rest = np.linalg.solve(np.eye(n - 1) - a - np.outer(b, seen), self.state[:-1, -1])
        weight = np.full(n - 1, _NOTHING)
        weight[0] += position**2
        weight[1] += velocity**2
        cost = solve_discrete_are(a, b[:, None], np.diag(weight), np.ones((1, 1)))
        gain = -(b @ cost @ a) / (1 + b @ cost @ b)
        return np.append(gain, rest[self.measured] - gain @ rest)

    def innovation(self, walk: float, motor: float, handle: float) -> FloatArray:
        """Return L: the stationary Kalman gain, with the encoder's noise for the unit of length."""
        from scipy.linalg import solve_discrete_are  # noqa: PLC0415

        n = len(self.asked)
        noise = np.diag(np.full(n, _NOTHING))
        noise[-1, -1] += walk**2
        for kick, size in zip(self.kicks, (motor, handle), strict=True):
            noise += size**2 * np.outer(kick, kick)
        seen = np.zeros((n, 1))
        seen[self.measured] = 1.0
        spread = solve_discrete_are(self.state.T, seen, noise, np.ones((1, 1)))
        return np.asarray(spread[:, self.measured] / (1 + spread[self.measured, self.measured]))

    def law(self, innovation: FloatArray, feedback: FloatArray, dead_zone_m: float) -> StateFeedback:
        return StateFeedback(
            state=tuple(tuple(row) for row in self.state.tolist()),
            force_m_per_n=tuple((self.asked / self.stiffness_n_per_m).tolist()),
            innovation=tuple(innovation.tolist()),
            feedback=tuple(feedback.tolist()),
            positions=tuple(place for place, name in enumerate(self.names) if name.endswith("_position_m")),
            measures=self.measured,
            dead_zone_m=dead_zone_m,
            face_m=dead_zone_m,
        )


def _unit(name: str, sample_time_s: float, stiffness_n_per_m: float) -> float:
    """Return what turns a state into a length."""
    unit = sample_time_s if name.endswith("_per_s") else 1.0
    return unit / stiffness_n_per_m if "_n" in name else unit
