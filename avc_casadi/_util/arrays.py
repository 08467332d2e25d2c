"""Array types of results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


def same(one: Any, other: Any) -> bool:
    """Return whether two results hold equal values; dataclasses by compared fields, arrays with equal shapes."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and _same_arrays(one, other)
    if is_dataclass(one) and not isinstance(one, type):
        names = [item.name for item in fields(one) if item.compare]
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other) or (_undefined(one) and _undefined(other))


def _same_arrays(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> bool:
    # Only numbers can be NaN.
    return np.array_equal(one, other, equal_nan=all(array.dtype.kind in "fc" for array in (one, other)))


def _undefined(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


class Comparable:
    """Base of dataclasses that hold arrays (declared with ``eq=False``): equal by content, and no keys of a dict."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return same(self, other) if type(self) is type(other) else NotImplemented


FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
