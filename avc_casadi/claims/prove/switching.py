"""The loop from sample to sample as an affine map that switches with contact: clipped last, or gated.

The state is position and velocity of the device, delayed forces, and the law's own states. In each piece the next state
is an affine function of this one; a scalar of the loop is kept as its row over (state, 1), so that the map and its
Jacobian coincide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.stability.declared_device import plants_with_forces
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_casadi.claims.prove.law import ContactLaw
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Contact


@dataclass(frozen=True)
class SwitchingLoop:
    """The loop with h hands, each with its own constant target.

    Attributes:
        law: the law.
        contact: the contact law.
        matrix: of the plants with their delayed forces, shape (h, s, s); velocities times T.
        push: of the force, shape (h, s).
        measured: row of the position, shape (s,).
        target_m: of each hand, shape (h,), m; the wall begins at 0.
        names: of all states.
    """

    law: ContactLaw
    contact: Contact
    matrix: FloatArray
    push: FloatArray
    measured: FloatArray
    target_m: FloatArray
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, law: ContactLaw, contact: Contact, device: Device, hands: Hand | StylusHand, target_m: FloatArray
    ) -> SwitchingLoop:
        """Return the loop of a device, known exactly, with hands."""
        plant = sampled_plant(device, hands)
        matrix, push, measured = plants_with_forces(plant)
        under_way = [f"force_{place + 1}_samples_ago_n" for place in range(len(measured) - len(plant.names))]
        names = [name.replace("_m_per_s", "_m_per_sample") for name in plant.names]
        return cls(law, contact, matrix, push, measured, target_m, (*names, *under_way, *_law_names(law, contact)))

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.names)

    def contact_radius(self) -> FloatArray:
        """Return the spectral radius of the loop in permanent contact, shape (h,)."""
        n = self.states
        rows, _, _ = self.piece(np.zeros((len(self.target_m), n)), always=True)
        return np.asarray(np.abs(np.linalg.eigvals(rows[:, :, :n])).max(axis=-1))

    def piece(self, state: FloatArray, *, always: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the affine map of the piece of each state.

        Args:
            state: shape (h, n).
            always: take the piece in contact, whatever the state.

        Returns:
            The map, (h, n, n + 1); the row of the force, (h, n + 1); the values whose signs chose the piece, (h, c).
        """
        h, n = state.shape
        s = len(self.measured)
        rows = np.zeros((h, n, n + 1))
        position = np.zeros((h, n + 1))
        position[:, :s], position[:, n] = self.measured, self.target_m
        known = np.append(state, np.ones((h, 1)), axis=1)

        def own(place: int) -> FloatArray:
            row = np.zeros((h, n + 1))
            row[:, s + place] = 1.0
            return row

        def value(row: FloatArray) -> FloatArray:
            return np.ones(h) if always else np.asarray(np.einsum("hn,hn->h", row, known))

        force, remembered, signs = self._law(position, own, value)
        rows[:, :s, :s] = self.matrix
        rows[:, :s] += self.push[:, :, None] * force[:, None, :]
        for place, row in enumerate(remembered):
            rows[:, s + place] = row
        return rows, force, np.stack(signs, axis=1)

    def _law(
        self, x: FloatArray, own: Callable[[int], FloatArray], value: Callable[[FloatArray], FloatArray]
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Return the row of the force, those of the law's next states, and the values that chose the piece."""
        law, t = self.law, self.law.sample_time_s
        observer = law.state_feedback
        first = 0 if observer is None else observer.states
        believed = np.zeros(0)
        if observer is not None:
            predicted = np.stack([own(place) for place in range(first)], axis=1)
            seen = x.copy()
            seen[:, -1] += observer.face_m
            off = seen - predicted[:, observer.measures]
            believed = predicted + np.array(observer.innovation)[:, None] * off[:, None, :]
            x = np.array(observer.feedback) @ believed
        before, stretch = own(first), own(first + 1)
        numbers = _Numbers.of(law)
        damper = law.contact_damping_ns_per_m / t * (x - before)
        signs: list[FloatArray] = []

        def positive(row: FloatArray) -> FloatArray:
            there = value(row)
            signs.append(there)
            return np.asarray(row * (there > 0)[:, None])

        free = x - numbers.memory * stretch
        if self.contact == "clip-last":
            force = numbers.series * (free - numbers.wall_memory * (before - stretch))
            kept = [x, numbers.memory * stretch + numbers.compliance * force]
            total = positive(force + damper)
        else:
            depth = own(first + 2)
            force = positive(numbers.series * (free - numbers.wall_memory * depth))
            tool = free - numbers.compliance * force
            kept = [x, x - tool, positive(tool)]
            there = value(x)
            signs.append(there)
            total = positive(force + damper) * (there > 0)[:, None]
        if observer is not None:
            told = np.array(observer.state) @ believed
            told += np.array(observer.force_m_per_n)[:, None] * total[:, None, :]
            kept = [*(told[:, place] for place in range(first)), *kept]
        return total, kept, signs


@dataclass(frozen=True)
class _Numbers:
    """Coupling and wall over one sample: a, 1/kappa, S and d of `ContactLaw`."""

    memory: float
    compliance: float
    series: float
    wall_memory: float

    @classmethod
    def of(cls, law: ContactLaw) -> _Numbers:
        t = law.sample_time_s
        wall = law.wall_stiffness_n_per_m + law.wall_damping_ns_per_m / t
        wall_memory = law.wall_damping_ns_per_m / (wall * t) if wall else 0.0
        if law.rigid:
            return cls(0.0, 0.0, wall, wall_memory)
        kappa = law.stiffness_n_per_m + law.damping_ns_per_m / t
        if kappa == 0:
            return cls(0.0, 0.0, 0.0, wall_memory)
        return cls(law.damping_ns_per_m / (kappa * t), 1 / kappa, kappa * (wall / (kappa + wall)), wall_memory)


def _law_names(law: ContactLaw, contact: Contact) -> list[str]:
    observer = law.state_feedback
    names = [] if observer is None else [f"predicted_{place + 1}_m" for place in range(observer.states)]
    names += ["position_before_m", "deflection_m"]
    return [*names, "depth_before_m"] if contact == "gated" else names
