"""Exact binomial intervals (Clopper and Pearson 1934), without a beta quantile: the tails are summed and bisected."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from avc_casadi.support import FloatArray

CONFIDENCE = 0.95
# Halvings of [0, 1]: below the spacing of doubles near any interval end.
_HALVINGS = 60


def exact_interval(count: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval of a probability that holds with at least the stated confidence, whatever the probability is.

    Args:
        count: successes.
        trials: trials, 1 or more.
        confidence: two-sided confidence, between 0 and 1.

    Returns:
        Its ends: each leaves half of the rest beyond it; 0 and 1 where there is no success or no failure.
    """
    if not 0 <= count <= trials or trials < 1:
        raise ValueError(f"{count} of {trials} is no count of trials")
    beyond = (1 - confidence) / 2
    low = 0.0 if count == 0 else _bisected(lambda p: at_least(count, trials, p) < beyond)
    high = 1.0 if count == trials else _bisected(lambda p: at_least(trials - count, trials, 1 - p) >= beyond)
    return low, high


def at_least(count: int, trials: int, probability: float) -> float:
    """P(X >= count) of a binomial X."""
    if count <= 0 or probability >= 1:
        return 1.0
    if probability <= 0:
        return 0.0
    k = np.arange(count, trials + 1)
    return float(np.exp(_log_terms(k, trials, probability)).sum())


def _log_terms(k: NDArray[np.int_], trials: int, probability: float) -> FloatArray:
    gamma = np.vectorize(math.lgamma, otypes=[float])
    ways = math.lgamma(trials + 1) - gamma(k + 1.0) - gamma(trials - k + 1.0)
    return np.asarray(ways + k * math.log(probability) + (trials - k) * math.log1p(-probability))


def _bisected(below: Callable[[float], bool]) -> float:
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if below(middle):
            low = middle
        else:
            high = middle
    return (low + high) / 2
