"""Bracketed root finding for many functions at once.

Chandrupatla, Advances in Engineering Software 28 (1997) 145-149.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from avc_casadi.support import FloatArray

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
