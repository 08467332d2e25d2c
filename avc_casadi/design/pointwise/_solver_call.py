"""What a call of a foreign solver needs: Ctrl-C that is not lost in it, and a terminal that it cannot write to."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Self


class Interrupt:
    """Remembers Ctrl-C while solvers run.

    CasADi hands Ctrl-C to the solver as an exception, which comes back as a return status (IPOPT), as a RuntimeError
    (sqpmethod) or not at all. Use as a context, and call `check` after each solve.
    """

    def __init__(self) -> None:
        self._came = False
        self._previous: Any = None
        self._mine = False

    def __enter__(self) -> Self:
        # Only the main thread may set handlers, and one that somebody else has set is to be left alone.
        self._mine = threading.current_thread() is threading.main_thread()
        self._mine = self._mine and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if self._mine:
            self._previous = signal.signal(signal.SIGINT, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        if self._mine:
            signal.signal(signal.SIGINT, self._previous)

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self._came = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C came."""
        if self._came:
            raise KeyboardInterrupt


@contextlib.contextmanager
def silent_terminal(*, active: bool) -> Iterator[None]:
    """Send what is written to standard output and error to nowhere, whether by Python or by a library.

    Args:
        active: whether to do so at all.
    """
    if not active:
        yield
        return
    sys.stdout.flush()
    sys.stderr.flush()
    with contextlib.ExitStack() as stack:
        nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123 - not a real path
        for number in (1, 2):
            kept = os.dup(number)
            stack.callback(_restore, kept, number)
            os.dup2(nowhere.fileno(), number)
        stack.enter_context(contextlib.redirect_stdout(nowhere))
        stack.enter_context(contextlib.redirect_stderr(nowhere))
        yield


def _restore(kept: int, number: int) -> None:
    # A library's own buffer would otherwise be written to the terminal later.
    with contextlib.suppress(OSError, TypeError, AttributeError):
        ctypes.CDLL(None).fflush(None)
    os.dup2(kept, number)
    os.close(kept)
