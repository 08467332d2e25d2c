"""Results as columns and as the command prints them: the page of the terminal, loaded at the first print."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._errors import MissingExtraError
from avc_casadi._util.arrays import Comparable
from avc_casadi._util.text import Cell, Table, number, sample_rows
from avc_casadi._util.units import Units, Wording, in_its_units, spoken

_NOTEBOOK_ROWS = 8

Columns = dict[str, np.ndarray[Any, Any]]


def short(values: ArrayLike, unit: str | Wording = "") -> str:
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
    shown = sample_rows(rows, _NOTEBOOK_ROWS)
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
        """Return the columns by name with unit, each of shape (rows,); the first is the index."""

    @abstractmethod
    def _summary(self) -> str:
        """Return a one-line summary."""

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the columns, indexed by the first; ``.to_xarray()`` makes an xarray.Dataset."""
        try:
            pandas = import_module("pandas")
        except ImportError as error:
            message = "to_pandas() needs pandas: pip install pandas; to_dict() gives the same columns without it"
            raise MissingExtraError(message) from error
        columns = self.to_dict()
        return pandas.DataFrame(columns).set_index(next(iter(columns)))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"

    def _repr_html_(self) -> str:
        return columns_html(repr(self), self.to_dict())


PAGES = "avc_casadi.present.results"
"""The renderer of results, imported when printing: results stand below their presentation."""


class Printed(Comparable):
    """Base of results that know their problem: ``print`` shows the rows of the command, a notebook the same."""

    problem: Any

    @property
    def units(self) -> Units:
        """Names and units in which it is printed."""
        return cast("Units", self.problem.units)

    @in_its_units
    def __str__(self) -> str:
        text: Any = import_module(PAGES).text_of(self)
        return str(text)

    @in_its_units
    def _repr_html_(self) -> str:
        return str(import_module(PAGES).html_of(self))


class PrintedColumns(Tabular):
    """Base of columns that may know their problem: ``print`` shows the rows of the command, else a line."""

    stated: Any

    @property
    def units(self) -> Units:
        """Names and units in which they are printed."""
        return spoken() if self.stated is None else cast("Units", self.stated.units)

    @in_its_units
    def __repr__(self) -> str:
        return super().__repr__()

    @in_its_units
    def __str__(self) -> str:
        return repr(self) if self.stated is None else str(import_module(PAGES).text_of(self))
