"""What a law must meet, and what is minimised: each condition with its value and derivatives by the gain L.

A condition is a set of values v(L), met where none is above 0. `linearised` gives those that a step may bring to 0,
with their derivatives, which are exact. The symbols are those of `law_family`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.design.law_family import (
    LEAST_CLIP_PHASE_COSINE,
    SECTOR_GAINS,
    LawLoops,
    SectorGain,
    required_decay_per_s,
)
from avc_casadi.design.plants import PlantMatrices
from avc_casadi.loops.spectrum import eigenvalues


@dataclass(frozen=True, eq=False)
class Linearised:
    """Values near L: v(L + d) is about `values` + `rows` @ d."""

    values: FloatArray  # (m,)
    rows: FloatArray  # (m, n)


class Condition(ABC):
    """Values that must not be above 0."""

    weight: ClassVar[float]
    """Price of the largest value above 0, in units of the impedance error: an exact penalty."""
    tolerance: ClassVar[float]
    """Value up to which the condition counts as met."""

    @abstractmethod
    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""

    @abstractmethod
    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return the values that a step of a relative change of Phi of `reach` may bring to 0."""


@dataclass(frozen=True)
class DiskMargin(Condition):
    """v = ln(goal |2 (1 + Y L) - Phi|/(2 |Phi|)): the disk margin at the actuator is at least the goal."""

    goal: float
    weight = 3.0
    tolerance = 0.015
    near = 0.35  # values this far below 0 may rise to it without a step in their direction

    def _values(self, loops: LawLoops) -> FloatArray:
        return np.asarray(np.log(np.abs(loops.margin_numerator / loops.phi_dense) * self.goal / 2))

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return float(self._values(loops).max())

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = ln(goal |N|/(2 |Phi|)), N = 2 (1 + Y L) - Phi, where a step may raise it to 0, and dv/dL.

        Y L is the observer's predicted position over its innovation, and Phi is 1 + Y L times the return difference of
        the loop at the actuator. As d ln|a| = Re(da/a), dv = Re(dN/N - dPhi/Phi).
        """
        values, rows = self._values(loops), loops.family.dense
        chosen = values > -self.near - 0.5 * reach
        of_plant, of_frequency = np.nonzero(chosen)
        phi_rows = rows.phi[of_plant, of_frequency]
        numerator_rows = 2 * rows.y[of_frequency] - phi_rows
        slopes = numerator_rows / loops.margin_numerator[chosen][:, None] - phi_rows / loops.phi_dense[chosen][:, None]
        return Linearised(values[chosen], slopes.real)


@dataclass(frozen=True)
class EncoderNoise(Condition):
    """v = ln(|X L|/(goal |Phi|)): the force over a sine of encoder noise is at most the goal, N/m."""

    goal_n_per_m: float
    weight = 1.0
    tolerance = 0.02
    near = 0.5

    def _values(self, loops: LawLoops) -> FloatArray:
        gain_n_per_m = np.abs(loops.force_per_innovation / loops.phi_dense)
        return np.asarray(np.log(np.maximum(gain_n_per_m, 1e-12 * self.goal_n_per_m) / self.goal_n_per_m))

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return float(self._values(loops).max())

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = ln(|X L|/(goal |Phi|)), where a step may raise it to 0, with its slopes by the gain L.

        X L/Phi is the commanded force over a sine of encoder noise, N/m: X L the force over the innovation, Phi the
        loop from noise to innovation. As d ln|a| = Re(da/a), dv = Re(d(X L)/(X L) - dPhi/Phi).
        """
        values, rows = self._values(loops), loops.family.dense
        chosen = values > -self.near - reach
        of_plant, of_frequency = np.nonzero(chosen)
        of_force = rows.x[of_frequency] / loops.force_per_innovation[of_frequency][:, None]
        slopes = of_force - rows.phi[of_plant, of_frequency] / loops.phi_dense[chosen][:, None]
        return Linearised(values[chosen], slopes.real)


@dataclass(frozen=True)
class Decay(Condition):
    """v = 1 - decay over the required one, for every pole at every sector gain."""

    weight = 0.6
    tolerance = 0.03
    near = 0.6  # poles that decay this much faster than required are left out
    least_modulus = 0.5  # faster poles end within some samples whatever is required

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return 1 - min(float(ratios.min()) for ratios in loops.decay_ratios)

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v at the poles near their required decay, of conjugate pairs one."""
        del reach  # poles move by their own derivatives, not by the change of Phi
        parts = [self._at_sector(loops, row) for row in range(len(SECTOR_GAINS))]
        return Linearised(
            np.concatenate([part.values for part in parts]), np.concatenate([part.rows for part in parts])
        )

    def _at_sector(self, loops: LawLoops, row: int) -> Linearised:
        """Return v = 1 - decay/required with its slopes by L, at the poles where a share of the innovation is passed.

        `row` is the place of the share in `SECTOR_GAINS`. Of conjugate pairs one pole counts. Poles that decay 1.6
        times as fast as required, and those within 0.5 of the origin, which end within some samples, are left out.
        """
        sector = SECTOR_GAINS[row]
        poles = loops.poles[row]
        ratios = loops.decay_ratios[row]
        chosen = (ratios < 1 + self.near) & (poles.imag >= 0) & (np.abs(poles) > self.least_modulus)
        if not chosen.any():
            return Linearised(np.zeros(0), np.zeros((0, len(loops.gain))))
        plants = loops.plants_at(sector).pick(np.nonzero(chosen)[0])
        slopes = loops.family.structure.slopes(plants, loops.gain, sector.share, poles[chosen])
        return Linearised(1 - ratios[chosen], -self._slopes_of_ratios(loops, sector, slopes, poles[chosen]))

    @staticmethod
    def _slopes_of_ratios(
        loops: LawLoops, sector: SectorGain, pole_slopes: ComplexArray, poles: ComplexArray
    ) -> FloatArray:
        """Return d(decay/required) by the gain L, shape (poles, n), from the slopes dz of the poles.

        Of a pole z = exp((-decay + i omega) T), d ln z/T = dz/(z T) is -d decay + i d omega, both 1/s. The required
        decay changes with the frequency omega/(2 pi); its slope is a difference over 0.001 Hz.
        """
        device = loops.family.problem.device
        hz, step_hz = np.angle(poles) / (2 * np.pi * device.sample_time_s), 1e-3
        decay_per_s = -np.log(np.abs(poles)) / device.sample_time_s
        required_per_s = required_decay_per_s(device, hz, sector)
        required_slope = (required_decay_per_s(device, hz + step_hz, sector) - required_per_s) / step_hz
        moves = pole_slopes / poles[:, None] / device.sample_time_s
        of_required = (decay_per_s / required_per_s * required_slope)[:, None] * moves.imag / (2 * np.pi)
        return np.asarray((-moves.real - of_required) / required_per_s[:, None])


@dataclass(frozen=True, eq=False)
class PerturbedDecay(Condition):
    """v = (required - decay)/scale for every pole with perturbed plants: they are to be stable, no more.

    The optimisation adds the plants at which a law is unstable, a few at a time
    (`program.Program.stable_when_perturbed`).
    """

    plants: PlantMatrices
    required_per_s = 0.5  # slower decay than any that a hand notices
    scale_per_s = 20.0  # a loop that grows by 20/s misses 1
    weight = 0.6
    tolerance = 0.02  # leaves a decay of 0.1/s
    near = 1.0  # poles that decay this much faster than required are left out

    def _poles(self, loops: LawLoops) -> ComplexArray:
        return eigenvalues(loops.family.structure.loops(self.plants, loops.gain))

    def _values(self, loops: LawLoops, poles: ComplexArray) -> FloatArray:
        decay_per_s = -np.log(np.maximum(np.abs(poles), 1e-9)) / loops.family.problem.device.sample_time_s
        return np.asarray((self.required_per_s - decay_per_s) / self.scale_per_s)

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return float(self._values(loops, self._poles(loops)).max())

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = (required - decay)/scale at the poles near the required decay, with its slopes by the gain L.

        decay = -ln|z|/T of a pole z, 1/s, so that d decay = -Re(dz/z)/T. Of conjugate pairs one pole counts.
        """
        del reach  # poles move by their own derivatives, not by the change of Phi
        structure, poles = loops.family.structure, self._poles(loops)
        values = self._values(loops, poles)
        chosen = (values > -self.near) & (poles.imag >= 0)
        plants = self.plants.pick(np.nonzero(chosen)[0])
        moves = structure.slopes(plants, loops.gain, 1.0, poles[chosen]) / poles[chosen][:, None]
        return Linearised(values[chosen], moves.real / loops.family.problem.device.sample_time_s / self.scale_per_s)


@dataclass(frozen=True)
class DistanceFromZero(Condition):
    """v = 1 - |1 + g (Phi - 1)|/required with every hand: the loop of quantiser and dead zone stays off 0."""

    factor: float = 1.0  # on the required distance of `SectorGain`
    weight = 1.0
    tolerance = 0.05

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return max(
            1 - float(distances.min()) / (self.factor * sector.distance)
            for sector, distances in zip(SECTOR_GAINS, loops.distances, strict=True)
            if sector.distance > 0
        )

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = 1 - |a|/required, a = 1 + g (Phi - 1), where a step may raise it to 0, and dv/dL.

        g is the share of the innovation that quantiser and dead zone pass, and Phi the loop with the whole innovation
        and a hand. As d|a| = Re(conj(a) da)/|a|, dv = -g Re(conj(a) dPhi)/(|a| required).
        """
        values, rows = [], []
        held = loops.phi_coarse[: len(loops.family.held)]
        held_rows = loops.family.coarse.phi[: len(loops.family.held)]
        for sector, distances in zip(SECTOR_GAINS, loops.distances, strict=True):
            required = self.factor * sector.distance
            if required == 0:
                continue
            chosen = distances < 1.8 * required + 0.2 * reach
            phi = 1 + sector.share * (held[chosen] - 1)
            values.append(1 - distances[chosen] / required)
            unit = (np.conj(phi) / np.abs(phi))[:, None]
            rows.append(-(unit * sector.share * held_rows[chosen]).real / required)
        return Linearised(np.concatenate(values), np.concatenate(rows))


@dataclass(frozen=True)
class ObserverPoles(Condition):
    """v = 100 (|pole| - 0.999) of the observer alone, A - A L C, whose error decays by 0.1 % a sample at least."""

    largest: float = 0.999
    weight = 1.0
    tolerance = 0.1
    scale = 100.0
    near = 0.03  # poles this far inside the largest one are left out

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return self.scale * (loops.family.structure.observer_radius(loops.gain) - self.largest)

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = 100 (|pole| - largest) of the observer alone near the largest allowed pole, with its slopes by L.

        The observer's error decays by M = A - A L C. With eigenvectors w and v of a pole, w'v = 1, d pole = w' dM v and
        d|pole| = Re(conj(pole) d pole)/|pole|. Of conjugate pairs one pole counts.
        """
        del reach
        structure = loops.family.structure
        model = structure.model
        poles, vectors = np.linalg.eig(structure.observer(loops.gain))
        left = np.linalg.inv(vectors)
        chosen = np.flatnonzero((np.abs(poles) > self.largest - self.near) & (poles.imag >= 0))
        rows = np.zeros((len(chosen), len(loops.gain)))
        units = (np.conj(poles[chosen]) / np.abs(poles[chosen]))[:, None]
        moves = -(left[chosen] @ model) * vectors[structure.measures, chosen][:, None]
        rows[:, : len(model)] = self.scale * (units * moves).real
        return Linearised(self.scale * (np.abs(poles[chosen]) - self.largest), rows)


# A little more than `LEAST_CLIP_PHASE_COSINE`, so that a law at its tolerance is still stable.
_REQUIRED_COSINE = 0.06


@dataclass(frozen=True)
class ClipPhase(Condition):
    """v = |phase of 1 - G| - largest, rad, G the loop of a clipped force: every lower gain of the force is stable."""

    largest_rad: float = 2 * math.acos(_REQUIRED_COSINE)
    weight = 1.0
    tolerance = 2 * (math.acos(LEAST_CLIP_PHASE_COSINE) - math.acos(_REQUIRED_COSINE))
    near = 0.3

    def worst(self, loops: LawLoops) -> float:
        """Return the largest value."""
        return float(np.abs(loops.clip_phases).max()) - self.largest_rad

    def linearised(self, loops: LawLoops, reach: float) -> Linearised:
        """Return v = |phase of 1 - G| - largest, rad, where a step may raise it to 0, with its slopes by the gain L.

        G is the loop that a clipped force closes. 1 - G = Phi D/(O Q): Phi the closed loop, O/Q the return difference
        of the observer alone, D/Q that of the feedback, which L does not change. As d phase(a/b) = Im(da/a - db/b), dv
        = sign(phase) Im(dPhi/Phi - d(O/Q)/(O/Q)).
        """
        values = np.abs(loops.clip_phases) - self.largest_rad
        chosen = values > -self.near - reach
        of_plant, of_frequency = np.nonzero(chosen)
        phi_change = loops.family.coarse.phi[of_plant, of_frequency] / loops.phi_coarse[chosen][:, None]
        observer_change = (loops.family.observer / loops.observer_difference[:, None])[of_frequency]
        signs = np.sign(loops.clip_phases[chosen])[:, None]
        return Linearised(values[chosen], signs * (phi_change - observer_change).imag)


@dataclass(frozen=True)
class ImpedanceError:
    """The goal: the largest |E_n|/|E_d| from 1 to 30 Hz, see `ErrorRows`."""

    sides: int = 24
    """Sides of the polygon that stands for a circle of E_n, turned so that a corner is at its present phase: more
    sides describe steps across it better, and make each quadratic program larger."""

    def largest(self, loops: LawLoops) -> float:
        """Return the largest error."""
        return float(loops.family.error.errors(loops.gain).max())

    def linearised(self, loops: LawLoops) -> Linearised:
        """Return values whose largest is the error after a step: Re(E_n e^-ia)/|E_d| less the error's share of d|E_d|.

        The impedance error at a frequency is |E_n|/|E_d|, both affine in the gain L (`ErrorRows`). To first order about
        the error t_0, |E_n + dE_n| <= t |E_d + dE_d| is |E_n + dE_n|/|E_d| - t_0 d|E_d|/|E_d| <= t. A polygon of
        `sides` angles a stands for the circle |E_n + dE_n|.
        """
        rows = loops.family.error
        deviation = rows.deviation @ loops.gain + rows.deviation_0
        size = rows.size @ loops.gain + rows.size_0
        growth = (rows.size / size[:, None]).real
        error = self.largest(loops)
        angles = 2 * np.pi * np.arange(self.sides) / self.sides
        turns = np.exp(-1j * (angles[:, None] + np.angle(deviation)))
        values = (turns * deviation).real / np.abs(size)
        slopes = (turns[..., None] * rows.deviation).real / np.abs(size)[:, None] - error * growth
        return Linearised(values.ravel(), slopes.reshape(-1, len(loops.gain)))

    def relative_change_of_size(self, loops: LawLoops) -> ComplexArray:
        """Return rows of dE_d/E_d, in which the ratio is far from affine: a step bounds it."""
        rows = loops.family.error
        return np.asarray(rows.size / (rows.size @ loops.gain + rows.size_0)[:, None])
