"""A long computation in a process of its own, with progress and cancellation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from avc_casadi._errors import AvcError
from avc_casadi._util.parallel import begin_process, without_interrupts
from avc_casadi._util.progress import Progress

_BETWEEN_S = 0.1


class Background:
    """A function of a module that runs in a process of its own."""

    def __init__(self, work: Callable[[Any, Progress], Any], task: Any) -> None:
        self.state: tuple[int, int, str] = (0, 0, "")
        self.result: Any = None
        self.error = ""
        self._began_s, self._seconds = time.monotonic(), 0.0
        self._over = threading.Event()
        context = get_context("spawn")  # CasADi's threads do not survive a fork
        here, there = context.Pipe(duplex=False)
        with without_interrupts():
            self._process = context.Process(target=_work, args=(work, task, there), daemon=True)
            self._process.start()
        there.close()
        threading.Thread(target=self._listen, args=(here,), daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether it has ended, for any reason."""
        return self._over.is_set()

    @property
    def seconds(self) -> float:
        """Elapsed time, or total, s."""
        return self._seconds if self.over else time.monotonic() - self._began_s

    def cancel(self) -> None:
        """Terminate it, without a result."""
        if not self.over:
            self.error = "cancelled"
            self._process.terminate()

    def _listen(self, connection: Connection) -> None:
        kind, content = "state", None
        try:
            while kind == "state":
                kind, content = connection.recv()
                if kind == "state":
                    self.state = content
        except (EOFError, OSError):
            kind, content = "error", "it ended without a result; there may be too little memory"
        if not self.error:
            self.result, self.error = (content, "") if kind == "result" else (None, str(content))
        self._process.join()
        self._seconds = self.seconds
        self._over.set()


class _Piped(Progress):
    """Progress through a pipe, a few times a second."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._last_s = connection, 0.0

    @contextmanager
    def step(self, what: str) -> Iterator[None]:
        self._connection.send(("state", (0, 0, what)))
        yield

    def advance(self, done: int, total: int, what: str = "") -> None:
        now = time.monotonic()
        if now - self._last_s >= _BETWEEN_S:
            self._last_s = now
            self._connection.send(("state", (done, total, what)))


def _work(work: Callable[[Any, Progress], Any], task: Any, connection: Connection) -> None:
    begin_process()
    try:
        connection.send(("result", work(task, _Piped(connection))))
    except AvcError as error:
        connection.send(("error", str(error)))
