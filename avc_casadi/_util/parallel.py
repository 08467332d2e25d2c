"""One function of many tasks: in this process, in processes of their own, or on a cluster."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import import_module
from multiprocessing import get_context, parent_process
from types import TracebackType
from typing import Any, TypeVar

from avc_casadi._errors import InputError, MissingExtraError, WorkerLostError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import speaks, spoken

R = TypeVar("R")
T = TypeVar("T")
_AT_MOST: list[int] = []
_CONNECT_S = 10.0


def processors() -> int:
    """Return the number of processors for this process, at least 1: a worker beside others has its share of them."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([there, *_AT_MOST])


def require_workers(workers: object) -> None:
    """Refuse an invalid number of processes."""
    if not isinstance(workers, int) or isinstance(workers, bool) or workers < 1:
        raise InputError.of(f"is {workers!r}; allowed: a whole number, 1 or more", key="workers")


class Processes(ProcessPoolExecutor):
    """Processes that are fresh interpreters, as CasADi's threads do not survive a fork; an error ends them at once."""

    def __init__(self, workers: int, beside: int = 0) -> None:
        share = max(1, processors() // (workers + beside))
        super().__init__(workers, get_context("spawn"), begin_process, (share,))

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Submit a task."""
        with without_interrupts():
            return super().submit(speaks, spoken(), fn, *args, **kwargs)

    def end(self) -> None:
        """Terminate the processes, whatever they do."""
        for process in list((self._processes or {}).values()):
            process.terminate()
        self.shutdown(cancel_futures=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.shutdown()
        else:
            self.end()


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
    if share is not None:
        _AT_MOST[:] = [share]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
        client = module.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        message = f"no scheduler answers at {address!r}; start one with `dask scheduler`, its address is what it prints"
        raise InputError.of(message, key="--scheduler") from error
    with client:
        yield client.get_executor()


def mapped(
    work: Callable[[T], R],
    tasks: Sequence[T],
    executor: Executor | None = None,
    *,
    workers: int = 1,
    sizes: Sequence[int] = (),
    things: str = "",
    progress: Progress = SILENT,
) -> list[R]:
    """Return the result of each task, in order.

    Args:
        work: a function of a module.
        tasks: its arguments.
        executor: of `concurrent.futures` or with its interface, such as Dask's; it is not shut down.
        workers: processes without an executor; 1 stays in this one. More than one start this program anew, so that a
            script needs its guard ``if __name__ == "__main__"``.
        sizes: of the tasks, for the progress.
        things: what the sizes count.
        progress: of the tasks.

    Raises:
        WorkerLostError: a worker died.
    """
    require_workers(workers)
    weights = sizes or [1] * len(tasks)
    done, found = 0, {}
    with ExitStack() as stack:
        if executor is None and workers > 1 and len(tasks) > 1:
            executor = stack.enter_context(Processes(min(workers, len(tasks))))
        alone = ((place, work(task)) for place, task in enumerate(tasks))
        for place, result in alone if executor is None else _as_done(executor, work, tasks):
            found[place] = result
            done += weights[place]
            progress.advance(done, sum(weights), things)
    return [found[place] for place in range(len(tasks))]


def _as_done(executor: Executor, work: Callable[[T], R], tasks: Sequence[T]) -> Iterator[tuple[int, R]]:
    futures = {executor.submit(speaks, spoken(), work, task): place for place, task in enumerate(tasks)}
    try:
        for future in as_completed(futures):
            yield futures[future], result_of(future)
    finally:
        for future in futures:
            future.cancel()


def result_of(future: Future[R]) -> R:
    """Return the result of a task."""
    try:
        return future.result()
    except BrokenExecutor as error:
        raise WorkerLostError(
            "a worker died, of too little memory, or as the script that begins it has no "
            'if __name__ == "__main__": around what it does'
        ) from error


class Crew(ExitStack):
    """This process and its helpers, which share tasks; results do not depend on which did them."""

    def __init__(self, workers: int) -> None:
        require_workers(workers)
        super().__init__()
        helpers = min(workers, processors()) - 1
        self._helpers = Processes(helpers, beside=1) if helpers else None
        if self._helpers is not None:
            self.callback(self._helpers.end)

    def begin(self, task: Callable[[], R]) -> Callable[[], R]:
        """Start a task, a function of a module with its arguments, on a helper; return a function that awaits it."""
        if self._helpers is None:
            return cache(task)
        future = self._helpers.submit(task)
        return cache(lambda: task() if future.cancel() else result_of(future))

    def each(self, tasks: Sequence[Callable[[], R]]) -> Iterator[R]:
        """Yield the result of each task in order; this process does the first, and others that no helper has begun."""
        if self._helpers is None:
            yield from (task() for task in tasks)
            return
        begun = {place: self._helpers.submit(task) for place, task in enumerate(tasks[1:], 1)}
        own: dict[int, R] = {}
        try:
            yield from (task() for task in tasks[:1])
            for place, future in begun.items():
                for later in range(place, len(tasks)):
                    if future.done():
                        break
                    if begun[later].cancel():
                        own[later] = tasks[later]()
                yield own[place] if place in own else result_of(future)
        finally:
            for future in begun.values():
                future.cancel()


ALONE = Crew(1)
"""Without helpers."""
