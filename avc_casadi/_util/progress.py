"""How far long work has come, told to whoever wants to know; nobody, unless asked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Progress(Protocol):
    """Who is told; both methods return at once and may be called thousands of times a second."""

    def step(self, what: str) -> AbstractContextManager[None]:
        """Begin one of several pieces of work; it ends with the context."""

    def advance(self, done: int, total: int, what: str = "") -> None:
        """Say how many parts of the present piece are done, and which one is next or has just been done."""


class _Silent:
    def step(self, what: str) -> AbstractContextManager[None]:  # noqa: ARG002
        return nullcontext()

    def advance(self, done: int, total: int, what: str = "") -> None:
        pass


SILENT: Progress = _Silent()


def chunks(rows: int, at_once: int, progress: Progress = SILENT, what: str = "") -> Iterator[slice]:
    """Yield slices of so many rows and tell of each that is done; one empty slice where there are no rows."""
    for start in range(0, max(rows, 1), at_once):
        yield slice(start, start + at_once)
        progress.advance(min(start + at_once, rows), rows, what)
