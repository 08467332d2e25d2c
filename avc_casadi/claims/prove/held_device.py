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
from typing import Any, NamedTuple

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
_DELAY = "device.delay_samples"
# Damping ratio of a current loop without resonance peak.
_NO_PEAK = 0.7072
# Terms on each side of the middle one: where those of n and -n nearly cancel, and where they do not.
_TERMS = 6
_MORE_TERMS = 16
# Multiple of these terms that a search takes, in plain numbers.
_TERMS_OF_SEARCH = 4
_TOO_SLOW = "damping or stiffness of hand and device are too large for the sample time"
# Allowance for rounding of bounds that are computed in plain numbers.
_ROOM = 1.0 + 1e-9
# Largest share of damping and stiffness in a rigid device's motion at the first omitted term.
_LARGEST_SHARE = 0.5
# Share of the first omitted angle below which an amplifier of second order has passed its resonance.
_BEYOND_RESONANCE = 0.9
# Largest product of both parts of a mass that a link divides: m_1 m_2/m <= m/4.
_LARGEST_REDUCED = 0.25


class FoldedPlant(NamedTuple):
    """P = numerator/denominator + rest: the middle term of the folded spectrum, and the others."""

    numerator: Value
    denominator: Value
    rest: Value


@dataclass(frozen=True)
class SampledPlantBox:
    """A device, known exactly or within ranges, with every hand of a box.

    Attributes:
        device: the device as declared.
        hand: range of each number of the hand, by `HAND`.
    """

    device: Device
    hand: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        fault = self._fault()
        if fault:
            raise UnsupportedError(fault)

    def _fault(self) -> str:
        """Return why no proof could enclose this box, or nothing."""
        low = {name: ends[0] for name, ends in self.ranges.items()}
        if tuple(self.hand) != HAND:
            return f"hands of {', '.join(self.hand)} are not supported here"
        if not all(lower <= upper for lower, upper in self.hand.values()):
            return "the range of a hand ends below where it begins"
        # Without a resonance the hand's mass moves with the device's.
        moved_mass = low["mass_kg"] if self.device.resonance is None else 0.0
        if not min(self.device.mass_kg, low.get("device.mass_kg", math.inf)) + moved_mass > 0:
            return "the proof needs a device with mass"
        if not low["stiffness_n_per_m"] > 0:
            return "a hand without stiffness has no position of rest"
        if not max(low.get("device.damping_ns_per_m", self.device.damping_ns_per_m), low["damping_ns_per_m"]) > 0:
            return "device and hand without damping never settle"
        return ""

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Range of every number that is not known exactly, or is the hand's."""
        ranges = device_ranges(self.device, LINEAR_KEYS)
        if self.device.amplifier_order == 1:
            ranges.pop(_RATIO, None)
        not_exact = {f"device.{key}": ranges[key] for key in LINEAR_KEYS if key in ranges and np.ptp(ranges[key]) > 0}
        return dict(self.hand) | not_exact

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers, in the order of a cell's columns after omega."""
        return tuple(self.ranges)

    @property
    def terms_cancel(self) -> bool:
        """Whether terms of n and -n nearly cancel: a rigid device, an ideal amplifier, whole samples of delay."""
        device = self.device
        whole = _DELAY not in self.ranges and device.delay_samples == int(device.delay_samples)
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
        angles = np.asarray(omega, dtype=np.complex128)[None, :]
        plant = self._fold(angles, columns, _TERMS_OF_SEARCH * self.terms)
        return np.asarray(plant.numerator / plant.denominator + plant.rest)

    def over(self, omega: Moving, numbers: tuple[Moving, ...]) -> FoldedPlant:
        """Enclose the included terms; the omitted ones are within `tail`."""
        return self._fold(omega, dict(zip(self.names, numbers, strict=True)), self.terms)

    def _fold(self, omega: Value, numbers: dict[str, Value], terms: int) -> FoldedPlant:
        """Return the sampled plant P at omega as a sum over aliases, so many `terms` on each side of the middle one.

        P = sum over n of Y(j (omega + 2 pi n)) x hold x delay, omega an angle a sample; as enclosures, or plain
        numbers. The middle term is kept as numerator and denominator.
        """
        moving = isinstance(omega, Moving)
        number = Disc.with_rounding if moving else complex
        t = self.device.sample_time_s
        step = hold(omega) if moving else _hold(omega)
        lift = step * (omega * 1j)
        # The largest terms are added last, after the small ones.
        places = np.array(sorted(range(-terms, terms + 1), key=abs, reverse=True)[:-1], dtype=np.float64)
        rest: Value = None
        # All at once for the few cells of an enclosure, one by one for the many points of a search.
        for n in (places[:, None],) if moving else places:
            s = (omega + number(2 * math.pi * n)) * 1j
            numerator, denominator = self._compliance(s, numbers, t)
            term = numerator * (1 / denominator) * (lift * (1 / s))
            term = self._delayed(term, n, numbers, moving=moving)
            if moving:
                term = term.sum()
            rest = term if rest is None else rest + term
        numerator, denominator = self._compliance(omega * 1j, numbers, t)
        scale: Value = number(t * t)
        delay = numbers.get(_DELAY, self.device.delay_samples)
        if _DELAY in numbers or delay:
            turned = omega * delay
            scale = (rotation(turned) if moving else _rotation(turned)) * scale
        return FoldedPlant(numerator * (step * scale), denominator, rest * scale)

    def _delayed(self, term: Value, n: FloatArray, numbers: dict[str, Value], *, moving: bool) -> Value:
        """Return the terms n times exp(-j 2 pi n delay); that of omega, which all have, is left out."""
        if _DELAY in numbers:
            turned = numbers[_DELAY] * (Disc.with_rounding if moving else complex)(2 * math.pi * n)
            return term * (rotation(turned) if moving else _rotation(turned))
        delay = self.device.delay_samples
        if delay == int(delay):
            return term
        # The whole part of n delay does not rotate.
        late = np.exp(-2j * math.pi * np.fmod(n * delay, 1.0))
        return term * (Disc(late, _ROUGH) if moving else late)

    def _compliance(self, s: Value, numbers: dict[str, Value], t: float) -> tuple[Value, Value]:
        """Return numerator and denominator of x/(F T^2), 1/kg, x the encoder's position over the commanded force F.

        s is Laplace's variable times T (without unit), t the sample time T, s. `numbers` holds the values of the
        hand, and of each number of the device that has a range; the others are as the device declares them.
        """
        known = Disc.with_rounding if isinstance(s, Moving) else complex
        device = self.device

        def number(key: str, declared: float) -> Value:
            return numbers.get(f"device.{key}", known(declared))

        mass = number("mass_kg", device.mass_kg)
        damping = number("damping_ns_per_m", device.damping_ns_per_m)
        held_mass, held_damping, stiffness = (numbers[name] for name in HAND)
        grip = s * (s * held_mass + held_damping * known(t)) + stiffness * known(t * t)
        mode = device.resonance
        numerator: Value
        if mode is None:
            numerator = known(1.0)
            denominator = s * (s * mass + damping * known(t)) + grip
        else:
            ratio = number("resonance.mass_ratio", mode.mass_ratio)
            angle = number("resonance.frequency_hz", mode.frequency_hz) * known(2 * math.pi * t)
            handle = mass * ratio
            motor = mass * (1 - ratio)
            reduced = handle * (1 - ratio)
            link = angle * reduced * (angle + s * (number("resonance.damping_ratio", mode.damping_ratio) * 2.0))
            far = s * s * handle + grip
            drive = s * (s * motor + damping * known(t))
            # Without quotients: the handle may rest on its link almost undamped.
            numerator = link if device.encoder_at == "handle" else link + far
            denominator = drive * link + (drive + link) * far
        if device.amplifier_bandwidth_hz is not None:
            rate = number("amplifier_bandwidth_hz", device.amplifier_bandwidth_hz) * known(2 * math.pi * t)
            lag = s + rate
            if device.amplifier_order == 2:
                ratio = number(_RATIO, device.amplifier_damping_ratio)
                lag = s * (s + rate * ratio * 2.0) + rate * rate
                rate = rate * rate
            numerator = numerator * rate * (1 / lag)
        return numerator, denominator

    def tail(self, omega_high: FloatArray) -> FloatArray:
        """Return a bound of the aliases that P leaves out, m/N, at angles up to the given ones.

        It is that of 1/(m omega^2) beyond the last term, times amplifier and hold; for a rigid device terms of both
        signs cancel.
        """
        lift = np.minimum(omega_high, 2.0) * self.device.sample_time_s**2 * _ROOM
        n = self.terms
        if not self.terms_cancel:
            gain, order = self._amplifier()
            return lift * 2 * self._largest_yield() * gain * _tail_sum(3 + order, n)
        bounds = self._rigid_bounds()
        mass = bounds.mass_kg
        share = 1 / (2 * (n + 1))
        # Terms of both sides: the remainder of 1/(m w^3), then the contribution of damping and stiffness.
        across = 6 * (1 + share**2 / 3) / (1 - share**2) ** 3 / (2 * math.pi) ** 4 / (3 * n**3)
        first = (2 * n + 1) * math.pi
        small = bounds.damping / (mass * first) + bounds.stiffness / (mass * first**2)
        if not small < _LARGEST_SHARE:
            raise UnsupportedError(_TOO_SLOW)
        rest = 2 / (1 - small) * (bounds.damping / mass * _tail_sum(4, n) + bounds.stiffness / mass * _tail_sum(5, n))
        return lift * (omega_high * across + rest) / mass

    def _rigid_bounds(self) -> _RigidBounds:
        """Lowest mass, largest damping times T and stiffness times T^2 that act on a rigid device."""
        device = self.device
        t = device.sample_time_s
        mass = self._ends("device.mass_kg", device.mass_kg)[0] + self.hand["mass_kg"][0]
        damping = self._ends("device.damping_ns_per_m", device.damping_ns_per_m)[1] + self.hand["damping_ns_per_m"][1]
        return _RigidBounds(mass, damping * t, self.hand["stiffness_n_per_m"][1] * t**2)

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
        if rate < _BEYOND_RESONANCE * first:
            return rate**2 / (1 - (rate / first) ** 2), 2
        # Largest gain of a current loop: 1 for a damping ratio beyond 0.707.
        ratio = self._ends(f"device.{_RATIO}", device.amplifier_damping_ratio)[0]
        peak = 1.0 if ratio >= _NO_PEAK else 1 / (2 * ratio * math.sqrt(1 - ratio**2))
        return peak * _ROOM, 0

    def _largest_yield(self) -> float:
        """Return a bound of |Y| omega^2 beyond the included terms, 1/kg: 1 over the mass that moves there.

        Y is position over force.
        """
        first = (2 * self.terms + 1) * math.pi
        device = self.device
        mode = device.resonance
        if mode is None:
            bounds = self._rigid_bounds()
            return _reciprocal_bound(bounds.mass_kg - bounds.stiffness / first**2 - bounds.damping / first)
        t = device.sample_time_s
        low, high = self._ends("device.mass_kg", device.mass_kg)
        ratios = self._ends("device.resonance.mass_ratio", mode.mass_ratio)
        angle = 2 * math.pi * t * self._ends("device.resonance.frequency_hz", mode.frequency_hz)[1]
        ratio = self._ends("device.resonance.damping_ratio", mode.damping_ratio)[1]
        link = high * _LARGEST_REDUCED * (angle**2 / first**2 + 2 * ratio * angle / first)
        handle = low * ratios[0]
        grip = self.hand["stiffness_n_per_m"][1] * t**2 / first**2
        far = handle - grip - link
        motor = low * (1 - ratios[1]) - link
        return _reciprocal_bound(motor - link**2 / far if far > link else -1.0)

    def _ends(self, name: str, declared: float) -> tuple[float, float]:
        """Return the range of a number, of one value where it is known exactly."""
        return self.ranges.get(name, (declared, declared))


@dataclass(frozen=True)
class _RigidBounds:
    """Bounds of what acts on a rigid device with its hand: lowest mass, kg, largest b T and k T^2, both in kg."""

    mass_kg: float
    damping: float
    stiffness: float


# Of exp(-j 2 pi n delay).
_ROUGH = np.asarray(1e-12)


def _tail_sum(power: int, terms: int) -> float:
    """Bound the sum of (2 pi (n - 1/2))^-power over n > terms: the mean over each step is no less."""
    return _ROOM * (2 * math.pi) ** -power * float(terms) ** (1 - power) / (power - 1)


def _reciprocal_bound(value: float) -> float:
    """Bound 1/value from above; refuse a value that is not positive."""
    if not value > 0:
        raise UnsupportedError(_TOO_SLOW)
    return _ROOM / value


def _rotation(angle: Value) -> Value:
    """Return exp(-j angle), in plain numbers."""
    return np.exp(-1j * np.asarray(angle))


def _hold(angle: Value) -> Value:
    """Return (1 - exp(-j angle))/(j angle), in plain numbers."""
    return np.exp(-0.5j * angle) * np.sinc(angle.real / (2 * np.pi))
