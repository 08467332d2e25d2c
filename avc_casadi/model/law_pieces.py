"""Pieces of a law, each a formula in z that compiles to a `Law` at the sample time of the device.

They stand in the model, beside `Law`: the table `[law]` of a problem states them, and whoever closes a loop sees the
matrices alone. x is the measured position, T the sample time; forces count against +x. Estimators of the velocity give
its growth in a sample, v T, so that all states are lengths, which keeps digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.law import Law

_BUTTERWORTH = complex(-1.0, 1.0) / math.sqrt(2)
"""A pole of the second-order low pass of maximally flat magnitude, of which 1 rad/s is the -3 dB frequency."""


def low_pass(cutoff_hz: float, order: int, sample_time_s: float) -> Law:
    """Return a low pass of gain 1 at rest, -3 dB at the cutoff f where that is far below the sample rate.

    Order 1: (1 - p)/(1 - p/z), p = exp(-2 pi f T). Order 2, Butterworth's poles matched in the same way:
    (1 + a1 + a2)/(1 + a1/z + a2/z^2), of which the poles are exp(2 pi f T (-1 +- j)/sqrt 2).
    """
    turn = 2 * math.pi * cutoff_hz * sample_time_s
    if order == 1:
        return Law.low_pass(math.exp(-turn), sample_time_s)
    pole = np.exp(turn * _BUTTERWORTH)
    first, second = -2 * float(pole.real), float(abs(pole)) ** 2
    return Law.fraction([abs(1 - pole) ** 2, 0.0, 0.0], [1.0, first, second], sample_time_s)


@dataclass(frozen=True)
class Difference:
    """v = (1 - 1/z)/T x."""

    def growth(self, sample_time_s: float) -> Law:
        """Return the estimate of v T."""
        return Law.difference(sample_time_s)


@dataclass(frozen=True)
class Window:
    """v = (1 - z^-n)/(n T) x over a window of n samples."""

    samples: int

    def growth(self, sample_time_s: float) -> Law:
        """Return the estimate of v T."""
        share = 1 / self.samples
        ends = [share, *[0.0] * (self.samples - 1), -share]
        return Law.fraction(ends, [1.0, *[0.0] * self.samples], sample_time_s)


@dataclass(frozen=True)
class SmoothedDifference:
    """The difference behind `low_pass`."""

    cutoff_hz: float
    order: int = 1

    def growth(self, sample_time_s: float) -> Law:
        """Return the estimate of v T."""
        return Law.difference(sample_time_s).then(low_pass(self.cutoff_hz, self.order, sample_time_s))


Velocity = Difference | Window | SmoothedDifference


@dataclass(frozen=True)
class Spring:
    """F = k x."""

    stiffness_n_per_m: float

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        return Law.gain(self.stiffness_n_per_m, sample_time_s)


@dataclass(frozen=True)
class Damper:
    """F = b v; below 0 it compensates damping of the device."""

    damping_ns_per_m: float
    velocity: Velocity = Difference()

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        return self.velocity.growth(sample_time_s).times(self.damping_ns_per_m / sample_time_s)


@dataclass(frozen=True)
class Integral:
    """F = ki T/(1 - 1/z) x, the newest sample counted."""

    integral_n_per_m_s: float

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        return Law.integral(sample_time_s).times(self.integral_n_per_m_s * sample_time_s)


@dataclass(frozen=True)
class VirtualMass:
    """F = m (1 - 1/z)/T v; below 0 it compensates inertia of the device."""

    mass_kg: float
    velocity: Velocity = Difference()

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        acceleration = self.velocity.growth(sample_time_s).then(Law.difference(sample_time_s))
        return acceleration.times(self.mass_kg / sample_time_s**2)


@dataclass(frozen=True)
class LowPass:
    """`low_pass` of the command."""

    cutoff_hz: float
    order: int = 1

    def law(self, sample_time_s: float) -> Law:
        """Return the filter."""
        return low_pass(self.cutoff_hz, self.order, sample_time_s)


def _second_order(above: FloatArray, below: FloatArray, frequency_hz: float, sample_time_s: float) -> Law:
    """Return N/D, quadratic in q = s/w, by Tustin prewarped at w: q = (z - 1)/((z + 1) tan(w T/2)).

    Times (z + 1)^2 tan^2, q^2 is (z - 1)^2, q is (z^2 - 1) tan, and 1 is (z + 1)^2 tan^2.
    """
    tangent = math.tan(math.pi * frequency_hz * sample_time_s)
    powers = np.array([[1.0, -2.0, 1.0], [tangent, 0.0, -tangent], tangent**2 * np.array([1.0, 2.0, 1.0])])
    return Law.fraction((above @ powers).tolist(), (below @ powers).tolist(), sample_time_s)


@dataclass(frozen=True)
class Notch:
    """(s^2 + 2 depth width w s + w^2)/(s^2 + 2 width w s + w^2) by Tustin, prewarped at w = 2 pi f: its gain there."""

    frequency_hz: float
    depth: float
    width: float

    def law(self, sample_time_s: float) -> Law:
        """Return the filter."""
        above = np.array([1.0, 2 * self.depth * self.width, 1.0])
        below = np.array([1.0, 2 * self.width, 1.0])
        return _second_order(above, below, self.frequency_hz, sample_time_s)


@dataclass(frozen=True)
class Lead:
    """(1 + r s/w)/(1 + s/(r w)) by Tustin, prewarped at w = 2 pi f: gain 1 at rest, its largest lead phi at f.

    r^2 = (1 + sin phi)/(1 - sin phi).
    """

    frequency_hz: float
    phase_deg: float

    def law(self, sample_time_s: float) -> Law:
        """Return the filter."""
        sine = math.sin(math.radians(self.phase_deg))
        ratio = math.sqrt((1 + sine) / (1 - sine))
        tangent = math.tan(math.pi * self.frequency_hz * sample_time_s)
        above = [ratio + tangent, tangent - ratio]
        below = [1 / ratio + tangent, tangent - 1 / ratio]
        return Law.fraction(above, below, sample_time_s)


@dataclass(frozen=True)
class Transfer:
    """N(z)/D(z), polynomials in z, the highest power first."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def law(self, sample_time_s: float) -> Law:
        """Return the filter."""
        return Law.fraction(self.numerator, self.denominator, sample_time_s)


Force = Spring | Damper | Integral | VirtualMass
Filter = LowPass | Notch | Lead | Transfer


def compiled(forces: tuple[Force, ...], filters: tuple[Filter, ...], sample_time_s: float) -> Law:
    """Return the sum of some forces, then the filters of the command in their order; no force at all is 0."""
    laws = [force.law(sample_time_s) for force in forces] or [Law.gain(0.0, sample_time_s)]
    command = reduce(Law.__add__, laws)
    return reduce(Law.then, (item.law(sample_time_s) for item in filters), command)
