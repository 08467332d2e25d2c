"""Ctrl-C: held in blocks that must be whole, and in the process `avc` raised again where foreign code drops it."""

import _thread
import os
import signal
import sys
import threading

TYPE_CHECKING = False  # typing takes long to load, and Ctrl-C meanwhile is a traceback
if TYPE_CHECKING:
    from typing import Any, Self

EXIT_CODE = 130
"""Exit code of a command that Ctrl-C ended: 128 and the number of SIGINT, as shells have it."""
_REPEATS = 3
"""Times that Ctrl-C is raised again where foreign code dropped it, ..."""
_REPEAT_AFTER_S = 0.5
"""... each after so long, s."""
_END_AFTER_S = 0.25
"""The process ends so long after the last, s."""
_came = threading.Event()
_taken = threading.Event()


def handle_interrupts() -> None:
    """Let Ctrl-C end the process within two seconds; not where its caller had it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)


def interrupted() -> bool:
    """Return whether Ctrl-C came, which CasADi or numpy may have converted to an error of another kind."""
    return _came.is_set()


def take_interrupt() -> None:
    """Let the command end by itself after Ctrl-C: what it says from here on is said to its end."""
    _taken.set()


def _interrupted(*_: object) -> None:
    """Handle Ctrl-C, the first with a thread that insists."""
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
        os.write(2, b"avc: interrupted\n")
        os._exit(EXIT_CODE)


class DeferredInterrupt:
    """Defer Ctrl-C to the end of a block of short calls to foreign code, which would drop it, or of a short write."""

    def __init__(self) -> None:
        self.came = False
        self._previous: Any = None

    def __enter__(self) -> "Self":
        # Only the main thread may set handlers and is ever interrupted.
        in_main_thread = threading.current_thread() is threading.main_thread()
        if in_main_thread and callable(signal.getsignal(signal.SIGINT)):
            self._previous = signal.signal(signal.SIGINT, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)
            if self.came:
                self._previous(signal.SIGINT, None)

    def _remember(self, *_: object) -> None:
        self.came = True
