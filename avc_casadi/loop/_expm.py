"""The matrix exponential of many matrices at once."""

from __future__ import annotations

import numpy as np

from avc_casadi.support import FloatArray

# With a norm of 1/2, the first term left out is 2^-19/19! = 1.6e-23 of the whole.
_TERMS = 18
_NORM = 0.5


def expm(matrix: FloatArray) -> FloatArray:
    """Return exp(matrix) over the last two axes by scaling, Taylor's series and squaring.

    Args:
        matrix: shape (..., n, n), balanced by the caller: the work grows with the logarithm of its largest norm.

    Returns:
        The same shape; numbers that are not finite where the exponential of a matrix is beyond them.
    """
    norm = float(np.abs(matrix).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(norm / _NORM)))) if norm > 0 else 0
    scaled = matrix / 2.0**squarings
    identity = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape)
    result = identity
    for term in range(_TERMS, 0, -1):
        result = identity + scaled @ result / term
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(squarings):
            result = result @ result
    return result
