"""All laws of one structure before one wall: what a gain L of the innovation makes of every loop.

A law is an observer with state feedback (`observer_law.Structure`). Its gain L is free, and the conditions on a law use

    X(z) L   force over innovation                    Y(z) L   predicted position over innovation
    Phi = 1 + (Y + P X) L                             the loop of a plant P: 1 + P C = Phi/(1 + Y L), C the law
    1 + g (Phi - 1)                                   the same where quantiser and dead zone pass a share g

so that Phi is affine in L, and its zeros are the poles of the closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.impedance import handle_impedance, target_impedance
from avc_casadi.design.observer_law import Structure
from avc_casadi.design.plants import PlantMatrices
from avc_casadi.loops.plant_family import PlantFamily, perturbed_plants
from avc_casadi.loops.spectrum import eigenvalues
from avc_casadi.model.device import Device
from avc_casadi.model.perturbed import perturbed_devices
from avc_casadi.model.problem import Problem

BAND_HZ = (1.0, 30.0)
"""Band of the impedance error: where a hand moves and feels a stiffness."""
ERROR_POINTS = 12
"""Frequencies in that band, evenly in their logarithm."""


@dataclass(frozen=True)
class SectorGain:
    """A share of the innovation that quantiser and dead zone pass, and what is required of the loop there."""

    share: float
    fast_decay: float  # required decay of vibrations, as a share of that at share 1
    slow_decay: float  # required decay of slow motion, the same
    distance: float  # least |1 + g (Phi - 1)| with a hand; 0 where none is required


SECTOR_GAINS = (
    SectorGain(share=1.0, fast_decay=1.0, slow_decay=1.0, distance=0.35),
    SectorGain(share=0.5, fast_decay=0.9, slow_decay=1.0, distance=0.25),
    SectorGain(share=0.25, fast_decay=0.8, slow_decay=0.8, distance=0.17),
    SectorGain(share=0.12, fast_decay=0.6, slow_decay=0.6, distance=0.12),
    SectorGain(share=0.06, fast_decay=0.3, slow_decay=0.35, distance=0.06),
    SectorGain(share=0.03, fast_decay=0.1, slow_decay=0.15, distance=0.0),
    SectorGain(share=0.015, fast_decay=0.02, slow_decay=0.05, distance=0.0),
)
"""From the whole innovation to nearly none of it: the smaller the share, the less is required."""

_SLOW_DECAY_PER_S = 10.0
_FAST_DECAY_PER_S = 4.0
_MOST_FAST_DECAY_PER_S = 5.0
_FAST_PER_DEVICE_DECAY = 0.05  # more where the device itself decays at b/m
_BETWEEN_SLOW_AND_FAST_HZ = 4.0

_LOWEST_HZ = 0.1
_RESONANCE_SPAN = (0.004, 0.5)  # distances from a resonance, relative to its frequency
_COARSE = 2  # density of the frequency grids
_DENSE = 8


def required_decay_per_s(device: Device, hz: FloatArray, sector: SectorGain) -> FloatArray:
    """Return the decay d(f) that poles at frequencies f must have, 1/s: fast + (slow - fast)/(1 + (f/4 Hz)^4).

    slow = 10/s for slow motion; fast = 4/s + 0.05 b/m for vibrations, 5/s at most, with b/m the decay of the device
    itself. `fast_decay` and `slow_decay` of the sector gain multiply them.
    """
    device_decay_per_s = device.damping_ns_per_m / device.mass_kg
    fast_per_s = min(_MOST_FAST_DECAY_PER_S, _FAST_DECAY_PER_S + _FAST_PER_DEVICE_DECAY * device_decay_per_s)
    fast_per_s *= sector.fast_decay
    slow_per_s = _SLOW_DECAY_PER_S * sector.slow_decay
    return np.asarray(fast_per_s + (slow_per_s - fast_per_s) / (1 + (hz / _BETWEEN_SLOW_AND_FAST_HZ) ** 4))


@dataclass(frozen=True, eq=False)
class FrequencyRows:
    """Rows by which the responses at frequencies depend on the gain L."""

    x: ComplexArray  # (frequencies, n), N/m
    y: ComplexArray  # (frequencies, n)
    phi: ComplexArray  # Y + P X, (plants, frequencies, n)


@dataclass(frozen=True, eq=False)
class ErrorRows:
    """Impedance error as a ratio of affine functions of L: |E_n|/|E_d|, with rows (frequencies, n) and constants.

    The impedance at the handle with a law C is Z_h = (z_0 + p C)/(1 + q C). It is compared with Z, device and physical
    wall as one body, and Z_e, the wall alone. With S = max(|Z|, |Z_e|), multiplied by (1 + Y L)(1 + q C):

        E_n = (z_0 - Z)(1 + Y L) + (p - Z q) X L        E_d = S ((1 + Y L) + q X L)
    """

    deviation: ComplexArray
    deviation_0: ComplexArray
    size: ComplexArray
    size_0: ComplexArray

    def errors(self, gain: FloatArray) -> FloatArray:
        """Return |E_n|/|E_d| at each frequency."""
        deviation = self.deviation @ gain + self.deviation_0
        return np.asarray(np.abs(deviation) / np.abs(self.size @ gain + self.size_0))


@dataclass(frozen=True)
class Performance:
    """What a law reaches: the error on the nominal device, everything else over all hands and devices."""

    error: float
    """Largest |Z_h - Z|/max(|Z|, |Z_e|) from 1 to 30 Hz, Z of device and physical wall, Z_e of the wall."""
    disk_margin: float
    """2/max |(1 - P C)/(1 + P C)| at the actuator, with a hand or released."""
    noise_n_per_m: float
    """Largest force over a sine of encoder noise."""
    clip_phase_cosine: float
    """Least cosine of half the phase of 1 - G, G the loop of a clipped force, at gains from 1 to 0.015."""
    decay_ratio: float
    """Least decay over the required one, at any of `SECTOR_GAINS`."""
    radius: float
    """Spectral radius of the loops."""

    @property
    def stable(self) -> bool:
        """Whether every hand is stable, and the device released, at each gain of a force that is clipped."""
        return self.radius < 1 and self.clip_phase_cosine > LEAST_CLIP_PHASE_COSINE


LEAST_CLIP_PHASE_COSINE = 0.05
"""Least cosine of half the phase of 1 - G: the phase is at most 174 degrees, 6 short of a negative real number."""


class LawFamily:
    """All laws of one structure on a problem: every corner of the device's ranges and of the hands, and released."""

    def __init__(self, problem: Problem, structure: Structure) -> None:
        """Compute the rows that multiply the gain L in each loop, at each frequency of the grids.

        Args:
            problem: device and wall; its ranges are judged at their corners, with every hand and released.
            structure: model and feedback of the observer, whose gain L is free.
        """
        self.problem = problem
        self.structure = structure
        self.held, released = PlantMatrices.held_and_released(PlantFamily.of(problem).sampled)
        self.plants = self.held.joined_with(released)
        hz = self._grid_hz(_COARSE)
        self.z = np.exp(2j * np.pi * hz * problem.device.sample_time_s)
        self.response = self.plants.position_per_force(self.z)
        x, y = structure.rows(self.z)
        self.coarse = FrequencyRows(x, y, y + self.response[..., None] * x)
        self.observer, self.feedback = structure.differences(self.z)
        dense_z = np.exp(2j * np.pi * self._grid_hz(_DENSE) * problem.device.sample_time_s)
        x, y = structure.rows(dense_z)
        self.dense = FrequencyRows(x, y, y + self.plants.position_per_force(dense_z)[..., None] * x)
        self.error = self.error_rows(np.geomspace(*BAND_HZ, ERROR_POINTS))

    @cached_property
    def perturbed(self) -> PlantMatrices | None:
        """Plants of perturbed devices, with every hand and released; None where every value has a range."""
        if not perturbed_devices(self.problem):
            return None
        held, released = PlantMatrices.held_and_released(perturbed_plants(self.problem))
        return held.joined_with(released)

    def _grid_hz(self, density: int) -> FloatArray:
        """Return frequencies from 0.1 Hz to the Nyquist frequency itself, Hz, dense about resonances of the devices.

        They are even in their logarithm up to 8 % of the sample rate, then even. `density` is a factor on their number.
        """
        rate_hz = 1 / self.problem.device.sample_time_s
        slow_hz, fast_hz = min(3.0, 0.01 * rate_hz), 0.08 * rate_hz
        parts = [
            np.geomspace(_LOWEST_HZ, slow_hz, 6 * density),
            np.geomspace(slow_hz, fast_hz, 32 * density),
            np.linspace(fast_hz, 0.5 * rate_hz, 24 * density),
        ]
        for corner in PlantFamily.of(self.problem).devices:
            if corner.resonance is not None:
                distances = np.geomspace(*_RESONANCE_SPAN, 6 * density)
                parts.append(corner.resonance.frequency_hz * np.concatenate([1 - distances, 1 + distances]))
        hz = np.unique(np.concatenate(parts))
        return hz[hz <= 0.5 * rate_hz * (1 + 1e-12)]

    def error_rows(self, hz: FloatArray) -> ErrorRows:
        """Return the impedance error |E_n|/|E_d| at frequencies as affine functions of the gain L, see `ErrorRows`.

        With a law C, force over position in N/m, the impedance at the handle is Z_h = (z_0 + p C)/(1 + q C). z_0, p and
        q, one each at each frequency, follow from Z_h with three laws: none, a spring k, and j k, a spring turned by 90
        degrees.
        """
        device, k = self.problem.device, self.structure.stiffness_n_per_m
        # z_0, p and q follow from the impedance with three laws C: none, a spring, and a spring turned by 90 degrees.
        alone, spring, turned = (handle_impedance(device, law, hz)[0] for law in (0j, k + 0j, 1j * k))
        matrix = np.array([[k + 0 * spring, -k * spring], [1j * k + 0 * spring, -1j * k * turned]]).transpose(2, 0, 1)
        p, q = np.linalg.solve(matrix, np.array([spring - alone, turned - alone]).T[..., None])[..., 0].T
        target, size = target_impedance(self.problem, hz)
        x, y = self.structure.rows(np.exp(2j * np.pi * hz * device.sample_time_s))
        deviation = (p - target * q)[:, None] * x + (alone - target)[:, None] * y
        return ErrorRows(deviation, alone - target, size[:, None] * (y + q[:, None] * x), size.astype(np.complex128))

    def at(self, gain: FloatArray) -> LawLoops:
        """Return the loops with a gain L, shape (n,)."""
        return LawLoops(self, gain)


@dataclass(frozen=True, eq=False)
class LawLoops:
    """The loops of one gain L; what conditions share is computed once."""

    family: LawFamily
    gain: FloatArray

    @cached_property
    def phi_coarse(self) -> ComplexArray:
        """Phi on the coarse grid, (plants, frequencies)."""
        return np.asarray(1 + self.family.coarse.phi @ self.gain)

    @cached_property
    def phi_dense(self) -> ComplexArray:
        """Phi on the dense grid, (plants, frequencies)."""
        return np.asarray(1 + self.family.dense.phi @ self.gain)

    @cached_property
    def margin_numerator(self) -> ComplexArray:
        """2 (1 + Y L) - Phi on the dense grid: (1 - loop)/(1 + loop) at the actuator times Phi."""
        return np.asarray(2 * (1 + self.family.dense.y @ self.gain) - self.phi_dense)

    @cached_property
    def force_per_innovation(self) -> ComplexArray:
        """X L on the dense grid, N/m, (frequencies,)."""
        return np.asarray(self.family.dense.x @ self.gain)

    def plants_at(self, sector: SectorGain) -> PlantMatrices:
        """Return the plants judged at a sector gain: with the whole innovation the released device too."""
        return self.family.plants if sector is SECTOR_GAINS[0] else self.family.held

    @cached_property
    def poles(self) -> tuple[ComplexArray, ...]:
        """The poles at each of `SECTOR_GAINS`, (plants, states) each."""
        structure = self.family.structure
        loops = [structure.loops(self.plants_at(sector), self.gain, sector.share) for sector in SECTOR_GAINS]
        return tuple(eigenvalues(matrices) for matrices in loops)

    @cached_property
    def decay_ratios(self) -> tuple[FloatArray, ...]:
        """Decay over the required one of each pole, at each of `SECTOR_GAINS`, shape (plants, states) each.

        A pole z decays with -ln|z|/T, 1/s, and has the frequency |arg z|/(2 pi T), by which the requirement goes.
        """
        device = self.family.problem.device
        ratios = []
        for sector, poles in zip(SECTOR_GAINS, self.poles, strict=True):
            hz = np.abs(np.angle(poles)) / (2 * np.pi * device.sample_time_s)
            decay_per_s = -np.log(np.maximum(np.abs(poles), 1e-9)) / device.sample_time_s
            ratios.append(decay_per_s / required_decay_per_s(device, hz, sector))
        return tuple(ratios)

    @cached_property
    def radius(self) -> float:
        """Spectral radius of the loops with the whole innovation."""
        return float(np.abs(self.poles[0]).max())

    @cached_property
    def distances(self) -> tuple[FloatArray, ...]:
        """|1 + g (Phi - 1)| with a hand at each of `SECTOR_GAINS`, (plants, frequencies)."""
        held = self.phi_coarse[: len(self.family.held)]
        return tuple(np.abs(1 + sector.share * (held - 1)) for sector in SECTOR_GAINS)

    @cached_property
    def observer_difference(self) -> ComplexArray:
        """O/Q, the return difference of the observer alone, (frequencies,)."""
        return np.asarray(1 + self.family.observer @ self.gain)

    @cached_property
    def clip_phases(self) -> FloatArray:
        """Phase of 1 - G = Phi D/(O Q), G the loop that a clipped force closes, (plants, frequencies), rad.

        D/Q is the return difference of the feedback and O/Q that of the observer. The loop is stable at the gain 1, so
        it is at each lower gain g where 1 - G is no negative number above 1 - 1/g. The phase is 0 where |1 - G| is so
        large that only gains below those of `SECTOR_GAINS` matter: there the hand alone decides.
        """
        difference = self.phi_coarse * self.family.feedback / self.observer_difference
        return np.where(np.abs(difference) < 1 / SECTOR_GAINS[-1].share, np.angle(difference), 0.0)

    @cached_property
    def performance(self) -> Performance:
        """Impedance error, disk margin, noise gain, decay and stability that the law reaches over hands and devices."""
        return Performance(
            error=float(self.family.error.errors(self.gain).max()),
            disk_margin=float(2 / np.abs(self.margin_numerator / self.phi_dense).max()),
            noise_n_per_m=float(np.abs(self.force_per_innovation / self.phi_dense).max()),
            clip_phase_cosine=float(np.cos(self.clip_phases / 2).min()),
            decay_ratio=min(float(ratios.min()) for ratios in self.decay_ratios),
            radius=self.radius,
        )
