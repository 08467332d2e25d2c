"""Complex numbers known to lie in a disc, and their rates of change: midpoint and radius, every rounding enclosed.

A disc is a centre c and a radius r; the result of a function contains its value at every point of its arguments. Radii
are rounded up by a factor far above the errors of double precision. exp, sin and cos are assumed right to four units in
the last place. Numbers are rotated and inverted repeatedly, by which a disc stays a disc.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray

# Of a complex product or sum, relative to its size, with room to spare; of a function of the standard library.
_ROUNDING = 2.0**-49
# Of the radii themselves: a handful of positive terms.
_UP = 1.0 + 2.0**-46
# Of the radius of a reciprocal, whose difference of squares cancels.
_UP_OPEN = 1.0 + 2.0**-40
# Roundings of the centre of a reciprocal, with room to spare; of the hold over a sample, and of its rate.
_RECIPROCAL_ROUNDINGS = 2**6
_HOLD_ROUNDINGS = 4
_HOLD_RATE_ROUNDINGS = 2**10
# Added where a product may underflow.
_TINY = 1e-300
# Beyond this ratio of radius to centre a reciprocal is taken as unbounded.
_MOST_OPEN = 0.99
# Below this angle the rate of the hold is a power series, of so many terms; its closed form cancels there.
_SMALL_ANGLE = 0.25
_SERIES_TERMS = 16

Number = float | complex


@dataclass(frozen=True, eq=False)
class Disc:
    """Discs c + r, arrays of one shape."""

    centre: ComplexArray
    radius: FloatArray

    @classmethod
    def around(cls, centre: FloatArray, radius: FloatArray) -> Disc:
        """Return real intervals as discs."""
        return cls(np.asarray(centre, dtype=np.complex128), np.asarray(radius, dtype=np.float64))

    @classmethod
    def with_rounding(cls, value: Number | FloatArray) -> Disc:
        """Return numbers that were rounded before as discs."""
        return cls(np.asarray(value, dtype=np.complex128), np.asarray(_ROUNDING * np.abs(value) + _TINY))

    def __add__(self, other: Disc | Number) -> Disc:
        if isinstance(other, Moving):
            return NotImplemented
        if isinstance(other, Disc):
            centre = self.centre + other.centre
            return Disc(centre, (self.radius + other.radius + _ROUNDING * np.abs(centre)) * _UP)
        centre = self.centre + other
        return Disc(centre, (self.radius + _ROUNDING * np.abs(centre)) * _UP)

    __radd__ = __add__

    def __neg__(self) -> Disc:
        return Disc(-self.centre, self.radius)

    def __sub__(self, other: Disc | Number) -> Disc:
        if isinstance(other, Moving):
            return NotImplemented
        return self + (-other)

    def __rsub__(self, other: Number) -> Disc:
        return -self + other

    def __mul__(self, other: Disc | Number) -> Disc:
        """Return a disc that encloses every product of two discs, or of a disc and a number, rounding included."""
        if isinstance(other, Moving):
            return NotImplemented
        if isinstance(other, Disc):
            size = np.abs(self.centre)
            other_size = np.abs(other.centre)
            spread = size * (other.radius + _ROUNDING * other_size) + self.radius * (other_size + other.radius)
            return Disc(self.centre * other.centre, (spread + _TINY) * _UP)
        spread = abs(other) * (self.radius + _ROUNDING * np.abs(self.centre))
        return Disc(self.centre * other, (spread + _TINY) * _UP)

    __rmul__ = __mul__

    def sum(self) -> Disc:
        """Add along the first axis."""
        spread = len(self.centre) * _ROUNDING * np.abs(self.centre).sum(axis=0)
        return Disc(self.centre.sum(axis=0), (self.radius.sum(axis=0) + spread) * _UP)

    def reciprocal(self) -> Disc:
        """Return a disc that encloses 1/z of every z of this one; unbounded where it comes near to 0."""
        size = np.abs(self.centre)
        apart = self.radius < _MOST_OPEN * size
        with np.errstate(all="ignore"):
            square = size * size - self.radius * self.radius
            centre = np.where(apart, np.conj(self.centre) / square, 0.0)
            rounding = _RECIPROCAL_ROUNDINGS * _ROUNDING * np.abs(centre)
            radius = np.where(apart, (self.radius / square + rounding) * _UP_OPEN, np.inf)
        return Disc(centre, radius)

    def __rtruediv__(self, other: Number) -> Disc:
        return self.reciprocal() * other

    def conj(self) -> Disc:
        """Return the conjugates."""
        return Disc(np.conj(self.centre), self.radius)

    def real(self) -> Disc:
        """Return the real parts."""
        return Disc(np.asarray(self.centre.real + 0j), self.radius)

    def abs2(self) -> Disc:
        """Return the squared moduli."""
        size = np.abs(self.centre)
        spread = self.radius * (2 * size + self.radius) + _ROUNDING * size * size
        return Disc(np.asarray(size * size + 0j), (spread + _TINY) * _UP)

    @property
    def largest(self) -> FloatArray:
        """Upper bound of |z|."""
        return (np.abs(self.centre) * (1 + _ROUNDING) + self.radius) * _UP

    @property
    def real_low(self) -> FloatArray:
        """Lower bound of the real part."""
        return self.centre.real - self.radius * _UP - _TINY


@dataclass(frozen=True, eq=False)
class Moving:
    """A disc with its rates of change along some variables, each over the whole cell.

    Attributes:
        value: the disc.
        slopes: its rate of change along each variable, by the variable's number; a variable without one has rate 0.
    """

    value: Disc
    slopes: dict[int, Disc]

    @classmethod
    def variable(cls, number: int, low: FloatArray, high: FloatArray) -> Moving:
        """Return a variable over its interval."""
        centre = 0.5 * (low + high)
        radius = np.maximum(high - centre, centre - low) * _UP
        unit_slope = Disc.around(np.ones(len(low)), np.zeros(len(low)))
        return cls(Disc.around(centre, radius), {number: unit_slope})

    @classmethod
    def constant(cls, value: FloatArray) -> Moving:
        """Return a constant."""
        return cls(Disc.around(value, np.zeros(len(value))), {})

    def __add__(self, other: Moving | Disc | Number) -> Moving:
        if not isinstance(other, Moving):
            return Moving(self.value + other, self.slopes)
        slopes = _sum_of_rates(self.slopes, other.slopes)
        return Moving(self.value + other.value, slopes)

    __radd__ = __add__

    def __neg__(self) -> Moving:
        return Moving(-self.value, {number: -slope for number, slope in self.slopes.items()})

    def __sub__(self, other: Moving | Disc | Number) -> Moving:
        return self + (-other)

    def __rsub__(self, other: Number) -> Moving:
        return -self + other

    def __mul__(self, other: Moving | Disc | Number) -> Moving:
        if not isinstance(other, Moving):
            return Moving(self.value * other, {number: slope * other for number, slope in self.slopes.items()})
        of_self = {number: slope * other.value for number, slope in self.slopes.items()}
        of_other = {number: slope * self.value for number, slope in other.slopes.items()}
        slopes = _sum_of_rates(of_self, of_other)
        return Moving(self.value * other.value, slopes)

    __rmul__ = __mul__

    def sum(self) -> Moving:
        """Add along the first axis."""
        return Moving(self.value.sum(), {number: slope.sum() for number, slope in self.slopes.items()})

    def conj(self) -> Moving:
        """Return the conjugate; the variables are real."""
        return Moving(self.value.conj(), {number: slope.conj() for number, slope in self.slopes.items()})

    def real(self) -> Moving:
        """Return the real part."""
        return Moving(self.value.real(), {number: slope.real() for number, slope in self.slopes.items()})

    def abs2(self) -> Moving:
        """Return the squared modulus."""
        back = self.value.conj() * 2.0
        return Moving(self.value.abs2(), {number: (slope * back).real() for number, slope in self.slopes.items()})

    def __rtruediv__(self, other: Number) -> Moving:
        inverse = self.value.reciprocal()
        square = -(inverse * inverse)
        whole = Moving(inverse, {number: slope * square for number, slope in self.slopes.items()})
        return whole if other == 1 else whole * other


def _sum_of_rates(first: dict[int, Disc], second: dict[int, Disc]) -> dict[int, Disc]:
    """Add rates of change by their variables."""
    rates = dict(first)
    for number, rate in second.items():
        rates[number] = rates[number] + rate if number in rates else rate
    return rates


def rotation(angle: Moving) -> Moving:
    """Return exp(-j angle) of a real angle."""
    centre, spread = angle.value.centre.real, angle.value.radius
    value = Disc(np.exp(-1j * centre), (spread + _ROUNDING * (1 + np.abs(centre))) * _UP)
    return Moving(value, {number: slope * (value * -1j) for number, slope in angle.slopes.items()})


def hold(angle: Moving) -> Moving:
    """Return (1 - exp(-j angle))/(j angle), the hold over one sample: the mean of exp(-j angle u) over u in [0, 1]."""
    centre = angle.value.centre.real
    spread = angle.value.radius
    mean = np.exp(-0.5j * centre) * np.sinc(centre / (2 * np.pi))
    # The mean of exp(-j angle u) has rates of at most 1/2 and 1/3.
    value = Disc(mean, (0.5 * spread + _HOLD_ROUNDINGS * _ROUNDING) * _UP)
    rate = Disc(_hold_rate(centre), (spread / 3 + _HOLD_RATE_ROUNDINGS * _ROUNDING) * _UP)
    return Moving(value, {number: slope * rate for number, slope in angle.slopes.items()})


def _hold_rate(angle: FloatArray) -> ComplexArray:
    """Return -j times the mean of u exp(-j angle u) over u in [0, 1], the rate of `hold`; of small angles a series."""
    small = np.abs(angle) < _SMALL_ANGLE
    far = np.where(small, 1.0, angle)
    closed = (np.exp(-1j * far) - np.exp(-0.5j * far) * np.sinc(far / (2 * np.pi))) / far
    near = np.where(small, angle, 0.0) * -1j
    term = np.ones_like(near)
    series = np.zeros_like(near)
    for power in range(_SERIES_TERMS):
        series += term / (power + 2)
        term = term * near / (power + 1)
    return np.where(small, -1j * series, closed)
