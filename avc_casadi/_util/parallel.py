"""One function of many tasks: in this process, in processes of their own, or on a cluster."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from multiprocessing import get_context, parent_process
from typing import Any, Self, TypeVar

from avc_casadi._errors import InputError, MissingExtraError, WorkerLostError
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi._util.progress import SILENT, Progress

R = TypeVar("R")
T = TypeVar("T")
_share_of_processors: int | None = None
"""Processors that this process may use as a worker beside others; None for all."""
_ANSWER_WITHIN_S = 10.0
"""Time within which the scheduler of a cluster must answer, s."""


def processors() -> int:
    """Return the number of processors for this process, at least 1: a worker beside others has its share of them."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return available if _share_of_processors is None else min(available, _share_of_processors)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Defer Ctrl-C while processes start, which then never see it."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_process(share: int | None = None) -> None:
    """Leave Ctrl-C to the parent, end with it, and use at most a share of the processors."""
    global _share_of_processors  # noqa: PLW0603 - set once, when the process begins
    if share is not None:
        _share_of_processors = share
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_after_parent, daemon=True).start()


def _end_after_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def cluster(address: str | None) -> Iterator[Executor | None]:
    """Yield the executor of the Dask cluster behind a scheduler; None without an address."""
    if address is None:
        yield None
        return
    try:
        module: Any = import_module("distributed")
    except ImportError as error:
        raise MissingExtraError("a cluster needs Dask: pip install 'avc-casadi[cluster]'") from error
    try:
        client = module.Client(address, timeout=_ANSWER_WITHIN_S)
    except (OSError, ValueError) as error:
        message = f"no Dask scheduler answers at {address!r}; start one with `dask scheduler`, it prints its address"
        raise InputError.of(message, key="--scheduler") from error
    with client:
        yield client.get_executor()


def map_tasks(
    work: Callable[[T], R],
    tasks: Sequence[T],
    executor: Executor | None = None,
    *,
    workers: int = 1,
    sizes: Sequence[int] = (),
    things: str = "",
    progress: Progress = SILENT,
) -> list[R]:
    """Return the result of each task, in order: of an executor, or of so many processes, this one included.

    Args:
        work: what is done of each task.
        tasks: in the order of their results.
        executor: in place of processes of this machine.
        workers: processes at most, this one included.
        sizes: share of each task in the progress; all alike where it is empty.
        things: what the sizes count.
        progress: receiver of the progress.
    """
    weights = sizes or [1] * len(tasks)
    last_first: list[R] = []
    with Crew(workers, executor) as crew:
        results = [crew.begin(partial(work, task)) for task in tasks]
        for index in reversed(range(len(tasks))):  # helpers begin at the other end
            last_first.append(results[index]())
            done = [size for task, size in enumerate(weights) if task >= index or crew.done(task)]
            progress.advance(sum(done), sum(weights), things)
    return last_first[::-1]


class Crew:
    """This process and fresh interpreters, as CasADi's threads survive no fork, that share tasks; or an executor."""

    def __init__(self, workers: int, executor: Executor | None = None) -> None:
        """Start so many processes, this one included and at most those of the machine; none beside an executor."""
        if not isinstance(workers, int) or isinstance(workers, bool) or workers < 1:
            raise InputError.of(f"is {workers!r}; allowed: a whole number, 1 or more", key="workers")
        size = min(workers, processors())
        self._executor = executor
        self._helpers: ProcessPoolExecutor | None = None
        self._begun: list[Future[Any]] = []
        if size > 1 and executor is None:
            share = max(1, processors() // size)
            self._helpers = ProcessPoolExecutor(size - 1, get_context("spawn"), begin_process, (share,))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._helpers is None:
            for future in self._begun:
                future.cancel()
        else:  # a broken pool raises on what was cancelled
            for process in list((self._helpers._processes or {}).values()):  # noqa: SLF001 - public from Python 3.14 on
                process.terminate()
            self._helpers.shutdown(cancel_futures=True)

    def begin(self, task: Callable[[], R]) -> Callable[[], R]:
        """Start a task; return a function that awaits its result, and does it here where no helper has begun it."""
        helpers = self._executor or self._helpers
        if helpers is None:
            return cache(task)
        with without_interrupts(), DeferredInterrupt():  # another thread may take the signal for this one
            future = helpers.submit(task)
        self._begun.append(future)
        return cache(partial(_result, future, None if self._executor else task))

    def done(self, index: int) -> bool:
        """Return whether a helper or the executor has done the task that was begun so many tasks after the first."""
        return bool(self._begun) and self._begun[index].done()


def _result(future: Future[R], task: Callable[[], R] | None) -> R:
    """Return the result of a future; of a task that nobody has begun it is made here."""
    try:
        if task is not None and future.cancel():
            return task()
        return future.result()
    except BrokenExecutor as error:
        raise WorkerLostError(
            "a worker process died: memory ran out, or the script that begins it has no "
            'if __name__ == "__main__": around what it does'
        ) from error
