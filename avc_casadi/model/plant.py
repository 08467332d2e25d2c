"""The plant: masses on one axis joined by springs and dampers; and the declared device in discrete time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO, Device

DEVICE = "device"
TARGET = "target"
GROUND = "ground"
HANDLE = "handle"


class Mechanics(Protocol):
    """Mechanical element attached to the device, such as a hand."""

    def mechanics(self, plant: Plant) -> None:
        """Add masses, springs and dampers."""


@dataclass(frozen=True)
class LinearPlant:
    """x' = A x + b_F F + b_x x_h + b_v v_h + b_f f: rates of the state; leading axes run over hands."""

    names: tuple[str, ...]
    matrix: FloatArray
    force: FloatArray
    target: FloatArray
    friction: FloatArray

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.names)


@dataclass
class Plant:
    """Assembly of the mechanics of all effects; masses, springs and dampers may be arrays over hands."""

    grip: str = DEVICE
    actuator_rate_per_s: float | None = None
    actuator_order: int = 1
    actuator_damping_ratio: float = CURRENT_LOOP_DAMPING_RATIO
    _masses: dict[str, FloatArray] = field(default_factory=dict)
    _links: list[tuple[str, str, FloatArray, FloatArray]] = field(default_factory=list)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies in the order of the state."""
        return tuple(self._masses)

    def add_mass(self, body: str, mass_kg: ArrayLike) -> None:
        """Add mass to a body; a new name makes a new body."""
        self._masses[body] = self._masses.get(body, np.zeros(())) + np.asarray(mass_kg, dtype=np.float64)

    def mass_kg(self, body: str) -> FloatArray:
        """Return the present mass of a body."""
        return self._masses[body]

    def join(self, body: str, neighbour: str, stiffness_n_per_m: ArrayLike, damping_ns_per_m: ArrayLike) -> None:
        """Put a spring and a damper side by side between two bodies, or a body and the target or the ground."""
        k, b = (np.asarray(value, dtype=np.float64) for value in (stiffness_n_per_m, damping_ns_per_m))
        self._links.append((body, neighbour, k, b))

    def split(
        self,
        frequency_hz: float | FloatArray,
        damping_ratio: float | FloatArray,
        mass_ratio: float,
        beyond: str = HANDLE,
    ) -> None:
        """Move a share of the device's mass to a handle, or another body, on a spring and damper; a hand holds that.

        k = m_r omega^2, b = 2 zeta omega m_r, m_r the reduced mass of both, so that the mode has this frequency, Hz,
        and damping ratio.
        """
        handle = self.mass_kg(DEVICE) * mass_ratio
        self.add_mass(DEVICE, -handle)
        self.add_mass(beyond, handle)
        reduced = handle * (1 - mass_ratio)
        omega = 2 * math.pi * frequency_hz
        self.join(DEVICE, beyond, reduced * omega**2, 2 * damping_ratio * omega * reduced)
        self.grip = beyond

    def linear(self) -> LinearPlant:
        """Return the equations of motion x' = A x + F f + friction + the hand's target, of positions and velocities.

        Shapes begin with those of the hands.
        """
        bodies = self.bodies
        shape = np.broadcast_shapes(
            *(mass.shape for mass in self._masses.values()), *(k.shape for _, _, k, _ in self._links)
        )
        names = [name for body in bodies for name in (f"{body}_position_m", f"{body}_velocity_m_per_s")]
        if self.actuator_rate_per_s is not None:
            names += ["actuator_force_n", "actuator_rate_n_per_s"][: self.actuator_order]
        n = len(names)
        matrix, target = np.zeros((*shape, n, n)), np.zeros((*shape, n, 2))
        force, friction = np.zeros((*shape, n)), np.zeros((*shape, n))
        first_row = {body: 2 * index for index, body in enumerate(bodies)}
        for body in bodies:
            matrix[..., first_row[body], first_row[body] + 1] = 1.0
        for first, second, k, b in self._links:
            for body, far in ((first, second), (second, first)):
                if body not in first_row:
                    continue
                k_per_kg, b_per_kg = k / self._masses[body], b / self._masses[body]
                row = first_row[body] + 1
                matrix[..., row, first_row[body]] -= k_per_kg
                matrix[..., row, row] -= b_per_kg
                if far in first_row:
                    matrix[..., row, first_row[far]] += k_per_kg
                    matrix[..., row, first_row[far] + 1] += b_per_kg
                elif far == TARGET:
                    target[..., row, 0] += k_per_kg
                    target[..., row, 1] += b_per_kg
        push = -1.0 / self._masses[DEVICE]
        friction[..., 1] = push
        if self.actuator_rate_per_s is None:
            force[..., 1] = push
        elif self.actuator_order == 1:
            matrix[..., 1, n - 1] = push
            matrix[..., n - 1, n - 1] = -self.actuator_rate_per_s
            force[..., n - 1] = self.actuator_rate_per_s
        else:
            matrix[..., 1, n - 2] = push
            matrix[..., n - 2, n - 1] = 1.0
            matrix[..., n - 1, n - 2] = -(self.actuator_rate_per_s**2)
            matrix[..., n - 1, n - 1] = -2 * self.actuator_damping_ratio * self.actuator_rate_per_s
            force[..., n - 1] = self.actuator_rate_per_s**2
        return LinearPlant(tuple(names), matrix, force, target, friction)


def expm(matrix: FloatArray) -> FloatArray:
    """Return exp(matrix) over the last two axes by scaling, Taylor's series and squaring."""
    norm = float(np.abs(matrix).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(2 * norm)))) if norm > 0 else 0
    scaled = matrix / 2.0**squarings
    identity = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape)
    result = identity
    # With a norm of 1/2, the first term left out is 2^-19/19! = 1.6e-23 of the whole.
    for term in range(18, 0, -1):
        result = identity + scaled @ result / term
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(squarings):
            result = result @ result
    return result


@dataclass(frozen=True)
class Transition:
    """One step of length h: x(h) = Phi x(0) + gamma_F F + gamma_x x_h + gamma_v v_h."""

    matrix: FloatArray
    force: FloatArray
    target: FloatArray


def time_scale(plant: LinearPlant, step_s: float | FloatArray) -> FloatArray:
    """Return the diagonal scaling of rates by the step, velocities in metres per step, which balances A."""
    return np.where([name.endswith("_per_s") for name in plant.names], step_s, 1.0)


def transition(plant: LinearPlant, step_s: float) -> Transition:
    """Discretise the plant exactly for a held force and a target at constant velocity."""
    return transitions([(plant, step_s)])[0]


def transitions(cases: Sequence[tuple[LinearPlant, float]]) -> list[Transition]:
    """Return exact transitions of many plants of one shape, each over its step, s, force and target's speed held.

    They are blocks of exp of the augmented matrix, scaled so that no column dominates.
    """
    plants, steps_s = [plant for plant, _ in cases], np.array([step_s for _, step_s in cases])
    n = plants[0].states
    matrix, force, target = (
        np.stack([getattr(plant, name) for plant in plants]) for name in ("matrix", "force", "target")
    )
    step = steps_s.reshape(-1, *(1,) * (matrix.ndim - 3))
    augmented = np.zeros((*matrix.shape[:-2], n + 3, n + 3))
    augmented[..., :n, :n] = matrix * step[..., None, None]
    augmented[..., :n, n] = force * step[..., None]
    augmented[..., :n, n + 1 :] = target * step[..., None, None]
    augmented[..., n + 1, n + 2] = step
    scales = np.ones((len(plants), n + 3))
    scales[:, :n] = time_scale(plants[0], steps_s[:, None])
    # The unit of force is chosen so that its column does not dominate the norm.
    scales[:, n] = np.maximum(1.0, np.abs(force).reshape(len(plants), -1).max(axis=1) * steps_s**2)
    scales[:, n + 2] = steps_s
    scale = scales.reshape(len(cases), *(1,) * (augmented.ndim - 3), -1)
    wholes = expm(augmented * scale[..., None] / scale[..., None, :]) / scale[..., None] * scale[..., None, :]
    return [Transition(whole[..., :n, :n], whole[..., :n, n], whole[..., :n, n + 1 :]) for whole in wholes]


@dataclass(frozen=True)
class Mode:
    """A resonance between motor and handle; its values may be arrays over hands."""

    frequency_hz: float | FloatArray
    damping_ratio: float | FloatArray
    mass_ratio: float


def device_plant(
    device: Device, hand: Mechanics | None = None, mode: Mode | None = None, beyond: str = HANDLE
) -> Plant:
    """Return motor, handle and amplifier of a device, and the hand that holds it, as a continuous plant.

    `beyond` names the body beyond a resonance.
    """
    plant = Plant()
    plant.add_mass(DEVICE, device.mass_kg)
    plant.join(DEVICE, GROUND, 0.0, device.damping_ns_per_m)
    split = device.resonance if mode is None else mode
    if split is not None:
        plant.split(split.frequency_hz, split.damping_ratio, split.mass_ratio, beyond)
    if hand is not None:
        hand.mechanics(plant)
    if device.amplifier_bandwidth_hz is not None:
        plant.actuator_rate_per_s = 2 * math.pi * device.amplifier_bandwidth_hz
        plant.actuator_order = device.amplifier_order
        plant.actuator_damping_ratio = device.amplifier_damping_ratio
    return plant


@dataclass(frozen=True)
class SampledPlant:
    """x(k+1) = A x(k) + B_new u(k-n) + B_old u(k-n-1): u is the commanded force, positive against +x."""

    names: tuple[str, ...]
    matrix: FloatArray
    new: FloatArray
    old: FloatArray
    whole_delay: IndexArray
    output_row: FloatArray
    held: FloatArray
    sample_time_s: float
    force_row: FloatArray | None = None
    """What a force sensor reads, (devices, hands, n); None without one."""

    def of_device(self, index: int) -> SampledPlant:
        """Return the plants of one of the devices."""
        chosen = slice(index, index + 1)
        return replace(
            self,
            matrix=self.matrix[chosen],
            new=self.new[chosen],
            old=self.old[chosen],
            whole_delay=self.whole_delay[chosen],
            force_row=None if self.force_row is None else self.force_row[chosen],
        )

    @property
    def forces_under_way(self) -> int:
        """Number d of pending forces of the device with the longest delay."""
        fractional = np.any(self.old != 0, axis=(1, 2))
        return int(np.max(self.whole_delay + fractional))

    def with_forces_under_way(self) -> tuple[FloatArray, FloatArray]:
        """Return A and B of the state [x, u(k-1), ..., u(k-d)] and the force u(k)."""
        devices, hands, s = self.new.shape
        d = self.forces_under_way
        whole = np.zeros((devices, hands, s + d, s + d + 1))
        whole[..., :s, :s] = self.matrix
        for device, n in enumerate(self.whole_delay):
            # Columns of u(k), u(k-1), ..., u(k-d).
            columns = [s + d, *range(s, s + d)]
            whole[device, :, :s, columns[n]] = self.new[device]
            if n < d:
                whole[device, :, :s, columns[n + 1]] = self.old[device]
        if d:
            whole[..., s, s + d] = 1.0
            whole[..., np.arange(s + 1, s + d), np.arange(s, s + d - 1)] = 1.0
        return whole[..., : s + d], whole[..., s + d]


def sampled_plant(
    devices: Device | Sequence[Device],
    hand: Mechanics | Sequence[Mechanics] | None = None,
    mode: Mode | None = None,
) -> SampledPlant:
    """Return devices with a hand as exact transitions from sample to sample, the force held and delayed.

    Leading axes are (devices, hands); `mode` replaces the declared resonance.
    """
    listed = devices if isinstance(devices, Sequence) else (devices,)
    first = listed[0]
    hands = hand if isinstance(hand, Sequence) else [hand] * len(listed)
    plants = [device_plant(device, held, mode) for device, held in zip(listed, hands, strict=True)]
    grip = plants[0].grip
    linear = [plant.linear() for plant in plants]
    names = linear[0].names
    matrix, new, old = discretised(linear, listed)
    sensed = HANDLE if first.encoder_at == "handle" and first.resonance is not None else DEVICE
    return SampledPlant(
        names=names,
        matrix=matrix,
        new=new,
        old=old,
        whole_delay=np.array([int(device.delay_samples) for device in listed]),
        output_row=_row(names, sensed),
        held=_row(names, grip),
        sample_time_s=first.sample_time_s,
    )


class Timed(Protocol):
    """A device that is commanded in samples, with a delay."""

    @property
    def sample_time_s(self) -> float:
        """The sample time."""

    @property
    def delay_samples(self) -> float:
        """Samples from a command to when it acts."""


def discretised(plants: Sequence[LinearPlant], devices: Sequence[Timed]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B_new and B_old of plants of one shape, each with the timing of its device, (devices, hands, ...)."""
    steps_s = [_steps_s(device) for device in devices]
    moves = transitions([(plant, step) for plant, steps in zip(plants, steps_s, strict=True) for step in steps])
    places = np.cumsum([0, *map(len, steps_s)])
    parts = [_sampled(moves[begin:end]) for begin, end in itertools.pairwise(places)]
    matrix, new, old = (np.stack(part) for part in zip(*parts, strict=True))
    return matrix, new, old


def _steps_s(device: Timed) -> tuple[float, ...]:
    """Return the sample, and where the delay is not whole, the parts before and after a new force arrives."""
    period, late = device.sample_time_s, device.delay_samples - int(device.delay_samples)
    return (period, late * period, (1 - late) * period) if late else (period,)


def _sampled(moves: Sequence[Transition]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B_new, B_old of one device with all hands, from its transitions over `_steps_s`."""
    whole, n = moves[0], moves[0].force.shape[-1]
    new, old = whole.force, np.zeros_like(whole.force)
    if len(moves) > 1:
        _, before, after = moves
        new, old = after.force, (after.matrix @ before.force[..., None])[..., 0]
    return whole.matrix.reshape(-1, n, n), new.reshape(-1, n), old.reshape(-1, n)


def _row(names: tuple[str, ...], body: str) -> FloatArray:
    return np.array([float(name == f"{body}_position_m") for name in names])
