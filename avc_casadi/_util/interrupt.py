"""Ctrl-C: deferred where an exception would be lost, ignored while a result is written, recognised in any form.

CasADi drops an exception raised by Ctrl-C while it reads an argument or builds an expression, or converts it to
another; numpy converts it too.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

# IPOPT's status where Ctrl-C, or another exception, came while CasADi ran it.
_THROWN = "NonIpopt_Exception_Thrown"
# Time for an interrupt inside CasADi to come out of it.
_RAISED_AGAIN_S = 0.05


class HeldInterrupt:
    """Defer Ctrl-C in a block of short calls to foreign code to the block's end.

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
    """Ignore Ctrl-C during a short operation that must not be left half done."""
    if not _in_main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)


@contextmanager
def reraised_interrupts() -> Iterator[None]:
    """Raise Ctrl-C out of a block as itself, whatever foreign code in it has converted it to, nothing included."""
    with _Insistent() as interrupt:
        try:
            yield
        except Exception as error:
            reraise_interrupt(error)
            if interrupt.fell_into:
                raise KeyboardInterrupt from error
            raise


class _Insistent:
    """Raises an interrupt inside CasADi again until the block ends, unless it is being handled.

    Attributes:
        fell_into: the interrupted foreign code, or empty.
    """

    def __init__(self) -> None:
        self.fell_into = ""
        self._previous: Any = None
        self._over = threading.Event()

    def __enter__(self) -> Self:
        handler = signal.getsignal(signal.SIGINT)
        outermost = not isinstance(getattr(handler, "__self__", None), _Insistent)
        if outermost and callable(handler) and _in_main_thread():
            self._previous = signal.signal(signal.SIGINT, self._interrupted)
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if self.fell_into == "casadi":
            if _interrupt_is_handled():
                return
        else:
            self.fell_into = _foreign(frame)
            if self.fell_into == "casadi":
                threading.Thread(target=self._insist, daemon=True).start()
        self._previous(number, frame)

    def _insist(self) -> None:
        while not self._over.wait(_RAISED_AGAIN_S):
            if sys.platform == "win32":
                _thread.interrupt_main()
            else:
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def _interrupt_is_handled() -> bool:
    error = sys.exception()
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _foreign(frame: FrameType | None) -> str:
    while frame is not None:
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if package in {"casadi", "numpy", "scipy"}:
            return package
        frame = frame.f_back
    return ""


def reraise_interrupt(outcome: BaseException | str) -> None:
    """Raise Ctrl-C again where CasADi has converted it.

    Args:
        outcome: an error, which names it or is caused by it; or the return status of a solver.

    Raises:
        KeyboardInterrupt: it was Ctrl-C.
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
