"""Hardware in the loop: the plant of a scene in Python, the firmware image on the emulated core, in lock step.

At every tick the plant moves by one sample under the force that the firmware has put on its output (12 bits), and the
encoder shows where it is. The link stays open meanwhile: couplings may be pushed while the hand presses. Nothing
depends on the computer's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi import InputError, UnsupportedError
from avc_casadi.coupling import Coupling
from avc_casadi.model.plant import DEVICE, GROUND, HANDLE, Plant
from avc_casadi.simulation.effects.actuation import Saturation
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.effects.sensing import Delay
from avc_casadi.simulation.motion import target_of
from avc_hardware._bench_plant import BenchPlant, force_of_code
from avc_hardware._connection import Connection
from avc_hardware._device import DeviceStatus
from avc_hardware._emulator import EmulatedBoard
from avc_hardware._machine import CLOCK_HZ
from avc_hardware._messages import Kind
from avc_hardware._push import PushResult, push_over
from avc_hardware._qemu import LockStepBoard
from avc_hardware._runs_on import emulated_board, limits_of

if TYPE_CHECKING:
    from avc_casadi import Problem
    from avc_hardware._host import BoardLimits

PLANT_KINDS = frozenset({"hand", "stylus-hand", "viscous-friction", "resonance", "amplifier", "delay"})
"""Effects of a scene that the bench has, beside what the firmware does itself."""
FIRMWARE_KINDS = frozenset({"wall", "encoder", "state-feedback", "estimator", "adaptation", "guard", "saturation"})
"""What the firmware does itself."""


@dataclass
class LoopTrace:
    """What happened at every tick since the motion began; lists grow as time passes.

    Attributes:
        position_m: true position of the device.
        velocity_m_per_s: true velocity.
        force_n: on the output of the firmware, held from this tick to the next.
        held_m_per_s: true velocity of the handle, where that is another body; empty where it is not.
    """

    position_m: list[float] = field(default_factory=list)
    velocity_m_per_s: list[float] = field(default_factory=list)
    force_n: list[float] = field(default_factory=list)
    held_m_per_s: list[float] = field(default_factory=list)


class FirmwareInTheLoop:
    """A device with a hand on it, driven by the firmware image.

    Attributes:
        trace: what has happened so far.
        board: the emulated board, a link.
        connection: the open link to it.
    """

    def __init__(self, of: Coupling | Problem, *, qemu: tuple[Path, str] | None = None) -> None:
        """Build the plant of the problem's scene, start the firmware, and open the link; no table runs yet.

        Args:
            of: a coupling, whose settings the firmware gets; or a problem. Sample time, encoder and force limit are
                those of its device; where it says nothing, 2 um and 50 N.
            qemu: image and name of a bench target, to run in QEMU; its output has no steps. Call `stop` in the end.

        Raises:
            InputError: QEMU's image has another sample time or encoder.
            UnsupportedError: the scene has an effect that the bench does not have, or the firmware cannot run so.
        """
        problem = of.problem if isinstance(of, Coupling) else of
        limits = limits_of(problem)
        effects = build_effects(problem)
        _check(problem, effects, limits)
        plant = Plant()
        plant.add_mass(DEVICE, problem.device.mass_kg)
        plant.join(DEVICE, GROUND, 0.0, problem.device.damping_ns_per_m)
        for effect in effects:
            effect.mechanics(plant)
        time_s = limits.sample_time_s
        self._target = target_of(problem.scene.motion, max(1, round(problem.scene.duration_s / time_s)), time_s)
        late = sum(effect.samples for effect in effects if isinstance(effect, Delay))
        linear = plant.linear()
        held = f"{HANDLE}_velocity_m_per_s"
        self._handle = linear.names.index(held) if held in linear.names else None
        self._plant = BenchPlant(linear, time_s, delay_samples=late)
        self._plant.place(self._target.device_start_m)
        self._sample = -1  # the motion has not begun
        self._limits = limits
        self.trace = LoopTrace()
        self.board = self._board(of, qemu)
        self.connection = Connection(self.board, session=1)
        device = self.connection.device
        if not np.allclose(
            [device.sample_time_s, device.metres_per_count], [time_s, limits.metres_per_count], rtol=1e-6
        ):
            self.stop()
            raise InputError.of(
                f"has T = {time_s:g} s and encoder steps of {limits.metres_per_count:g} m; allowed in QEMU: "
                f"{device.sample_time_s:g} s and {device.metres_per_count:g} m, those of its image",
                file=problem.name,
                key="device",
            )

    def _board(self, of: Coupling | Problem, qemu: tuple[Path, str] | None) -> EmulatedBoard | LockStepBoard:
        if qemu is not None:
            board = LockStepBoard(*qemu, position=lambda _: self._encoder())
            board.on_force = self._hold
            return board
        if isinstance(of, Coupling):
            return emulated_board(of, encoder=lambda _: self._encoder(), on_force_code=self._actuate)
        return EmulatedBoard(limits=self._limits, encoder=lambda _: self._encoder(), on_force_code=self._actuate)

    def push(self, coupling: Coupling) -> PushResult:
        """Push a coupling; the plant goes on meanwhile."""
        return push_over(self.connection, coupling)

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
        self._plant.advance(target)
        position_m, velocity_m_per_s = map(float, self._plant.state[:2])
        if self._sample >= 0:
            self._sample += 1
            self.trace.position_m.append(position_m)
            self.trace.velocity_m_per_s.append(velocity_m_per_s)
            if self._handle is not None:
                self.trace.held_m_per_s.append(float(self._plant.state[self._handle]))
        return round(position_m / self._limits.metres_per_count)

    def _actuate(self, code: int) -> None:
        self._hold(force_of_code(code, self._limits.max_force_n))

    def _hold(self, force_n: float) -> None:
        self._plant.hold(force_n)
        if self._sample >= 0 and self.trace.position_m:
            self.trace.force_n.append(force_n)


def _check(problem: Problem, effects: tuple[SceneEffect, ...], limits: BoardLimits) -> None:
    foreign = [effect.kind for effect in effects if effect.kind not in PLANT_KINDS | FIRMWARE_KINDS]
    if foreign:
        raise UnsupportedError(
            f"{problem.name}: the bench has no {', '.join(foreign)}; allowed: "
            f"{', '.join(sorted(PLANT_KINDS | FIRMWARE_KINDS))}"
        )
    for effect in effects:
        if isinstance(effect, Saturation) and effect.force_n != limits.max_force_n:
            raise UnsupportedError(
                f"{problem.name}: the scene limits the force at {effect.force_n:g} N, the board at "
                f"{limits.max_force_n:g} N; set device.max_force_n instead"
            )
