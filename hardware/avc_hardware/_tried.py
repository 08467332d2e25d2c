"""A coupling tried on the firmware: pushed into the emulated board, then a hand presses the wall."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi import InputError
from avc_casadi.coupling import require_coupling
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.effects import HandEffect, WallEffect
from avc_casadi.model.registries import EFFECTS
from avc_casadi.simulation.judge import judge
from avc_casadi.simulation.population.motions import TRIAL_S, course_of
from avc_hardware._device_fault import DeviceFault
from avc_hardware._in_the_loop import FIRMWARE_KINDS, PLANT_KINDS, FirmwareInTheLoop

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.simulation.judge import Judgement
    from avc_hardware._device import DeviceStatus
    from avc_hardware._push import PushResult


@dataclass(frozen=True)
class LoopResult:
    """How the firmware held the wall.

    Attributes:
        seconds: that the hand pressed.
        judgement: figures of the last half second, as scenes are judged.
        peak_force_n: largest force on the output.
        left_out: effects of the problem's scene that the bench does not have.
        push: what the push came to.
        status: of the device in the end.
    """

    seconds: float
    judgement: Judgement
    peak_force_n: float
    left_out: tuple[str, ...]
    push: PushResult
    status: DeviceStatus

    @property
    def at_rest(self) -> bool:
        """Whether device and handle came to rest, by the scene's criterion, and holds the wall: it latched no fault."""
        return bool(self.judgement.stable) and not self.status.faults

    @property
    def apparent_stiffness_n_per_m(self) -> float:
        """Mean force over mean penetration in the end; not a number without contact."""
        return float(self.judgement.apparent_stiffness_n_per_m)

    @property
    def sentence(self) -> str:
        """What came of it, in one line."""
        if self.status.faults:
            word = DeviceFault(self.status.faults).word
            return f"with a hand for {self.seconds:g} s it STOPPED ITSELF and gives no force: {word}"
        stiffness = self.apparent_stiffness_n_per_m
        felt = f", {stiffness:.4g} N/m at the sensor in the end" if self.at_rest and math.isfinite(stiffness) else ""
        rest = "came to rest" if self.at_rest else "DID NOT COME TO REST"
        return f"with a hand for {self.seconds:g} s it {rest}; at most {self.peak_force_n:.3g} N{felt}"

    def document(self) -> dict[str, Any]:
        """Return the figures: JSON values only."""
        stiffness = self.apparent_stiffness_n_per_m
        return {
            "at_rest": self.at_rest,
            "sentence": self.sentence,
            "seconds": self.seconds,
            "peak_force_n": self.peak_force_n,
            "apparent_stiffness_n_per_m": stiffness if math.isfinite(stiffness) else None,
            "peak_velocity_m_per_s": float(self.judgement.peak_velocity_m_per_s),
            "mode": self.status.mode,
            "faults": DeviceFault(self.status.faults).word if self.status.faults else "",
            "overruns": self.status.overruns,
            "saturated_ticks": self.status.saturated,
            "coupling_id": self.status.coupling_id,
            "left_out": list(self.left_out),
        }


def tried_in_the_loop(coupling: Coupling, *, seconds: float | None = None, device: Device | None = None) -> LoopResult:
    """Push a coupling into an emulated board of its device, and press the wall with the middle hand of ``[hands]``.

    The hand moves as the problem's scene says; of the scene's effects those of the plant stay. Dry friction is left
    out, which would only help.

    Args:
        coupling: what is to run, at its own sample time, encoder and force limit.
        seconds: how long; None is the duration of the scene, and as much more as a hand alone swings on with a heavy
            device, where it still moves then.
        device: that is there in truth; None is the one that the coupling was made for.

    Raises:
        InputError: it is no coupling, or the duration is not a finite time above 0.
        FirmwareLacksError: the coupling needs what the firmware does not have.
        MissingExtraError: the emulator is not installed.
    """
    require_coupling(coupling)
    scene = coupling.problem.scene
    lasts = scene.duration_s if seconds is None else seconds
    if not (math.isfinite(lasts) and lasts > 0):
        raise InputError.of(f"{lasts:g} s; allowed: a finite time above 0", key="seconds")
    true = coupling.problem if device is None else coupling.problem.changed(device=device)
    there = scene_effects(true)
    kept = tuple(effect for effect in there if effect.kind in PLANT_KINDS and EFFECTS[effect.kind].role != "hand")
    own = PLANT_KINDS | FIRMWARE_KINDS | {"environment"}
    left_out = tuple(effect.kind for effect in there if effect.kind not in own)
    bench = true.changed(
        scene={"effects": (HandEffect(), WallEffect(), *kept), "duration_s": lasts, "integrator": "exact"}
    )
    loop = FirmwareInTheLoop(replace(coupling, problem=bench))
    pushed = loop.push(coupling)

    def after(more_s: float, whole_s: float) -> LoopResult:
        trace = loop.run(more_s)
        samples = min(len(trace.position_m), len(trace.force_n))
        position, velocity, force = (
            np.array(values[:samples]) for values in (trace.position_m, trace.velocity_m_per_s, trace.force_n)
        )
        return LoopResult(
            seconds=whole_s,
            judgement=judge(
                position,
                velocity,
                force,
                coupling.sample_time_s,
                coupling.problem.device.metres_per_unit,
                held_m_per_s=np.array(trace.held_m_per_s[:samples]) if trace.held_m_per_s else None,
            ),
            peak_force_n=float(np.abs(force).max(initial=0.0)),
            left_out=left_out,
            push=pushed,
            status=loop.status(),
        )

    found, swings_s = after(lasts, lasts), course_of(true).longest_s - TRIAL_S
    if seconds is None and swings_s > 0 and not (found.at_rest or found.status.faults):
        return after(swings_s, lasts + swings_s)
    return found
