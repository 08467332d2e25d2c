"""Hardware in the loop: the plant of a scene in Python, the firmware image on the emulated core, in lock step."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from avc_casadi import UnsupportedError
from avc_casadi._util.json_values import Document
from avc_casadi.coupling import Coupling, require_coupling
from avc_casadi.model import EFFECTS
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.effects import HandEffect, WallEffect
from avc_casadi.model.plant import HANDLE
from avc_casadi.simulation.compile import build_effects, mechanics_of, target_of
from avc_casadi.simulation.effects.interface import Delay
from avc_casadi.simulation.judge import Traces
from avc_casadi.simulation.population.motions import TRIAL_S, course_of
from avc_hardware.codegen.figures import board_limits, device_config
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.emulator.bench import BenchPlant, force_of_code
from avc_hardware.emulator.board import EmulatedBoard
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link.connection import Connection
from avc_hardware.link.device import DeviceStatus
from avc_hardware.link.faults import DeviceFault
from avc_hardware.link.push import PushResult, push_over

if TYPE_CHECKING:
    from avc_casadi import Problem
    from avc_casadi.model.device import Device
    from avc_casadi.simulation.judge import Judgement


PLANT_KINDS = frozenset({"hand", "stylus-hand", "viscous-friction", "resonance", "amplifier", "delay"})
"""Effects of a scene on the bench, beside those of the firmware."""
_FIRMWARE_KINDS = frozenset({"wall", "encoder", "state-feedback", "estimator", "adaptation", "guard", "saturation"})
"""Effects that the firmware itself has."""


@dataclass
class LoopTrace:
    """Trace of every tick since the motion began; lists grow with time."""

    position_m: list[float] = field(default_factory=list)
    velocity_m_per_s: list[float] = field(default_factory=list)
    force_n: list[float] = field(default_factory=list)
    handle_m_per_s: list[float] = field(default_factory=list)


class FirmwareInTheLoop:
    """A device with a hand on it, driven by the firmware image."""

    def __init__(self, of: Coupling | Problem) -> None:
        """Build the plant of the problem's scene, start the firmware, and open the link; no table runs yet."""
        problem = of.problem if isinstance(of, Coupling) else of
        limits = board_limits(problem.device)
        effects = build_effects(problem)
        foreign = {effect.kind for effect in effects} - PLANT_KINDS - _FIRMWARE_KINDS
        if foreign:
            raise UnsupportedError(f"{problem.name}: the emulated board does not simulate {', '.join(sorted(foreign))}")
        time_s = limits.sample_time_s
        self._target = target_of(problem.scene.motion, max(1, round(problem.scene.duration_s / time_s)), time_s)
        late = sum(effect.table.samples for effect in effects if isinstance(effect, Delay))
        linear = mechanics_of(problem, effects)
        held = f"{HANDLE}_velocity_m_per_s"
        self._handle = linear.names.index(held) if held in linear.names else None
        self._plant = BenchPlant(linear, time_s, delay_samples=late)
        self._plant.place(self._target.device_start_m)
        self._sample = -1  # the motion has not begun
        self._limits = limits
        self.trace = LoopTrace()
        self.board = EmulatedBoard(limits=limits, encoder=lambda _: self._encoder(), on_force_code=self._actuate)
        self.connection = Connection(self.board, session=1)
        self.connection.configure(packed_config(device_config(problem.device)))
        # Its encoder and its output are those of this device, whatever a coupling was made for.
        self.connection.device = replace(self.connection.device, bound=True)

    def push(self, coupling: Coupling) -> PushResult:
        """Push a coupling; the plant moves meanwhile."""
        return push_over(self.connection, coupling)

    def run(self, seconds: float) -> LoopTrace:
        """Advance time; the first call begins the motion."""
        self._sample = max(self._sample, 0)
        self.board.machine.run_until(self.board.machine.cycle + round(seconds * CLOCK_HZ))
        return self.trace

    def status(self) -> DeviceStatus:
        """Query the state of the firmware."""
        return self.connection.status()

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
                self.trace.handle_m_per_s.append(float(self._plant.state[self._handle]))
        return round(position_m / self._limits.metres_per_count)

    def _actuate(self, code: int) -> None:
        force_n = force_of_code(code, self._limits.max_force_n)
        self._plant.hold(force_n)
        if self._sample >= 0 and self.trace.position_m:
            self.trace.force_n.append(force_n)


@dataclass(frozen=True)
class LoopResult(Document):
    """Result of a press on the wall."""

    JSON_KEYS: ClassVar = (
        "at_rest",
        "seconds",
        "peak_force_n",
        "apparent_stiffness_n_per_m",
        "peak_velocity_m_per_s",
        "mode",
        "faults",
        "overruns",
        "saturated_ticks",
        "coupling_id",
        "left_out",
    )

    seconds: float
    judgement: Judgement
    peak_force_n: float
    left_out: tuple[str, ...]
    push: PushResult
    status: DeviceStatus

    @property
    def at_rest(self) -> bool:
        """Whether device and handle settled, by the scene's criterion, and no fault was latched."""
        return bool(self.judgement.stable) and not self.status.faults

    @property
    def apparent_stiffness_n_per_m(self) -> float:
        """Mean force over mean penetration at the end; NaN without contact."""
        return float(self.judgement.apparent_stiffness_n_per_m)

    @property
    def peak_velocity_m_per_s(self) -> float:
        """Largest speed at the end, of device or handle."""
        return float(self.judgement.peak_velocity_m_per_s)

    @property
    def mode(self) -> str:
        """Mode of the device afterwards."""
        return self.status.mode

    @property
    def faults(self) -> str:
        """Latched faults in words; empty without any."""
        return DeviceFault(self.status.faults).word

    @property
    def overruns(self) -> int:
        """Ticks that took too long."""
        return self.status.overruns

    @property
    def saturated_ticks(self) -> int:
        """Ticks at the force limit."""
        return self.status.saturated

    @property
    def coupling_id(self) -> str:
        """The coupling that the device ran."""
        return self.push.device.coupling_id


def tried_in_the_loop(coupling: Coupling, *, device: Device | None = None) -> LoopResult:
    """Push a coupling into an emulated board of its device, and press the wall with the central hand of ``[hands]``."""
    require_coupling(coupling)
    true = coupling.problem if device is None else coupling.problem.changed(device=device)
    listed = scene_effects(true)
    kept = tuple(effect for effect in listed if effect.kind in PLANT_KINDS and EFFECTS[effect.kind].role != "hand")
    on_bench = PLANT_KINDS | _FIRMWARE_KINDS | {"environment"}
    left_out = tuple(effect.kind for effect in listed if effect.kind not in on_bench)
    bench = true.changed(scene={"effects": (HandEffect(), WallEffect(), *kept), "integrator": "exact"})
    loop = FirmwareInTheLoop(bench)
    lasts_s = bench.scene.duration_s
    pushed = loop.push(coupling)

    def after(more_s: float, whole_s: float) -> LoopResult:
        trace = loop.run(more_s)
        samples = min(len(trace.position_m), len(trace.force_n))
        force = np.array(trace.force_n[:samples])
        traces = Traces(
            position_m=np.array(trace.position_m[:samples]),
            velocity_m_per_s=np.array(trace.velocity_m_per_s[:samples]),
            force_n=force,
            sample_time_s=coupling.sample_time_s,
            metres_per_unit=coupling.problem.device.metres_per_unit,
            handle_m_per_s=np.array(trace.handle_m_per_s[:samples]) if trace.handle_m_per_s else None,
        )
        return LoopResult(
            seconds=whole_s,
            judgement=traces.judge(),
            peak_force_n=float(np.abs(force).max(initial=0.0)),
            left_out=left_out,
            push=pushed,
            status=loop.status(),
        )

    result = after(lasts_s, lasts_s)
    swings_s = course_of(true).duration_s - TRIAL_S
    if swings_s > 0 and not (result.at_rest or result.status.faults):
        return after(swings_s, lasts_s + swings_s)
    return result
