"""An executor whose workers are processes that may die: what one of them had begun is begun again by a fresh one."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from types import TracebackType
from typing import Any, TypeVar

from avc_casadi._errors import InputError, WorkerLostError
from avc_casadi.support._interrupt import starting_processes
from avc_casadi.support._processors import processors, use_at_most

R = TypeVar("R")
# A task that takes so many processes with it would take the next one too.
_TRIES = 3


class Processes(Executor):
    """Tasks in processes of their own; each is a fresh interpreter, as CasADi's threads do not survive a fork.

    Left with an error (or Ctrl-C), the context ends its processes at once.

    Args:
        workers: number of processes.
        beside: number of processes that work beside them: each has its share of the processors.
    """

    def __init__(self, workers: int, beside: int = 0) -> None:
        require_workers(workers)
        if getattr(current_process(), "_inheriting", False):
            raise WorkerLostError(
                "a script whose workers start it anew begins workers as it is read; put what it does under "
                'if __name__ == "__main__":'
            )
        self._share = max(1, processors() // (workers + beside))
        self._threads = ThreadPoolExecutor(workers)
        self._idle: SimpleQueue[_Worker | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._workers: set[_Worker] = set()
        self._lock = threading.Lock()
        self._ending = False

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Let a process do it, as soon as one has nothing else to do.

        The future raises `WorkerLostError` where each of three processes died of it.
        """
        return self._threads.submit(self._done, partial(fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks, and end the processes when those begun are done."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            self._ending = True
            workers = list(self._workers)
        for worker in workers:
            worker.pool.shutdown(wait=wait)

    def end(self) -> None:
        """End the processes now, whatever they do."""
        with self._lock:
            self._ending = True
            workers = list(self._workers)
        for worker in workers:
            worker.end()
        self.shutdown(cancel_futures=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.end()

    def _done(self, task: Callable[[], R]) -> R:
        worker = self._idle.get()
        try:
            for _ in range(_TRIES):
                if worker is None:
                    worker = self._started()
                try:
                    return worker.pool.submit(task).result()
                except BrokenExecutor:
                    with self._lock:
                        self._workers.discard(worker)
                    worker.pool.shutdown()
                    worker = None
        finally:
            self._idle.put(worker)
        raise WorkerLostError(
            f"{_TRIES} processes died of the same task, the last one without a word: of too little memory, or as the "
            'script that begins them has no if __name__ == "__main__": around what it does'
        )

    def _started(self) -> _Worker:
        # One at a time, so that a new child is known to be this worker's.
        with self._lock:
            if self._ending:
                raise WorkerLostError("the executor ends; begin no more tasks")
            others = set(active_children())
            pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin, initargs=(self._share,))
            with starting_processes():
                pool.submit(os.getpid)  # begins the process
            worker = _Worker(pool, tuple(set(active_children()) - others))
            self._workers.add(worker)
            return worker


class _Worker:
    """A pool of one process."""

    def __init__(self, pool: ProcessPoolExecutor, processes: tuple[BaseProcess, ...]) -> None:
        self.pool = pool
        self._processes = processes

    def end(self) -> None:
        for process in self._processes:
            process.terminate()


def require_workers(workers: object) -> None:
    """Refuse what is no number of processes.

    Raises:
        InputError: no whole number of 1 or more.
    """
    if not isinstance(workers, int) or isinstance(workers, bool) or workers < 1:
        raise InputError.of(f"is {workers!r}; allowed: a whole number, 1 or more", key="workers")


def _begin(share: int) -> None:
    use_at_most(share)
    follow_parent()


def follow_parent() -> None:
    """Leave Ctrl-C to the parent, and end when it has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_after_parent, daemon=True).start()


def _end_after_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
