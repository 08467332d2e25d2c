"""A device with the hand that holds it, as a log may bear them out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand

# Samples; what a device may have at least beside none.
_SHORTEST_DELAY = 1e-3


@dataclass(frozen=True)
class Answer:
    """A device with the hand that holds it.

    Attributes:
        device: with its delay from the commanded force to the motion.
        hand: None let go.
    """

    device: Device
    hand: Hand | None

    def without_mode(self) -> Answer:
        """Return the same with rigid mechanics."""
        return Answer(device_as(self.device, {"resonance": None}), self.hand)

    def delayed(self, samples: float) -> Answer:
        """Return the same with another delay; none where it is too short for a device to have."""
        taken = samples if samples >= _SHORTEST_DELAY else 0.0
        return Answer(device_as(self.device, {"delay_samples": taken}), self.hand)


def device_as(device: Device, changed: Mapping[str, object]) -> Device:
    """Return a device with some keys changed, known exactly."""
    return Device.model_validate({**device.model_dump(exclude={"range"}), **changed})
