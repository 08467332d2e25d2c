"""The step of an encoder, from the lattice that its readings lie on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avc_casadi.identification._record import Record

_MOST_VALUES = 4000
# Readings off the lattice by this share of a step, root mean square, are still on it: clocks and files round.
_OFF = 0.08
_FEWEST = 6


def encoder_step_m(records: Sequence[Record]) -> float | None:
    """Return the step of the encoder, or None where the readings lie on no lattice.

    Args:
        records: of one device.
    """
    values = np.unique(np.concatenate([record.position_m for record in records]))
    if values.size < _FEWEST:
        return None
    steps = np.diff(values)
    # Values that differ by rounding only are one.
    span = values[-1] - values[0]
    steps = steps[steps > 1e-9 * span]
    guess = float(np.median(steps[steps < 1.5 * np.quantile(steps, 0.1)]))
    spread = values[:: max(1, values.size // _MOST_VALUES)] - values[0]
    # Refined by counting steps over ever longer spans.
    step = guess
    reach = 20 * step
    while reach < 4 * span:
        some = spread[spread <= reach]
        counts = np.round(some / step)
        if counts.any():
            step = float(some @ counts / (counts @ counts))
        reach *= 3
    off = spread / step - np.round(spread / step)
    many = spread.size >= _FEWEST and np.round(spread / step).max() >= _FEWEST
    return step if many and float(np.sqrt(np.mean(off**2))) < _OFF else None
