"""The sampled plant of device and hand over a whole box of hands: sampled position over held force.

With w_n = omega + 2 pi n, angles per sample and impedances times T^2, all as declared,

    P(omega) = sum over n of (1 - exp(-j omega))/(j w_n) exp(-j w_n delay) A(j w_n/T) Y(j w_n/T),

A of the amplifier and Y the position of the device over a force on its motor. The omitted terms are bounded (`tail`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.prove.disc import Disc, Moving, hold, rotation
from avc_casadi.model.corners import LINEAR_KEYS, device_ranges
from avc_casadi.model.device import Device

# Moving, or an array of plain complex numbers: the formulas are the same.
Value = Any

HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
_RATIO = "amplifier_damping_ratio"
# Damping ratio of a current loop without resonance peak.
_NO_PEAK = 0.7072
# Terms on each side of the middle one.
_TERMS, _MORE_TERMS = 6, 16
_TOO_SLOW = "damping or stiffness of hand and device are too large for the sample time"
# Allowance for rounding of bounds that are computed in plain numbers.
_ROOM = 1.0 + 1e-9


@dataclass(frozen=True)
class SampledPlantBox:
    """A device, known exactly or within ranges, with every hand of a box."""

    device: Device
    hand: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        low = {name: ends[0] for name, ends in self.ranges.items()}
        fault, moves = None, self.device.resonance is None
        if tuple(self.hand) != HAND:
            fault = f"hands of {', '.join(self.hand)} are not known here"
        elif not all(one <= other for one, other in self.hand.values()):
            fault = "the range of a hand ends below where it begins"
        elif not min(self.device.mass_kg, low.get("device.mass_kg", math.inf)) + moves * low["mass_kg"] > 0:
            fault = "a device without mass follows no sampled force that a proof could enclose"
        elif not low["stiffness_n_per_m"] > 0:
            fault = "a hand without stiffness has no place of rest"
        elif not max(low.get("device.damping_ns_per_m", self.device.damping_ns_per_m), low["damping_ns_per_m"]) > 0:
            fault = "device and hand without damping never settle"
        if fault is not None:
            raise UnsupportedError(fault)

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Range of every number that is not known exactly, or is the hand's."""
        ranges = device_ranges(self.device, LINEAR_KEYS)
        if self.device.amplifier_order == 1:
            ranges.pop(_RATIO, None)
        wide = {f"device.{key}": ranges[key] for key in LINEAR_KEYS if key in ranges and np.ptp(ranges[key]) > 0}
        return dict(self.hand) | wide

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers, in the order of a cell's columns after omega."""
        return tuple(self.ranges)

    @property
    def terms_cancel(self) -> bool:
        """Whether terms of n and -n nearly cancel: a rigid device, an ideal amplifier, whole samples of delay."""
        device = self.device
        whole = "device.delay_samples" not in self.ranges and device.delay_samples == int(device.delay_samples)
        return whole and device.resonance is None and device.amplifier_bandwidth_hz is None

    @property
    def terms(self) -> int:
        """Number of terms on each side."""
        return _TERMS if self.terms_cancel else _MORE_TERMS

    def corners(self) -> FloatArray:
        """Return every corner of the box, shape (c, numbers)."""
        grids = np.meshgrid(*(np.unique(ends) for ends in self.ranges.values()), indexing="ij")
        return np.stack([grid.ravel() for grid in grids], axis=1)

    def at(self, omega: FloatArray, numbers: FloatArray) -> ComplexArray:
        """Return P at angles (f,) with hands (h, numbers), shape (h, f): plain numbers, for the search."""
        columns = {name: numbers[:, place, None] for place, name in enumerate(self.names)}
        above, below, around = self._fold(np.asarray(omega, dtype=np.complex128)[None, :], columns, 4 * self.terms)
        return np.asarray(above / below + around)

    def over(self, omega: Moving, numbers: tuple[Moving, ...]) -> tuple[Moving, Moving, Moving]:
        """Enclose the included terms; the omitted ones are within `tail`."""
        return self._fold(omega, dict(zip(self.names, numbers, strict=True)), self.terms)

    def _fold(self, omega: Value, numbers: dict[str, Value], terms: int) -> tuple[Value, Value, Value]:
        moving = isinstance(omega, Moving)
        number = Disc.with_rounding if moving else complex
        turn, mean = (rotation, hold) if moving else (lambda angle: np.exp(-1j * np.asarray(angle)), _hold)
        t = self.device.sample_time_s
        delay = numbers.get("device.delay_samples", self.device.delay_samples)
        late_range = "device.delay_samples" in numbers
        whole = not late_range and delay == int(delay)
        step = mean(omega)
        lift = step * (omega * 1j)
        # The largest terms are added last, after the small ones.
        places = np.array(sorted(range(-terms, terms + 1), key=abs, reverse=True)[:-1], dtype=np.float64)
        around: Value = None
        # All at once for the few cells of an enclosure, one by one for the many points of a search.
        for n in (places[:, None],) if moving else places:
            s = (omega + number(2 * math.pi * n)) * 1j
            above, below = self._compliance(s, numbers, t)
            term = above * (1 / below) * (lift * (1 / s))
            if late_range:
                term = term * turn(delay * number(2 * math.pi * n))
            elif not whole:
                # The whole part of n delay does not rotate.
                late = np.exp(-2j * math.pi * np.fmod(n * delay, 1.0))
                term = term * (Disc(late, _ROUGH) if moving else late)
            if moving:
                term = term.sum()
            around = term if around is None else around + term
        above, below = self._compliance(omega * 1j, numbers, t)
        scale: Value = number(t * t)
        if late_range or delay:
            scale = turn(omega * delay) * scale
        return above * (step * scale), below, around * scale

    def _compliance(self, s: Value, numbers: dict[str, Value], t: float) -> tuple[Value, Value]:
        """Return position over commanded force, over T^2, as a numerator and a denominator; s per sample."""
        known = Disc.with_rounding if isinstance(s, Moving) else complex
        device = self.device

        def number(key: str, own: float) -> Value:
            return numbers.get(f"device.{key}", known(own))

        mass, damping = number("mass_kg", device.mass_kg), number("damping_ns_per_m", device.damping_ns_per_m)
        held_mass, held_damping, stiffness = (numbers[name] for name in HAND)
        grip = s * (s * held_mass + held_damping * known(t)) + stiffness * known(t * t)
        mode = device.resonance
        above: Value
        if mode is None:
            above = known(1.0)
            below = s * (s * mass + damping * known(t)) + grip
        else:
            ratio = number("resonance.mass_ratio", mode.mass_ratio)
            angle = number("resonance.frequency_hz", mode.frequency_hz) * known(2 * math.pi * t)
            handle, motor = mass * ratio, mass * (1 - ratio)
            reduced = handle * (1 - ratio)
            link = angle * reduced * (angle + s * (number("resonance.damping_ratio", mode.damping_ratio) * 2.0))
            far = s * s * handle + grip
            drive = s * (s * motor + damping * known(t))
            # Without quotients: the handle may rest on its link almost undamped.
            above = link if device.encoder_at == "handle" else link + far
            below = drive * link + (drive + link) * far
        if device.amplifier_bandwidth_hz is not None:
            rate = number("amplifier_bandwidth_hz", device.amplifier_bandwidth_hz) * known(2 * math.pi * t)
            lag = s + rate
            if device.amplifier_order == 2:
                ratio = number(_RATIO, device.amplifier_damping_ratio)
                rate, lag = rate * rate, s * (s + rate * ratio * 2.0) + rate * rate
            above = above * rate * (1 / lag)
        return above, below

    def tail(self, omega_high: FloatArray) -> FloatArray:
        """Bound the omitted terms of P, at angles up to the given ones."""
        lift = np.minimum(omega_high, 2.0) * self.device.sample_time_s**2 * _ROOM
        n = self.terms
        if not self.terms_cancel:
            gain, order = self._amplifier()
            return lift * 2 * self._largest_yield() * gain * _tail_sum(3 + order, n)
        mass, b, k = self._rigid_bounds()
        share = 1 / (2 * (n + 1))
        # Terms of both sides: the remainder of 1/(m w^3), then the contribution of damping and stiffness.
        across = 6 * (1 + share**2 / 3) / (1 - share**2) ** 3 / (2 * math.pi) ** 4 / (3 * n**3)
        first = (2 * n + 1) * math.pi
        small = b / (mass * first) + k / (mass * first**2)
        if not small < 0.5:
            raise UnsupportedError(_TOO_SLOW)
        rest = 2 / (1 - small) * (b / mass * _tail_sum(4, n) + k / mass * _tail_sum(5, n))
        return lift * (omega_high * across + rest) / mass

    def _rigid_bounds(self) -> tuple[float, float, float]:
        """Lowest mass, largest damping times T and stiffness times T^2 that act on a rigid device."""
        t, device = self.device.sample_time_s, self.device
        mass = self._ends("device.mass_kg", device.mass_kg)[0]
        damping = self._ends("device.damping_ns_per_m", device.damping_ns_per_m)[1]
        mass, damping = mass + self.hand["mass_kg"][0], damping + self.hand["damping_ns_per_m"][1]
        return mass, damping * t, self.hand["stiffness_n_per_m"][1] * t**2

    def _amplifier(self) -> tuple[float, int]:
        """Bound the amplifier's gain beyond the included terms: c/w^order, c and the order."""
        device = self.device
        if device.amplifier_bandwidth_hz is None:
            return 1.0, 0
        rate = 2 * math.pi * device.sample_time_s
        rate *= self._ends("device.amplifier_bandwidth_hz", device.amplifier_bandwidth_hz)[1]
        first = (2 * self.terms + 1) * math.pi
        if device.amplifier_order == 1:
            return rate, 1
        if rate < 0.9 * first:
            return rate**2 / (1 - (rate / first) ** 2), 2
        # Largest gain of a current loop: 1 for a damping ratio beyond 0.707.
        ratio = self._ends(f"device.{_RATIO}", device.amplifier_damping_ratio)[0]
        return (1.0 if ratio >= _NO_PEAK else 1 / (2 * ratio * math.sqrt(1 - ratio**2))) * _ROOM, 0

    def _largest_yield(self) -> float:
        """Bound |Y| w^2 beyond the included terms, 1/kg."""
        first = (2 * self.terms + 1) * math.pi
        mode, device = self.device.resonance, self.device
        if mode is None:
            mass, b, k = self._rigid_bounds()
            return _reciprocal_bound(mass - k / first**2 - b / first)
        t = device.sample_time_s
        low, high = self._ends("device.mass_kg", device.mass_kg)
        ratios = self._ends("device.resonance.mass_ratio", mode.mass_ratio)
        angle = 2 * math.pi * t * self._ends("device.resonance.frequency_hz", mode.frequency_hz)[1]
        ratio = self._ends("device.resonance.damping_ratio", mode.damping_ratio)[1]
        link = high * 0.25 * (angle**2 / first**2 + 2 * ratio * angle / first)
        handle = low * ratios[0]
        grip = self.hand["stiffness_n_per_m"][1] * t**2 / first**2
        far = handle - grip - link
        motor = low * (1 - ratios[1]) - link
        return _reciprocal_bound(motor - link**2 / far if far > link else -1.0)

    def _ends(self, name: str, own: float) -> tuple[float, float]:
        return self.ranges.get(name, (own, own))


# Of exp(-j 2 pi n delay).
_ROUGH = np.asarray(1e-12)


def _tail_sum(power: int, terms: int) -> float:
    """Bound the sum of (2 pi (n - 1/2))^-power over n > terms: the mean over each step is no less."""
    return _ROOM * (2 * math.pi) ** -power * float(terms) ** (1 - power) / (power - 1)


def _reciprocal_bound(value: float) -> float:
    if not value > 0:
        raise UnsupportedError(_TOO_SLOW)
    return _ROOM / value


def _hold(angle: Value) -> Value:
    return np.exp(-0.5j * angle) * np.sinc(angle.real / (2 * np.pi))
