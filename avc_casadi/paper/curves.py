"""Curves in the gain box along which one gain moves, all frequencies at once, and the sign changes along them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.paper.equations import coupling_impedance, series
from avc_casadi.paper.loop import Loop

Functions = Callable[[FloatArray, NDArray[np.intp]], FloatArray]
"""(x, index) -> value: evaluate function number ``index[i]`` at ``x[i]``."""

_MOST_STEPS = 120
_SMALL = 1e-14
"""Brackets are narrowed relative to x, but not below that of this x: a root may stand at 0."""


def bracketed_roots(
    function: Functions,
    low: FloatArray,
    high: FloatArray,
    value_low: FloatArray,
    value_high: FloatArray,
    *,
    tolerance: float,
) -> tuple[FloatArray, FloatArray]:
    """Narrow brackets [low, high] with a sign change to a width, by inverse quadratic steps or halving.

    Args:
        function: evaluates the functions; each bracket is one function.
        low: lower ends, shape (m,).
        high: upper ends, shape (m,).
        value_low: values at ``low``; their signs differ from those of ``value_high``.
        value_high: values at ``high``.
        tolerance: width of the final brackets, relative to x >= 0.

    Returns:
        Both ends of each final bracket, (m,) each: the one with a value >= 0, the one with a value < 0.
    """
    a, b, fa, fb = high.copy(), low.copy(), value_high.copy(), value_low.copy()
    c, fc = a.copy(), fa.copy()
    share = np.full(low.shape, 0.5)
    at = np.flatnonzero(np.abs(b - a) > tolerance * (np.abs(a) + _SMALL))
    for _ in range(_MOST_STEPS):
        if not at.size:
            break
        x = a[at] + share[at] * (b[at] - a[at])
        fx = function(x, at)
        same = (fx < 0) == (fa[at] < 0)
        c[at] = np.where(same, a[at], b[at])
        fc[at] = np.where(same, fa[at], fb[at])
        b[at] = np.where(same, b[at], a[at])
        fb[at] = np.where(same, fb[at], fa[at])
        a[at], fa[at] = x, fx
        share[at], still_open = _next_share(*(v[at] for v in (a, b, c, fa, fb, fc)), tolerance=tolerance)
        at = at[still_open]
    upper = fa >= 0
    return np.where(upper, a, b), np.where(upper, b, a)


def _next_share(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    fa: FloatArray,
    fb: FloatArray,
    fc: FloatArray,
    *,
    tolerance: float,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where to evaluate next, as a share of the way from a to b, and whether the bracket is still too wide."""
    least = np.clip(tolerance * (np.abs(a) + _SMALL) / np.abs(b - a), 0, 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        inverse = (phi * phi < xi) & ((1 - phi) ** 2 < 1 - xi)
        step = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    step = np.where(inverse & np.isfinite(step), step, 0.5)
    return np.clip(step, least, 1 - least), (least < 0.5) & (fa != 0)


Index = NDArray[np.intp]
Function = Callable[[ComplexArray, ComplexArray, Index], FloatArray]
"""(Z_eavc + b_p, its derivative along x, position of the curve) -> a real value."""

_SAMPLES = 13
TOLERANCE = 4 * float(np.finfo(np.float64).eps)
"""Width in x of a root's last bracket: |dZ/dx| is of the order of |Z|, so that this is the rounding of Z."""


@dataclass(frozen=True)
class Points:
    """Gains found on curves, flat arrays of one length, with the frequency that each belongs to."""

    row: Index
    b: FloatArray
    k: FloatArray
    p: FloatArray


@dataclass(frozen=True)
class Curves:
    """Curves t -> (b, k, b_p), one gain moving; flat arrays, one entry a curve.

    Attributes:
        row: frequency that the curve belongs to.
        b: damping where it is fixed.
        k: stiffness where it is fixed.
        p: contact damping where it is fixed.
        moving: 0, 1 or 2: b, k or b_p moves.
        low: lower end of the moving gain.
        high: upper end.
        loop: the loop at ``row``.
        scale: c of x = t/(c + t).
        coupling: Z_avc where the moving gain is 0.
        slope: its derivative along the moving gain; 0 where that is b_p.
        rise: derivative of b_p along the moving gain, 1 or 0.
    """

    row: Index
    b: FloatArray
    k: FloatArray
    p: FloatArray
    moving: Index
    low: FloatArray
    high: FloatArray
    loop: Loop
    scale: FloatArray
    coupling: ComplexArray
    slope: ComplexArray
    rise: FloatArray

    @classmethod
    def of(cls, loop: Loop, fixed: Points, moving: Index, low: FloatArray, high: FloatArray, margin: float) -> Curves:
        """Make curves from their fixed gains (the moving one is ignored); ``margin`` is that of (12)."""
        here = loop.rows(fixed.row)
        b, k, p = (np.where(moving == i, 0.0, gain) for i, gain in enumerate((fixed.b, fixed.k, fixed.p)))
        coupling, spring = coupling_impedance(here.angle, b, k), coupling_impedance(here.angle, 0.0, 1.0)
        # Along a line Z_h = Z_0 + H b_p what is sought has the size of Z_0, of the goal or of the margin.
        sizes = np.maximum(np.abs(here.target), margin), np.abs(here.perceived(b, k, p))
        weight = np.where(moving == 2, np.maximum(*sizes) / np.abs(here.hold), np.abs(here.environment + coupling))
        weight /= np.where(moving == 1, np.abs(spring), 1.0)
        return cls(
            row=fixed.row,
            b=b,
            k=k,
            p=p,
            moving=moving,
            low=low,
            high=high,
            loop=here,
            scale=np.where(weight > 0, weight, np.maximum(high, 1.0)),
            coupling=coupling,
            slope=np.choose(moving, (1.0, spring, 0.0)),
            rise=np.where(moving == 2, 1.0, 0.0),
        )

    def at(self, t: FloatArray, index: Index) -> Points:
        """Gains where the moving gain is t, on the curves ``index``."""
        moving = self.moving[index]
        gains = (gain[index] for gain in (self.b, self.k, self.p))
        b, k, p = (np.where(moving == i, t, gain) for i, gain in enumerate(gains))
        return Points(self.row[index], b, k, p)

    def points(self, x: FloatArray, index: Index) -> Points:
        """Gains at x on the curves ``index``."""
        return self.at(self._moving_gain(x, index), index)

    def _moving_gain(self, x: FloatArray, index: Index) -> FloatArray:
        # x may be 1 in a box that is wide enough.
        with np.errstate(divide="ignore"):
            return np.clip(self.scale[index] * x / (1 - x), self.low[index], self.high[index])

    def evaluate(self, x: FloatArray, index: Index) -> tuple[ComplexArray, ComplexArray]:
        """Return Z_eavc + b_p and its derivative dZ/dx at x on the curves ``index``."""
        scale, t = self.scale[index], self._moving_gain(x, index)
        environment, slope, rise = self.loop.environment[index], self.slope[index], self.rise[index]
        coupling = self.coupling[index] + slope * t
        total = environment + coupling
        share = environment / np.where(total == 0, 1.0, total)
        rendered = series(coupling, environment, numbers=self.loop.angle.numbers)
        along = (scale + t) * ((scale + t) / scale)  # dt/dx
        return rendered + (self.p[index] + rise * t), (share * share * slope + rise) * along

    def ends(self) -> Points:
        """Gains at both ends of every curve."""
        index = np.arange(len(self.row))
        return join([self.at(self.low, index), self.at(self.high, index)])


def join(groups: list[Points]) -> Points:
    """Put groups of points behind one another."""
    return Points(*(np.concatenate([getattr(group, name) for group in groups]) for name in ("row", "b", "k", "p")))


@dataclass(frozen=True)
class Pieces:
    """Intervals of x on curves, with what was evaluated at their ends: flat arrays."""

    index: Index
    low: FloatArray
    high: FloatArray
    at_low: tuple[ComplexArray, ComplexArray]
    at_high: tuple[ComplexArray, ComplexArray]

    @classmethod
    def sampled(cls, curves: Curves) -> Pieces:
        """Cut every curve at equally spaced x."""
        low, high = curves.low / (curves.scale + curves.low), curves.high / (curves.scale + curves.high)
        x = low + (high - low) * np.linspace(0, 1, _SAMPLES)[:, None]
        index = np.broadcast_to(np.arange(len(low)), x.shape)
        values = [value.reshape(x.shape) for value in curves.evaluate(x.ravel(), index.ravel())]
        return cls(
            index[1:].ravel(),
            x[:-1].ravel(),
            x[1:].ravel(),
            (values[0][:-1].ravel(), values[1][:-1].ravel()),
            (values[0][1:].ravel(), values[1][1:].ravel()),
        )

    def split(self, curves: Curves, found: Index, x: FloatArray) -> Pieces:
        """Cut the pieces ``found`` at ``x``."""
        middle = curves.evaluate(x, self.index[found])
        high, at_high = self.high.copy(), (self.at_high[0].copy(), self.at_high[1].copy())
        high[found] = x
        for values, new in zip(at_high, middle, strict=True):
            values[found] = new
        return Pieces(
            np.concatenate((self.index, self.index[found])),
            np.concatenate((self.low, x)),
            np.concatenate((high, self.high[found])),
            (np.concatenate((self.at_low[0], middle[0])), np.concatenate((self.at_low[1], middle[1]))),
            (
                np.concatenate((at_high[0], self.at_high[0][found])),
                np.concatenate((at_high[1], self.at_high[1][found])),
            ),
        )


@dataclass(frozen=True)
class Roots:
    """Sign changes of one function: positions of their pieces, the curves, and both ends of the last brackets."""

    piece: Index
    curve: Index
    above: FloatArray
    below: FloatArray


def find_roots(
    curves: Curves, tasks: list[tuple[Pieces, Function]], *, tolerance: float = TOLERANCE, rounding: float = 0.0
) -> list[Roots]:
    """Find the sign changes of functions over pieces on which each is monotone, all in one vectorised iteration.

    Args:
        curves: the curves.
        tasks: pieces of the curves, and the function to be followed on them.
        tolerance: width of the final brackets, relative to x.
        rounding: a value at one end of a piece that is smaller than this share of that at the other end has no sign;
            the root stands at that end.

    Returns:
        For each task its roots; ``above`` is where the function is >= 0, ``below`` where it is < 0.
    """
    values = [(f(*pieces.at_low, pieces.index), f(*pieces.at_high, pieces.index)) for pieces, f in tasks]
    found = [np.flatnonzero(_changes_sign(low, high, rounding)) for low, high in values]
    index, low, high = (
        np.concatenate([getattr(pieces, name)[at] for (pieces, _), at in zip(tasks, found, strict=True)])
        for name in ("index", "low", "high")
    )
    value_low, value_high = (
        np.concatenate([pair[end][at] for pair, at in zip(values, found, strict=True)]) for end in (0, 1)
    )
    task = np.repeat(np.arange(len(tasks)), [len(at) for at in found])

    def function(x: FloatArray, at: Index) -> FloatArray:
        z, dz = curves.evaluate(x, index[at])
        return np.choose(task[at], [f(z, dz, index[at]) for _, f in tasks])

    above, below = bracketed_roots(function, low, high, value_low, value_high, tolerance=tolerance)
    return [
        Roots(at, index[task == number], above[task == number], below[task == number])
        for number, at in enumerate(found)
    ]


def _changes_sign(low: FloatArray, high: FloatArray, rounding: float) -> BoolArray:
    sizes = np.abs(low), np.abs(high)
    changes: BoolArray = ((low < 0) != (high < 0)) & (np.minimum(*sizes) >= rounding * np.maximum(*sizes))
    return changes
