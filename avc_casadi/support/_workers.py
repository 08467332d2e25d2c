"""Work beside this thread: in processes that end with it (at Ctrl-C, at an error, when it is killed), or one ahead."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from typing import TypeVar

from avc_casadi.support._interrupt import starting_processes

T = TypeVar("T")
R = TypeVar("R")


def in_processes(work: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[R]:
    """Yield the results of the tasks in their order.

    Args:
        work: function of a module.
        tasks: what to call it with.
        workers: number of processes.
    """
    with _started(work, tasks, workers) as futures:
        for future in futures:
            yield future.result()


@contextmanager
def meanwhile(work: Callable[[T], R], task: T) -> Iterator[Callable[[], R]]:
    """Do a task in a process beside what the block does; what is given waits for the result.

    Args:
        work: function of a module.
        task: what to call it with.
    """
    with _started(work, [task], 1) as (future,):
        yield future.result


def one_ahead(tasks: Iterable[tuple[T, Callable[[], R]]]) -> Iterator[tuple[T, R]]:
    """Yield what each task gives, in their order; a thread does it while the next is made and the last one's is used.

    Args:
        tasks: names with work that leaves Python to others for most of its time, and is short: Ctrl-C waits for it.
    """
    with ThreadPoolExecutor(1) as pool:
        before: tuple[T, Future[R]] | None = None
        for name, task in tasks:
            coming = pool.submit(task)
            if before is not None:
                yield before[0], before[1].result()
            before = name, coming
        if before is not None:
            yield before[0], before[1].result()


@contextmanager
def _started(work: Callable[[T], R], tasks: Sequence[T], workers: int) -> Iterator[list[Future[R]]]:
    others = set(active_children())
    # A fresh interpreter for each process: CasADi's threads do not survive a fork.
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=follow_parent) as pool:
        try:
            with starting_processes():
                futures = [pool.submit(work, task) for task in tasks]
            yield futures
        except BaseException:
            for child in set(active_children()) - others:
                child.terminate()
            raise


def follow_parent() -> None:
    """Leave Ctrl-C to the parent, and end when it has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_after_parent, daemon=True).start()


def _end_after_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
