"""What a log is compared with: the intended loop, and device and hand that may have made it, with their stability."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.control_law import NotchFilter
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, released_hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Hands
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES

_SLOWER_LOG = 1.3
"""Sample times of the device from which on a tick of a log is a longer one, not the same with an error."""

EncoderSide = Literal["motor", "handle"]
"""Side of a resonance on which the encoder is."""

DeviceValue = float | EncoderSide | Mapping[str, float] | None
"""Value of a key of a device: a number, the place of its encoder, a table such as a resonance, or none."""

_LONGEST_TRAVEL_M = 1.0
"""Travel of a linear device, m, above which its log may have another unit: haptic devices move by less."""


@dataclass(frozen=True)
class IntendedLaw:
    """What the loop was designed for: a device, whether it was declared or is assumed, and the hands."""

    device: Device
    known: bool
    hands: Hands

    @property
    def delay_samples(self) -> tuple[float, float]:
        """Range of the declared delay, samples of the device; an assumed one may be none or twice as long."""
        delay = float(self.device.delay_samples)
        return self.device.range.delay_samples or ((delay, delay) if self.known else (0.0, 2 * delay))

    def samples_a_tick(self, log: Log) -> float:
        """Return the samples of the device in a tick of a log, which may be longer."""
        ratio = log.period_s / self.device.sample_time_s
        return ratio if ratio > _SLOWER_LOG else 1.0

    def mismatches(self, log: Log) -> list[str]:
        """Return what of a log is unlikely of the device: its rate, or the size of its motion."""
        sentences = []
        stated_s = self.device.sample_time_s
        if self.known and log.sample_time_s > _SLOWER_LOG * stated_s:
            sentences.append(
                f"the log has a sample every {number(1e3 * log.sample_time_s, 3)} ms, and device.sample_time_s is "
                f"{number(1e3 * stated_s, 3)} ms: check that log and file are of the same device and rate"
            )
        travel_m = float(np.ptp(log.position_m))
        if self.device.motion == "linear" and travel_m > _LONGEST_TRAVEL_M:
            sentences.append(f"the position moves by {number(travel_m, 3)} m: check its unit (--units position=mm)")
        return sentences

    def latest(self, log: Log) -> float:
        """Return the longest declared delay in ticks of a log."""
        return self.delay_samples[1] / self.samples_a_tick(log)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A device, the hand on it or None, the positions of travel stops, m, and how something outside shakes it."""

    device: Device
    hand: Hand | None
    stops: tuple[float, float] | None = None
    shake_hz: float | None = None
    """Frequency of a steady sine by which a hand, the table or a machine moves the device, Hz; None without one."""

    def vary(self, **values: DeviceValue) -> Hypothesis:
        """Return the hypothesis with other values of its device; a delay below the least of a device is none."""
        delay = values.get("delay_samples")
        if isinstance(delay, float | int) and not delay >= LEAST_DELAY_SAMPLES:
            values["delay_samples"] = 0.0
        device = Device.model_validate({**self.device.model_dump(exclude={"range"}), **values})
        return replace(self, device=device)

    @property
    def delay(self) -> float:
        """Delay of the device, samples."""
        return float(self.device.delay_samples)


def notch_of(frequency_hz: float, period_s: float) -> Law:
    """Return the notch filter of the command, with the width and depth of one in [law] that states none."""
    return NotchFilter(frequency_hz=frequency_hz).piece.law(period_s)


def growth(hypothesis: Hypothesis, law: FittedLaw, stiffness: float = 1.0, damping: float = 1.0) -> float:
    """Return the growth rate, 1/s, of the least damped mode of the loop of one rate, gains scaled.

    ln|z| / T of the largest pole z of the sampled loop, whose force is that of the law without switch and frames.
    """
    period = hypothesis.device.sample_time_s
    late = hypothesis.vary(delay_samples=hypothesis.delay + law.lag)
    body = Body.of(sampled_plant(late.device, hypothesis.hand or released_hand())).axes(0, 0)
    scaled = Law.spring_damper(stiffness * law.stiffness_n_per_m, damping * law.damping_ns_per_m, period, pole=law.keep)
    if law.notch_hz is not None:
        scaled = scaled.then(notch_of(law.notch_hz, period))
    return math.log(max(float(closed(body, scaled).radius), 1e-300)) / period


def stable(hypothesis: Hypothesis, law: FittedLaw, stiffness: float = 1.0, damping: float = 1.0) -> bool:
    """Return whether the loop decays, gains scaled."""
    return growth(hypothesis, law, stiffness, damping) < 0
