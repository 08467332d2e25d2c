"""Results that print as the command does: the page of the terminal, loaded at the first print."""

from __future__ import annotations

from importlib import import_module
from typing import Any, cast

from avc_casadi._util.arrays import Comparable
from avc_casadi._util.text import Tabular
from avc_casadi._util.units import Units, in_its_units, spoken

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
