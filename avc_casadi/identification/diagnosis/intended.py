"""The intended loop, and how the log contradicts it: other gains, another unit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi.coupling import Coupling
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation
from avc_casadi.loops.wall import Rendering, joint_rendering
from avc_casadi.model.device import Device
from avc_casadi.model.hands import STYLUS_RANGES, Hand, hand_corners, joined
from avc_casadi.model.problem import Hands, defaults_at

# Default device on a desk where none is declared; the hand's ranges widen it.
_ASSUMED = {"mass_kg": 0.1, "damping_ns_per_m": 1.0, "delay_samples": 1.0}

# Mass, damping and stiffness of hardly any hand.
_LEAST_HAND = np.array([[1e-3], [0.1], [5.0]])

# Tolerance of an unaltered delay about the declared one, samples.
_PUNCTUAL = 0.15


@dataclass(frozen=True)
class Declared:
    """The intended loop.

    Attributes:
        device: as declared, or assumed.
        known: whether a device was declared.
        hands: ranges of the hands it was designed for.
        notes: assumptions.
    """

    device: Device
    known: bool
    hands: Hands
    notes: tuple[str, ...]

    @classmethod
    def of(cls, device: Device | None, hands: Hands | None, sample_time_s: float) -> Declared:
        """Build the intended loop from what was declared, and defaults.

        Args:
            device: None where none was declared.
            hands: None for the usual ranges.
            sample_time_s: of the log, for an assumed device.
        """
        notes = []
        if device is None:
            device = Device.model_validate({**_ASSUMED, "sample_time_s": sample_time_s})
            notes.append(
                "no device was given: 0.1 and one sample of delay are assumed, within a factor of 3, so that a "
                "released device is not distinguished from a held one; better: --device NAME|FILE"
            )
            return cls(device, known=False, hands=hands or Hands(), notes=tuple(notes))
        usual = defaults_at(Hands, device.metres_per_unit)
        return cls(device, known=True, hands=hands or Hands.model_validate(usual), notes=())

    @property
    def longest_delay(self) -> float:
        """Declared delay, samples of the device: the upper end of a range."""
        most = self.device.range.delay_samples
        return float(self.device.delay_samples if most is None else most[1])

    @property
    def shortest_delay(self) -> float:
        """Declared delay, samples of the device: the lower end of a range."""
        least = self.device.range.delay_samples
        return float(self.device.delay_samples if least is None else least[0])

    def delay_prior(self) -> tuple[float, float]:
        """Return mean and standard deviation of the declared delay, samples; uniform within a range."""
        ends = self.device.range.delay_samples
        if ends is None:
            return float(self.device.delay_samples), _PUNCTUAL
        return float(np.mean(ends)), math.hypot(_PUNCTUAL, float(np.ptp(ends)) / math.sqrt(12))

    def box(self) -> Hand:
        """Return the corners and the centre of the ranges of hands."""
        middle = [float(np.mean(ends)) for ends in self._ends()]
        ranges = self.hands
        held = Hands(
            mass_kg=ranges.mass_kg, damping_ns_per_m=ranges.damping_ns_per_m, stiffness_n_per_m=ranges.stiffness_n_per_m
        )
        return joined(hand_corners(held), Hand(*middle))

    def hand_prior(self) -> tuple[FloatArray, FloatArray]:
        """Return centre and spread of ln mass, damping and stiffness of the hand."""
        ends = np.log(np.maximum(self._ends(), self.device.metres_per_unit**2 * _LEAST_HAND))
        spread = np.maximum((ends[:, 1] - ends[:, 0]) / 2, 0.4)
        return ends.mean(axis=1), spread if self.known else np.maximum(spread, 1.1)

    def grip(self) -> FloatArray:
        """Return the ranges of damping and stiffness of the grip of a hand on a stylus, shape (2, 2)."""
        keys = ("grip_damping_ns_per_m", "grip_stiffness_n_per_m")
        return np.asarray(self.device.metres_per_unit**2 * np.array([STYLUS_RANGES[key] for key in keys]))

    def grip_prior(self) -> tuple[FloatArray, FloatArray]:
        """Return centre and spread of ln damping and stiffness of the grip of a hand on a stylus."""
        ends = np.log(self.grip())
        return ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2

    def _ends(self) -> FloatArray:
        return np.array([self.hands.mass_kg, self.hands.damping_ns_per_m, self.hands.stiffness_n_per_m])


# Gains that differ by a larger share are different.
_OTHER = 0.05


def law_differs(
    law: Law,
    found: Oscillation,
    log: Log,
    coupling: Coupling | None,
    stiffness_n_per_m: float | None,
    damping_ns_per_m: float | None,
) -> list[str]:
    """Return how the commanded force differs from that of the intended gains.

    Args:
        law: identified from the log.
        found: the oscillation; dynamic stiffness is compared at its frequency.
        log: on its tick grid.
        coupling: the intended one, or None.
        stiffness_n_per_m: intended k, or None.
        damping_ns_per_m: intended b, or None.
    """
    if not law.told:
        return []
    period = log.ticks.period_s
    meant: dict[str, float] = {}
    if coupling is not None and coupling.runtime.state_feedback is not None:
        return ["the coupling feeds a state back, which is not compared with the log's spring and damper"]
    if coupling is not None:
        at = coupling.table.at_rest
        gains = (
            np.array([value]) for value in (at.damping_ns_per_m, at.stiffness_n_per_m, at.contact_damping_ns_per_m)
        )
        rendering = joint_rendering(coupling.problem, *gains)
        hertz = found.frequency_hz if math.isfinite(found.frequency_hz) else 10.0
        angle = 2 * math.pi * hertz * period
        asked, ran = _dynamic(rendering, angle), _dynamic(law.rendering(period), angle)
        for what, key in (("spring", "real"), ("damper", "imag")):
            scale = 1.0 if key == "real" else 1 / (2 * math.pi * hertz)
            one, other = float(getattr(asked, key)) * scale, float(getattr(ran, key)) * scale
            if abs(other - one) > _OTHER * max(abs(one), abs(other)):
                meant[f"{what} at {number(hertz, 3)} Hz: {number(other, 4)} ran, {number(one, 4)}"] = one
        return [f"the log does not run the coupling that was given: {each} was meant" for each in meant]
    notes = []
    for name, told, wanted in (
        ("k", law.stiffness_n_per_m, stiffness_n_per_m),
        ("b", law.damping_ns_per_m, damping_ns_per_m),
    ):
        if wanted is not None and abs(told - wanted) > _OTHER * max(abs(told), abs(wanted)):
            notes.append(
                f"the log does not run the gains that were given: {name} = {number(told, 4)} ran, "
                f"{number(wanted, 4)} was meant"
            )
    return notes


def _dynamic(rendering: Rendering, angle: float) -> complex:
    """Return the dynamic stiffness, force over position, at an angle per sample."""
    z = complex(math.cos(angle), math.sin(angle))
    force, state = rendering.force[0], rendering.state[0]
    # The state after a sample enters with the next one.
    own = (state[0] + state[1] / z) / (z - state[2])
    return complex(force[0] + force[1] / z + force[2] * own)


# Ratio of a declared to a read length, and the unit errors that cause it.
_FACTORS = {
    1e-2: ("100 times too large", "cm read as m"),
    1e-3: ("1000 times too large", "mm read as m, or um as mm"),
    1e-6: ("a million times too large", "um read as m"),
    1e2: ("100 times too small", "m read as cm"),
    1e3: ("1000 times too small", "mm read as um, or m as mm"),
    1e6: ("a million times too small", "m read as um"),
}
_ANGLE_FACTORS = {
    math.pi / 180: ("57 times too large", "degrees read as rad"),
    180 / math.pi: ("57 times too small", "rad read as degrees"),
    1e-3: ("1000 times too large", "mm read as m, or um as mm"),
    1e-6: ("a million times too large", "um read as m"),
    1e3: ("1000 times too small", "mm read as um, or m as mm"),
    1e6: ("a million times too small", "m read as um"),
}
_LENGTHS = (1.0, 1e-2, 1e-3, 1e-6, 1e-9)
_ANGLES = (1.0, math.pi / 180, 1e-3, 1e-6)
# A ratio within this share of a unit's is that unit.
_NEAR = 0.05
# Oscillating mass over the declared mass with the heaviest hand, or the lightest device: beyond this it is impossible.
_ABSURD = 50.0
# Share of the time in contact above which the force sustains the oscillation.
_TOUCHING = 0.2


def other_unit(
    log: Log,
    found: Oscillation,
    law: Law | None,
    declared: Declared,
    coupling: Coupling | None,
    stiffness_n_per_m: float | None,
) -> str:
    """Return why the positions seem to be in another unit than assumed, or nothing.

    Args:
        log: on its tick grid.
        found: the oscillation.
        law: identified from the log.
        declared: the intended loop.
        coupling: the intended one, or None.
        stiffness_n_per_m: intended k, or None.
    """
    turns = not declared.device.units.linear
    meant = stiffness_n_per_m
    if coupling is not None and coupling.runtime.state_feedback is None:
        meant = coupling.table.at_rest.stiffness_n_per_m
    signs = []
    if law is not None and law.told and meant and law.stiffness_n_per_m > 0:
        # Millimetres read as metres make a spring a thousand times softer.
        factor = _factor(law.stiffness_n_per_m / meant, turns)
        if factor:
            signs.append((factor, f"k = {number(law.stiffness_n_per_m, 3)} ran and {number(meant, 3)} was meant"))
    step = declared.device.encoder_resolution_m
    if step and log.encoder_m:
        told = f"their step is {number(log.encoder_m, 3)} and {number(step, 3)} is declared"
        factor = _factor(step / log.encoder_m, turns)
        if factor:
            signs.append((factor, told))
        elif abs(math.log(log.encoder_m / step)) > math.log(_ABSURD) and _whole(log.encoder_m, turns):
            return f"the positions look like counts of the encoder: {told}; a count times the step is a position"
    if signs:
        (size, how), told = signs[0]
        return f"the positions look {size} ({how}): {told}; --units position=... tells the right one"
    if math.isfinite(found.frequency_hz) and found.force_peak_to_peak_n > 0 and found.contact_share > _TOUCHING:
        swings = found.force_peak_to_peak_n / found.peak_to_peak_m / (2 * math.pi * found.frequency_hz) ** 2
        heaviest = declared.device.mass_kg + declared.hands.mass_kg[1]
        told = f"at {number(found.frequency_hz, 3)} Hz their force swings {number(swings, 2)}"
        if swings < declared.device.mass_kg / _ABSURD:
            told = f"{told}, the device has {number(declared.device.mass_kg, 3)}"
            kinds = "degrees or counts read as rad" if turns else ", or counts read as"
            return f"the positions look like {kinds}: {told}"
        if swings > heaviest * _ABSURD:
            return f"the positions look too small, or the force too large, by a unit: {told}"
    return ""


def _factor(ratio: float, turns: bool) -> tuple[str, str] | None:
    """Return a phrase for the factor of a ratio, or nothing."""
    return next(
        (
            (how_much, str(what))
            for size, (how_much, what) in (_ANGLE_FACTORS if turns else _FACTORS).items()
            if abs(math.log(ratio / size)) < _NEAR
        ),
        None,
    )


def _whole(step: float, turns: bool) -> bool:
    """Return whether a step is 1 in some unit of length, or of angle."""
    return any(abs(step / size - 1) < 1e-3 for size in (_ANGLES if turns else _LENGTHS))
