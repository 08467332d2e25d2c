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

# Distance of the sum of the taps from 1, so that the multiplier is strict; below that, what rounding may hide.
_SLACK = 1e-4
_STRICT = 1e-12
# Smallest |1 + L| that is divided by.
_SMALLEST_SIZE = 1e-300
# Allowance for rounding of a few sums and products in plain numbers.
_ROOM = 1 + 1e-12
LAGS = tuple(lag for lag in range(-5, 6) if lag)
"""Lags of the taps, in samples."""


@dataclass(frozen=True)
class Multiplier:
    """1 - sum of h_i exp(-j omega i), a Zames-Falb multiplier; ``taps`` are the h_i by their lags i."""

    taps: Mapping[int, float]

    @property
    def valid(self) -> bool:
        """Whether it is a multiplier: no tap negative or at lag 0, their sum below 1 whatever the rounding."""
        values = list(self.taps.values())
        return 0 not in self.taps and all(0 <= value < 1 for value in values) and sum(values) < 1 - _STRICT

    def at(self, omega: FloatArray) -> ComplexArray:
        """Return its values at angles, in plain numbers."""
        value = np.ones(np.shape(omega), dtype=np.complex128)
        for lag, tap in self.taps.items():
            value -= tap * np.exp(-1j * lag * np.asarray(omega))
        return value

    def over(self, omega: Moving) -> Moving:
        """Enclose it over angles."""
        ones = np.ones_like(omega.value.radius)
        value = Moving(Disc.around(ones, 0 * ones), {})
        for lag, tap in self.taps.items():
            value = value - rotation(omega * lag) * tap
        return value


def search(omega: FloatArray, loop: ComplexArray) -> tuple[Multiplier, float]:
    """Return the taps with the largest t in Re{M (1 + L)} >= t |1 + L|, and t, of loops L (p,) at angles omega (p,).

    M = 1 - sum h_i exp(-j omega i) is the multiplier with taps h_i. A linear programme over the taps and t:

        0 <= h_i <= 1,   sum h_i <= 1 - 1e-4,   -1 <= t <= 1
    """
    import casadi as ca  # noqa: PLC0415

    return_difference = 1 + loop
    direction = return_difference / np.maximum(np.abs(return_difference), _SMALLEST_SIZE)
    lags = np.array(LAGS)
    of_taps = -(np.exp(-1j * omega[:, None] * lags) * direction[:, None]).real
    rows = np.column_stack([of_taps, -np.ones(len(omega))])
    matrix = np.vstack([rows, [*np.ones(len(lags)), 0.0]])
    low = np.append(-direction.real, -np.inf)
    high = np.append(np.full(len(omega), np.inf), 1 - _SLACK)
    solver = ca.conic("multiplier", "highs", {"a": ca.Sparsity.dense(*matrix.shape)}, _QUIET)
    solution = solver(
        g=np.append(np.zeros(len(lags)), -1.0),
        a=ca.DM(matrix),
        lba=low,
        uba=high,
        lbx=np.append(np.zeros(len(lags)), -1.0),
        ubx=np.ones(len(lags) + 1),
    )
    if not solver.stats()["success"]:
        return Multiplier({}), -np.inf
    values = np.asarray(solution["x"]).ravel()
    taps = {lag: float(tap) for lag, tap in zip(LAGS, values[:-1], strict=True) if tap > _NO_TAP}
    return Multiplier(taps), float(values[-1])


# A tap below this is none.
_NO_TAP = 1e-9
_QUIET: dict[str, Any] = {"error_on_fail": False, "highs": {"output_flag": False}}


MOST_CELLS = 400_000
"""Budget of a proof: some seconds."""
_AT_ONCE = 4096
"""Cells that are evaluated at a time."""
_FIRST_ANGLES = 64
"""Intervals of the angle at the beginning."""
_PROGRESS_STEPS = 1000


@dataclass(frozen=True)
class Verification:
    """Result of the verification of a multiplier.

    Attributes:
        holds: whether the real part is positive at every angle with every hand.
        cells: cells that were evaluated.
        fails_at: angle and hand where it is negative; None where it holds, or where the budget ran out.
    """

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
    """Decide whether Re{M (1 + P C1 - C2)} > 0 for every angle of [0, pi] and every hand of the box.

    M is the multiplier, P the plant, C1 and C2 the law from position and from its own force. Cells of angle and hand
    are bounded by discs, and bisected until every bound is positive or one is not; `most_cells` ends it.
    """
    coefficients = tuple(_discs(part) for part in law.transfer)
    ends = np.array(list(device.ranges.values()))
    # Just above pi: the real part repeats there.
    angles = np.linspace(0.0, np.nextafter(np.pi, 4.0), _FIRST_ANGLES + 1)
    low = np.column_stack([angles[:-1], np.tile(ends[:, 0], (_FIRST_ANGLES, 1))])
    high = np.column_stack([angles[1:], np.tile(ends[:, 1], (_FIRST_ANGLES, 1))])
    whole = (high - low)[0]
    share = np.full(_FIRST_ANGLES, 1 / _FIRST_ANGLES)
    unknown = np.full(_FIRST_ANGLES, np.nan)
    waiting = [_Cells(low, high, share, unknown)]
    cells = 0
    verified_share = 0.0
    while waiting:
        part = waiting.pop()
        if len(part.low) > _AT_ONCE:
            waiting.append(part.pick(slice(_AT_ONCE, None)))
            part = part.pick(slice(_AT_ONCE))
        cells += len(part.low)
        bounds = _bounds(coefficients, device, multiplier, part)
        if (bounds.at_middle < 0).any():
            worst = int(np.argmin(bounds.at_middle))
            return Verification(False, cells, 0.5 * (part.low[worst] + part.high[worst]))
        left = np.flatnonzero(~(bounds.lower > 0))
        verified_share += float(part.share.sum() - part.share[left].sum())
        progress.advance(round(_PROGRESS_STEPS * verified_share), _PROGRESS_STEPS, "verified")
        if left.size:
            worse = part.pick(left).at_worse_ends(bounds.slope_sign[left], bounds.remainder[left])
            waiting.append(_cut(worse, bounds.across[left], whole))
        if cells > most_cells:
            return Verification(False, cells, None)
    return Verification(True, cells, None)


class _Cells(NamedTuple):
    """Cells of (omega, numbers of hand and device).

    Attributes:
        low: lower ends, shape (cells, numbers).
        high: upper ends.
        share: share of the whole box that each cell had, before numbers were fixed, shape (cells,).
        remainder: e, bound of the omitted terms of a cell whose numbers were fixed; else not a number.
    """

    low: FloatArray
    high: FloatArray
    share: FloatArray
    remainder: FloatArray

    def pick(self, rows: slice | IndexArray) -> _Cells:
        """Return some of the cells."""
        return _Cells(self.low[rows], self.high[rows], self.share[rows], self.remainder[rows])

    def at_worse_ends(self, slope_sign: FloatArray, remainder: FloatArray) -> _Cells:
        """Fix increasing numbers at their lower end, and decreasing ones at their upper."""
        low = np.where(slope_sign < 0, self.high, self.low)
        high = np.where(slope_sign > 0, self.low, self.high)
        fixed = (high - low < self.high - self.low).any(axis=1)
        return _Cells(low, high, self.share, np.where(fixed, remainder, self.remainder))


class _Bounds(NamedTuple):
    """Bounds of the scaled real part in n cells.

    Attributes:
        at_middle: upper bound at the middle, shape (n,).
        lower: lower bound over the cell, shape (n,).
        across: largest decrease along each number, shape (n, numbers).
        slope_sign: sign of the slope along a number where it has one sign; else 0.
        remainder: e, bound of the omitted terms, shape (n,).
    """

    at_middle: FloatArray
    lower: FloatArray
    across: FloatArray
    slope_sign: FloatArray
    remainder: FloatArray


def _bounds(
    coefficients: tuple[list[Disc], ...], device: SampledPlantBox, multiplier: Multiplier, cells: _Cells
) -> _Bounds:
    """Return bounds of the real part in cells of angle and hand: at the middle, over the cell, and its slopes.

    They are rigorous: discs with their rounding, and the bound of the aliases that the plant leaves out.
    """
    low = cells.low
    high = cells.high
    middle = 0.5 * (low + high)
    numbers = range(low.shape[1])
    cell = [Moving.variable(number, low[:, number], high[:, number]) for number in numbers]
    point = [Moving.constant(middle[:, number]) for number in numbers]
    half = np.maximum(high - middle, middle - low) * _ROOM
    across = np.zeros_like(low)
    slope_sign = np.zeros_like(low)
    with np.errstate(invalid="ignore", over="ignore"):  # what is unknown stays unknown
        weights = _weights(coefficients, multiplier, cell[0])
        remainder = weights[0].value.largest * device.tail(high[:, 0]) * _ROOM
        remainder = np.where(np.isnan(cells.remainder), remainder, cells.remainder)
        over_cell, _ = _real(weights, device, cell, remainder)
        at_point, scale = _real(_weights(coefficients, multiplier, point[0]), device, point, remainder)
        for number, slope in over_cell.slopes.items():
            radius = slope.radius * _ROOM
            across[:, number] = (np.abs(slope.centre.real) + radius) * half[:, number]
            slope_sign[:, number] = np.sign(slope.centre.real) * (np.abs(slope.centre.real) > radius)
        decrease = across.sum(axis=1) * _ROOM
        lower = np.fmax(at_point.value.real_low - decrease, over_cell.value.real_low)
        at_middle = at_point.value.centre.real + at_point.value.radius + 2 * remainder * scale
    across[~np.isfinite(decrease)] = np.nan
    return _Bounds(at_middle, np.where(np.isfinite(lower), lower, -np.inf), across, slope_sign, remainder)


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
    of_plant, alone = weights  # M C1 and M (1 - C2)
    plant = device.over(cell[0], tuple(cell[1:]))
    scale = plant.denominator.abs2()
    rest = (of_plant * plant.rest + alone).real() + Disc.around(-remainder, np.zeros_like(remainder))
    middle = (of_plant * plant.numerator * plant.denominator.conj()).real()
    return middle + rest * scale, scale.value.largest


def _discs(polynomial: Polynomial) -> list[Disc]:
    """Return exact coefficients as discs about their rounded values."""
    return [Disc.with_rounding(float(coefficient)) for coefficient in polynomial]


def _value(coefficients: list[Disc], variable: Moving) -> Moving:
    """Enclose a polynomial and its rate by its Taylor series about the middle, which preserves cancellation.

    Its coefficients, from the highest power down, are those of repeated synthetic division by the middle.
    """
    middle = Disc(variable.value.centre, np.zeros_like(variable.value.radius))
    ones = Disc.around(np.ones_like(middle.radius), middle.radius)
    left = [ones * coefficient for coefficient in coefficients]
    series: list[Disc] = []
    while left:
        for place in range(1, len(left)):
            left[place] = left[place - 1] * middle + left[place]
        series.append(left.pop())
    spread = variable.value.radius
    powers = [(term.largest, power) for power, term in enumerate(series)]
    off = sum((size * spread**power for size, power in powers[1:]), np.zeros_like(spread))
    value = Disc(series[0].centre, (series[0].radius + off) * _ROOM)
    if len(series) == 1:
        return Moving(value, {})
    bend = sum((power * size * spread ** (power - 1) for size, power in powers[2:]), np.zeros_like(spread))
    rate = Disc(series[1].centre, (series[1].radius + bend) * _ROOM)
    return Moving(value, {number: slope * rate for number, slope in variable.slopes.items()})


def _cut(cells: _Cells, across: FloatArray, whole: FloatArray) -> _Cells:
    """Return both halves of each cell, cut in the middle of one of its numbers (the angle, and those of the hand).

    Args:
        cells: boxes of the numbers, (cells, numbers).
        across: how much the real part may fall from the middle along each number, (cells, numbers); nan if unknown.
        whole: width of the whole box, by which the widest number is found where `across` is unknown.
    """
    width = cells.high - cells.low
    relative_width = width / np.where(whole > 0, whole, 1.0)
    number = np.argmax(np.where(np.isfinite(across), across * (width > 0), relative_width), axis=1)
    rows = np.arange(len(width))
    middle = 0.5 * (cells.low[rows, number] + cells.high[rows, number])
    low_of_upper = cells.low.copy()
    high_of_lower = cells.high.copy()
    low_of_upper[rows, number] = middle
    high_of_lower[rows, number] = middle
    return _Cells(
        low=np.concatenate([cells.low, low_of_upper]),
        high=np.concatenate([high_of_lower, cells.high]),
        share=np.tile(0.5 * cells.share, 2),
        remainder=np.tile(cells.remainder, 2),
    )
