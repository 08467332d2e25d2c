"""Results as columns and as the command prints them: the page of the terminal, loaded at the first print."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._util.page import printed
from avc_casadi._util.text import number
from avc_casadi._util.units import LINEAR, Units

Columns = dict[str, np.ndarray[Any, Any]]


def short(values: ArrayLike, unit: str = "") -> str:
    """Return the span of an array, as "0.3 to 41 N/m", or its one value; a dash where none is finite."""
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    if not known.size:
        return "-"
    low, high = float(known.min()), float(known.max())
    span = number(low) if low == high else f"{number(low)} to {number(high)}"
    return f"{span} {unit}".rstrip()


class Printed:
    """Base of results: ``print`` shows the rows of the command where they know their problem, else a line."""

    @property
    def _problem(self) -> Any:
        """The problem in whose units it is printed; None where it does not know it."""
        return getattr(self, "definition", getattr(self, "problem", None))

    @property
    def units(self) -> Units:
        """Names and units in which it is printed."""
        units: Units = LINEAR if self._problem is None else self._problem.units
        return units

    def __str__(self) -> str:
        if self._problem is None:
            return repr(self)
        return printed(self)


class Tabular(Printed, ABC):
    """Base of results that are columns of equal length; dataclasses declare ``eq=False, repr=False`` with it."""

    @abstractmethod
    def to_dict(self) -> Columns:
        """Return the columns by name with unit, each of shape (rows,); the first is the index."""

    @abstractmethod
    def _summary(self) -> str:
        """Return a one-line summary."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"
