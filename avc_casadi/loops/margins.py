"""Gain, phase and delay margins of the loop in contact, broken at the actuator.

L(z) = -C(z) P(z): P from the actuator's force to the measured position, C from there to the commanded force; 1 + L = 0
closes it (Franklin, Powell and Workman 1998, 7.5). The disk margin alpha = 2/max |(1 - L)/(1 + L)| leaves a gain of
(2 + alpha)/(2 - alpha) or a phase of 2 atan(alpha/2) (Seiler, Packard and Gahinet, Control Systems 40(5), 2020).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.resolvent import response
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.spectrum import ClosedLoops, lowest, root
from avc_casadi.loops.wall import closed, law_at_rest
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant

LEAST_DISK = 0.15
"""Disk margin below which a coupling should not run on a device."""
SOUND_DISK = 0.2
"""Disk margin below which a coupling is thin."""
SETTLING_BAND = 0.02
"""Share of the largest depth after an impact within which a device counts as settled."""
# The lowest angle of z of interest.
_LOWEST_TURN = 1e-5
# Angles of a first look, evenly in their logarithm: of all loops at once, and of one loop's own.
_EVEN_TURNS = 200
_EVEN_TURNS_OF_A_LOOP = 40
# An angle in a sample below which a pole is real by rounding, and a size below which it is 0.
_LEAST_TURN = 1e-6
_DEADBEAT = 1e-9
# Angles about a pole.
_ABOUT_A_POLE = 17
# Peaks of |(1 - L)/(1 + L)| that are refined.
_PEAKS = 12
# An impact is followed over so many points, until it is down to this share.
_POINTS_OF_IMPACT = 2**13
_SETTLED_SHARE = 1e-4


@dataclass(frozen=True)
class Margins:
    """Smallest margins of some loops; 1 and 0 where one is not stable, infinite without a limit."""

    gain: float
    gain_down: float
    phase_deg: float
    delay_samples: float
    disk: float
    gain_hz: float
    phase_hz: float
    delay_hz: float
    disk_hz: float


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """The loop of a coupling, broken at the actuator, with h hands: the corners of the set, then none.

    Attributes:
        law: that of all loops, or with one leading axis that of each.
        body: the sampled device with each hand.
        closed: the closed loops, of n states each.
        moving: which of the states are velocities, shape (n,): an impact sets them.
    """

    law: Law
    body: Body
    closed: ClosedLoops
    moving: BoolArray

    @classmethod
    def of(cls, coupling: Coupling) -> Self:
        """Return the loop of a coupling, on the corner of [device.range] with which its disk margin is the smallest."""
        family = PlantFamily.of(coupling.problem)
        law = law_at_rest(coupling)
        loops = [cls.around(family.sampled.of_device(index), law) for index in range(len(family.devices))]
        return loops[0] if len(loops) == 1 else max(loops, key=lambda loop: loop.swings().max())

    @classmethod
    def around(cls, plant: SampledPlant, law: Law) -> Self:
        """Return the loop of a law around h plants, the last released."""
        return cls.of_bodies(Body.of(plant).flat(), law)

    @classmethod
    def of_bodies(cls, body: Body, law: Law) -> Self:
        """Return the loops of h bodies (device and hand, sampled) with one law, or each with its own."""
        loops = closed(body, law)
        moving = np.array([name.endswith("velocity_m_per_s") for name in body.names])
        return cls(
            law=law,
            body=body,
            closed=loops,
            moving=np.pad(moving, (0, loops.maps.shape[-1] - len(moving))),
        )

    @property
    def poles(self) -> ComplexArray:
        """The poles of each closed loop, shape (h, s)."""
        return self.closed.poles

    def gain(self, turn: FloatArray, loops: IndexArray | slice = slice(None)) -> ComplexArray:
        """Return the loop L = -C(z) P(z), C the law and P the plant, at z = exp(j turn), shape (loops, turns).

        `turn` is omega T, rad a sample. L has no unit; 1 + L = 0 is the limit of stability.
        """
        body = self.body.axes(loops)
        angles = np.broadcast_to(turn, (len(body.a), np.shape(turn)[-1]))
        z = np.exp(1j * angles)
        law = self.law.pick((loops, None)) if self.law.shape else self.law
        rows = np.broadcast_to(body.measured, (len(body.a), *body.measured.shape[-2:]))
        measured = response(z, body.a[:, None], body.b[:, None], rows[:, None])
        command = sum(law.transfer(z, place) * signal for place, signal in enumerate(measured))
        return np.asarray(-command)

    def turns(self) -> FloatArray:
        """Return angles of z at which L is evaluated, dense at peaks of it or of 1/(1 + L), shape (n,)."""
        poles = np.concatenate([self.poles.ravel(), np.linalg.eigvals(self.body.a).ravel()])
        poles = poles[np.abs(poles) > _LOWEST_TURN]
        about = angles_about(poles[:, None])
        about = about[(about > _LOWEST_TURN) & (about < math.pi)]
        return np.unique(np.concatenate([np.geomspace(_LOWEST_TURN, math.pi, _EVEN_TURNS), about]))

    def impact(self, speed_m_per_s: float, points: int, loops: slice = slice(None), stride: int = 1) -> FloatArray:
        """Return the position of a device that meets its wall at a speed, the wall two-sided, shape (h, points).

        The points lie a stride of samples apart. Each round doubles them: those so far, then the same ones later by a
        power of the map.
        """
        step = np.linalg.matrix_power(self.closed.maps[loops], stride)
        state = np.repeat((self.moving * speed_m_per_s * self.body.sample_time_s)[None, :, None], len(step), axis=0)
        while state.shape[-1] < points:
            state = np.concatenate([state, step @ state], axis=-1)
            step = step @ step
        return np.asarray(self.body.output_row @ state[:, : self.body.size, :points])

    def settling_s(self) -> FloatArray:
        """Return the time from an impact until the depth stays within `SETTLING_BAND` of its largest, s, shape (h,).

        The device begins at 1 m/s; the response is looked at until its slowest mode has died. Infinite where unstable.
        """
        slowest = np.maximum(self.closed.radius, 1e-9)
        settling_s = np.full(slowest.shape, np.inf)
        for row in np.flatnonzero(slowest < 1):
            stride = 1 + int(math.log(_SETTLED_SHARE) / math.log(slowest[row])) // _POINTS_OF_IMPACT
            depth = self.impact(1.0, _POINTS_OF_IMPACT, slice(row, row + 1), stride)[0]
            moves = np.abs(depth - depth[-1]) > SETTLING_BAND * np.abs(depth).max()
            settling_s[row] = self.body.sample_time_s * stride * (np.flatnonzero(moves).max(initial=-1) + 1)
        return settling_s

    def margins(self) -> tuple[Margins, Margins]:
        """Return the margins of the device released, the last loop, and the smallest of those with hands."""
        return self.least(slice(-1, None)), self.least(slice(-1))

    def least(self, chosen: slice = slice(None)) -> Margins:
        """Return the smallest gain, phase, delay and disk margins of some of the loops, with their frequencies.

        They are read where L, the loop broken at the actuator, becomes real or of size 1; 1 and 0 where a loop is
        unstable.
        """
        loops = np.arange(len(self.body.a))[chosen]
        if np.abs(self.poles[loops]).max() >= 1:
            return Margins(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        turn = self.turns()
        gain = self.gain(turn, loops)
        # L becomes real where its imaginary part changes sign, and crosses the unit circle where |L| - 1 does.
        signs = np.stack([np.sign(gain.imag), np.sign(np.abs(gain) - 1)])
        kind, row, place = np.nonzero(signs[..., :-1] * signs[..., 1:] < 0)
        crossing = self._crossings(kind == 0, loops[row], turn[place], turn[place + 1])
        disk, disk_turn = self._disk(loops, turn, gain)
        return self._smallest(
            _Crossings(
                # L is real at half the sample rate, the last angle.
                turn=np.append(crossing.turn, np.full(len(loops), math.pi)),
                gain=np.append(crossing.gain, gain[:, -1]),
                real=np.append(crossing.real, np.ones(len(loops), dtype=bool)),
            ),
            disk,
            disk_turn,
        )

    @property
    def quick_disk_margin(self) -> float:
        """The smallest disk margin of all loops, up to 2 % too large, eight times as quick; 0 if one is unstable."""
        return 2 / float(self.swings().max()) if self.closed.radius.max() < 1 else 0.0

    def swings(self) -> FloatArray:
        """Return the largest |(1 - L)/(1 + L)| of each loop L on angles dense at its own poles, shape (h,).

        The disk margin is 2 over it.
        """
        # Of a pair of conjugate poles one has the angles of both.
        upper = np.argsort(-self.poles.imag, axis=1)[:, : int((self.poles.imag >= 0).sum(axis=1).max())]
        poles = np.take_along_axis(self.poles, upper, axis=1)
        about = angles_about(poles[..., None]).reshape(len(poles), -1)
        even = np.geomspace(10 * _LOWEST_TURN, math.pi, _EVEN_TURNS_OF_A_LOOP)
        even = np.broadcast_to(even, (len(about), len(even)))
        angles = np.concatenate([even, np.clip(about, _LOWEST_TURN, math.pi)], axis=1)
        return np.asarray(swing(self.gain(angles)).max(axis=1))

    def _disk(self, loops: IndexArray, turn: FloatArray, gain: ComplexArray) -> tuple[float, float]:
        """Return the smallest disk margin 2/max |(1 - L)/(1 + L)| of some loops and its angle, rad a sample.

        `gain` is L of the loops at the angles `turn`; the highest peaks are refined.
        """
        size = swing(gain)
        neighbours = np.pad(size, ((0, 0), (1, 1)), constant_values=-np.inf)
        size[(size < neighbours[:, :-2]) | (size < neighbours[:, 2:])] = -np.inf
        row, top = np.unravel_index(np.argsort(size, axis=None)[-_PEAKS:], size.shape)
        around = (turn[np.clip(top + side, 0, len(turn) - 1)] for side in (-1, 0, 1))

        def size_at(angles: FloatArray) -> FloatArray:
            return swing(self.gain(angles[:, None], loops[row]))[:, 0]

        best = lowest(lambda angles: -size_at(angles), *around)
        size = size_at(best)
        worst = int(size.argmax())
        return float(2 / size[worst]), float(best[worst])

    def _smallest(self, crossings: _Crossings, disk: float, disk_turn: float) -> Margins:
        """Return the margins at the crossings that come first, of stable loops.

        Where L is real and below 0, -1/L is the gain that takes the loop to its limit; where |L| = 1, the phase of -L.
        """
        hz_per_turn = 1 / (2 * math.pi * self.body.sample_time_s)
        real = crossings.real
        with np.errstate(divide="ignore"):  # nothing is rendered
            factor = -1 / crossings.gain[real].real
        up = np.where(factor > 1, factor, np.inf)
        down = np.where((factor > 0) & (factor <= 1), factor, 0.0)
        lag = (np.angle(crossings.gain[~real]) + math.pi) % (2 * math.pi)
        phase_deg = np.append(np.degrees(np.minimum(lag, 2 * math.pi - lag)), np.inf)
        delay = np.append(lag / crossings.turn[~real], np.inf)
        gain_hz = crossings.turn[real] * hz_per_turn
        phase_hz = np.append(crossings.turn[~real] * hz_per_turn, 0.0)
        return Margins(
            gain=float(up.min()),
            gain_down=float(down.max()),
            phase_deg=float(phase_deg.min()),
            delay_samples=float(delay.min()),
            disk=disk,
            gain_hz=float(gain_hz[up.argmin()]) if np.isfinite(up).any() else 0.0,
            phase_hz=float(phase_hz[phase_deg.argmin()]),
            delay_hz=float(phase_hz[delay.argmin()]),
            disk_hz=disk_turn * hz_per_turn,
        )

    def _crossings(self, real: BoolArray, loops: IndexArray, low: FloatArray, high: FloatArray) -> _Crossings:
        """Return the angles between `low` and `high` at which L becomes real, where so marked, else of size 1."""
        if not len(loops):
            return _Crossings(low, np.empty(0, dtype=np.complex128), real)

        def value(turn: FloatArray) -> FloatArray:
            gain = self.gain(turn[:, None], loops)[:, 0]
            # A window of ticks has angles at which L is exactly 0.
            size = np.maximum(np.abs(gain), np.finfo(np.float64).tiny)
            return np.where(real, gain.imag / size, np.log(size))

        turn = root(value, low, high)
        return _Crossings(turn, self.gain(turn[:, None], loops)[:, 0], real)


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Where L is real, or of size 1 otherwise: angles of z, and L there, shape (n,)."""

    turn: FloatArray
    gain: ComplexArray
    real: BoolArray


def swing(gain: ComplexArray) -> FloatArray:
    """Return |(1 - L)/(1 + L)| of loops L."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a gain of 1e300 is infinite
        return np.nan_to_num(np.abs((1 - gain) / (1 + gain)), nan=1.0, posinf=np.inf)


def angles_about(poles: ComplexArray, points: int = _ABOUT_A_POLE) -> FloatArray:
    """Return angles of z about poles (..., 1), from within to far beyond their bandwidths, shape (..., points)."""
    bandwidth = np.maximum(np.abs(1 - np.abs(poles)), _LOWEST_TURN)
    return np.asarray(np.abs(np.angle(poles)) + bandwidth * np.sinh(np.linspace(-4.0, 4.0, points)))


@dataclass(frozen=True)
class Transient:
    """How the loop in contact settles after an impact, on the device of `OpenLoop.of`: the worst of some hands."""

    settling_s: float
    damping_ratio: float
    frequency_hz: float


def damping_ratios(poles: ComplexArray) -> FloatArray:
    """Return the damping ratio of each pole; 1 of one that does not oscillate.

    A real pole below 0 is none of a pair: it alternates from sample to sample, which no damped oscillator does.
    """
    # A pole that turns less per sample, or that much less than half a turn, is real; a smaller one is deadbeat.
    turn = np.abs(np.angle(poles))
    swings = (turn > _LEAST_TURN) & (turn < math.pi - _LEAST_TURN) & (np.abs(poles) > _DEADBEAT)
    rate = np.log(np.where(swings, poles, 0.5))
    return np.asarray(-rate.real / np.abs(rate))


def transients(coupling: Coupling) -> tuple[Transient, Transient]:
    """Return settling time, damping ratio and its frequency of the device in contact: released, and the worst hand."""
    loop = OpenLoop.of(coupling)
    settling_s = loop.settling_s()
    ratios = damping_ratios(loop.poles)
    hz = np.where(ratios < 1, np.abs(np.angle(loop.poles)), 0.0) / (2 * math.pi * loop.body.sample_time_s)

    def worst(loops: slice) -> Transient:
        least = ratios[loops].argmin()
        return Transient(
            settling_s=float(settling_s[loops].max()),
            damping_ratio=float(ratios[loops].flat[least]),
            frequency_hz=float(hz[loops].flat[least]),
        )

    return worst(slice(-1, None)), worst(slice(-1))
