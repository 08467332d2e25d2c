"""Results that print as the command does: the page of the terminal, loaded at the first print."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from avc_casadi._util.arrays import Comparable
from avc_casadi._util.text import Tabular

PAGES = "avc_casadi.present.results"
"""The renderer of results, imported when printing: results stand below their presentation."""


class Printed(Comparable):
    """Base of results that know their problem: ``print`` shows the rows of the command, a notebook the same."""

    def __str__(self) -> str:
        text: Any = import_module(PAGES).text_of(self)
        return str(text)

    def _repr_html_(self) -> str:
        return str(import_module(PAGES).html_of(self))


class PrintedColumns(Tabular):
    """Base of columns that may know their problem: ``print`` shows the rows of the command, else a line."""

    stated: Any

    def __str__(self) -> str:
        return repr(self) if self.stated is None else str(import_module(PAGES).text_of(self))
