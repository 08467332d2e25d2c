"""Eigenvalues of many small matrices, on two processors."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from avc_casadi.support import ComplexArray, FloatArray, processors

# Fewer are done sooner than a thread takes them up.
_MANY = 48


def eigenvalues(matrices: FloatArray) -> ComplexArray:
    """Return the eigenvalues of matrices, shape (..., s, s), as shape (..., s).

    Half of many are worked out by another thread, where there is a processor for it: LAPACK runs without Python.
    """
    flat = matrices.reshape(-1, *matrices.shape[-2:])
    if len(flat) < _MANY or processors() == 1:
        return np.asarray(np.linalg.eigvals(matrices), dtype=np.complex128)
    half = len(flat) // 2
    other = _helper().submit(np.linalg.eigvals, flat[half:])
    both = np.concatenate([np.linalg.eigvals(flat[:half]), other.result()])
    return np.asarray(both.reshape(matrices.shape[:-1]), dtype=np.complex128)


@cache
def _helper() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)
