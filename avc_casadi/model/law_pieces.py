"""Pieces of a law, each a formula in z that compiles to a `Law` at the sample time of the device.

They stand in the model, beside `Law`: the table `[law]` of a problem states them, and whoever closes a loop sees the
matrices alone. x is the measured position, T the sample time; forces count against +x. Estimators of the velocity give
its growth in a sample, v T, so that all states are lengths, which keeps digits. A piece that is not linear compiles to
a law with a sector, its range of slopes; simulation and exported C run the piece itself.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache, reduce

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.law import FRICTION_COMPENSATION, SPRING_DEAD_ZONE, Law

_KEPT = 256
"""Compiled laws that are kept."""
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


class VelocityEstimator(ABC):
    """An estimator of the velocity: blocks in series, from the position to its growth in a sample, v T."""

    @abstractmethod
    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return the blocks in their order."""

    def growth(self, sample_time_s: float) -> Law:
        """Return the estimate of v T."""
        return reduce(Law.then, self.blocks(sample_time_s))


@dataclass(frozen=True)
class Difference(VelocityEstimator):
    """v = (1 - 1/z)/T x."""

    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return the difference."""
        return (Law.difference(sample_time_s),)


@dataclass(frozen=True)
class Window(VelocityEstimator):
    """v = (1 - z^-n)/(n T) x over a window of n samples."""

    samples: int

    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return the difference over the window, and its share of a sample."""
        ends = [1.0, *[0.0] * (self.samples - 1), -1.0]
        over_window = Law.fraction(ends, [1.0, *[0.0] * self.samples], sample_time_s)
        return over_window, Law.gain(1 / self.samples, sample_time_s)


@dataclass(frozen=True)
class SmoothedDifference(VelocityEstimator):
    """The difference behind `low_pass`."""

    cutoff_hz: float
    order: int = 1

    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return the difference and the low pass."""
        return Law.difference(sample_time_s), low_pass(self.cutoff_hz, self.order, sample_time_s)


@dataclass(frozen=True)
class Kalman(VelocityEstimator):
    """The steady Kalman filter of a constant velocity that white accelerations disturb (alpha-beta filter).

    With the prediction p = x_e + g and the innovation e = x - p: x_e = p + alpha e, g = g + beta e, g the growth in a
    sample. Kalata's relation beta = 2 (2 - alpha) - 4 sqrt(1 - alpha) makes it the steady filter of some ratio of
    noises; with alpha = 1 - r^2 it is beta = 2 (1 - r)^2. r = exp(-w T/sqrt 2) gives its poles the size of those of the
    continuous filter, Butterworth's of w = 2 pi f. From x to g:

        beta (1 - 1/z)/(1 - (2 - alpha - beta)/z + (1 - alpha)/z^2)

    P. R. Kalata, The tracking index, IEEE Trans. Aerospace and Electronic Systems 20 (1984).
    """

    bandwidth_hz: float

    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return the difference and the filter behind it."""
        size = math.exp(-math.sqrt(2) * math.pi * self.bandwidth_hz * sample_time_s)
        beta = 2 * (1 - size) ** 2
        below = [1.0, beta - 1 - size**2, size**2]
        return Law.difference(sample_time_s), Law.fraction([beta, 0.0, 0.0], below, sample_time_s)


@dataclass(frozen=True)
class Ticks(VelocityEstimator):
    """The way between the last two changes of the position over the time between them, 0 after a timeout.

    A change after n samples, with n up to the timeout, gives v = way/(n T), which is kept until the next change. At a
    steady speed of one step in n samples it is n samples old in the mean: half of n within the two changes, half while
    it is kept. A window of 2 n samples is as old. The linear claim takes n = timeout/T, which is the slowest speed that
    is seen at all.
    """

    timeout_s: float

    def samples(self, sample_time_s: float) -> int:
        """Return the timeout in samples."""
        return max(1, round(self.timeout_s / sample_time_s))

    def blocks(self, sample_time_s: float) -> tuple[Law, ...]:
        """Return what a linear claim takes it for, its window at the slowest speed."""
        return Window(2 * self.samples(sample_time_s)).blocks(sample_time_s)


Velocity = Difference | Window | SmoothedDifference | Kalman | Ticks


@dataclass(frozen=True)
class Spring:
    """F = k x; with a dead zone w: F = k (x - w) above w, k (x + w) below -w, 0 between."""

    stiffness_n_per_m: float
    dead_zone_m: float = 0.0

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        if not self.dead_zone_m:
            return Law.gain(self.stiffness_n_per_m, sample_time_s)
        return Law.of_sector(SPRING_DEAD_ZONE, sample_time_s).times(self.stiffness_n_per_m)


class OfVelocity(ABC):
    """A force that follows from an estimate of the velocity."""

    velocity: Velocity

    @abstractmethod
    def of_growth(self, sample_time_s: float) -> Law:
        """Return the law of the growth in a sample, v T."""

    def law(self, sample_time_s: float) -> Law:
        """Return the law of the position."""
        return self.velocity.growth(sample_time_s).then(self.of_growth(sample_time_s))


@dataclass(frozen=True)
class Damper(OfVelocity):
    """F = b v; below 0 it compensates damping of the device."""

    damping_ns_per_m: float
    velocity: Velocity = Difference()

    def of_growth(self, sample_time_s: float) -> Law:
        """Return the law of v T."""
        return Law.gain(self.damping_ns_per_m / sample_time_s, sample_time_s)


@dataclass(frozen=True)
class Integral:
    """F = ki T/(1 - 1/z) x, the newest sample counted; with a limit the sum stops where F would exceed it."""

    integral_n_per_m_s: float
    limit_n: float | None = None

    def law(self, sample_time_s: float) -> Law:
        """Return the law."""
        summed = Law.integral(sample_time_s) if self.limit_n is None else Law.limited_integral(sample_time_s)
        return summed.times(self.integral_n_per_m_s * sample_time_s)


@dataclass(frozen=True)
class FrictionCompensation(OfVelocity):
    """F = -f sat(v/w): a push of f along the motion, in proportion to the velocity below w.

    sat(u) is u between -1 and 1, and the sign of u beyond. It has the slope of tanh at 0, the steepest of both, and is
    the same number on every processor, which no library's tanh is.
    """

    force_n: float
    velocity_m_per_s: float
    velocity: Velocity = Difference()

    @property
    def steepest_ns_per_m(self) -> float:
        """The damper that it is at rest, -f/w."""
        return -self.force_n / self.velocity_m_per_s

    def of_growth(self, sample_time_s: float) -> Law:
        """Return the law of v T."""
        passed = Law.of_sector(FRICTION_COMPENSATION, sample_time_s)
        return passed.times(self.steepest_ns_per_m / sample_time_s)


@dataclass(frozen=True)
class VirtualMass(OfVelocity):
    """F = m (1 - 1/z)/T v; below 0 it compensates inertia of the device."""

    mass_kg: float
    velocity: Velocity = Difference()

    def of_growth(self, sample_time_s: float) -> Law:
        """Return the law of v T."""
        return Law.difference(sample_time_s).times(self.mass_kg / sample_time_s**2)


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


Force = Spring | Damper | Integral | VirtualMass | FrictionCompensation
Filter = LowPass | Notch | Lead | Transfer


@lru_cache(maxsize=_KEPT)
def compiled(forces: tuple[Force, ...], filters: tuple[Filter, ...], sample_time_s: float) -> Law:
    """Return the sum of some forces, then the filters of the command in their order; no force at all is 0.

    Searches change one piece of many laws: what stands before it is compiled once.
    """
    if not filters:
        return _summed(forces, sample_time_s)
    return compiled(forces, filters[:-1], sample_time_s).then(filters[-1].law(sample_time_s))


@lru_cache(maxsize=_KEPT)
def _summed(forces: tuple[Force, ...], sample_time_s: float) -> Law:
    """Return the sum of some forces; those of one estimate of the velocity share its states."""
    laws = [force.law(sample_time_s) for force in forces if not isinstance(force, OfVelocity)]
    moving = [force for force in forces if isinstance(force, OfVelocity)]
    for velocity in dict.fromkeys(force.velocity for force in moving):
        of_growth = [force.of_growth(sample_time_s) for force in moving if force.velocity == velocity]
        laws.append(velocity.growth(sample_time_s).then(reduce(Law.__add__, of_growth)))
    return reduce(Law.__add__, laws or [Law.gain(0.0, sample_time_s)])
