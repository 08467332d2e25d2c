"""Which virtual masses are stable, or have a sound disk margin, at a damping: a scan of masses, its ends by bisection.

They are those of some plants: what a search of the ranges finds worse is not known here (`mass_edges`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import chunks
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.loops.handle import Pair, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import SOUND_DISK, OpenLoop, angles_about, swing
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance, virtual_mass_law
from avc_casadi.model.law import Law

# Dampings of a curve and masses of a scan, and by how much they span the scales of a device: contact stiffness times
# lag is a damping, and that times the lag a mass.
_DAMPINGS = 40
_MASSES = 56
_DAMPING_SHARES = (0.02, 50.0)
_MASS_SHARES = (1e-3, 300.0)
# Of a handle and a hand the mass is at least this share and at most this multiple.
_HANDLE_SHARES = (0.03, 30.0)
# Bisections between two masses of a scan: to 1e-5 of it.
_BISECTIONS = 12
# Angles at which every loop is looked at: evenly in their logarithm, and about each pole of the plant.
_EVEN_TURNS = 420
_LOWEST_TURN = 1e-4
_ABOUT_A_POLE = 13
# A closed loop of a smaller bandwidth, as a share of the angle of its pole, may have its peak between these angles,
# which lie 2.5 per cent apart. So many angles about such a pole show its peak to 1.4 per cent, others to 0.8.
_NARROW = 0.1
_ABOUT_A_NARROW_POLE = 25
# Laws that are judged together: their responses fill the cache, not the memory.
_LAWS_AT_ONCE = 64
# A disk margin of `VelocityResponse` is at most two per cent too large.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK


@dataclass(frozen=True, eq=False)
class JudgedLaws:
    """Which of n laws are stable, and which have a sound disk margin too, shape (n,)."""

    stable: BoolArray
    sound: BoolArray


class VelocityResponse:
    """Frequency responses of plants, which laws share: from the commanded velocity to position and force."""

    def __init__(self, pairs: Sequence[Pair]) -> None:
        self.body = Body.of(plants_of(pairs)).flat()
        poles = np.linalg.eigvals(self.body.a).ravel()
        poles = poles[np.abs(poles) > _LOWEST_TURN]
        width = np.maximum(np.abs(1 - np.abs(poles)), _LOWEST_TURN)[:, None]
        about = np.abs(np.angle(poles))[:, None] + width * np.sinh(np.linspace(-3.0, 3.0, _ABOUT_A_POLE))
        even = np.geomspace(_LOWEST_TURN, math.pi, _EVEN_TURNS)
        inside = about[(about > _LOWEST_TURN) & (about < math.pi)]
        turns = np.unique(np.concatenate([even, np.round(inside, 4)]))
        self.z: ComplexArray = np.exp(1j * turns)
        pencil = self.z[:, None, None] * np.eye(self.body.size) - self.body.a[:, None]
        push = np.broadcast_to(self.body.b[:, None, :, None], (*pencil.shape[:-1], 1)).astype(np.complex128)
        states = np.linalg.solve(pencil, push)[..., 0]
        # What the law reads at each angle, (plants, angles, 2).
        self.measured: ComplexArray = states @ np.swapaxes(self.body.measured, -1, -2)

    def disk_margins(self, law: Law) -> FloatArray:
        """Return the smallest disk margin of each of n laws, without asking whether their loops are stable."""
        return self._disk_margins(law, self._loops(law).poles)

    def sound(self, law: Law, limit: float = _SOUND_ROUGHLY) -> BoolArray:
        """Return which of n laws are stable with a disk margin of at least a limit."""
        return self.judged(law, limit).sound

    def judged(self, law: Law, limit: float = _SOUND_ROUGHLY) -> JudgedLaws:
        """Return which of n laws are stable, and which of these have a disk margin of at least a limit."""
        (count,) = law.shape
        stable, sound = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        for chosen in chunks(count, _LAWS_AT_ONCE):
            laws = law.pick(chosen)
            poles = self._loops(laws).poles
            inside = np.abs(poles).max(axis=(1, 2)) < 1
            stable[chosen] = sound[chosen] = inside
            if inside.any():
                sound[chosen][inside] = self._disk_margins(laws.pick(inside), poles[inside]) >= limit
        return JudgedLaws(stable, sound)

    def stable(self, law: Law) -> BoolArray:
        """Return which of n laws are stable."""
        return np.asarray(self._loops(law).radius.max(axis=-1) < 1)

    def _loops(self, law: Law) -> ClosedLoops:
        """Return the loops of each law around each plant."""
        return closed(self.body, law.pick((slice(None), None)))

    def _disk_margins(self, law: Law, poles: ComplexArray) -> FloatArray:
        """Return the smallest disk margin of each of n laws, whose loops have poles (n, plants, s)."""
        by_position = law.transfer(self.z[:, None], 0).T[:, None]
        by_force = law.transfer(self.z[:, None], 1).T[:, None]
        gain = -(by_position * self.measured[..., 0] + by_force * self.measured[..., 1])
        largest = swing(gain).max(axis=(1, 2))
        turn, bandwidth = np.angle(poles), np.abs(1 - np.abs(poles))
        laws, plants, _ = narrow = np.nonzero((turn > _LOWEST_TURN) & (bandwidth < _NARROW * turn))
        about = angles_about(poles[narrow][:, None], _ABOUT_A_NARROW_POLE)
        angles = np.clip(about, _LOWEST_TURN, math.pi)
        loops = OpenLoop.of_bodies(self.body.axes(plants), law.pick(laws))
        np.maximum.at(largest, laws, swing(loops.gain(angles)).max(axis=-1))
        return np.asarray(2 / largest)


@dataclass(frozen=True)
class LawScales:
    """Masses and dampings between which the region of a device lies."""

    masses_kg: FloatArray
    dampings_ns_per_m: FloatArray

    @classmethod
    def of(cls, problem: AdmittanceProblem, cutoff_hz: float | None) -> LawScales:
        """Return those of a problem: with k the stiffest that it meets and tau its lag, k tau and k tau^2.

        The lag is the delay and half a sample, that of the drive and that of the filter.
        """
        device, hands = problem.device, problem.hands
        lags = [device.drive_bandwidth_hz, *([cutoff_hz] if cutoff_hz else [])]
        lag = (device.delay_samples + 0.5) * device.sample_time_s + sum(1 / (2 * math.pi * hz) for hz in lags)
        stiffest = hands.stiffness_n_per_m[1] + problem.contact.stiffest_contact_n_per_m
        carried = device.force_sensor.handle_mass_kg + hands.mass_kg[1]
        damping = max(stiffest * lag, carried / lag * 1e-2)
        lightest = min(_MASS_SHARES[0] * damping * lag, _HANDLE_SHARES[0] * carried)
        heaviest = max(_MASS_SHARES[1] * damping * lag, _HANDLE_SHARES[1] * carried)
        return cls(
            masses_kg=np.geomspace(lightest, heaviest, _MASSES),
            dampings_ns_per_m=np.geomspace(damping * _DAMPING_SHARES[0], damping * _DAMPING_SHARES[1], _DAMPINGS),
        )


@dataclass(frozen=True)
class Span:
    """Lowest and highest value of a run of a scan that hold; not a number where none does.

    The highest is infinite where the last value of the scan holds, the lowest 0 where the first does.
    """

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Spans:
    """Those of n scans, shape (n,)."""

    low: FloatArray
    high: FloatArray


RowsHold = Callable[[FloatArray, IndexArray], BoolArray]
"""Which values, each of one of n scans, hold."""


def held_spans(held: BoolArray, holds: RowsHold, scan: FloatArray) -> Spans:
    """Return the longest run of each of n scans of the same values that hold (n, values), its ends by bisection."""
    count = len(held)
    first, last = np.full(count, -1), np.full(count, -1)
    for row, inside in enumerate(map(np.flatnonzero, held)):
        if inside.size:
            runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
            longest = max(runs, key=len)
            first[row], last[row] = longest[0], longest[-1]
    low, high = np.full(count, math.nan), np.full(count, math.nan)
    low[first == 0] = 0.0
    high[last == len(scan) - 1] = math.inf
    lower, upper = np.flatnonzero(first > 0), np.flatnonzero((last >= 0) & (last < len(scan) - 1))
    inner = np.concatenate([scan[first[lower]], scan[last[upper]]])
    outer = np.concatenate([scan[first[lower] - 1], scan[last[upper] + 1]])
    rows = np.concatenate([lower, upper])
    for _ in range(_BISECTIONS if rows.size else 0):
        middle = np.sqrt(inner * outer)
        holding = holds(middle, rows)
        inner, outer = np.where(holding, middle, inner), np.where(holding, outer, middle)
    low[lower], high[upper] = inner[: len(lower)], inner[len(lower) :]
    return Spans(low, high)


def held_span(holds: Callable[[FloatArray], BoolArray], scan: FloatArray) -> Span:
    """Return the longest run of values of a scan that hold, its ends by bisection."""
    spans = held_spans(holds(scan)[None], lambda values, _: holds(values), scan)
    return Span(float(spans.low[0]), float(spans.high[0]))


@dataclass(frozen=True)
class MassSpans:
    """Laws with the spring and the low pass of a law, for scans of their masses and dampings."""

    response: VelocityResponse
    scales: LawScales
    base: VirtualImpedance
    sample_time_s: float

    @classmethod
    def of(cls, analysis: HandleAnalysis, base: VirtualImpedance) -> Self:
        """Return those of the plants of an analysis."""
        scales = LawScales.of(analysis.problem, base.cutoff_hz)
        return cls(VelocityResponse(analysis.pairs), scales, base, analysis.period_s)

    def laws(self, masses_kg: FloatArray | float, dampings_ns_per_m: FloatArray | float) -> Law:
        """Return the laws of masses and dampings."""
        spring, cutoff_hz = self.base.stiffness_n_per_m, self.base.cutoff_hz
        return virtual_mass_law(masses_kg, dampings_ns_per_m, self.sample_time_s, spring, cutoff_hz)
