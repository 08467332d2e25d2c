"""One law of the search space: a Kalman filter with an assumed hand model, and a linear regulator on its estimate.

The observer models both bodies, amplifier, delay and its own commanded force; the hand's force is a random-walk
disturbance. The regulator drives the device to the equilibrium of wall and estimated disturbance, so that the static
stiffness is exactly the wall's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.loops.wall import Laws
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import DEVICE, transition
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.model.sampled_plant import Mode, device_plant, sampled_plant

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands

DEAD_ZONE_STEPS = 0.75
"""Half width of the dead zone in encoder steps: half a step of quantisation and a quarter for model error."""

# Sample time of the initial guesses; at shorter ones the filter is as fast in seconds, at longer ones in samples.
_USUAL_SAMPLE_TIME_S = 1e-3

# Regularises states without weight or noise.
_NOTHING = 1e-9
# Largest number of doublings for a Riccati equation, and the relative change that ends them.
_DOUBLINGS, _CHANGE = 40, 1e-14

# A of shape (points, n, n), b (points, n) and Q (points, n, n) to P.
Solver = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def dead_zone_m(device: Device) -> float:
    """Return the half width of the dead zone, m: that of the coarsest encoder of the declared range."""
    known = device.range.encoder_resolution_m
    return DEAD_ZONE_STEPS * (device.encoder_resolution_m if known is None else known[1])


@dataclass(frozen=True)
class Knob:
    """One parameter of the search, represented by its logarithm.

    Attributes:
        name: of a weight or noise of the regulator or the filter.
        starts: initial guesses, the middle of the results for the stiffest walls of random devices: with a stiff
            regulator behind a slow filter, and with a soft one.
        low: lower bound.
        high: upper bound.
    """

    name: str
    starts: tuple[float, ...]
    low: float
    high: float


@dataclass(frozen=True)
class Space:
    """The parameters of the search, in units of the device.

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
        """The parameters, those of a resonance only where there is one."""
        hands, faster = self.hands, min(1.0, self.device.sample_time_s / _USUAL_SAMPLE_TIME_S)
        light, middle = self._light_kg, [sum(getattr(hands, name)) / 2 for name in _HAND]
        rigid = self.device.resonance is None
        found = [
            Knob("position weight", (17.0 if rigid else 22.0, 20.0, 2.2), 0.1, 300.0),
            Knob("velocity weight", (1.9 if rigid else 0.96, 2.0, 0.4), 0.008, 13.0),
            _noise("walk of the push", (0.0065 if rigid else 0.0025, 0.0022, 0.009), 1e-4, 3.5, faster**3),
            _noise("force on the motor", (0.64 if rigid else 0.16, 0.12, 0.6), 1e-3, 60.0, faster**2),
        ]
        if not rigid:
            found += [
                _noise("force on the handle", (0.13, 0.11, 0.23), 1e-3, 60.0, faster**2),
                Knob("believed damping of the resonance", (0.09, 0.16, 0.16), 0.01, 0.7),
                Knob("believed frequency of the resonance", (0.81, 0.87, 0.87), 0.65, 1.3),
            ]
        turned = self.device.metres_per_unit**2
        mass, damping, stiffness = (max(value, least * turned) for value, least in zip(middle, _LEAST, strict=True))
        masses, dampings = (0.15 if rigid else 0.25, 0.13, 0.43), (3.2 if rigid else 2.2, 1.4, 1.4)
        stiffnesses = (1.7 if rigid else 4.7, 4.9, 3.8)
        return (
            *found,
            _hand("believed mass", masses, min(0.4 * light / mass, 0.1), 3.0, mass),
            _hand("believed damping", dampings, 0.17, 10.0, damping),
            _hand("believed stiffness", stiffnesses, 0.05, 18.0, stiffness),
        )

    @property
    def starts(self) -> tuple[FloatArray, ...]:
        """Logarithms of the initial guesses, likeliest first.

        They lie in different basins; which is better depends on the device.
        """
        return tuple(np.log([knob.starts for knob in self.knobs]).T)

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
            stiffness_n_per_m: K of the rendered wall.

        Raises:
            numpy.linalg.LinAlgError: the point has no law.
        """
        value = dict(zip([knob.name for knob in self.knobs], np.exp(logarithms).tolist(), strict=True))
        model, weights, sizes = self._assumed_model(value, stiffness_n_per_m)
        return self.one_of(model.laws(*weights, *sizes, solve=_precisely), 0)

    def one_of(self, laws: Laws, row: int) -> StateFeedback:
        """Return one of several laws in the form that runs."""
        half_m = dead_zone_m(self.device)
        return StateFeedback(
            state=tuple(map(tuple, laws.state[row].tolist())),
            force_m_per_n=tuple(laws.force_m_per_n[row].tolist()),
            innovation=tuple(laws.innovation[row].tolist()),
            feedback=tuple(laws.feedback[row].tolist()),
            positions=laws.positions,
            measures=laws.measures,
            dead_zone_m=half_m,
            face_m=half_m,
        )

    def laws(self, points: FloatArray, stiffness_n_per_m: float) -> Laws:
        """Return the laws of many points, quickly, to about ten digits.

        Args:
            points: logarithms of the parameters, shape (points, parameters).
            stiffness_n_per_m: K of the rendered wall.

        Returns:
            The laws; non-finite where a point has none.
        """
        value = dict(zip([knob.name for knob in self.knobs], np.exp(points).T, strict=True))
        model, weights, sizes = self._assumed_model(value, stiffness_n_per_m)
        return model.laws(*weights, *sizes, solve=_by_doubling)

    def _assumed_model(
        self, value: dict[str, Any], stiffness_n_per_m: float
    ) -> tuple[_Model, tuple[Any, Any], tuple[Any, Any, Any]]:
        """Return the observer's model, the regulator's weights, and the filter's noise intensities."""
        device, t, mode = self.device, self.device.sample_time_s, None
        if device.resonance is not None:
            mode = Mode(
                device.resonance.frequency_hz * value["believed frequency of the resonance"],
                value["believed damping of the resonance"],
                device.resonance.mass_ratio,
            )
        hand = Hand(*(value[f"believed {name}"] for name in ("mass", "damping", "stiffness")))
        model = _Model.of(device, hand, mode, stiffness_n_per_m)
        speed = value["velocity weight"] * math.sqrt(self._light_kg / stiffness_n_per_m) / t
        unit = self._light_kg / t**2 / stiffness_n_per_m
        sizes = ("walk of the push", "force on the motor", "force on the handle")
        return model, (value["position weight"], speed), tuple(unit * value.get(name, 0.0) for name in sizes)


def _noise(name: str, starts: tuple[float, ...], low: float, high: float, scale: float) -> Knob:
    """Return a noise parameter scaled so that the filter is as fast at other sample times."""
    return Knob(name, tuple(scale * start for start in starts), scale * low, scale * high)


def _hand(name: str, starts: tuple[float, ...], low: float, high: float, middle: float) -> Knob:
    """Return a parameter of the assumed hand model, relative to the middle of its range."""
    return Knob(name, tuple(middle * start for start in starts), middle * low, middle * high)


_HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
_LEAST = (0.01, 1.0, 10.0)


@dataclass(frozen=True)
class _Model:
    """Models of the observers of several points: s+ = A s + B u in metres; rates times T, forces over K.

    The disturbance is the last state.

    Attributes:
        state: A, shape (points, n, n).
        asked: B of u = F/K, shape (points, n).
        names: of the states.
        measured: index of the measured position.
        kicks: response to a force of K times a metre on motor and handle for one sample, shape (points, 2, n).
        stiffness_n_per_m: K.
    """

    state: FloatArray
    asked: FloatArray
    names: tuple[str, ...]
    measured: int
    kicks: FloatArray
    stiffness_n_per_m: float

    @classmethod
    def of(cls, device: Device, hand: Hand, mode: Mode | None, stiffness_n_per_m: float) -> _Model:
        """Return the model for an assumed hand and mode, whose parameters may be arrays over points."""
        t, k = device.sample_time_s, stiffness_n_per_m
        plant = device_plant(device, hand, mode=mode)
        linear = plant.linear()
        sampled = sampled_plant(device, hand, mode=mode)
        matrix, push = (part[0] for part in sampled.with_forces_under_way())
        s, n = len(linear.names), push.shape[-1] + 1
        names = (*linear.names, *(f"force_under_way_{place + 1}_n" for place in range(n - 1 - s)), "push_n")
        # A target displaced by 1/k_h exerts 1 N through the hand's spring.
        spring = np.reshape(hand.stiffness_n_per_m, (-1, 1))
        pushed = transition(linear, t).target.reshape(-1, s, 2)[..., 0] / spring
        state, asked = np.zeros((len(push), n, n)), np.zeros((len(push), n))
        state[:, :-1, :-1], state[:, :s, -1], state[:, -1, -1], asked[:, :-1] = matrix, pushed, 1.0, push
        unit = np.array([_unit(name, t, k) for name in names])
        half = transition(linear, t / 2).matrix.reshape(-1, s, s)
        kicks = np.zeros((len(push), 2, n))
        for row, body in enumerate((DEVICE, plant.grip)):
            place = names.index(f"{body}_velocity_m_per_s")
            kicks[:, row, :s] = half[..., place] * t / np.reshape(plant.mass_kg(body), (-1, 1)) * k
        return cls(
            state * unit[:, None] / unit,
            asked * unit * k,
            names,
            int(np.argmax(sampled.measured)),
            kicks * unit,
            stiffness_n_per_m,
        )

    def laws(self, position: Any, velocity: Any, walk: Any, motor: Any, handle: Any, *, solve: Solver) -> Laws:
        """Return observers and regulators; every argument is a scalar, or one for each point.

        Args:
            position: weight of the position.
            velocity: weight of the velocity.
            walk: intensity of the random-walk disturbance.
            motor: noise of the force on the motor.
            handle: noise of the force on the handle.
            solve: solver of Riccati equations.
        """
        feedback = self._feedback(position, velocity, solve)
        innovation = self._innovation(walk, (motor, handle), solve)
        positions = tuple(place for place, name in enumerate(self.names) if name.endswith("_position_m"))
        force = self.asked / self.stiffness_n_per_m
        return Laws(self.state, force, innovation, feedback, self.measured, positions)

    def _feedback(self, position: Any, velocity: Any, solve: Solver) -> FloatArray:
        """Return R: the regulator towards the equilibrium of the disturbance."""
        a, b, n = self.state[:, :-1, :-1], self.asked[:, :-1], self.asked.shape[-1]
        seen = np.zeros(n - 1)
        seen[self.measured] = 1.0
        # Equilibrium where u = the measured position balances the disturbance: the wall's own stiffness.
        rest = np.linalg.solve(np.eye(n - 1) - a - b[..., None] * seen, self.state[:, :-1, -1:])
        weight = np.full((len(a), n - 1), _NOTHING)
        weight[:, 0] += position**2
        weight[:, 1] += velocity**2
        cost = solve(a, b, weight[..., None] * np.eye(n - 1))
        pushed = b[:, None] @ cost
        gain = -(pushed @ a) / (1 + pushed @ b[..., None])
        return np.concatenate([gain, rest[:, self.measured, None] - gain @ rest], axis=-1)[:, 0]

    def _innovation(self, walk: Any, forces: tuple[Any, Any], solve: Solver) -> FloatArray:
        """Return L: the stationary Kalman gain, with the encoder's noise as the unit of length."""
        points, n = self.asked.shape
        noise = np.zeros((points, n, n))
        noise[:] = np.diag(np.full(n, _NOTHING))
        noise[:, -1, -1] += walk**2
        for row, size in enumerate(forces):
            kick = self.kicks[:, row]
            noise += np.reshape(size**2, (-1, 1, 1)) * (kick[:, :, None] * kick[:, None])
        seen = np.zeros((points, n))
        seen[:, self.measured] = 1.0
        spread = solve(np.swapaxes(self.state, -1, -2), seen, noise)[..., self.measured]
        return np.asarray(spread / (1 + spread[:, self.measured, None]))


def _precisely(a: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """Solve P = A'PA - A'Pb b'PA / (1 + b'Pb) + Q by ordered Schur vectors; where reordering fails, by doubling.

    Raises:
        numpy.linalg.LinAlgError: there is no solution.
    """
    from scipy.linalg import solve_discrete_are  # noqa: PLC0415

    one = np.ones((1, 1))
    try:
        return np.stack([solve_discrete_are(*each, one) for each in zip(a, b[..., None], weight, strict=True)])
    except (ValueError, np.linalg.LinAlgError):
        # Slow eigenvalues lie close to the unit circle; scipy raises either error.
        found = _by_doubling(a, b, weight)
    if not np.isfinite(found).all():
        raise np.linalg.LinAlgError("a Riccati equation has no solution")
    return found


def _by_doubling(a: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """Solve many at once, to about ten digits, by structured doubling (Chu et al. 2004).

    Solutions that do not converge are non-finite.
    """
    eye, power, cost, left = np.eye(a.shape[-1]), a, weight, b[..., None] * b[:, None]
    change = np.full(len(a), np.inf)
    for _ in range(_DOUBLINGS):
        whole = np.linalg.solve(eye + left @ cost, np.concatenate([power, left], axis=-1))
        power_left, left_left = np.split(whole, 2, axis=-1)
        turned = np.swapaxes(power, -1, -2)
        step = turned @ cost @ power_left
        cost, left, power = cost + step, left + power @ left_left @ turned, power @ power_left
        change = np.abs(step).max(axis=(-2, -1)) / np.abs(cost).max(axis=(-2, -1))
        if not (change > _CHANGE).any():
            break
    cost[~(change <= _CHANGE)] = np.nan
    return cost


def _unit(name: str, sample_time_s: float, stiffness_n_per_m: float) -> float:
    """Return the factor that turns a state into a length."""
    unit = sample_time_s if name.endswith("_per_s") else 1.0
    return unit / stiffness_n_per_m if "_n" in name else unit
