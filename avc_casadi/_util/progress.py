"""Progress of long computations, silent by default."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext


class Progress:
    """Receiver of progress, this one silent; both methods return at once, also thousands of times a second."""

    def step(self, name: str) -> AbstractContextManager[None]:  # noqa: ARG002
        """Begin one of several steps; it ends with the context."""
        return nullcontext()

    def advance(self, done: int, total: int, part: str = "") -> None:
        """Report finished parts of the present step, of a total or of 0 where nobody knows, and the part at work."""


SILENT = Progress()


def chunks(rows: int, at_once: int, progress: Progress = SILENT, things: str = "") -> Iterator[slice]:
    """Yield slices of so many rows and report each that is done; one empty slice where there are no rows.

    `things` says what rows are.
    """
    for start in range(0, max(rows, 1), at_once):
        yield slice(start, start + at_once)
        progress.advance(min(start + at_once, rows), rows, things)
