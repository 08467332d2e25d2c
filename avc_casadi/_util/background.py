"""A long computation in a process of its own, with progress and cancellation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from avc_casadi._errors import AvcError
from avc_casadi._util.interrupt import starting_processes
from avc_casadi._util.parallel import follow_parent
from avc_casadi._util.progress import Progress

_BETWEEN_S = 0.1
_ENDED = "it ended without a result; there may be too little memory"


@dataclass
class Background:
    """A function of a module that runs in a process of its own.

    Attributes:
        said: the last (done, total, what) of its progress.
        result: its return value; None until then.
        error: reason without a result; empty where there is one, or none yet.
        seconds: elapsed time, or total.
    """

    said: tuple[int, int, str] = (0, 0, "")
    result: Any = None
    error: str = ""
    _started_s: float = field(default_factory=time.monotonic)
    _ended_s: float | None = None
    _process: Any = None
    _over: threading.Event = field(default_factory=threading.Event)

    @classmethod
    def of(cls, work: Callable[[Any, Progress], Any], task: Any) -> Background:
        """Start ``work(task, progress)``."""
        context = get_context("spawn")  # CasADi's threads do not survive a fork
        here, there = context.Pipe(duplex=False)
        found = cls()
        with starting_processes():
            found._process = context.Process(target=_worked, args=(work, task, there), daemon=True)
            found._process.start()
        there.close()
        threading.Thread(target=found._listen, args=(here,), daemon=True).start()
        return found

    @property
    def over(self) -> bool:
        """Whether it has ended, for any reason."""
        return self._over.is_set()

    @property
    def seconds(self) -> float:
        """Elapsed time, or total, s."""
        return (time.monotonic() if self._ended_s is None else self._ended_s) - self._started_s

    def cancel(self) -> None:
        """Terminate it, without a result."""
        if not self.over:
            self.error = "cancelled"
            self._process.terminate()

    def _listen(self, connection: Connection) -> None:
        kind, content = "error", _ENDED
        try:
            while True:
                kind, content = connection.recv()
                if kind != "said":
                    break
                self.said, content = content, _ENDED
        except (EOFError, OSError):
            kind = "error"
        if not self.error:
            self.result, self.error = (content, "") if kind == "result" else (None, content)
        connection.close()
        self._process.join()
        self._ended_s = time.monotonic()
        self._over.set()


@dataclass
class _Told:
    """Progress through a pipe, a few times a second."""

    connection: Connection
    last_s: float = 0.0

    @contextmanager
    def step(self, what: str) -> Iterator[None]:
        self.connection.send(("said", (0, 0, what)))
        yield

    def advance(self, done: int, total: int, what: str = "") -> None:
        now = time.monotonic()
        if now - self.last_s >= _BETWEEN_S:
            self.last_s = now
            self.connection.send(("said", (done, total, what)))


def _worked(work: Callable[[Any, Progress], Any], task: Any, connection: Connection) -> None:
    follow_parent()
    try:
        connection.send(("result", work(task, _Told(connection))))
    except AvcError as error:
        connection.send(("error", str(error)))
