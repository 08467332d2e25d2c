"""A hypothesis (device and hand) in its sampled loop with a law: growth rate and stability limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import Rendering, wall
from avc_casadi.model.corners import device_with
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, no_hand
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.simulation.effects.filters import Notch

# Least delay of a device, samples.
_SHORTEST_DELAY = 1e-3


@dataclass(frozen=True)
class Hypothesis:
    """A device with the hand on it.

    Attributes:
        device: with its delay from the commanded force to the motion.
        hand: None where the device is released.
    """

    device: Device
    hand: Hand | None

    def without_mode(self) -> Hypothesis:
        """Return the hypothesis with rigid mechanics."""
        return Hypothesis(device_as(self.device, {"resonance": None}), self.hand)

    def delayed(self, samples: float) -> Hypothesis:
        """Return the hypothesis with another delay, at least the smallest of a device."""
        taken = samples if samples >= _SHORTEST_DELAY else 0.0
        return Hypothesis(device_as(self.device, {"delay_samples": taken}), self.hand)


def device_as(device: Device, changed: Mapping[str, object]) -> Device:
    """Return a device with some keys changed, exact values."""
    return Device.model_validate({**device.model_dump(exclude={"range"}), **changed})


# Factors of a gain that are scanned, and the tolerance of its limit.
_FACTORS = np.geomspace(1.0, 0.01, 41)
_HALVINGS = 8
_MOST_TICKS = 3000


@dataclass(frozen=True)
class Mode:
    """The least damped mode of a loop.

    Attributes:
        growth_per_s: growth rate of its amplitude, below 0 where stable.
        frequency_hz: its frequency.
    """

    growth_per_s: float
    frequency_hz: float

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.growth_per_s < 0


def worst_mode(answer: Hypothesis, law: Law, *, stiffness: float = 1.0, damping: float = 1.0) -> Mode:
    """Return the least damped mode of the loop in contact.

    Args:
        answer: device and hand; the lag of the law adds to its delay.
        law: from position to force.
        stiffness: factor of its stiffness.
        damping: factor of its damping.
    """
    period = answer.device.sample_time_s
    matrix = _loops(answer, law, np.array([stiffness]), np.array([damping]))[0]
    values = np.linalg.eigvals(matrix)
    value = values[np.argmax(np.abs(values))]
    return Mode(math.log(max(abs(value), 1e-300)) / period, abs(float(np.angle(value))) / (2 * math.pi * period))


def notched_growth(answer: Hypothesis, law: Law, notch: Notch) -> float:
    """Return the growth of the loop in contact with a notch on the measured position, 1/s.

    Args:
        answer: device and hand.
        law: from position to force.
        notch: the filter.
    """
    period = answer.device.sample_time_s
    plant = _plant(answer, law.lag)
    s, measured = plant.size, plant.measured
    b0, b1, b2, a1, a2 = notch.section(period)
    # y = b0 u + p, p' = b1 u - a1 y + q, q' = b2 u - a2 y: two states more, and y is what is rendered.
    whole = np.zeros((1, s + 2, s + 2))
    whole[:, :s, :s] = plant.a
    whole[:, s, :s], whole[:, s + 1, :s] = (b1 - a1 * b0) * measured, (b2 - a2 * b0) * measured
    whole[:, s, s:], whole[:, s + 1, s] = (-a1, 1.0), -a2
    pushed = np.concatenate([plant.b, np.zeros((1, 2))], axis=1)
    notched = replace(plant, a=whole, b=pushed, measured=np.concatenate([b0 * measured, [1.0, 0.0]]))
    loop = wall(notched, law.rendering(period))
    return math.log(max(float(_radius(loop).max()), 1e-300)) / period


def worst_growth_of_hands(answer: Hypothesis, law: Law, hands: Hand) -> FloatArray:
    """Return the growth rate of the loop with each of several hands in place of its own, shape (hands,)."""
    return np.array(
        [
            worst_mode(Hypothesis(answer.device, hands.pick(slice(i, i + 1))), law).growth_per_s
            for i in range(len(hands))
        ]
    )


def at_period(answer: Hypothesis, law: Law, sample_time_s: float) -> tuple[Hypothesis, Law]:
    """Return the loop at another sample time: same gains, filter in seconds and delay in samples."""
    keep = law.keep ** (sample_time_s / answer.device.sample_time_s) if law.keep else 0.0
    device = device_with(answer.device, {"sample_time_s": sample_time_s})
    return Hypothesis(device, answer.hand), replace(law, keep=keep)


def growth_over(answer: Hypothesis, law: Law, ran: BoolArray) -> float:
    """Return the mean growth rate over ticks of which some are missed: there the force is held and nothing is computed.

    Args:
        answer: device and hand.
        law: from position to force.
        ran: whether each tick ran, shape (n,).
    """
    run = _loops(answer, law, np.ones(1), np.ones(1))[0]
    size = run.shape[0]
    held = Rendering(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))
    missed = _closed(answer, law.lag, held)[0]
    missed[size - 2] = 0.0
    missed[size - 2, size - 2] = 1.0
    state = np.random.default_rng(0).standard_normal(size)
    grown = 0.0
    ticks = np.resize(ran, _MOST_TICKS)
    # The transient has decayed after the first half.
    for count, ticked in enumerate(ticks):
        state = (run if ticked else missed) @ state
        length = float(np.linalg.norm(state))
        grown += math.log(length) if 2 * count >= _MOST_TICKS else 0.0
        state /= length
    return 2 * grown / (_MOST_TICKS * answer.device.sample_time_s)


def growth_of_two_rates(answer: Hypothesis, law: Law, slow: str, ticks: int, late: int) -> float:
    """Return the growth rate, 1/s, of a loop whose spring or damper is updated once a frame, from frame to frame.

    Args:
        answer: device and hand.
        law: both gains.
        slow: "spring" or "damper": which one holds the value of its last frame.
        ticks: of a frame.
        late: frames from a position to its force, beyond those of the frame itself.
    """
    period = answer.device.sample_time_s
    plant = _plant(answer, law.lag)
    # States beyond the plant's: the position before, that of the last frame, and the delayed values, each as a row.
    whole = np.eye(plant.size + 3 + late)
    states, (before, framed, *waiting) = whole[: plant.size], whole[plant.size :]
    for tick in range(ticks):
        here = plant.measured @ states
        if tick == 0:
            waiting = [*waiting[1:], here if slow == "spring" else (here - framed) / (ticks * period)]
            framed = here
        spring, speed = (waiting[0], (here - before) / period) if slow == "spring" else (here, waiting[0])
        force = law.stiffness_n_per_m * spring + law.damping_ns_per_m * speed
        states, before = plant.a[0] @ states + np.outer(plant.b[0], force), here
    frame = np.concatenate([states, [before, framed], waiting])
    return math.log(max(float(_radius(frame)), 1e-300)) / (ticks * period)


def limit_of(answer: Hypothesis, law: Law, gain: str) -> float | None:
    """Return the largest factor, at most 1, of a gain for which the loop is stable; None where there is none.

    Args:
        answer: device and hand.
        law: from position to force.
        gain: "stiffness" or "damping".
    """
    ones = np.ones_like(_FACTORS)
    factors = (_FACTORS, ones) if gain == "stiffness" else (ones, _FACTORS)
    stable = _radius(_loops(answer, law, *factors)) < 1
    if not stable.any():
        return None
    first = int(np.argmax(stable))
    if first == 0:
        return 1.0
    low, high = float(_FACTORS[first]), float(_FACTORS[first - 1])
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        if worst_mode(answer, law, **{gain: middle}).stable:
            low = middle
        else:
            high = middle
    return low


def longest_delay(answer: Hypothesis, law: Law) -> float | None:
    """Return the longest delay, at most its own, at which the loop is stable; None where there is none."""
    own = float(answer.device.delay_samples)
    some = np.linspace(own, 0.0, max(2, math.ceil(4 * own) + 1))
    stable = [worst_mode(answer.delayed(float(delay)), law).stable for delay in some]
    if not any(stable):
        return None
    first = stable.index(True)
    if first == 0:
        return own
    low, high = float(some[first]), float(some[first - 1])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if worst_mode(answer.delayed(middle), law).stable else (low, middle)
    return low


def _loops(answer: Hypothesis, law: Law, stiffness: FloatArray, damping: FloatArray) -> FloatArray:
    return _closed(answer, law.lag, law.rendering(answer.device.sample_time_s, stiffness, damping))


def _closed(answer: Hypothesis, lag: int, rendering: Rendering) -> FloatArray:
    return wall(_plant(answer, lag), rendering)


def _plant(answer: Hypothesis, lag: int) -> Body:
    device = answer.delayed(float(answer.device.delay_samples) + lag).device if lag else answer.device
    return Body.of(sampled_plant(device, answer.hand or no_hand())).flat()


def _radius(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.linalg.eigvals(matrices)).max(axis=-1))
