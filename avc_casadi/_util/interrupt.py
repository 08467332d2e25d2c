"""Ctrl-C and SIGTERM: held in blocks that must be whole, raised again where foreign code drops them."""

import _thread
import os
import signal
import sys
import threading

TYPE_CHECKING = False  # typing takes long to load, and Ctrl-C meanwhile is a traceback
if TYPE_CHECKING:
    from typing import Any, Self

_ENDING = signal.SIGINT, signal.SIGTERM
"""Signals that end a command: Ctrl-C, and what `kill`, a shell or a service manager sends."""
_REPEATS = 3
"""Times that Ctrl-C is raised again where foreign code dropped it, ..."""
_REPEAT_AFTER_S = 0.5
"""... each after so long, s."""
_END_AFTER_S = 0.25
"""The process ends so long after the last, s."""
_came = threading.Event()
_taken = threading.Event()
_signals: list[int] = []
"""The signals that came, in order."""


def handle_interrupts() -> None:
    """Let Ctrl-C and SIGTERM end the process within two seconds; not where its caller had them ignored."""
    for number in _ENDING:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, _interrupted)


def exit_code() -> int:
    """Return the exit code of a command that was interrupted: 128 and the number of the signal, as shells have it."""
    return 128 + (_signals[0] if _signals else signal.SIGINT)


def interrupted() -> bool:
    """Return whether Ctrl-C or SIGTERM came, which CasADi or numpy may have converted to an error of another kind."""
    return _came.is_set()


def take_interrupt() -> None:
    """Let the command end by itself after Ctrl-C: what it says from here on is said to its end."""
    _taken.set()


def _interrupted(number: int, _: object) -> None:
    """Handle a signal, the first with a thread that insists."""
    _signals.append(number)
    if not _came.is_set():
        _came.set()
        threading.Thread(target=_insist, daemon=True).start()
    if not (_taken.is_set() or isinstance(sys.exception(), KeyboardInterrupt)):
        raise KeyboardInterrupt


def _insist() -> None:
    """Raise Ctrl-C again until the command takes it, and end the process where it does not."""
    for _ in range(_REPEATS):
        if _taken.wait(_REPEAT_AFTER_S):
            return
        _thread.interrupt_main()
    if not _taken.wait(_END_AFTER_S):
        _release_semaphores()
        os.write(2, b"avc: interrupted\n")
        os._exit(exit_code())


def _release_semaphores() -> None:
    """Give back the semaphores of worker processes, which are reported as leaked otherwise."""
    module = sys.modules.get("multiprocessing.util")
    if module is not None:
        module._run_finalizers()  # noqa: SLF001 - a process that ends at once has no other way


class DeferredInterrupt:
    """Defer Ctrl-C and SIGTERM to the end of a block of short calls of foreign code, which drops them, or a write."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._previous: dict[int, Any] = {}

    @property
    def came(self) -> bool:
        """Whether a signal came."""
        return self._first is not None

    def __enter__(self) -> "Self":
        # Only the main thread may set handlers and is ever interrupted.
        if threading.current_thread() is threading.main_thread():
            handled = [number for number in _ENDING if callable(signal.getsignal(number))]
            self._previous = {number: signal.signal(number, self._remember) for number in handled}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        if self._first is not None:
            self._previous[self._first](self._first, None)

    def _remember(self, number: int, _: object) -> None:
        self._first = number if self._first is None else self._first
