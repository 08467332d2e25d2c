"""This process and others that help it with what they are given; alone it does everything itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import cache
from types import TracebackType
from typing import Generic, Self, TypeVar

from avc_casadi.support._processes import Processes, require_workers
from avc_casadi.support._processors import processors

R = TypeVar("R")


class Crew:
    """Tasks that this process and its helpers share; what they give does not depend on who did them.

    The context ends the helpers, whatever they still do.

    Args:
        workers: processes at most, this one among them, and no more than there are processors; each helper is a fresh
            interpreter, as for `Processes`.

    Raises:
        InputError: no whole number of 1 or more.
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
        """Let a helper begin a task, a function of a module with its arguments; what is given waits for the result.

        It is done here where no helper has begun with it by then.
        """
        return cache(task) if self._helpers is None else _Begun(task, self._helpers.submit(task)).result

    def each(self, tasks: Sequence[Callable[[], R]]) -> Iterator[R]:
        """Yield what each task gives, in their order.

        The first one is done here. While another is awaited, this process does one that no helper has begun; left
        early, it drops those that nobody has begun.
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


ALONE = Crew(1)
"""Without helpers."""


class _Begun(Generic[R]):
    """A task that a helper has or will have begun, unless it is done here."""

    def __init__(self, task: Callable[[], R], future: Future[R]) -> None:
        self._task, self._future = task, future
        self._found: list[R] = []

    @property
    def done(self) -> bool:
        return bool(self._found) or self._future.done()

    def here(self) -> None:
        """Do it here, if nobody has begun with it."""
        if not self._found and self._future.cancel():
            self._found.append(self._task())

    def result(self) -> R:
        self.here()
        return self._found[0] if self._found else self._future.result()

    def drop(self) -> None:
        self._future.cancel()
