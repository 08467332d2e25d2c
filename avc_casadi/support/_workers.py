"""Work beside this thread: in a process that ends with it (at Ctrl-C, at an error, when it is killed), or one ahead."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from avc_casadi.support._processes import Processes

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def meanwhile(work: Callable[[T], R], task: T) -> Iterator[Callable[[], R]]:
    """Do a task in a process beside what the block does; what is given waits for the result.

    Args:
        work: function of a module.
        task: what to call it with.
    """
    with Processes(1) as executor:
        yield executor.submit(work, task).result


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
