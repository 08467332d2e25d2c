"""Exact binomial intervals (Clopper and Pearson 1934), without a beta quantile: the tails are summed and bisected."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

CONFIDENCE = 0.95
# Halvings of [0, 1]: below the spacing of doubles near any interval end.
_HALVINGS = 60
# Terms summed at a time, and what no longer counts beside a sum.
_TERMS, _NOTHING = 1000, 1e-18


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
    mean = trials * probability
    # The smaller tail, from its largest term outwards: a few thousand terms of a million trials.
    if count > mean:
        return _tail(count, trials, probability)
    return 1.0 - _tail(trials - count + 1, trials, 1 - probability)


def _tail(count: int, trials: int, probability: float) -> float:
    """P(X >= count) where that is beyond the mean, so that each term is smaller than the one before."""
    first = (
        math.lgamma(trials + 1)
        - math.lgamma(count + 1)
        - math.lgamma(trials - count + 1)
        + count * math.log(probability)
        + (trials - count) * math.log1p(-probability)
    )
    odds, total, begin = probability / (1 - probability), 0.0, count
    last = 1.0
    while begin <= trials:
        k = np.arange(begin, min(begin + _TERMS, trials + 1))
        terms = last * np.cumprod(np.append(1.0, (trials - k[:-1]) / (k[:-1] + 1) * odds))
        total += float(terms.sum())
        last = float(terms[-1]) * (trials - k[-1]) / (k[-1] + 1) * odds
        if last < total * _NOTHING:
            break
        begin += len(k)
    return math.exp(first) * total


def _bisected(below: Callable[[float], bool]) -> float:
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if below(middle):
            low = middle
        else:
            high = middle
    return (low + high) / 2
