"""Ctrl-C: held back where an exception would be lost, passed over where an answer is written, seen in any disguise."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

# What IPOPT returns where Ctrl-C, or another exception, came while CasADi ran it.
_THROWN = "NonIpopt_Exception_Thrown"


class HeldInterrupt:
    """Hold Ctrl-C back in a block of short calls to foreign code; at the block's end it takes its course.

    An exception raised inside C code or in a callback from it may be lost, and the interrupt too.

    Attributes:
        came: whether Ctrl-C came; the block should then end soon.
    """

    def __init__(self) -> None:
        self.came = False
        self._previous: Any = None

    def __enter__(self) -> Self:
        # Only the main thread may set handlers and is ever interrupted.
        if _in_main_thread() and callable(signal.getsignal(signal.SIGINT)):
            self._previous = signal.signal(signal.SIGINT, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)
            if self.came:
                self._previous(signal.SIGINT, None)

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self.came = True


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Pass over Ctrl-C while something short is done that must not be left half done."""
    if not _in_main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)


@contextmanager
def starting_processes() -> Iterator[None]:
    """Let Ctrl-C wait while processes start, which then never see it, not even while they import."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def undisguised_interrupts() -> Iterator[None]:
    """Let Ctrl-C out of a block as itself, whatever a call to foreign code in it has made of it."""
    try:
        yield
    except Exception as error:
        reraise_interrupt(error)
        raise


def reraise_interrupt(outcome: BaseException | str) -> None:
    """Raise Ctrl-C again where CasADi has made something else of it.

    Args:
        outcome: an error, which tells of it in words or as what it came from; or the return status of a solver.

    Raises:
        KeyboardInterrupt: that is what it was.
    """
    if isinstance(outcome, str):
        if outcome == _THROWN:
            raise KeyboardInterrupt
        return
    error: BaseException | None = outcome
    while error is not None:
        if isinstance(error, KeyboardInterrupt) or "KeyboardInterrupt" in str(error):
            raise KeyboardInterrupt from outcome
        error = error.__cause__ or error.__context__


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
