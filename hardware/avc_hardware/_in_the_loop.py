"""Hardware in the loop: the plant of a scene in Python, the firmware image on the emulated core, in lock step.

At every tick the plant moves by one sample under the force that the firmware has put on its output (12 bits), and the
encoder shows where it is. The link stays open meanwhile: tables may be pushed while the hand presses. Nothing depends
on the computer's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from avc_casadi import InputError, Problem, UnsupportedError
from avc_casadi.coupling import GainSchedule
from avc_casadi.loop import DEVICE, GROUND, Plant, transition
from avc_casadi.scene import target_of
from avc_casadi.scene.effects import build_effects
from avc_hardware._connection import Connection
from avc_hardware._emulator import METRES_PER_COUNT, EmulatedBoard
from avc_hardware._machine import CLOCK_HZ
from avc_hardware._messages import DeviceStatus, Kind
from avc_hardware._push import PushResult, push_over
from avc_hardware._qemu import LockStepBoard
from avc_hardware._table import TableSettings, Wall

_CODE_ZERO, _CODE_FULL = 2048, 2047
# Effects that are part of the plant or of the firmware; the others the bench does not have.
_KNOWN = {"hand", "stylus-hand", "viscous-friction", "resonance", "wall", "encoder", "estimator", "adaptation", "guard"}


@dataclass
class LoopTrace:
    """What happened at every tick since the motion began; lists grow as time passes.

    Attributes:
        position_m: true position of the device.
        velocity_m_per_s: true velocity.
        force_n: on the output of the firmware, held from this tick to the next.
    """

    position_m: list[float] = field(default_factory=list)
    velocity_m_per_s: list[float] = field(default_factory=list)
    force_n: list[float] = field(default_factory=list)


class FirmwareInTheLoop:
    """A device with a hand on it, driven by the firmware image.

    Attributes:
        trace: what has happened so far.
        board: the emulated board, a link.
        connection: the open link to it.
    """

    def __init__(self, problem: Problem, *, qemu: tuple[Path, str] | None = None) -> None:
        """Build the plant of the problem's scene, start the firmware, and open the link.

        Args:
            problem: its scene may have a hand, a wall and what the firmware does itself.
            qemu: image and name of a bench target, to run in QEMU; its output has no steps. Call `stop` in the end.

        Raises:
            InputError: the problem's sample time is not the firmware's.
            UnsupportedError: the scene has an effect that the bench does not have.
        """
        effects = build_effects(problem)
        foreign = [effect.kind for effect in effects if effect.kind not in _KNOWN]
        if foreign:
            raise UnsupportedError(
                f"{problem.name}: the bench has no {', '.join(foreign)}; allowed: {', '.join(sorted(_KNOWN))}"
            )
        plant = Plant()
        plant.add_mass(DEVICE, problem.device.mass_kg)
        plant.join(DEVICE, GROUND, 0.0, problem.device.damping_ns_per_m)
        for effect in effects:
            effect.mechanics(plant)
        time_s = problem.device.sample_time_s
        self._step = transition(plant.linear(), time_s)
        self._target = target_of(problem.scene.motion, max(1, round(problem.scene.duration_s / time_s)), time_s)
        self._state = np.zeros(self._step.matrix.shape[-1])
        self._state[0] = self._target.device_start_m
        self._force_n = 0.0
        self._sample = -1  # the motion has not begun
        self._most_n = 0.0
        self._settings = TableSettings(
            wall=Wall(problem.environment.damping_ns_per_m, problem.environment.stiffness_n_per_m)
        )
        self.trace = LoopTrace()
        self.board: EmulatedBoard | LockStepBoard
        if qemu is None:
            self.board = EmulatedBoard(encoder=lambda _: self._encoder(), on_force_code=self._actuate)
        else:
            self.board = LockStepBoard(*qemu, position=lambda _: self._encoder())
            self.board.on_force = self._hold
        self.connection = Connection(self.board, session=1)
        self._most_n = self.connection.device.max_force_n
        if not np.isclose(self.connection.device.sample_time_s, time_s, rtol=1e-6):
            raise InputError.of(
                f"is {time_s:g} s; allowed: {self.connection.device.sample_time_s:g}, the firmware's",
                file=problem.name,
                key="device.sample_time_s",
            )

    def push(self, gains: GainSchedule, settings: TableSettings | None = None) -> PushResult:
        """Push a table; the plant goes on meanwhile. The wall is the problem's unless the settings say otherwise."""
        return push_over(self.connection, gains, settings=settings or self._settings)

    def run(self, seconds: float) -> LoopTrace:
        """Let time pass; the first call begins the motion."""
        self._sample = max(self._sample, 0)
        if isinstance(self.board, EmulatedBoard):
            self.board.machine.run_until(self.board.machine.cycle + round(seconds * CLOCK_HZ))
        else:
            for _ in range(round(seconds / self.connection.device.sample_time_s)):
                self.board.tick()
        return self.trace

    def stop(self) -> None:
        """End an emulator that runs as a process of its own."""
        if isinstance(self.board, LockStepBoard):
            self.board.stop()

    def status(self) -> DeviceStatus:
        """Ask the firmware for its state."""
        return self.connection.run(self.connection.session.ask(Kind.STATUS, b"", DeviceStatus))

    def _encoder(self) -> int:
        """Move the plant from the last tick to this one."""
        last = len(self._target.position_m) - 1
        before = self._sample - 1  # the interval that ends now
        moves = self._target.velocity_m_per_s[before] if 0 <= before <= last else 0.0
        target = np.array([self._target.position_m[min(max(before, 0), last)], moves])
        self._state = self._step.matrix @ self._state + self._step.force * self._force_n + self._step.target @ target
        if self._sample >= 0:
            self._sample += 1
            self.trace.position_m.append(float(self._state[0]))
            self.trace.velocity_m_per_s.append(float(self._state[1]))
        return round(float(self._state[0]) / METRES_PER_COUNT)

    def _actuate(self, code: int) -> None:
        self._hold((code - _CODE_ZERO) / _CODE_FULL * self._most_n)

    def _hold(self, force_n: float) -> None:
        self._force_n = force_n
        if self._sample >= 0 and self.trace.position_m:
            self.trace.force_n.append(self._force_n)
