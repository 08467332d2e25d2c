"""The emulated board as a link: the real firmware image on an emulated STM32F405, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from avc_hardware.codegen.boards import IMAGE
from avc_hardware.codegen.figures import BoardLimits, board_limits
from avc_hardware.codegen.firmware_fit import check_runs_on
from avc_hardware.codegen.image import read_elf
from avc_hardware.emulator.machine import CLOCK_HZ, Machine

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


_TAP_M = 4e-4
"""Amplitude of a hand that taps about the wall's face."""
_START_S = 2e-3
"""Time in which the firmware clears its memory and switches the serial port on: earlier bytes are lost."""


def tapping_hand(time_s: float) -> float:
    """Position of the hand on the emulated board, metres: 0.4 mm about the wall's face, 1 to 9 Hz and back in 8 s."""
    swing = 2 * math.pi * time_s / 8
    phase = 2 * math.pi * (5 * time_s - 4 * 8 / (2 * math.pi) * math.sin(swing))
    return _TAP_M * math.sin(phase)


def encoder_of(motion_m: Callable[[float], float], limits: BoardLimits) -> Callable[[int], int]:
    """Return the encoder of a motion, m of s: its count by the cycle of the processor."""
    return lambda cycle: round(motion_m(cycle / CLOCK_HZ) / limits.metres_per_count)


class EmulatedBoard:
    """A `ByteLink` to the firmware: time passes only while waiting for an answer."""

    def __init__(
        self,
        image: Path = IMAGE,
        *,
        limits: BoardLimits | None = None,
        encoder: Callable[[int], int] | None = None,
        on_force_code: Callable[[int], None] = lambda _: None,
        slice_cycles: int = CLOCK_HZ // 1000,
        on_instruction: Callable[[int], None] | None = None,
    ) -> None:
        """Start the firmware on a device that a hand taps with, or with another encoder, whose count is of a cycle."""
        self.limits = limits or BoardLimits()
        self.machine = Machine(
            read_elf(image),
            encoder=encoder or encoder_of(tapping_hand, self.limits),
            actuator=on_force_code,
            slice_cycles=slice_cycles,
            on_instruction=on_instruction,
        )
        self.machine.run_until(round(_START_S * CLOCK_HZ))

    @property
    def name(self) -> str:
        """Its name as a port."""
        return "emulator"

    def now_s(self) -> float:
        """Virtual time since the start, seconds."""
        return self.machine.cycle / CLOCK_HZ

    def write(self, data: bytes) -> None:
        """Send bytes over the virtual wire."""
        self.machine.send(data)

    def read(self, timeout_s: float) -> bytes:
        """Advance virtual time until the firmware has sent something, at most ``timeout_s``."""
        machine = self.machine
        machine.run_until(machine.cycle + max(1, round(timeout_s * CLOCK_HZ)), stop=lambda: bool(machine.sent))
        data = bytes(machine.sent)
        machine.sent.clear()
        return data

    def close(self) -> None:
        """Do nothing: there is no resource."""


def emulated_board(coupling: Coupling) -> EmulatedBoard:
    """Return a fresh emulated board of a coupling's device; a hand taps about the face that the coupling renders."""
    check_runs_on(coupling)
    device = coupling.problem.device
    feedback = coupling.runtime.state_feedback
    face_m = 0.0 if feedback is None else feedback.face_m
    limits = board_limits(device)

    def motion_m(time_s: float) -> float:
        return tapping_hand(time_s) / device.metres_per_unit - face_m

    return EmulatedBoard(limits=limits, encoder=encoder_of(motion_m, limits))
