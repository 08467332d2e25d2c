"""The regression of a force on a position and its change, with errors of its factors that readings of a log have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.diagnose.oscillation import Log, samples_alike
from avc_casadi.identification.regression import regression

_ROUNDING = 1e-9
"""Share of the standard deviation of the force that is rounding."""

_LEAST_SQUARE = 1e-300
"""What a square that is divided by is at least."""

_WHITE_THIRD_DIFFERENCE = 20.0
"""Variance of the third difference of white noise, per variance of the noise: 1 + 9 + 9 + 1."""


@dataclass(frozen=True, eq=False)
class Regression:
    """A regression of the force on position, its change in a tick, 1 and further columns."""

    factors: FloatArray
    """Factor of each column."""
    errors: FloatArray
    """Errors of the first two factors, half of 95 % intervals."""
    residual_n: FloatArray
    """Force that is left, N."""


def reading_variance_of(log: Log) -> float:
    """Return the variance, m2, that errors of the positions of a log have at most.

    An encoder step of size s makes s^2/12. White noise makes the position rough: its third difference, to which a
    motion of many ticks adds little, has 20 times the variance of the noise.
    """
    rough_m = np.diff(log.position_m, 3)
    ran = log.ran[3:] & log.ran[2:-1] & log.ran[1:-2] & log.ran[:-3]
    rough_variance = float(np.mean(rough_m[ran] ** 2)) / _WHITE_THIRD_DIFFERENCE if ran.any() else math.inf
    return max(log.encoder_m**2 / 12, rough_variance)


def regress(
    force: FloatArray,
    position: FloatArray,
    change: FloatArray,
    further: Sequence[FloatArray],
    reading_variance: float,
    average: int = 1,
) -> Regression | None:
    """Return the regression of a force on position, its change, 1 and further columns; None where columns are alike.

    A factor within its error is left out: it is 0, with an error from before it was, which may not reach the true one
    where errors of the positions are about as large as the motion. Errors of the positions have at most the reading
    variance, m2. Position and change may be means over `average` ticks.
    """
    parts = (position - position.mean(), change)
    constants = [np.ones(position.size), *further]
    deviation = float(np.std(force))
    use = [0, 1]
    errors = np.zeros(2)
    for _ in range(3):
        columns = np.stack([*(parts[part] for part in use), *constants], axis=1)
        fit = regression(columns, force) if deviation else None
        if fit is None:
            return None
        fitted, fitted_residual = fit
        factors = np.zeros(2 + len(constants))
        factors[[*use, *range(2, factors.size)]] = fitted
        residual = force - columns @ fitted
        if fitted_residual > _ROUNDING * deviation:
            most_variance = reading_variance / average
            for part, error in _errors(columns, factors, residual, use, most_variance, average).items():
                errors[part] = error
        clear = [
            part
            for part in use
            if abs(factors[part]) > errors[part] + _ROUNDING * deviation / float(np.std(parts[part]))
        ]
        if clear == use:
            break
        use = clear
    return Regression(factors, errors, residual)


def _errors(
    columns: FloatArray,
    factors: FloatArray,
    residual: FloatArray,
    use: Sequence[int],
    most_variance: float,
    average: int,
) -> dict[int, float]:
    """Return the errors of the factors of position (0) and change (1), half of 95 % intervals.

    Where the rest is an error of the positions, the change has it too, which pulls its factor towards 0 and half of the
    other's: so far the errors reach. A rest of r with factors f0 and f1 is one of the variance r^2/max(f0^2, 2 f1^2),
    which is more than positions have where both factors are about 0: there another part of the force leaves the rest.
    """
    scale = np.sqrt(np.mean(columns**2, axis=0))
    inverse = np.diag(np.linalg.inv((columns / scale).T @ (columns / scale) / len(columns)))
    # Of columns of size 1 none is below 1: rounding of columns that explain each other leaves any number.
    inverse = np.where(inverse < 1 - _ROUNDING, np.inf, inverse)
    # Size of each column without what the others explain of it.
    sizes = (scale / np.sqrt(inverse)).tolist()
    rms = float(np.sqrt(np.mean(residual**2)))
    white = 2 * rms * math.sqrt(samples_alike(residual) / len(columns))
    of_rest = rms**2 / max(factors[0] ** 2, 2 * factors[1] ** 2 / average, _LEAST_SQUARE)
    reading_variance = min(of_rest, most_variance)
    errors = {}
    for part, size in zip(use, sizes, strict=False):
        if size == 0:
            errors[part] = math.inf
            continue
        pull = reading_variance / size**2 / (average if part else 1)
        share = min((1 + part) * pull, 1.0)
        error = white / size + abs(factors[1 - part]) * pull + abs(factors[part]) * share
        errors[part] = error / (1 - share) if share < 1 else math.inf
    return errors
