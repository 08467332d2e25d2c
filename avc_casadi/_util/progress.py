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


class Stages:
    """Stages of a long computation: each is reported as it begins, after those that are finished.

    Args:
        progress: receiver of the progress.
        expected: number of stages of a usual computation; of one that takes more, one more is left at any time.
    """

    def __init__(self, progress: Progress, expected: int) -> None:
        self._progress = progress
        self._expected = expected
        self._finished = -1

    def begin(self, name: str) -> None:
        """Report that a stage begins, and the one before it is finished."""
        self._finished += 1
        self._progress.advance(self._finished, max(self._expected, self._finished + 1), name)


UNSEEN_STAGES = Stages(SILENT, 0)
"""Stages of a computation that reports none."""


def chunks(rows: int, at_once: int, progress: Progress = SILENT, things: str = "") -> Iterator[slice]:
    """Yield slices of so many rows and report each that is done; one empty slice where there are no rows.

    `things` says what rows are.
    """
    for start in range(0, max(rows, 1), at_once):
        yield slice(start, start + at_once)
        progress.advance(min(start + at_once, rows), rows, things)
