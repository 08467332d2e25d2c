"""A device on an emulated board: linear mechanics, dry friction with sticking, delay, encoder and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.model.plant import LinearPlant, Transition, device_plant, transition
from avc_hardware.codegen.figures import board_limits
from avc_hardware.emulator.board import EmulatedBoard

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.model.device import Device


_CODE_ZERO = 2048
"""Code of the 12-bit output for no force."""
_CODE_FULL = 2047
"""Codes from there to the full force."""
_LEAST_SHARE = 1e-9
"""Share of a sample below which a part of it is none."""
_PARTS = 16  # of a sample, where friction may reverse: the velocity changes evenly within each


@dataclass(frozen=True)
class _Part:
    """A part of a sample under a constant force and constant friction."""

    step: Transition
    friction: FloatArray

    def moved(self, state: FloatArray, force_n: float, target: FloatArray, friction_n: float) -> FloatArray:
        """Return the state after it; both forces are positive against +x."""
        step = self.step
        return step.matrix @ state + step.force * force_n + step.target @ target + self.friction * friction_n


class BenchPlant:
    """A device that moves from sample to sample under the force that has arrived."""

    def __init__(
        self, plant: LinearPlant, sample_time_s: float, *, friction_n: float = 0.0, delay_samples: float = 0.0
    ) -> None:
        """Put a plant at rest, with exact transitions over a sample, and friction in sixteenths of it."""
        whole = int(delay_samples)
        late = delay_samples - whole
        self._friction_n = friction_n
        # Until the newer force arrives, and after: in one step, and in short ones in which friction reverses.
        self._halves = [
            (_part(plant, share * sample_time_s), _part(plant, share * sample_time_s / _PARTS), newer)
            for share, newer in ((late, False), (1.0 - late, True))
            if share > _LEAST_SHARE
        ]
        self._positions = [index for index, name in enumerate(plant.names) if name.endswith("_position_m")]
        self.state: FloatArray = np.zeros(plant.states)
        self._asked = [0.0] * (whole + 2)

    def place(self, position_m: float) -> None:
        """Put every body at a position, at rest, without stretch between them."""
        self.state[:] = 0.0
        self.state[self._positions] = position_m

    def hold(self, force_n: float) -> None:
        """Command a force, positive against +x, from now on."""
        self._asked = [*self._asked[1:], force_n]

    def advance(self, target: FloatArray) -> None:
        """Move by one sample, under the force that has arrived and the hand's target; friction stops it inside."""
        older, newer = self._asked[:2]
        for whole, part, is_newer in self._halves:
            force = newer if is_newer else older
            before = float(self.state[1])
            after = whole.moved(self.state, force, target, math.copysign(self._friction_n, before))
            if self._friction_n and not before * after[1] > 0:
                after = self.state
                for _ in range(_PARTS):
                    before, free = float(after[1]), part.moved(after, force, target, 0.0)
                    held = _friction(before, float(free[1]), -float(part.friction[1]), self._friction_n)
                    after = free + part.friction * held
            self.state = after


def _friction(before: float, free: float, ease: float, most_n: float) -> float:
    """Return the mean friction over a part of a sample, N, against +x: sliding, or stopping and sticking or reversing.

    `before` is the velocity then and `free` that without friction; a force of 1 N changes it by `ease`, m/s.
    """
    held = min(max((free - before) / ease, -most_n), most_n)
    if before == 0:
        return held
    slides = math.copysign(most_n, before)
    after = free - slides * ease
    if after * before >= 0:
        return slides
    share = before / (before - after)
    return share * slides + (1 - share) * held


def _part(plant: LinearPlant, seconds: float) -> _Part:
    rubbing = LinearPlant(plant.names, plant.matrix, plant.friction, plant.target, plant.friction)
    return _Part(transition(plant, seconds), transition(rubbing, seconds).force)


class BenchDevice:
    """A device without a hand on it: `count` reads its encoder, once a tick, `hold` drives its actuator."""

    def __init__(self, device: Device, *, seed: int = 0) -> None:
        """Put a device at rest at 0."""
        linear = device_plant(device).linear()
        self.limits = board_limits(device)
        self.plant = BenchPlant(
            linear,
            device.sample_time_s,
            friction_n=device.coulomb_friction_n,
            delay_samples=device.delay_samples,
        )
        self._seen = 2 if device.resonance is not None and device.encoder_at == "handle" else 0
        self._noise_m = device.position_noise_rms_m
        self._random = np.random.default_rng(seed)
        self._still = np.zeros(2)
        self.speed_m_per_s: list[float] = []

    def count(self) -> int:
        """Move to the next tick; return the encoder count."""
        self.plant.advance(self._still)
        seen = float(self.plant.state[self._seen])
        self.speed_m_per_s.append(float(self.plant.state[1]))
        if self._noise_m:
            seen += self._noise_m * float(self._random.standard_normal())
        return round(seen / self.limits.metres_per_count)

    def hold(self, force_n: float) -> None:
        """Apply the force of this tick, positive against +x."""
        self.plant.hold(force_n)

    def board(self) -> EmulatedBoard:
        """Return the firmware image on an emulated board with this device on it."""
        return EmulatedBoard(
            limits=self.limits,
            encoder=lambda _: self.count(),
            on_force_code=lambda code: self.hold(force_of_code(code, self.limits.max_force_n)),
        )


def code_of_force(force_n: Any, full_n: float) -> Any:
    """Return the 12-bit code of the output for a force, N, as the board's own firmware rounds it."""
    return np.floor(_CODE_ZERO + _CODE_FULL * (np.asarray(force_n) / full_n) + 0.5)


def force_of_code(code: Any, full_n: float) -> Any:
    """Return the force of a 12-bit code of the output, N."""
    return (code - _CODE_ZERO) / _CODE_FULL * full_n
