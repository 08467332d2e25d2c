"""Verification of a multiplier for every angle and every hand of a box: enclosures, branch and bound.

With P = N/D + R, the middle term of the folded spectrum and the rest, the real part is multiplied by |D|^2, which
nearly vanishes with a light and loose hand: Re{M C1 N D*} + Re{M (1 + R C1 - C2)} |D|^2, less e |D|^2 for the omitted
terms. On a cell of (omega, hand) the value at the middle less its largest decrease bounds it from below. A number along
which it is monotone is fixed at its worse end, with e of the whole cell; the rest is bisected across the largest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.prove.disc import Disc, Moving, hold, rotation
from avc_casadi.claims.prove.held_device import SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw, Polynomial

# Distance of the sum of the taps from 1, so that the multiplier is strict.
_SLACK = 1e-4
LAGS = tuple(lag for lag in range(-5, 6) if lag)


@dataclass(frozen=True)
class Multiplier:
    """1 - sum of h_i exp(-j omega i)."""

    taps: Mapping[int, float]

    @property
    def valid(self) -> bool:
        """Whether it is a multiplier: no tap negative or at lag 0, their sum below 1 whatever the rounding."""
        values = list(self.taps.values())
        return 0 not in self.taps and all(0 <= value < 1 for value in values) and sum(values) < 1 - 1e-12

    def at(self, omega: FloatArray) -> ComplexArray:
        """Return its values at angles, in plain numbers."""
        found = np.ones(np.shape(omega), dtype=np.complex128)
        for lag, tap in self.taps.items():
            found -= tap * np.exp(-1j * lag * np.asarray(omega))
        return found

    def over(self, omega: Moving) -> Moving:
        """Enclose it over angles."""
        ones = np.ones_like(omega.value.radius)
        found = Moving(Disc.around(ones, 0 * ones), {})
        for lag, tap in self.taps.items():
            found = found - rotation(omega * lag) * tap
        return found


def search(omega: FloatArray, loop: ComplexArray) -> tuple[Multiplier, float]:
    """Return the taps with the largest t in Re{M (1 + L)} >= t |1 + L|."""
    import casadi as ca  # noqa: PLC0415

    around = 1 + loop
    way = around / np.maximum(np.abs(around), 1e-300)
    lags = np.array(LAGS)
    rows = np.column_stack([-(np.exp(-1j * omega[:, None] * lags) * way[:, None]).real, -np.ones(len(omega))])
    matrix = np.vstack([rows, [*np.ones(len(lags)), 0.0]])
    low = np.append(-way.real, -np.inf)
    high = np.append(np.full(len(omega), np.inf), 1 - _SLACK)
    solver = ca.conic("multiplier", "highs", {"a": ca.Sparsity.dense(*matrix.shape)}, _QUIET)
    found = solver(
        g=np.append(np.zeros(len(lags)), -1.0),
        a=ca.DM(matrix),
        lba=low,
        uba=high,
        lbx=np.append(np.zeros(len(lags)), -1.0),
        ubx=np.ones(len(lags) + 1),
    )
    if not solver.stats()["success"]:
        return Multiplier({}), -np.inf
    values = np.asarray(found["x"]).ravel()
    taps = {lag: float(tap) for lag, tap in zip(LAGS, values[:-1], strict=True) if tap > _NO_TAP}
    return Multiplier(taps), float(values[-1])


_NO_TAP = 1e-9
_QUIET: dict[str, Any] = {"error_on_fail": False, "highs": {"output_flag": False}}


MOST_CELLS = 400_000
"""Budget of a proof: some seconds."""
_AT_ONCE = 4096
_FIRST_ANGLES = 64


@dataclass(frozen=True)
class Verification:
    """Result of the verification of a multiplier."""

    holds: bool
    cells: int
    fails_at: FloatArray | None


def verify(
    law: ContactLaw,
    device: SampledPlantBox,
    multiplier: Multiplier,
    *,
    most_cells: int = MOST_CELLS,
    progress: Progress = SILENT,
) -> Verification:
    """Decide whether Re{M (1 + P C1 - C2)} > 0 for every angle of [0, pi] and every hand of the box."""
    coefficients = tuple(_discs(part) for part in law.transfer)
    ends = np.array(list(device.ranges.values()))
    # Just above pi: the real part repeats there.
    angles = np.linspace(0.0, np.nextafter(np.pi, 4.0), _FIRST_ANGLES + 1)
    low = np.column_stack([angles[:-1], np.tile(ends[:, 0], (_FIRST_ANGLES, 1))])
    high = np.column_stack([angles[1:], np.tile(ends[:, 1], (_FIRST_ANGLES, 1))])
    whole = (high - low)[0]
    share, unknown = np.full(_FIRST_ANGLES, 1 / _FIRST_ANGLES), np.full(_FIRST_ANGLES, np.nan)
    open_, cells, done = [_Cells(low, high, share, unknown)], 0, 0.0
    while open_:
        some = open_.pop()
        if len(some.low) > _AT_ONCE:
            open_.append(some.pick(slice(_AT_ONCE, None)))
            some = some.pick(slice(_AT_ONCE))
        cells += len(some.low)
        found = _bounds(coefficients, device, multiplier, some)
        if (found.at_middle < 0).any():
            worst = int(np.argmin(found.at_middle))
            return Verification(False, cells, 0.5 * (some.low[worst] + some.high[worst]))
        left = np.flatnonzero(~(found.lower > 0))
        done += float(some.share.sum() - some.share[left].sum())
        progress.advance(round(1000 * done), 1000, "verified")
        if left.size:
            worse = some.pick(left).at_worse_ends(found.way[left], found.remainder[left])
            open_.append(_cut(worse, found.across[left], whole))
        if cells > most_cells:
            return Verification(False, cells, None)
    return Verification(True, cells, None)


class _Cells(NamedTuple):
    """Cells of (omega, hand)."""

    low: FloatArray
    high: FloatArray
    share: FloatArray
    remainder: FloatArray

    def pick(self, rows: slice | IndexArray) -> _Cells:
        return _Cells(*(part[rows] for part in self))

    def at_worse_ends(self, way: FloatArray, remainder: FloatArray) -> _Cells:
        """Fix increasing numbers at their lower end, and decreasing ones at their upper."""
        low, high = np.where(way < 0, self.high, self.low), np.where(way > 0, self.low, self.high)
        fixed = (high - low < self.high - self.low).any(axis=1)
        return _Cells(low, high, self.share, np.where(fixed, remainder, self.remainder))


class _Bounds(NamedTuple):
    """Bounds of the scaled real part in n cells."""

    at_middle: FloatArray
    lower: FloatArray
    across: FloatArray
    way: FloatArray
    remainder: FloatArray


def _bounds(
    coefficients: tuple[list[Disc], ...], device: SampledPlantBox, multiplier: Multiplier, cells: _Cells
) -> _Bounds:
    low, high = cells.low, cells.high
    middle = 0.5 * (low + high)
    numbers = range(low.shape[1])
    cell = [Moving.variable(number, low[:, number], high[:, number]) for number in numbers]
    point = [Moving.constant(middle[:, number]) for number in numbers]
    half = np.maximum(high - middle, middle - low) * (1 + 1e-12)
    across, way = np.zeros_like(low), np.zeros_like(low)
    with np.errstate(invalid="ignore", over="ignore"):  # what is unknown stays unknown
        weights = _weights(coefficients, multiplier, cell[0])
        remainder = weights[0].value.largest * device.tail(high[:, 0]) * (1 + 1e-12)
        remainder = np.where(np.isnan(cells.remainder), remainder, cells.remainder)
        over, _ = _real(weights, device, cell, remainder)
        at, scale = _real(_weights(coefficients, multiplier, point[0]), device, point, remainder)
        for number, slope in over.slopes.items():
            radius = slope.radius * (1 + 1e-12)
            across[:, number] = (np.abs(slope.centre.real) + radius) * half[:, number]
            way[:, number] = np.sign(slope.centre.real) * (np.abs(slope.centre.real) > radius)
        decrease = across.sum(axis=1) * (1 + 1e-12)
        lower = np.fmax(at.value.real_low - decrease, over.value.real_low)
        at_middle = at.value.centre.real + at.value.radius + 2 * remainder * scale
    across[~np.isfinite(decrease)] = np.nan
    return _Bounds(at_middle, np.where(np.isfinite(lower), lower, -np.inf), across, way, remainder)


def _weights(coefficients: tuple[list[Disc], ...], multiplier: Multiplier, omega: Moving) -> tuple[Moving, Moving]:
    """Enclose M C1 and M (1 - C2)."""
    # z - 1 without cancellation.
    step = hold(-omega) * (omega * 1j)
    from_position, from_force, poles = (_value(part, step) for part in coefficients)
    weight = multiplier.over(omega) * (1 / poles)
    return weight * from_position, weight * (poles - from_force)


def _real(
    weights: tuple[Moving, Moving], device: SampledPlantBox, cell: list[Moving], remainder: FloatArray
) -> tuple[Moving, FloatArray]:
    """Enclose Re{M C1 N D*} + (Re{M (1 + R C1 - C2)} - e) |D|^2; return also an upper bound of |D|^2."""
    through, own = weights
    above, below, around = device.over(cell[0], tuple(cell[1:]))
    scale = below.abs2()
    rest = (through * around + own).real() + Disc.around(-remainder, np.zeros_like(remainder))
    return (through * above * below.conj()).real() + rest * scale, scale.value.largest


def _discs(polynomial: Polynomial) -> list[Disc]:
    return [Disc.with_rounding(float(coefficient)) for coefficient in polynomial]


def _value(coefficients: list[Disc], at: Moving) -> Moving:
    """Enclose a polynomial and its rate by its Taylor series about the middle, which preserves cancellation."""
    middle = Disc(at.value.centre, np.zeros_like(at.value.radius))
    ones = Disc.around(np.ones_like(middle.radius), middle.radius)
    left = [ones * coefficient for coefficient in coefficients]
    series: list[Disc] = []
    while left:
        for place in range(1, len(left)):
            left[place] = left[place - 1] * middle + left[place]
        series.append(left.pop())
    spread = at.value.radius
    powers = [(term.largest, power) for power, term in enumerate(series)]
    off = sum((size * spread**power for size, power in powers[1:]), np.zeros_like(spread))
    value = Disc(series[0].centre, (series[0].radius + off) * (1 + 1e-12))
    if len(series) == 1:
        return Moving(value, {})
    bend = sum((power * size * spread ** (power - 1) for size, power in powers[2:]), np.zeros_like(spread))
    rate = Disc(series[1].centre, (series[1].radius + bend) * (1 + 1e-12))
    return Moving(value, {number: slope * rate for number, slope in at.slopes.items()})


def _cut(cells: _Cells, across: FloatArray, whole: FloatArray) -> _Cells:
    """Bisect each cell across the number with the largest decrease; where none is known, across the widest."""
    width = cells.high - cells.low
    wide = width / np.where(whole > 0, whole, 1.0)
    worth = np.where(np.isfinite(across), across * (width > 0), wide)
    number = np.argmax(worth, axis=1)
    rows = np.arange(len(width))
    middle = 0.5 * (cells.low[rows, number] + cells.high[rows, number])
    upper, lower = cells.low.copy(), cells.high.copy()
    upper[rows, number] = middle
    lower[rows, number] = middle
    halves = np.concatenate([cells.low, upper]), np.concatenate([lower, cells.high])
    return _Cells(*halves, np.tile(0.5 * cells.share, 2), np.tile(cells.remainder, 2))
