"""What was declared of the loop: device, hands, and what is assumed where nothing is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import Device
from avc_casadi.model.hands import STYLUS_RANGES, Hand, hand_corners, joined
from avc_casadi.model.problem import Hands
from avc_casadi.model.rotary_defaults import turned_hands

# What a device on a desk is taken for where none is declared; the hand's ranges widen it.
_ASSUMED = {"mass_kg": 0.1, "damping_ns_per_m": 1.0, "delay_samples": 1.0}

# Mass, damping and stiffness of hardly any hand.
_LEAST_HAND = np.array([[1e-3], [0.1], [5.0]])


@dataclass(frozen=True)
class Declared:
    """The loop as it was meant to be.

    Attributes:
        device: as declared, or what is assumed.
        known: whether a device was declared.
        hands: ranges of the hands it was meant for.
        notes: what is assumed.
    """

    device: Device
    known: bool
    hands: Hands
    notes: tuple[str, ...]

    @classmethod
    def of(cls, device: Device | None, hands: Hands | None, sample_time_s: float) -> Declared:
        """Take what was declared, and assume the rest.

        Args:
            device: None where none was declared.
            hands: None for the usual ranges.
            sample_time_s: of the log, for a device that is assumed.
        """
        notes = []
        if device is None:
            device = Device.model_validate({**_ASSUMED, "sample_time_s": sample_time_s})
            notes.append(
                "no device was given: 0.1 kg and one sample of delay are assumed, within a factor of 3, so that a hand "
                "that let go is not told from one that holds; better: --device NAME|FILE"
            )
            return cls(device, known=False, hands=hands or Hands(), notes=tuple(notes))
        return cls(
            device, known=True, hands=hands or Hands.model_validate(turned_hands(device.metres_per_unit)), notes=()
        )

    @property
    def longest_delay(self) -> float:
        """Delay that was declared, samples of the device: the upper end where a range was."""
        most = self.device.range.delay_samples
        return float(self.device.delay_samples if most is None else most[1])

    def box(self) -> Hand:
        """Return the corners and the middle of the ranges of hands."""
        middle = [float(np.mean(ends)) for ends in self._ends()]
        ranges = self.hands
        held = Hands(
            mass_kg=ranges.mass_kg, damping_ns_per_m=ranges.damping_ns_per_m, stiffness_n_per_m=ranges.stiffness_n_per_m
        )
        return joined(hand_corners(held), Hand(*middle))

    def hand_prior(self) -> tuple[FloatArray, FloatArray]:
        """Return middle and spread of ln mass, damping and stiffness of the hand."""
        ends = np.log(np.maximum(self._ends(), self.device.metres_per_unit**2 * _LEAST_HAND))
        spread = np.maximum((ends[:, 1] - ends[:, 0]) / 2, 0.4)
        return ends.mean(axis=1), spread if self.known else np.maximum(spread, 1.1)

    def grip_prior(self) -> tuple[FloatArray, FloatArray]:
        """Return middle and spread of ln damping and stiffness of the grip of a hand on a stylus."""
        keys = ("grip_damping_ns_per_m", "grip_stiffness_n_per_m")
        ends = np.log(self.device.metres_per_unit**2 * np.array([STYLUS_RANGES[key] for key in keys]))
        return ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2

    def _ends(self) -> FloatArray:
        return np.array([self.hands.mass_kg, self.hands.damping_ns_per_m, self.hands.stiffness_n_per_m])
