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
from avc_casadi.loops.spectrum import eigenvalues, lowest, root
from avc_casadi.loops.wall import Rendering, closed, force_over_position, frozen_rendering
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.runtime import StateFeedback

LEAST_DISK, SOUND_DISK = 0.15, 0.2
"""Disk margins below which a coupling should not run on a device, and below which it is thin."""
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

    law: StateFeedback | None
    rendering: Rendering
    body: Body
    closed: FloatArray
    moving: BoolArray
    poles: ComplexArray

    @classmethod
    def of(cls, coupling: Coupling) -> Self:
        """Return the loop of a coupling, its gains with their runtime."""
        problem, law = coupling.problem, coupling.runtime.state_feedback
        corners = hand_corners(problem.hands.model_copy(update={"let_go": False}))
        rendering = frozen_rendering(problem, *vars(coupling.table.at_rest).values())
        return cls.around(sampled_plant(problem.device, with_released(corners)), rendering, law)

    @classmethod
    def around(cls, plant: SampledPlant, rendering: Rendering, law: StateFeedback | None = None) -> Self:
        """Return the loop of one rendering around h plants, the last released."""
        body = Body.of(plant).flat()
        loops = closed(body, rendering, law)
        moving = np.array([name.endswith("velocity_m_per_s") for name in plant.names])
        return cls(
            law=law,
            rendering=rendering,
            body=body,
            closed=loops,
            moving=np.pad(moving, (0, loops.shape[-1] - len(moving))),
            poles=eigenvalues(loops),
        )

    @property
    def sample_time_s(self) -> float:
        """T."""
        return self.body.sample_time_s

    def __len__(self) -> int:
        return len(self.closed)

    def gain(self, turn: FloatArray, who: IndexArray | slice = slice(None)) -> ComplexArray:
        """Return L at z = exp(j turn)."""
        body = self.body.axes(who)
        angles = np.broadcast_to(turn, (len(body.a), np.shape(turn)[-1]))
        z = np.exp(1j * angles)
        pencil = z[..., None, None] * np.eye(body.size) - body.a[:, None]
        pushed = np.broadcast_to(body.b[:, None], (*angles.shape, body.size))
        position = np.linalg.solve(pencil, pushed.astype(np.complex128)[..., None])[..., 0] @ body.measured
        force = force_over_position(self.rendering, z.ravel(), self.law).reshape(angles.shape)
        return np.asarray(-force * position)

    def turns(self) -> FloatArray:
        """Return angles of z at which L is evaluated, dense at peaks of it or of 1/(1 + L), shape (n,)."""
        poles = np.concatenate([self.poles.ravel(), np.linalg.eigvals(self.body.a).ravel()])
        poles = poles[np.abs(poles) > _LOWEST_TURN]
        about = _about(poles[:, None])
        about = about[(about > _LOWEST_TURN) & (about < math.pi)]
        return np.unique(np.concatenate([np.geomspace(_LOWEST_TURN, math.pi, 200), about]))

    def struck(self, speed_m_per_s: float, samples: int) -> FloatArray:
        """Return the position of a device that meets its wall at a speed, the wall two-sided, shape (h, samples)."""
        state = np.broadcast_to(self.moving * speed_m_per_s * self.sample_time_s, self.poles.shape)
        found = np.empty((len(state), samples))
        for sample in range(samples):
            found[:, sample] = state[:, : self.body.size] @ self.body.measured
            state = (self.closed @ state[..., None])[..., 0]
        return found

    def margins(self) -> tuple[Margins, Margins]:
        """Return the margins of the device released, the last loop, and the smallest of those with hands."""
        alone = np.arange(len(self)) == len(self) - 1
        return self.least(alone), self.least(~alone)

    def least(self, some: BoolArray | slice = slice(None)) -> Margins:
        """Return the smallest margins of some of the loops, or of all."""
        loops = np.arange(len(self))[some]
        turn = self.turns()
        gain = self.gain(turn, loops)
        of_phase = np.stack([np.sign(gain.imag), np.sign(np.abs(gain) - 1)])
        kind, row, place = np.nonzero(of_phase[..., :-1] * of_phase[..., 1:] < 0)
        who = loops[row]
        crossed = self._crossings(kind == 0, who, turn[place], turn[place + 1])
        there = self.gain(crossed[:, None], who)[:, 0] if len(who) else np.empty(0, dtype=np.complex128)
        # L is real at half the sample rate, the last angle.
        crossed, there = np.append(crossed, np.full(len(loops), math.pi)), np.append(there, gain[:, -1])
        return self._of_crossings(
            loops, crossed, there, np.append(kind == 0, loops >= 0), self._disk(loops, turn, gain)
        )

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
        self, loops: IndexArray, crossed: FloatArray, there: ComplexArray, real: BoolArray, disk: tuple[float, float]
    ) -> Margins:
        poles = self.poles[loops].ravel()
        # At a wall without a spring any position is an equilibrium.
        if np.abs(poles[np.abs(poles - 1) > 1e-9]).max(initial=0.0) >= 1:
            return Margins(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        hz = 1 / (2 * math.pi * self.sample_time_s)
        with np.errstate(divide="ignore"):  # nothing is rendered
            at, factor = crossed[real] * hz, -1 / there[real].real
        up = np.where(factor > 1, factor, np.inf)
        lag = (np.angle(there[~real]) + math.pi) % (2 * math.pi)
        phase = np.append(np.degrees(np.minimum(lag, 2 * math.pi - lag)), np.inf)
        late, where = np.append(lag / crossed[~real], np.inf), np.append(crossed[~real] * hz, 0.0)
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


SETTLED = 0.02
"""Share of its initial amplitude below which an oscillation counts as settled."""


@dataclass(frozen=True)
class Transient:
    """How the loop in contact settles, on the nominal device."""

    settling_s: float
    damping_ratio: float
    frequency_hz: float

    @classmethod
    def of(cls, poles: ComplexArray, sample_time_s: float) -> Transient:
        """Return the worst of the poles of some loops."""
        ratio = damping_ratios(poles)
        worst = int(np.argmin(ratio))
        hz = np.abs(np.angle(poles[worst])) / (2 * math.pi * sample_time_s) if ratio[worst] < 1 else 0.0
        radius = np.abs(poles[_swings(poles)]).max(initial=0.0)
        settling_s = sample_time_s * math.log(SETTLED) / math.log(radius) if 0 < radius < 1 else 0.0
        return cls(settling_s if radius < 1 else math.inf, float(ratio[worst]), float(hz))


def damping_ratios(poles: ComplexArray) -> FloatArray:
    """Return the damping ratio of each pole; 1 of one that does not oscillate."""
    rate = np.log(np.where(_swings(poles), poles, 0.5))
    return np.asarray(-rate.real / np.abs(rate))


def _swings(poles: ComplexArray) -> BoolArray:
    # A pole that turns less per sample does not oscillate; a smaller one is deadbeat.
    return np.asarray((np.abs(np.angle(poles)) > 1e-6) & (np.abs(poles) > 1e-9))


def transients(coupling: Coupling) -> tuple[Transient, Transient]:
    """Return the transients of the device in contact: released, and with the worst corner of the hands."""
    loop = OpenLoop.of(coupling)
    return Transient.of(loop.poles[-1], loop.sample_time_s), Transient.of(loop.poles[:-1].ravel(), loop.sample_time_s)
