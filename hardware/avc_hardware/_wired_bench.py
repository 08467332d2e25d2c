"""A device on the bench that is wired rightly or wrongly, with the hand that commissioning asks for."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from avc_hardware._bench_plant import BenchDevice, force_of_code
from avc_hardware._emulator import EmulatedBoard

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

# The hand: when it is where, as shares of the way that it makes; then it lets go.
_TIMES_S = (0.0, 0.8, 1.6, 2.8, 3.6, 5.2)
_SHARES = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0)


class Wiring(StrEnum):
    """How a device on the bench is wired."""

    RIGHT = "right"
    ENCODER_REVERSED = "encoder-reversed"
    ENCODER_STUCK = "encoder-stuck"
    MOTOR_REVERSED = "motor-reversed"
    MOTOR_DEAD = "motor-dead"


class WiredBench:
    """A device that a hand first pushes into the wall and draws back, and then lets go.

    Attributes:
        device: on the bench.
    """

    def __init__(self, declared: Device, wiring: Wiring = Wiring.RIGHT, *, way_m: float = 0.01) -> None:
        """Put a device at rest at 0.

        Args:
            declared: what moves.
            wiring: of motor and encoder.
            way_m: that the hand makes into the wall.
        """
        self.device = BenchDevice(declared)
        self._wiring = wiring
        self._way_m = way_m
        self._period_s = declared.sample_time_s
        self._ticks = 0

    def count(self) -> int:
        """Move to the next tick; return what the encoder shows."""
        time_s = self._ticks * self._period_s
        self._ticks += 1
        shown = self.device.count()
        if time_s < _TIMES_S[-1]:
            place = self._way_m * float(np.interp(time_s, _TIMES_S, _SHARES))
            self.device.plant.place(place)
            shown = round(place / self.device.limits.metres_per_count)
        if self._wiring is Wiring.ENCODER_STUCK:
            return 0
        return -shown if self._wiring is Wiring.ENCODER_REVERSED else shown

    def hold(self, force_n: float) -> None:
        """Take the force of this tick, positive against +x."""
        gain = {Wiring.MOTOR_REVERSED: -1.0, Wiring.MOTOR_DEAD: 0.0}.get(self._wiring, 1.0)
        self.device.hold(gain * force_n)

    def board(self) -> EmulatedBoard:
        """Return the firmware image on an emulated board with this device on it.

        Raises:
            MissingExtraError: the emulator is not installed.
        """
        limits = self.device.limits
        encoder: Callable[[int], int] = lambda _: self.count()  # noqa: E731 - beside the actuator's
        return EmulatedBoard(
            limits=limits,
            encoder=encoder,
            on_force_code=lambda code: self.hold(force_of_code(code, limits.max_force_n)),
        )
