"""The continuous part of the loop: masses on one axis joined by springs and dampers, moved by the hand's target."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi.problem import CURRENT_LOOP_DAMPING_RATIO
from avc_casadi.support import FloatArray

DEVICE = "device"
TARGET = "target"
GROUND = "ground"
HANDLE = "handle"


class Mechanics(Protocol):
    """What holds or joins the device mechanically, such as a hand."""

    def mechanics(self, plant: Plant) -> None:
        """Add masses, springs and dampers."""


@dataclass(frozen=True)
class LinearPlant:
    """x' = A x + b_F F + b_x x_h + b_v v_h + b_f f: rates of the state; leading axes run over hands.

    Attributes:
        names: state names with units; position and velocity of the device come first.
        matrix: A, shape (..., n, n), 1/s.
        force: b_F, shape (..., n): F is the force of the actuator, positive against +x.
        target: b_x and b_v, shape (..., n, 2): position x_h (m) and velocity v_h (m/s) of the hand's target.
        friction: b_f, shape (..., n): f is the dry friction, positive against +x.
    """

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
    """Collects what the effects add to the mechanics; masses, springs and dampers may be arrays over hands.

    Attributes:
        grip: the body that the hand holds.
        actuator_rate_per_s: bandwidth of the actuator, rad/s, or None for an ideal one.
        actuator_order: 1, a lag; 2, a current loop.
        actuator_damping_ratio: of a current loop.
    """

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
        """Return the mass of a body so far."""
        return self._masses[body]

    def join(self, one: str, other: str, stiffness_n_per_m: ArrayLike, damping_ns_per_m: ArrayLike) -> None:
        """Put a spring and a damper side by side between two bodies, or a body and the target or the ground."""
        k, b = (np.asarray(value, dtype=np.float64) for value in (stiffness_n_per_m, damping_ns_per_m))
        self._links.append((one, other, k, b))

    def split(self, frequency_hz: float | FloatArray, damping_ratio: float | FloatArray, mass_ratio: float) -> None:
        """Move a share of the device's mass to a handle on a spring, which is what a hand then holds.

        Args:
            frequency_hz: frequency of motor and handle against each other, the device free.
            damping_ratio: damping of that mode, as a share of the critical.
            mass_ratio: share of the device's mass on the side of the hand.
        """
        handle = self.mass_kg(DEVICE) * mass_ratio
        self.add_mass(DEVICE, -handle)
        self.add_mass(HANDLE, handle)
        reduced = handle * (1 - mass_ratio)
        omega = 2 * math.pi * frequency_hz
        self.join(DEVICE, HANDLE, reduced * omega**2, 2 * damping_ratio * omega * reduced)
        self.grip = HANDLE

    def linear(self) -> LinearPlant:
        """Assemble the equations of motion."""
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
        at = {body: 2 * index for index, body in enumerate(bodies)}
        for body in bodies:
            matrix[..., at[body], at[body] + 1] = 1.0
        for one, other, k, b in self._links:
            for body, far in ((one, other), (other, one)):
                if body not in at:
                    continue
                k_per_kg, b_per_kg = k / self._masses[body], b / self._masses[body]
                row = at[body] + 1
                matrix[..., row, at[body]] -= k_per_kg
                matrix[..., row, row] -= b_per_kg
                if far in at:
                    matrix[..., row, at[far]] += k_per_kg
                    matrix[..., row, at[far] + 1] += b_per_kg
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
