"""Intervals of doubles over whole arrays, rounded outwards: enclosures are proved, not estimated.

Assumed is IEEE 754 double precision with rounding to nearest for +, -, *, / and square root, which numpy passes to the
processor; results that underflow may be flushed to zero. Nothing is assumed of libm: sine and cosine are summed here.
Every result is widened by one to two units in the last place and by 2^-1022.

An end that is not a number is unknown. Every comparison with it is false, so that nothing follows from it: test `x.low
> 0`, never `not x.low <= 0`.

Complex numbers that are rotated have `disc`: a rectangle grows by up to the root of 2 with each rotation, a disc does
not. Rectangles keep real and imaginary parts separate, whose signs decide here, and need no function of libm.

python-flint and mpmath enclose one number at a time: products and quotients of 100 000 intervals take python-flint four
to nine times as long, sums twelve times, plus 0.7 and 1.1 us a number of conversion. Packages for arrays have binaries
for few platforms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import EllipsisType
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avc_casadi._util.arrays import FloatArray

_UNIT = 2.0**-52
_LEAST = 2.0**-1022

Index = int | slice | EllipsisType | NDArray[Any] | None | tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Interval:
    """An array of closed intervals; numbers and arrays in the same formula count as exact.

    Attributes:
        low: lower ends.
        high: upper ends, of the same shape.
    """

    low: FloatArray
    high: FloatArray

    # numpy then leaves `array * interval` to this class.
    __array_ufunc__ = None

    @classmethod
    def of(cls, low: ArrayLike, high: ArrayLike | None = None) -> Self:
        """Return the intervals between two arrays of ends, or the numbers of one array as exact."""
        first = np.asarray(low, dtype=np.float64)
        one, other = np.broadcast_arrays(first, first if high is None else np.asarray(high, dtype=np.float64))
        return cls(one, other)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.low.shape

    @property
    def middle(self) -> FloatArray:
        """A number inside each interval, near its middle."""
        return np.asarray(np.clip(0.5 * self.low + 0.5 * self.high, self.low, self.high))

    @property
    def width(self) -> FloatArray:
        """Upper bound of the width."""
        return _above(self.high - self.low)

    @property
    def magnitude(self) -> FloatArray:
        """Largest absolute value."""
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))

    def __getitem__(self, index: Index) -> Interval:
        return Interval(np.asarray(self.low[index]), np.asarray(self.high[index]))

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __abs__(self) -> Interval:
        least = np.maximum(np.maximum(self.low, -self.high), 0.0)
        return Interval(np.asarray(least), self.magnitude)

    def __add__(self, other: Interval | FloatArray | float) -> Interval:
        if isinstance(other, ComplexInterval):
            return NotImplemented
        low, high = (other.low, other.high) if isinstance(other, Interval) else (other, other)
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            return Interval(_below(self.low + low), _above(self.high + high))

    __radd__ = __add__

    def __sub__(self, other: Interval | FloatArray | float) -> Interval:
        return self + (-other)

    def __rsub__(self, other: FloatArray | float) -> Interval:
        return -self + other

    def __mul__(self, other: Interval | FloatArray | float) -> Interval:
        if isinstance(other, ComplexInterval):
            return NotImplemented
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            if not isinstance(other, Interval):
                one, two = self.low * other, self.high * other
                return Interval(_below(np.minimum(one, two)), _above(np.maximum(one, two)))
            a, b = self.low * other.low, self.low * other.high
            c, d = self.high * other.low, self.high * other.high
            low = np.minimum(np.minimum(a, b), np.minimum(c, d))
            high = np.maximum(np.maximum(a, b), np.maximum(c, d))
            return Interval(_below(low), _above(high))

    __rmul__ = __mul__

    def __truediv__(self, other: Interval | FloatArray | float) -> Interval:
        """Divide; where the divisor may be 0 the quotient is unknown."""
        if isinstance(other, float) and other > 0:
            with np.errstate(over="ignore", invalid="ignore", under="ignore"):
                return Interval(_below(self.low / other), _above(self.high / other))
        divisor = other if isinstance(other, Interval) else Interval.of(other)
        with np.errstate(over="ignore", invalid="ignore", under="ignore", divide="ignore"):
            a, b = self.low / divisor.low, self.low / divisor.high
            c, d = self.high / divisor.low, self.high / divisor.high
            low = _below(np.minimum(np.minimum(a, b), np.minimum(c, d)))
            high = _above(np.maximum(np.maximum(a, b), np.maximum(c, d)))
        sound = (divisor.low > 0) | (divisor.high < 0)
        return Interval(np.where(sound, low, np.nan), np.where(sound, high, np.nan))

    def __rtruediv__(self, other: FloatArray | float) -> Interval:
        return Interval.of(other) / self

    def square(self) -> Interval:
        """Return the squares, which are never negative."""
        near = abs(self)
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            low, high = near.low * near.low, near.high * near.high
            return Interval(np.asarray(np.maximum(_below(low), 0.0)), _above(high))

    def sqrt(self) -> Interval:
        """Return the square roots; unknown for intervals that reach below 0."""
        with np.errstate(invalid="ignore"):
            root = np.sqrt(self.low)
            return Interval(np.asarray(np.maximum(_below(root), 0.0)), _above(np.sqrt(self.high) + 0.0 * root))

    def hull(self, other: Interval) -> Interval:
        """Return the smallest intervals that contain both."""
        return Interval(np.minimum(self.low, other.low), np.maximum(self.high, other.high))

    def clip(self, low: float, high: float) -> Interval:
        """Return the intersection with two known bounds."""
        return Interval(np.clip(self.low, low, high), np.clip(self.high, low, high))

    def sum(self, axis: int) -> Interval:
        """Add along an axis."""
        low, high = np.moveaxis(self.low, axis, 0), np.moveaxis(self.high, axis, 0)
        total = Interval.of(np.zeros(low.shape[1:]))
        for one_low, one_high in zip(low, high, strict=True):
            total = total + Interval(np.asarray(one_low), np.asarray(one_high))
        return total


@dataclass(frozen=True, eq=False)
class ComplexInterval:
    """An array of rectangles in the complex plane.

    Attributes:
        real: real parts.
        imag: imaginary parts, of the same shape.
    """

    real: Interval
    imag: Interval

    __array_ufunc__ = None

    @classmethod
    def on_unit_circle(cls, angle: Interval) -> Self:
        """Return exp(j angle), angle in rad."""
        sin, cos = sine_and_cosine(angle)
        return cls(cos, sin)

    def __getitem__(self, index: Index) -> ComplexInterval:
        return ComplexInterval(self.real[index], self.imag[index])

    def __neg__(self) -> ComplexInterval:
        return ComplexInterval(-self.real, -self.imag)

    def __add__(self, other: ComplexInterval | Interval | FloatArray | float) -> ComplexInterval:
        if isinstance(other, ComplexInterval):
            return ComplexInterval(self.real + other.real, self.imag + other.imag)
        return ComplexInterval(self.real + other, self.imag)

    __radd__ = __add__

    def __sub__(self, other: ComplexInterval | Interval | FloatArray | float) -> ComplexInterval:
        return self + (-other)

    def __rsub__(self, other: Interval | FloatArray | float) -> ComplexInterval:
        return -self + other

    def __mul__(self, other: ComplexInterval | Interval | FloatArray | float) -> ComplexInterval:
        if isinstance(other, ComplexInterval):
            return ComplexInterval(
                self.real * other.real - self.imag * other.imag, self.real * other.imag + self.imag * other.real
            )
        return ComplexInterval(self.real * other, self.imag * other)

    __rmul__ = __mul__

    def conj(self) -> ComplexInterval:
        """Return the conjugates."""
        return ComplexInterval(self.real, -self.imag)

    def square(self) -> ComplexInterval:
        """Return the squares."""
        return ComplexInterval(self.real.square() - self.imag.square(), 2.0 * (self.real * self.imag))

    def abs2(self) -> Interval:
        """Return the squared moduli."""
        return self.real.square() + self.imag.square()


def cosine(angle: Interval) -> Interval:
    """Return the cosine of angles in rad."""
    return sine_and_cosine(angle)[1]


def sine(angle: Interval) -> Interval:
    """Return the sine of angles in rad."""
    return sine_and_cosine(angle)[0]


def sine_and_cosine(angle: Interval) -> tuple[Interval, Interval]:
    """Return both of angles in rad, for little more than one."""
    sin, cos = _of_numbers(np.stack([angle.low, angle.high]))
    return _over_range(angle, sin[0], sin[1], 0.5), _over_range(angle, cos[0], cos[1], 0.0)


# The double next to pi/2 lies below it.
_HALF_PI = Interval.of(math.pi / 2, np.nextafter(math.pi / 2, 2.0))
_TERMS = 9


def _of_numbers(angle: FloatArray) -> tuple[Interval, Interval]:
    """Return sine and cosine of exact angles: Taylor's series on the nearest multiple of pi/2, remainder enclosed."""
    with np.errstate(invalid="ignore"):
        turns = np.rint(angle / (math.pi / 2))
        rest = Interval.of(angle) - _HALF_PI * turns
        square = rest.square()
        sin, cos = Interval.of(np.ones_like(angle)), Interval.of(np.ones_like(angle))
        for i in range(_TERMS - 1, 0, -1):
            sin = 1.0 - square * sin / float(2 * i * (2 * i + 1))
            cos = 1.0 - square * cos / float((2 * i - 1) * 2 * i)
        # Lagrange: the next derivative is at most 1.
        left = Interval.of(np.ones_like(angle))
        for i in range(1, 2 * _TERMS + 1):
            left = left * rest.magnitude / float(i)
        left_sin = (left * rest.magnitude / float(2 * _TERMS + 1)).high
        sin = (rest * sin + Interval(-left_sin, left_sin)).clip(-1.0, 1.0)
        cos = (cos + Interval(-left.high, left.high)).clip(-1.0, 1.0)
        quarter = np.mod(turns, 4.0)
    return (
        _chosen(quarter, (sin, cos, -sin, -cos)),
        _chosen(quarter, (cos, -sin, -cos, sin)),
    )


def _chosen(quarter: FloatArray, four: tuple[Interval, ...]) -> Interval:
    conditions = [quarter == i for i in range(4)]
    low = np.select(conditions, [one.low for one in four], np.nan)
    high = np.select(conditions, [one.high for one in four], np.nan)
    return Interval(low, high)


def _over_range(angle: Interval, at_low: Interval, at_high: Interval, shift: float) -> Interval:
    """Add the extrema inside: 1 at even multiples of pi (and the shift, of pi), -1 at odd ones."""
    ends = at_low.hull(at_high)
    with np.errstate(invalid="ignore"):
        first, last = angle.low / math.pi - shift, angle.high / math.pi - shift
        # An extremum just outside is harmless, a missed one is not.
        spare = 1e-12 * (1.0 + np.abs(first) + np.abs(last))
        first, last = np.ceil(first - spare), np.floor(last + spare)
        top = 2 * np.ceil(first / 2) <= last
        bottom = 2 * np.ceil((first - 1) / 2) + 1 <= last
    return Interval(np.where(bottom, -1.0, ends.low), np.where(top, 1.0, ends.high))


def _below(value: FloatArray) -> FloatArray:
    """Return lower bounds of all numbers that round to these: |x| 2^-52 is a unit in the last place or up to two."""
    return np.asarray(value - (np.abs(value) * _UNIT + _LEAST))


def _above(value: FloatArray) -> FloatArray:
    return np.asarray(value + (np.abs(value) * _UNIT + _LEAST))


Number = TypeVar("Number", Interval, ComplexInterval)


@dataclass(frozen=True)
class Jet(Generic[Number]):
    """An enclosure of a function over n cells, and of its partial derivatives there.

    Attributes:
        value: shape (n,).
        slope: shape (variables, n).
    """

    value: Number
    slope: Number

    def __add__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value + other.value, self.slope + other.slope)

    def __sub__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value - other.value, self.slope - other.slope)

    def __neg__(self) -> Jet[Number]:
        return Jet(-self.value, -self.slope)

    def __mul__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value * other.value, self.slope * other.value + other.slope * self.value)

    def times(self, number: Interval | FloatArray | float) -> Jet[Number]:
        """Multiply by a number that does not depend on the variables."""
        return Jet(self.value * number, self.slope * number)

    def plus(self, number: Interval | FloatArray | float) -> Jet[Number]:
        """Add a number that does not depend on the variables."""
        return Jet(self.value + number, self.slope)

    def square(self) -> Jet[Number]:
        """Return the square."""
        return Jet(self.value.square(), 2.0 * (self.slope * self.value))
