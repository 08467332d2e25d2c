"""Results as people and their tools take them: a line in a console, a table in a notebook, columns for pandas."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._errors import MissingExtraError
from avc_casadi.support._same import Comparable
from avc_casadi.support._table import Cell, Table, number, sample_rows

NOTEBOOK_ROWS = 8

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


def columns_html(title: str, columns: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """Return some rows of columns as an HTML table under a title, escaped."""
    rows = len(next(iter(columns.values())))
    shown = sample_rows(rows, NOTEBOOK_ROWS)
    body = tuple(tuple(_cell(column[row]) for column in columns.values()) for row in shown)
    left = tuple(index for index, column in enumerate(columns.values()) if column.dtype.kind not in "fciu")
    below = f"<p>{len(shown)} of {rows} rows</p>" if len(shown) < rows else ""
    return f"<p>{escape(title)}</p>\n{Table(tuple(columns), body, left).html()}{below}"


def _cell(value: Any) -> Cell:
    if isinstance(value, complex | np.complexfloating):
        return f"{number(float(value.real))}{'-' if value.imag < 0 else '+'}{number(abs(float(value.imag)))}j"
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, float | int | str) or value is None else str(value)


class Tabular(Comparable, ABC):
    """Base of results that are columns of equal length; dataclasses declare ``eq=False, repr=False`` with it."""

    @abstractmethod
    def to_dict(self) -> Columns:
        """Return the columns by name with unit, each of shape (rows,); they stand against the first."""

    @abstractmethod
    def _summary(self) -> str:
        """Return what a line can say."""

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the columns, indexed by the first; ``.to_xarray()`` makes an xarray.Dataset.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        columns = self.to_dict()
        return data_frame(columns, next(iter(columns)))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"

    def _repr_html_(self) -> str:
        return columns_html(repr(self), self.to_dict())


def data_frame(columns: Columns, index: str) -> Any:
    """Return columns as a pandas.DataFrame.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError as error:
        raise MissingExtraError(
            "to_pandas() needs pandas, which is not installed: pip install pandas; to_dict() gives the same columns "
            "without it"
        ) from error
    return pandas.DataFrame(columns).set_index(index)
