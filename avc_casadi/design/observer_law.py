"""Observer laws: a Kalman filter with an assumed hand and a linear regulator to begin with, and what stays fixed of it.

The observer models motor and handle, amplifier, delay and its own commanded force; the hand's force is a random-walk
disturbance. The regulator drives the device to the equilibrium of wall and estimated disturbance, so that the static
stiffness is exactly the wall's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.design.plants import PlantMatrices
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import DEVICE, Mode, device_plant, sampled_plant, transition
from avc_casadi.model.problem import Hands, Problem
from avc_casadi.model.runtime import MOST_STATES, StateFeedback


@dataclass(frozen=True)
class Guess:
    """Weight of a regulator, noises of its filter as forces, and the hand that it assumes.

    The unit of the noises is m/T^2 times the encoder's noise, m the mass of the device with the lightest hand. Below a
    sample time of 1 ms the noise of the push is multiplied by (T/1 ms)^3, that of the force on the motor by (T/1 ms)^2.
    """

    velocity: float  # weight, in units of sqrt(K m)
    walk: float  # noise of the push
    motor: float  # noise of the motor's force
    hand_mass: float  # mass, damping and stiffness of the hand, over the middles of their ranges
    hand_damping: float
    hand_stiffness: float


GUESSES = (
    Guess(velocity=2.7, walk=0.0018, motor=0.23, hand_mass=0.25, hand_damping=4.8, hand_stiffness=7.1),
    Guess(velocity=4.2, walk=0.0036, motor=0.17, hand_mass=0.083, hand_damping=2.2, hand_stiffness=2.0),
    Guess(velocity=0.33, walk=0.0026, motor=0.38, hand_mass=0.24, hand_damping=4.7, hand_stiffness=7.9),
)
"""The best of some 100 on 54 drawn devices: two weigh the velocity much, and one weighs it little."""
_POSITION_WEIGHT = 1.1
"""Weight of the position, relative to that of the force.

A regulator much stiffer than its wall is unstable at the lower gain of a clipped force.
"""
_HANDLE_NOISE = 0.2
"""Noise of the force on the handle, in the unit of `Guess.motor`; chosen with the guesses, on the same devices."""
_MODE_FREQUENCY = 0.9
"""Frequency of the observer's mode over the declared one; chosen with the guesses. A lower frequency is safer."""
_MODE_DAMPING = 0.1
"""Damping ratio of the observer's mode."""
_REGULARISATION = 1e-9  # weight and noise of states that have none
_SHORTEST_FILTER_S = 1e-3  # at shorter sample times the filter is as fast in seconds, at longer ones in samples
_LEAST_HAND = {"mass_kg": 0.01, "damping_ns_per_m": 1.0, "stiffness_n_per_m": 10.0}
WIDTHS = (1.0, 1.25, 1.5, 2.0, 3.0)
"""Half widths of the dead zone to choose from, in steps of the coarsest encoder."""
# Without a trial: with it nearly all hands came to rest on the devices where that takes most.
_USUAL_WIDTH = 1.5
# A study of devices drawn at random chose the next four (tests/benchmarks/RESULTS_dead_zone.md).
_BEGINS_TO_OPEN = 1.0
"""Range of recent positions, in half widths, from which the dead zone begins to open."""
_FULLY_OPEN = 4.0
"""Range of recent positions, in half widths, from which the dead zone is fully open."""
_MEMORY_S = 0.6
"""Time constant with which the range of recent positions fades, s."""
_SMOOTHED_HZ = 15.0
"""Corner of the lag before the range: encoder steps sustain 15 to 200 Hz, a hand moves at 10 Hz at most."""


def _assumed_hand(guess: Guess, device: Device, hands: Hands) -> Hand:
    """Return the hand of a guess: mass, damping and stiffness as its shares of the middles of the ranges of [hands].

    A middle counts as at least 0.01 kg, 1 N.s/m or 10 N/m at the handle, since a hand without mass or spring gives the
    filter no model.
    """
    middle_kg, middle_ns_per_m, middle_n_per_m = (
        max(sum(getattr(hands, name)) / 2, least * device.metres_per_unit**2) for name, least in _LEAST_HAND.items()
    )
    return Hand(
        guess.hand_mass * middle_kg,
        guess.hand_damping * middle_ns_per_m,
        guess.hand_stiffness * middle_n_per_m,
    )


def regulator(device: Device, hands: Hands, stiffness_n_per_m: float, guess: Guess) -> StateFeedback:
    """Return a Kalman filter with a linear regulator as an observer law, before a wall of a stiffness.

    The filter models the device, a hand of the guess and a push that walks at random; its noises are forces on motor
    and handle. The regulator weighs position and velocity against the force. Its static stiffness is the wall's.
    """
    t = device.sample_time_s
    light_kg, faster = device.mass_kg + hands.mass_kg[0], min(1.0, t / _SHORTEST_FILTER_S)
    hand = _assumed_hand(guess, device, hands)
    mode = None
    if device.resonance is not None:
        frequency_hz = _MODE_FREQUENCY * device.resonance.frequency_hz
        mode = Mode(frequency_hz, _MODE_DAMPING, device.resonance.mass_ratio)
    model = _Model.of(device, hand, mode, stiffness_n_per_m)
    unit = light_kg / t**2 / stiffness_n_per_m
    forces = unit * faster**2 * guess.motor, unit * faster**2 * _HANDLE_NOISE
    kalman_gain = model.kalman_gain(unit * faster**3 * guess.walk, forces)
    feedback = model.feedback(_POSITION_WEIGHT, guess.velocity * math.sqrt(light_kg / stiffness_n_per_m) / t)
    positions = tuple(place for place, name in enumerate(model.names) if name.endswith("_position_m"))
    # The push is counted from that which holds the handle where it is: a law starts at rest, with positions alone.
    to = np.eye(len(model.push))
    to[-1, model.measured] = -hand.stiffness_n_per_m / stiffness_n_per_m
    back = np.linalg.inv(to)
    parts = to @ model.state @ back, to @ model.push / stiffness_n_per_m, to @ kalman_gain, feedback @ back
    return _law(device, parts, positions, model.measured)


def _law(device: Device, parts: tuple[FloatArray, ...], positions: tuple[int, ...], measures: int) -> StateFeedback:
    """Return the observer law of A, B, L and R in `parts`, rounded to single precision, with the usual dead zone.

    Its step is s+ = A (s + L innovation) + B force, its force K R (s + L innovation), K the stiffness of the wall.
    """
    # In single precision, as on the device: what is judged is what runs.
    state, force, gain, feedback = (part.astype(np.float32).astype(np.float64) for part in parts)
    law = StateFeedback(
        state=tuple(map(tuple, state.tolist())),
        force_m_per_n=tuple(force.tolist()),
        innovation=tuple(gain.tolist()),
        feedback=tuple(feedback.tolist()),
        positions=positions,
        measures=measures,
    )
    return with_dead_zone(law, device, _USUAL_WIDTH)


def with_dead_zone(law: StateFeedback, device: Device, steps: float) -> StateFeedback:
    """Return the law with another half width of its dead zone, in steps of the coarsest encoder; none without steps.

    The wall's face is not shifted: a hand that presses opens the dead zone, so that there is no lag to balance. Only
    coupling files of 0.3.0 have another `face_m` than 0.
    """
    known, t = device.range.encoder_resolution_m, device.sample_time_s
    half_m = steps * (device.encoder_resolution_m if known is None else known[1])
    zone = {
        "dead_zone_m": half_m,
        "face_m": 0.0,
        "opens_m": _BEGINS_TO_OPEN * half_m,
        "open_m": _FULLY_OPEN * half_m,
        "kept": math.exp(-t / _MEMORY_S),
        "smoothing": math.exp(-2 * math.pi * _SMOOTHED_HZ * t),
    }
    return law.model_copy(update=zone)


@dataclass(frozen=True, eq=False)
class Structure:
    """Model and feedback of a law, and filters of its innovation; see `StateFeedback` for A, B, R."""

    state: FloatArray  # A, (n, n), a diagonal part for the filters
    force: FloatArray  # B
    feedback: FloatArray  # R
    measures: int  # index of the estimated measured position
    positions: tuple[int, ...]
    modelled: int  # number of states that the force moves
    regulator_gain: FloatArray  # L of the regulator that the model comes from
    stiffness_n_per_m: float  # K

    @classmethod
    def of(cls, problem: Problem, guess: Guess, filters: int) -> Structure:
        """Return the model and feedback of a guess, with filters of the innovation from 3 Hz to 1/(4 T)."""
        t, stiffness = problem.device.sample_time_s, problem.environment.stiffness_n_per_m
        law = regulator(problem.device, problem.hands, stiffness, guess)
        n = law.states
        filters = min(filters, MOST_STATES - n - (problem.environment.damping_ns_per_m > 0))
        poles = np.exp(-2 * np.pi * t * np.geomspace(3.0, 0.25 / t, filters))
        state = np.diag(np.concatenate([np.zeros(n), poles]))
        state[:n, :n] = law.state
        unmoved = np.zeros(filters)  # no force moves a filter, and no innovation of the regulator passes one
        return cls(
            state=state,
            force=np.concatenate([law.force_m_per_n, unmoved]),
            feedback=np.concatenate([law.feedback, np.ones(filters)]),
            measures=law.measures,
            positions=law.positions,
            modelled=n,
            regulator_gain=np.concatenate([law.innovation, unmoved]),
            stiffness_n_per_m=stiffness,
        )

    @cached_property
    def closed(self) -> FloatArray:
        """A + K B R: the law without innovation."""
        return np.asarray(self.state + self.stiffness_n_per_m * np.outer(self.force, self.feedback))

    def rows(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return the rows X and Y of a gain L at points z, shape (..., n) each.

        X L is the force over the innovation, N/m, and Y L the predicted position over the innovation, of the law
        without a plant: with M = A + K B R, X = K R (1 - M/z)^-1 and Y = C M (1 - M/z)^-1/z, C the measured position.
        """
        inner = np.linalg.inv(np.eye(len(self.force)) - self.closed / z[..., None, None])
        x = self.stiffness_n_per_m * (self.feedback @ inner)
        return np.asarray(x), np.asarray((self.closed[self.measures] @ inner) / z[..., None])

    def differences(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return O/Q - 1 of the observer alone as rows of L, (..., n), and D/Q of the feedback, at points z.

        O, D and Q = det(z - A) are polynomials; A, B, C, L and R are matrices, and K is the wall's stiffness. O/Q = 1 +
        C (z - A)^-1 A L is the return difference of the observer that no force moves, and D/Q = 1 - K R (z - A)^-1 B
        that of the feedback of the state, both of the modelled states without filters.
        """
        n = self.modelled
        rows = np.zeros((*z.shape, len(self.force)), dtype=np.complex128)
        inner = np.linalg.inv(z[..., None, None] * np.eye(n) - self.model)
        rows[..., :n] = inner[..., self.measures, :] @ self.model
        return rows, 1 - self.stiffness_n_per_m * (inner @ self.force[:n] @ self.feedback[:n])

    @property
    def model(self) -> FloatArray:
        """A of the states that the force moves, without the filters."""
        return self.state[: self.modelled, : self.modelled]

    def observer(self, gain: FloatArray) -> FloatArray:
        """Return A - A L C of the observer alone, by which its error decays."""
        matrix = self.model.copy()
        matrix[:, self.measures] -= self.model @ gain[: self.modelled]
        return matrix

    def observer_radius(self, gain: FloatArray) -> float:
        """Return the spectral radius of the observer alone."""
        return float(np.abs(np.linalg.eigvals(self.observer(gain))).max())

    def loops(self, plants: PlantMatrices, gain: FloatArray, share: float = 1.0) -> FloatArray:
        """Return the closed loops of p plants where a share of the innovation is passed, (p, s + n, s + n).

        The states are the s of the plant, then the n of the law: x+ = A_p x + B_p F, with the force F = K R (state
        corrected by share x L x innovation).
        """
        s, n = len(plants.measured), len(self.force)
        loops = np.zeros((len(plants), s + n, s + n))
        loops[:, :s, :s], loops[:, s:, s:] = plants.state, self.closed
        loops[:, :s, s:] = plants.force[:, :, None] * (self.stiffness_n_per_m * self.feedback)
        innovation, corrected = self._through(plants)
        loops += share * (corrected @ gain)[..., None] * innovation
        return loops

    def _through(self, plants: PlantMatrices) -> tuple[FloatArray, FloatArray]:
        """Return the row of the innovation over the states (x, s), and how they move by a correction of s.

        x is the state of the plant and s that of the observer, of p plants: the innovation is C x - C_m s. A correction
        of s moves x through the force, and s by A + K B R.
        """
        n = len(self.force)
        innovation = np.concatenate([plants.measured, -np.eye(n)[self.measures]])
        force = plants.force[:, :, None] * (self.stiffness_n_per_m * self.feedback)
        corrected = np.concatenate([force, np.broadcast_to(self.closed, (len(plants), n, n))], axis=1)
        return innovation, corrected

    def slopes(self, plants: PlantMatrices, gain: FloatArray, share: float, poles: ComplexArray) -> ComplexArray:
        """Return the derivative by L of one pole of each plant's loop M, (p, n): w' dM v/w'v, w and v its eigenvectors.

        The eigenvectors come from three steps of inverse iteration. `share` is that of the innovation that is passed.
        """
        loops = self.loops(plants, gain, share)
        # Off the pole itself, where the matrix is singular.
        shifted = loops - ((1 + 1e-9) * poles)[:, None, None] * np.eye(loops.shape[-1])
        right = left = np.ones((*loops.shape[:2], 1), dtype=np.complex128)
        for _ in range(3):
            right, left = np.linalg.solve(shifted, right), np.linalg.solve(shifted.swapaxes(1, 2), left)
            right /= np.linalg.norm(right, axis=1, keepdims=True)
            left /= np.linalg.norm(left, axis=1, keepdims=True)
        innovation, corrected = self._through(plants)
        product = (left * right).sum(axis=1)
        return np.asarray(share * (left.swapaxes(1, 2) @ corrected)[:, 0] * (innovation @ right) / product)

    def law(self, gain: FloatArray, problem: Problem) -> StateFeedback:
        """Return the law that runs, of a gain L; a damper of the wall is taken out of it, and acts on its position.

        With a damper b_e, the force k_e y + b_e (y - y before)/T of the wall is to be that of the law, where y is the
        position of its face: one more state remembers y before.
        """
        state = self.state
        force = self.force
        feedback = self.feedback
        per_sample = problem.environment.damping_ns_per_m / problem.device.sample_time_s
        if per_sample > 0:
            total = self.stiffness_n_per_m + per_sample
            feedback = np.append(self.stiffness_n_per_m * feedback, per_sample) / total
            # One more state: the position before, on which the damper acts.
            state = np.concatenate([np.pad(state, ((0, 0), (0, 1))), feedback[None]])
            force = np.append(force, 0.0)
            gain = np.append(gain, 0.0)
        return _law(problem.device, (state, force, gain, feedback), self.positions, self.measures)


@dataclass(frozen=True, eq=False)
class _Model:
    """The observer's model, s+ = A s + B u in metres: rates times T, forces over K, the disturbance last."""

    state: FloatArray  # A, (n, n)
    push: FloatArray  # B of u = F/K
    names: tuple[str, ...]
    measured: int  # index of the measured position
    kicks: FloatArray  # response to a force of K times a metre on motor and handle for one sample, (2, n)

    @classmethod
    def of(cls, device: Device, hand: Hand, mode: Mode | None, stiffness_n_per_m: float) -> _Model:
        """Return the observer's model: sampled device with the assumed hand and mode, forces under way, and a push.

        States become lengths: velocities times T, forces over the wall's stiffness K.
        """
        t, k = device.sample_time_s, stiffness_n_per_m
        plant = device_plant(device, hand, mode=mode)
        linear = plant.linear()
        sampled = sampled_plant(device, hand, mode=mode)
        matrix, push = (part[0, 0] for part in sampled.with_forces_under_way())
        s, n = len(linear.names), len(push) + 1
        names = (*linear.names, *(f"force_under_way_{place + 1}_n" for place in range(n - 1 - s)), "push_n")
        state = np.zeros((n, n))
        state[:-1, :-1], state[-1, -1] = matrix, 1.0
        # A target displaced by 1/k_h exerts 1 N through the hand's spring.
        state[:s, -1] = transition(linear, t).target.reshape(s, 2)[:, 0] / hand.stiffness_n_per_m
        unit = np.array([_unit(name, t, k) for name in names])
        half = transition(linear, t / 2).matrix.reshape(s, s)
        kicks = np.zeros((2, n))
        for row, body in enumerate((DEVICE, plant.grip)):
            place = names.index(f"{body}_velocity_m_per_s")
            kicks[row, :s] = half[:, place] * t / float(plant.mass_kg(body)) * k
        asked = np.append(push, 0.0) * unit * k
        scaled = np.asarray(state * unit[:, None] / unit)
        return cls(scaled, asked, names, int(np.argmax(sampled.output_row)), kicks * unit)

    @cached_property
    def _seen(self) -> FloatArray:
        return np.asarray(np.eye(len(self.push))[self.measured])

    def feedback(self, position: float, velocity: float) -> FloatArray:
        """Return R of u = R s, u the force over K: the regulator towards the equilibrium of the estimated push.

        `position` and `velocity` are the weights of the device's in the cost next to that of u, which is 1. In the
        equilibrium u is the measured position that balances the push, so that a hand feels the wall's own stiffness.
        """
        a, b = self.state[:-1, :-1], self.push[:-1]
        # Equilibrium where u = the measured position balances the disturbance: the wall's own stiffness.
        rest = np.linalg.solve(np.eye(len(b)) - a - np.outer(b, self._seen[:-1]), self.state[:-1, -1])
        weight = np.full(len(b), _REGULARISATION)
        weight[:2] += position**2, velocity**2
        cost = _riccati(a, b, np.diag(weight))
        gain = -(b @ cost @ a) / (1 + b @ cost @ b)
        return np.append(gain, rest[self.measured] - gain @ rest)

    def kalman_gain(self, walk: float, forces: tuple[float, float]) -> FloatArray:
        """Return L: the stationary Kalman gain, with the encoder's noise as the unit of length.

        `walk` is the noise of the push in a sample, `forces` those of the forces on motor and handle.
        """
        noise = np.full(len(self.push), _REGULARISATION)
        noise[-1] += walk**2
        spread = np.diag(noise) + (self.kicks.T * np.square(forces)) @ self.kicks
        covariance = _riccati(self.state.T, self._seen, spread)[:, self.measured]
        return np.asarray(covariance / (1 + covariance[self.measured]))


def _riccati(a: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """Solve P = A'PA - A'Pb b'PA / (1 + b'Pb) + Q."""
    from scipy.linalg import solve_discrete_are  # noqa: PLC0415

    try:
        return np.asarray(solve_discrete_are(a, b[:, None], weight, np.ones((1, 1))))
    except ValueError as none:
        raise np.linalg.LinAlgError(str(none)) from none


def _unit(name: str, sample_time_s: float, stiffness_n_per_m: float) -> float:
    """Return the factor that turns a state into a length."""
    unit = sample_time_s if name.endswith("_per_s") else 1.0
    return unit / stiffness_n_per_m if "_n" in name else unit
