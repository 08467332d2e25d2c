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
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import ClosedLoops, lowest, root
from avc_casadi.loops.wall import closed, law_at_rest
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant, sampled_plant

LEAST_DISK, SOUND_DISK = 0.15, 0.2
"""Disk margins below which a coupling should not run on a device, and below which it is thin."""
SETTLING_BAND = 0.02
"""Share of the largest depth after an impact within which a device counts as settled."""
# The lowest angle of z of interest.
_LOWEST_TURN = 1e-5


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
    """The loop of a coupling, broken at the actuator, with h hands: the corners of the set, then none."""

    law: Law
    body: Body
    closed: ClosedLoops
    moving: BoolArray

    @classmethod
    def of(cls, coupling: Coupling) -> Self:
        """Return the loop of a coupling, on the corner of [device.range] with which its disk margin is the smallest."""
        problem = coupling.problem
        hands = with_released(hand_corners(problem.hands.model_copy(update={"let_go": False})))
        law = law_at_rest(coupling)
        devices = device_corners(problem.device, LINEAR_KEYS)
        loops = [cls.around(sampled_plant(device, hands), law) for device in devices]
        return loops[0] if len(loops) == 1 else max(loops, key=lambda one: one.swings().max())

    @classmethod
    def around(cls, plant: SampledPlant, law: Law) -> Self:
        """Return the loop of a law around h plants, the last released."""
        body = Body.of(plant).flat()
        loops = closed(body, law)
        moving = np.array([name.endswith("velocity_m_per_s") for name in plant.names])
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

    def gain(self, turn: FloatArray, who: IndexArray | slice = slice(None)) -> ComplexArray:
        """Return L at z = exp(j turn)."""
        body = self.body.axes(who)
        angles = np.broadcast_to(turn, (len(body.a), np.shape(turn)[-1]))
        z = np.exp(1j * angles)
        pencil = z[..., None, None] * np.eye(body.size) - body.a[:, None]
        push = np.broadcast_to(body.b[:, None], (*angles.shape, body.size))
        position = np.linalg.solve(pencil, push.astype(np.complex128)[..., None])[..., 0] @ body.output_row
        return np.asarray(-self.law.transfer(z) * position)

    def turns(self) -> FloatArray:
        """Return angles of z at which L is evaluated, dense at peaks of it or of 1/(1 + L), shape (n,)."""
        poles = np.concatenate([self.poles.ravel(), np.linalg.eigvals(self.body.a).ravel()])
        poles = poles[np.abs(poles) > _LOWEST_TURN]
        about = _about(poles[:, None])
        about = about[(about > _LOWEST_TURN) & (about < math.pi)]
        return np.unique(np.concatenate([np.geomspace(_LOWEST_TURN, math.pi, 200), about]))

    def impact(self, speed_m_per_s: float, samples: int, who: slice = slice(None), every: int = 1) -> FloatArray:
        """Return the position of a device that meets its wall at a speed, the wall two-sided, shape (h, samples)."""
        step = np.linalg.matrix_power(self.closed.maps[who], every)
        state = np.repeat((self.moving * speed_m_per_s * self.body.sample_time_s)[None, :, None], len(step), axis=0)
        while state.shape[-1] < samples:
            state, step = np.concatenate([state, step @ state], axis=-1), step @ step
        return np.asarray(self.body.output_row @ state[:, : self.body.size, :samples])

    def settling_s(self) -> FloatArray:
        """Return the time from an impact until the depth stays within `SETTLING_BAND` of its largest, shape (h,)."""
        slowest = np.maximum(self.closed.radius, 1e-9)
        settling_s = np.full(slowest.shape, np.inf)
        for row in np.flatnonzero(slowest < 1):
            every = 1 + int(math.log(1e-4) / math.log(slowest[row])) // 2**13
            depth = self.impact(1.0, 2**13, slice(row, row + 1), every)[0]
            moves = np.abs(depth - depth[-1]) > SETTLING_BAND * np.abs(depth).max()
            settling_s[row] = self.body.sample_time_s * every * (np.flatnonzero(moves).max(initial=-1) + 1)
        return settling_s

    def margins(self) -> tuple[Margins, Margins]:
        """Return the margins of the device released, the last loop, and the smallest of those with hands."""
        return self.least(slice(-1, None)), self.least(slice(-1))

    def least(self, some: slice = slice(None)) -> Margins:
        """Return the smallest margins of some of the loops, or of all."""
        loops = np.arange(len(self.body.a))[some]
        turn = self.turns()
        gain = self.gain(turn, loops)
        of_phase = np.stack([np.sign(gain.imag), np.sign(np.abs(gain) - 1)])
        kind, row, place = np.nonzero(of_phase[..., :-1] * of_phase[..., 1:] < 0)
        who = loops[row]
        angle = self._crossings(kind == 0, who, turn[place], turn[place + 1])
        there = self.gain(angle[:, None], who)[:, 0] if len(who) else np.empty(0, dtype=np.complex128)
        # L is real at half the sample rate, the last angle.
        angle, there = np.append(angle, np.full(len(loops), math.pi)), np.append(there, gain[:, -1])
        return self._of_crossings(loops, angle, there, np.append(kind == 0, loops >= 0), self._disk(loops, turn, gain))

    def swings(self) -> FloatArray:
        """Return the largest |(1 - L)/(1 + L)| of each loop on angles dense at its own poles, shape (h,)."""
        about = _about(self.poles[..., None]).reshape(len(self.poles), -1)
        even = np.broadcast_to(np.geomspace(1e-4, math.pi, 40), (len(about), 40))
        angles = np.concatenate([even, np.clip(about, _LOWEST_TURN, math.pi)], axis=1)
        return np.asarray(_swing(self.gain(angles)).max(axis=1))

    def _disk(self, loops: IndexArray, turn: FloatArray, gain: ComplexArray) -> tuple[float, float]:
        """Return the smallest disk margin of some loops and its angle, from their L at angles."""
        size = _swing(gain)
        beside = np.pad(size, ((0, 0), (1, 1)), constant_values=-np.inf)
        size[(size < beside[:, :-2]) | (size < beside[:, 2:])] = -np.inf
        row, top = np.unravel_index(np.argsort(size, axis=None)[-12:], size.shape)
        around = (turn[np.clip(top + side, 0, len(turn) - 1)] for side in (-1, 0, 1))

        def size_at(angles: FloatArray) -> FloatArray:
            return _swing(self.gain(angles[:, None], loops[row]))[:, 0]

        best = lowest(lambda angles: -size_at(angles), *around)
        size = size_at(best)
        worst = int(size.argmax())
        return float(2 / size[worst]), float(best[worst])

    def _of_crossings(
        self, loops: IndexArray, angle: FloatArray, there: ComplexArray, real: BoolArray, disk: tuple[float, float]
    ) -> Margins:
        if np.abs(self.poles[loops]).max() >= 1:
            return Margins(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        hz = 1 / (2 * math.pi * self.body.sample_time_s)
        with np.errstate(divide="ignore"):  # nothing is rendered
            at, factor = angle[real] * hz, -1 / there[real].real
        up = np.where(factor > 1, factor, np.inf)
        lag = (np.angle(there[~real]) + math.pi) % (2 * math.pi)
        phase = np.append(np.degrees(np.minimum(lag, 2 * math.pi - lag)), np.inf)
        late, where = np.append(lag / angle[~real], np.inf), np.append(angle[~real] * hz, 0.0)
        return Margins(
            gain=float(up.min()),
            gain_down=float(np.max(factor, where=(factor > 0) & (factor <= 1), initial=0.0)),
            phase_deg=float(phase.min()),
            delay_samples=float(late.min()),
            disk=disk[0],
            gain_hz=float(at[up.argmin()]) if np.isfinite(up).any() else 0.0,
            phase_hz=float(where[phase.argmin()]),
            delay_hz=float(where[late.argmin()]),
            disk_hz=disk[1] * hz,
        )

    def _crossings(self, real: BoolArray, who: IndexArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the angles between two at which L of a hand becomes real, or of size 1."""

        def value(turn: FloatArray) -> FloatArray:
            gain = self.gain(turn[:, None], who)[:, 0]
            return np.where(real, gain.imag / np.abs(gain), np.log(np.abs(gain)))

        return root(value, low, high) if len(who) else low


def _swing(gain: ComplexArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):  # a gain of 1e300 is infinite
        return np.nan_to_num(np.abs((1 - gain) / (1 + gain)), nan=1.0, posinf=np.inf)


def _about(poles: ComplexArray) -> FloatArray:
    """Return angles of z about poles (..., 1), from within to far beyond their bandwidths."""
    bandwidth = np.maximum(np.abs(1 - np.abs(poles)), _LOWEST_TURN)
    return np.asarray(np.abs(np.angle(poles)) + bandwidth * np.sinh(np.linspace(-4.0, 4.0, 17)))


@dataclass(frozen=True)
class Transient:
    """How the loop in contact settles after an impact, on the device of `OpenLoop.of`: the worst of some hands."""

    settling_s: float
    damping_ratio: float
    frequency_hz: float


def damping_ratios(poles: ComplexArray) -> FloatArray:
    """Return the damping ratio of each pole; 1 of one that does not oscillate."""
    # A pole that turns less per sample does not oscillate; a smaller one is deadbeat.
    swings = (np.abs(np.angle(poles)) > 1e-6) & (np.abs(poles) > 1e-9)
    rate = np.log(np.where(swings, poles, 0.5))
    return np.asarray(-rate.real / np.abs(rate))


def transients(coupling: Coupling) -> tuple[Transient, Transient]:
    """Return the transients of the device in contact: released, and with the worst corner of the hands."""
    loop = OpenLoop.of(coupling)
    settling_s, ratios = loop.settling_s(), damping_ratios(loop.poles)
    hz = np.where(ratios < 1, np.abs(np.angle(loop.poles)), 0.0) / (2 * math.pi * loop.body.sample_time_s)
    sides = [(settling_s[some], ratios[some], hz[some]) for some in (slice(-1, None), slice(-1))]
    worst = ((seconds.max(), each.min(), turns.flat[each.argmin()]) for seconds, each, turns in sides)
    released, held = (Transient(*map(float, one)) for one in worst)
    return released, held
