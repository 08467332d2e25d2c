"""Parallel work in processes of their own, or in this one alone."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextvars import copy_context
from functools import cache, partial
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from avc_casadi._errors import InputError, WorkerLostError
from avc_casadi._util.interrupt import starting_processes
from avc_casadi._util.units import speaks, spoken

_AT_MOST: list[int] = []


def processors() -> int:
    """Return the number of processors for this process, at least 1: a worker beside others has its share of them."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([there, *_AT_MOST])


def use_at_most(count: int) -> None:
    """Limit the number of processors that this process uses."""
    _AT_MOST[:] = [count]


R = TypeVar("R")
# A task that kills so many processes would kill the next one too.
_TRIES = 3


class Processes(Executor):
    """Tasks in processes of their own; each is a fresh interpreter, as CasADi's threads do not survive a fork.

    Left with an error (or Ctrl-C), the context ends its processes at once.

    Args:
        workers: number of processes.
        beside: number of other processes: each has its share of the processors.
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
        """Submit a task to the next idle process.

        The future raises `WorkerLostError` where three processes died of it.
        """
        return self._threads.submit(self._done, partial(speaks, spoken(), fn, *args, **kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more tasks, and end the processes after those begun."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            self._ending = True
            workers = list(self._workers)
        for worker in workers:
            worker.pool.shutdown(wait=wait)

    def end(self) -> None:
        """Terminate the processes."""
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
    """Refuse an invalid number of processes.

    Raises:
        InputError: not a whole number of 1 or more.
    """
    if not isinstance(workers, int) or isinstance(workers, bool) or workers < 1:
        raise InputError.of(f"is {workers!r}; allowed: a whole number, 1 or more", key="workers")


def _begin(share: int) -> None:
    use_at_most(share)
    follow_parent()


def follow_parent() -> None:
    """Leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_after_parent, daemon=True).start()


def _end_after_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


T = TypeVar("T")


def one_ahead(tasks: Iterable[tuple[T, Callable[[], R]]]) -> Iterator[tuple[T, R]]:
    """Yield the result of each task in order; a thread computes the next while the last one's is used.

    Args:
        tasks: names with work that mostly releases the GIL, and is short: Ctrl-C waits for it.
    """
    with ThreadPoolExecutor(1) as pool:
        before: tuple[T, Future[R]] | None = None
        for name, task in tasks:
            coming = pool.submit(copy_context().run, task)
            if before is not None:
                yield before[0], before[1].result()
            before = name, coming
        if before is not None:
            yield before[0], before[1].result()


class SharedTasks:
    """Tasks shared by this process and its helpers; results do not depend on which did them.

    The context terminates the helpers.

    Args:
        workers: maximum number of processes, this one included, and no more than there are processors; each helper is a
            fresh interpreter, as for `Processes`.

    Raises:
        InputError: not a whole number of 1 or more.
    """

    def __init__(self, workers: int) -> None:
        require_workers(workers)
        helpers = min(workers, processors()) - 1
        self._helpers = Processes(helpers, beside=1) if helpers else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._helpers is not None:
            self._helpers.end()

    def begin(self, task: Callable[[], R]) -> Callable[[], R]:
        """Start a task, a function of a module with its arguments, on a helper; return a function that awaits it.

        It runs here where no helper has begun with it by then.
        """
        return cache(task) if self._helpers is None else _Begun(task, self._helpers.submit(task)).result

    def each(self, tasks: Sequence[Callable[[], R]]) -> Iterator[R]:
        """Yield the result of each task in order.

        The first one runs here. While waiting for another, this process runs one that no helper has begun; closed
        early, it drops those not begun.
        """
        if self._helpers is None:
            yield from (task() for task in tasks)
            return
        begun = [_Begun(task, self._helpers.submit(task)) for task in tasks[1:]]
        try:
            yield from (task() for task in tasks[:1])
            for place, one in enumerate(begun):
                for other in begun[place:]:
                    if one.done:
                        break
                    other.here()
                yield one.result()
        finally:
            for one in begun:
                one.drop()


ALONE = SharedTasks(1)
"""Without helpers."""


class _Begun(Generic[R]):
    """A task that a helper has begun or will begin, unless it runs here."""

    def __init__(self, task: Callable[[], R], future: Future[R]) -> None:
        self._task, self._future = task, future
        self._found: list[R] = []

    @property
    def done(self) -> bool:
        return bool(self._found) or self._future.done()

    def here(self) -> None:
        """Run it here, if no helper has begun."""
        if not self._found and self._future.cancel():
            self._found.append(self._task())

    def result(self) -> R:
        self.here()
        return self._found[0] if self._found else self._future.result()

    def drop(self) -> None:
        self._future.cancel()
