"""Ctrl-C that waits: an exception raised inside C code or in a callback from it may be lost, and the interrupt too."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self


class HeldInterrupt:
    """Hold Ctrl-C back in a block of short calls to such code; at the block's end it takes its course.

    Attributes:
        came: whether Ctrl-C came; the block should then end soon.
    """

    def __init__(self) -> None:
        self.came = False
        self._previous: Any = None

    def __enter__(self) -> Self:
        # Only the main thread may set handlers and is ever interrupted.
        if threading.current_thread() is threading.main_thread() and callable(signal.getsignal(signal.SIGINT)):
            self._previous = signal.signal(signal.SIGINT, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)
            if self.came:
                self._previous(signal.SIGINT, None)

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self.came = True
