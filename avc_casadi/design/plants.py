"""Sampled plants in the loop of a law: every device and hand along one axis, with the forces that are under way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.model.plant import SampledPlant


@dataclass(frozen=True, eq=False)
class PlantMatrices:
    """Plants x+ = A x + B F, measured position C x, for p pairs of device and hand with s states each."""

    state: FloatArray  # A, (p, s, s)
    force: FloatArray  # B, (p, s), of a force F in N that pushes the device out of the wall, towards -x
    measured: FloatArray  # C, (s,), m

    @classmethod
    def of(cls, plant: SampledPlant) -> PlantMatrices:
        """Return the plants of all devices and hands of a sampled plant."""
        state, force = plant.with_forces_under_way()
        size = force.shape[-1]
        measured = np.pad(plant.output_row, (0, size - len(plant.output_row)))
        return cls(state.reshape(-1, size, size), force.reshape(-1, size), measured)

    @classmethod
    def held_and_released(cls, plant: SampledPlant) -> tuple[PlantMatrices, PlantMatrices]:
        """Return the plants of all devices with a hand, and those released, where the last hand is the released one."""
        devices, hands = plant.new.shape[:2]
        released = (np.arange(devices * hands) + 1) % hands == 0
        plants = cls.of(plant)
        return plants.pick(np.flatnonzero(~released)), plants.pick(np.flatnonzero(released))

    def __len__(self) -> int:
        return len(self.state)

    def joined_with(self, other: PlantMatrices) -> PlantMatrices:
        """Return these plants, then those of another with the same states."""
        state = np.concatenate([self.state, other.state])
        return PlantMatrices(state, np.concatenate([self.force, other.force]), self.measured)

    def pick(self, rows: NDArray[np.intp]) -> PlantMatrices:
        """Return the plants at some indices, repeated ones too."""
        return PlantMatrices(self.state[rows], self.force[rows], self.measured)

    def position_per_force(self, z: ComplexArray) -> ComplexArray:
        """Return P(z) = -C (z - A)^-1 B in m/N, shape (p, len(z)).

        A law F = K(z) x around the plant has the return difference Rd = 1 + P K.
        """
        pencils = z[:, None, None] * np.eye(len(self.measured)) - self.state[:, None]
        pushes = np.broadcast_to(-self.force[:, None, :, None], (*pencils.shape[:3], 1))
        return np.asarray(np.linalg.solve(pencils, pushes)[..., 0] @ self.measured)
