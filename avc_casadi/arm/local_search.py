"""A local search in a box from many places at once, for functions that are cheap for many points together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from avc_casadi._util.arrays import FloatArray

_REACH, _SHRINK, _STILL = 0.2, 0.6, 1e-4
_ROUNDS = 24


def climb(
    value: Callable[[FloatArray], FloatArray], starts: FloatArray, *, probes: int = 24, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Climb from several places in the unit box; not numbers are avoided.

    Args:
        value: of points (m, k) to values (m,).
        starts: shape (s, k).
        probes: points tried about each place in a round.
        seed: of the probes.

    Returns:
        Where each climb ended, shape (s, k), and the value there.
    """
    random = np.random.default_rng(seed)
    at = np.clip(starts, 0.0, 1.0)
    top = _numbers(value(at))
    reach = np.full(len(at), _REACH)
    for _ in range(_ROUNDS):
        going = np.flatnonzero(reach > _STILL)
        if not going.size:
            break
        steps = random.standard_normal((len(going), probes, at.shape[1])) * reach[going, None, None]
        # Half of the probes move a few of the coordinates only.
        kept = random.random(steps.shape) < np.where(np.arange(probes) % 2, 1.0, 2 / at.shape[1])[:, None]
        near = np.clip(at[going, None] + steps * kept, 0.0, 1.0)
        values = _numbers(value(near.reshape(-1, at.shape[1]))).reshape(len(going), probes)
        best = values.argmax(axis=1)
        rows = np.arange(len(going))
        better = values[rows, best] > top[going]
        winners = going[better]
        at[winners], top[winners] = near[rows, best][better], values[rows, best][better]
        reach[going[~better]] *= _SHRINK
    return at, top


def _numbers(values: FloatArray) -> FloatArray:
    return np.where(np.isnan(values), -np.inf, values)
