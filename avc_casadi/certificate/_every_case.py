"""The stiffest wall at each damping that meets a claim in every one of many cases, such as corners of a device."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from avc_casadi.support import BoolArray, FloatArray, IndexArray

Score = Callable[[IndexArray, FloatArray, FloatArray], FloatArray]
"""Of some cases, for walls of (B, K): above 0 where a wall meets the claim in a case, shape (walls, cases)."""

_BISECTIONS = 40
# Where all cases are looked at: the edge that was found, and some walls below it.
_SHARES = (0.1, 0.5, 1.0)


def largest_stiffness(
    damping: FloatArray, scan: FloatArray, meets: Callable[[FloatArray, FloatArray], BoolArray]
) -> FloatArray:
    """Upper end of the first stretch of stiffnesses that meet a claim, found on a scan and bisected, shape (n,)."""
    met = np.zeros((len(damping), len(scan)), dtype=bool)
    going_on = np.arange(len(damping))
    for column, stiffness in enumerate(scan):
        met[going_on, column] = meets(damping[going_on], np.full(len(going_on), stiffness))
        going_on = np.flatnonzero(met[:, column] | ~met[:, :column].any(axis=1))
        if not going_on.size:
            break
    first = np.argmax(met, axis=1)
    after = np.arange(len(scan))[None, :] > first[:, None]
    leaves = after & ~met
    last = np.where(leaves.any(axis=1), np.argmax(leaves, axis=1) - 1, len(scan) - 1)
    inside, outside = scan[last], scan[np.minimum(last + 1, len(scan) - 1)]
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        fits = meets(damping, middle)
        inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
    return np.asarray(np.where(met.any(axis=1), inside, np.nan))


def largest_in_every_case(damping: FloatArray, scan: FloatArray, cases: int, score: Score) -> FloatArray:
    """Find the same for a claim that must hold in all cases.

    Few cases decide. All are looked at on the edge that these give and at some walls below it; what fails there joins
    them, until nothing fails.

    Args:
        damping: B, shape (n,).
        scan: stiffnesses, ascending, shape (m,).
        cases: how many there are.
        score: of some of them.
    """
    every = np.arange(cases)
    some = np.array([scan[0], scan[len(scan) // 2], scan[-1]])
    middle = damping[[0, len(damping) // 2, -1]]
    deciding = set(np.argmin(score(every, middle, some), axis=1).tolist())
    while True:
        chosen = np.array(sorted(deciding))

        def meets(b: FloatArray, k: FloatArray, chosen: IndexArray = chosen) -> BoolArray:
            return np.asarray((score(chosen, b, k) > 0).all(axis=1))

        found = largest_stiffness(damping, scan, meets)
        if len(deciding) == cases:
            return found
        there = np.flatnonzero(np.isfinite(found))
        b = np.repeat(damping[there], len(_SHARES))
        k = (found[there][:, None] * np.array(_SHARES)).ravel()
        whole = score(every, b, k)
        failing = (whole <= 0).any(axis=1) & meets(b, k)
        if not failing.any():
            return found
        deciding |= set(np.argmin(whole[failing], axis=1).tolist())
