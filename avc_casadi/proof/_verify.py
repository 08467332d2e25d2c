"""Verification of a multiplier for every angle and every hand of a box: enclosures, branch and bound.

On a cell of (omega, hand) the real part at the middle, less what the rates of change over the cell can take from it,
bounds it from below (mean-value form). A cell that is not decided is cut in two across the number that takes most.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.proof._disc import Disc, Moving, finite, held
from avc_casadi.support import SILENT, FloatArray, Progress

if TYPE_CHECKING:
    from avc_casadi.proof._held_device import HeldDevice
    from avc_casadi.proof._law import ContactLaw, Polynomial
    from avc_casadi.proof._multiplier import Multiplier

_AT_ONCE = 4096
_FIRST_ANGLES = 64
MOST_CELLS = 400_000


@dataclass(frozen=True)
class Verified:
    """What became of a multiplier.

    Attributes:
        holds: whether it holds for every angle and hand.
        cells: cells that were looked at.
        fails_at: an angle and a hand at which it does not hold, shape (1 + numbers,); None where none was met.
    """

    holds: bool
    cells: int
    fails_at: FloatArray | None


def verify(
    law: ContactLaw,
    device: HeldDevice,
    multiplier: Multiplier,
    *,
    most_cells: int = MOST_CELLS,
    progress: Progress = SILENT,
) -> Verified:
    """Decide whether Re{M (1 + P C1 - C2)} > 0 for every angle of [0, pi] and every hand of the box.

    Args:
        law: the law, with its poles inside the unit circle.
        device: the device and the box of hands.
        multiplier: the multiplier.
        most_cells: where to give up.
        progress: told of the share of the box that is done.
    """
    coefficients = tuple(_rounded(part) for part in law.transfer)
    ends = np.array(list(device.ranges.values()))
    # Just above pi: the real part repeats there.
    angles = np.linspace(0.0, np.nextafter(np.pi, 4.0), _FIRST_ANGLES + 1)
    low = np.column_stack([angles[:-1], np.tile(ends[:, 0], (_FIRST_ANGLES, 1))])
    high = np.column_stack([angles[1:], np.tile(ends[:, 1], (_FIRST_ANGLES, 1))])
    whole = float(np.prod(high - low, axis=1, where=high > low).sum())
    open_, cells, done = [(low, high)], 0, 0.0
    while open_:
        low, high = open_.pop()
        if len(low) > _AT_ONCE:
            open_.append((low[_AT_ONCE:], high[_AT_ONCE:]))
            low, high = low[:_AT_ONCE], high[:_AT_ONCE]
        cells += len(low)
        middle, lower, across = _bounds(coefficients, device, multiplier, low, high)
        if (middle < 0).any():
            worst = int(np.argmin(middle))
            return Verified(False, cells, 0.5 * (low[worst] + high[worst]))
        left = np.asarray(~(lower > 0))
        done += float(np.prod(high[~left] - low[~left], axis=1, where=high[~left] > low[~left]).sum())
        progress.advance(round(1000 * done / whole), 1000, "verified")
        if left.any():
            open_.append(_cut(low[left], high[left], across[left]))
        if cells > most_cells:
            return Verified(False, cells, None)
    return Verified(True, cells, None)


def _bounds(
    coefficients: tuple[list[Disc], ...], device: HeldDevice, multiplier: Multiplier, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the real part's upper bound at the middle, its lower bound over the cell, and what each number takes."""
    middle = 0.5 * (low + high)
    numbers = range(low.shape[1])
    at, _ = _real(coefficients, device, multiplier, [Moving.fixed(middle[:, number]) for number in numbers])
    cell = [Moving.variable(number, low[:, number], high[:, number]) for number in numbers]
    with np.errstate(invalid="ignore", over="ignore"):  # what is unknown stays unknown
        over, through = _real(coefficients, device, multiplier, cell)
    off = through.largest * device.tail(high[:, 0])
    half = np.maximum(high - middle, middle - low) * (1 + 1e-12)
    across = np.zeros_like(low)
    for number, slope in over.slopes.items():
        # Only the real part counts.
        across[:, number] = (np.abs(slope.centre.real) + slope.radius) * half[:, number] * (1 + 1e-12)
    lower = at.value.real_low - across.sum(axis=1) * (1 + 1e-12) - off
    unknown = ~(finite(over.value) & np.isfinite(across).all(axis=1))
    if unknown.any():
        # What moves it at the middle tells where to cut.
        point = middle[unknown]
        some = [Moving.variable(number, point[:, number], point[:, number]) for number in numbers]
        for number, slope in _real(coefficients, device, multiplier, some)[0].slopes.items():
            across[unknown, number] = np.abs(slope.centre) * half[unknown, number]
    return at.value.centre.real + at.value.radius + off, np.where(np.isfinite(lower), lower, -np.inf), across


def _real(
    coefficients: tuple[list[Disc], ...], device: HeldDevice, multiplier: Multiplier, cell: list[Moving]
) -> tuple[Moving, Disc]:
    """Enclose M (1 + P C1 - C2), without the terms of P that are left out, and M C1, by which those count."""
    omega = cell[0]
    # z - 1 without cancellation.
    step = held(-omega) * (omega * 1j)
    from_position, from_force, poles = (_value(part, step) for part in coefficients)
    weight = multiplier.over(omega) * (1 / poles)
    through = weight * from_position
    return through * device.over(omega, tuple(cell[1:])) + weight * (poles - from_force), through.value


def _rounded(polynomial: Polynomial) -> list[Disc]:
    return [Disc.rounded(float(coefficient)) for coefficient in polynomial]


def _value(coefficients: list[Disc], at: Moving) -> Moving:
    """Enclose a polynomial and its rate by its Taylor series about the middle, which keeps what cancels."""
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


def _cut(low: FloatArray, high: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut each cell in two across the number that takes most."""
    number = np.argmax(np.nan_to_num(across), axis=1)
    rows = np.arange(len(low))
    middle = 0.5 * (low[rows, number] + high[rows, number])
    upper, lower = low.copy(), high.copy()
    upper[rows, number] = middle
    lower[rows, number] = middle
    return np.concatenate([low, upper]), np.concatenate([lower, high])
