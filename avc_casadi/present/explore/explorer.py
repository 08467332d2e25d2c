"""A problem to explore: results by settings, and the runs of slow methods in processes of their own."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from avc_casadi._errors import AvcError
from avc_casadi._util.parallel import begin_process, without_interrupts
from avc_casadi._util.progress import Progress
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS
from avc_casadi.model.problem import Problem
from avc_casadi.present.explore.settings import (
    Form,
    RequestError,
    Settings,
    gain_fields,
    problem_fields,
    problem_of_settings,
)
from avc_casadi.present.row import Mark, Row, row
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.recommendation.recommend import recommend

T = TypeVar("T")


class _Piped(Progress):
    """Progress through a pipe, a few times a second."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._last_s = connection, 0.0

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self._connection.send(("state", f": {name}"))
        yield

    def advance(self, done: int, total: int, part: str = "") -> None:
        now = time.monotonic()
        if now - self._last_s >= 0.1:
            self._last_s = now
            self._connection.send(("state", f": {part}, {done} of {total or '?'}"))


def _work(work: Callable[[Any, Progress], Any], task: Any, connection: Connection) -> None:
    begin_process()
    try:
        connection.send(("result", work(task, _Piped(connection))))
    except AvcError as error:
        connection.send(("error", str(error)))


def _found(task: tuple[Problem, str], progress: Progress) -> tuple[Coupling | None, list[Row]]:
    """Return the coupling of a slow method, and its rows."""
    problem, method = task
    if method == "recommend":
        found = recommend(problem, progress=progress)
        return found.coupling, [one for one in recommendation(found).rows if one.rank == 0]
    gains = solve(problem, method, progress=progress)
    usable = bool(gains.usable.any())
    notes = [row("Note", note) for note in (gains.notes if usable else dict.fromkeys(gains.reason))]
    return Coupling.of(problem, gains) if usable else None, notes


class SlowRun:
    """A slow method in a process of its own, with progress and cancellation."""

    def __init__(self, problem: Problem, method: str) -> None:
        self.began_s = self.wanted_s = time.monotonic()
        self.state = self.error = ""
        self.result: tuple[Coupling | None, list[Row]] | None = None
        context = get_context("spawn")  # CasADi's threads do not survive a fork
        here, there = context.Pipe(duplex=False)
        with without_interrupts():
            self._process = context.Process(target=_work, args=(_found, (problem, method), there), daemon=True)
            self._process.start()
        there.close()
        threading.Thread(target=self._listen, args=(here,), daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether it has ended, for any reason."""
        return self.result is not None or bool(self.error)

    def cancel(self) -> None:
        """Terminate it, without a result."""
        if not self.over:
            self.error = "cancelled"
            self._process.terminate()

    def _listen(self, connection: Connection) -> None:
        kind, content = "state", ""
        try:
            while kind == "state":
                self.state = content
                kind, content = connection.recv()
        except (EOFError, OSError):
            kind, content = "error", "it ended without a result; there may be too little memory"
        if not self.error:
            self.result, self.error = (content, "") if kind == "result" else (None, content)  # type: ignore[assignment]
        self._process.join()


class Explorer:
    """A problem to explore, and results by settings."""

    def __init__(self, base: Problem, source: str, versions: Mapping[str, str] | None = None) -> None:
        self.base, self.source, self.versions = base, source, versions or {}
        pair = base.simulation is not None or base.follower is not None
        live, slow = ([name for name, one in METHODS.items() if one.pointwise is at_once] for at_once in (True, False))
        kinds = ((), ("recommend",)) if pair else (tuple(live), ("recommend", *slow))
        self.form = Form(problem_fields(base), gain_fields(base), *kinds)
        self._cache: OrderedDict[str, tuple[threading.Lock, list[Any]]] = OrderedDict()
        self._lock = threading.Lock()
        self._runs: dict[str, SlowRun] = {}

    def problem(self, settings: Settings) -> Problem:
        """Return the problem of the settings."""
        key = f"problem {settings.method in self.form.live} {settings.key('motion')}"
        return self.cached(key, lambda: problem_of_settings(self.base, settings, self.form))

    def cached(self, key: str, make: Callable[[], T]) -> T:
        """Return a result by its key; two threads that want it compute it once."""
        with self._lock:
            lock, found = self._cache.setdefault(key, (threading.Lock(), []))
            self._cache.move_to_end(key)
            while len(self._cache) > 64:
                self._cache.popitem(last=False)
        with lock:
            if not found:
                found.append(make())
            result: T = found[0]
            return result

    def run(self, settings: Settings, *, begin: bool = False, cancel: bool = False) -> SlowRun | None:
        """Return the run of the settings; begin it or cancel it. None where there is none."""
        key, now = settings.key("method"), time.monotonic()
        problem = self.problem(settings) if begin else self.base
        with self._lock:
            for one in self._runs.values():
                if now - one.wanted_s > 15:  # a page that was closed no longer asks
                    one.cancel()
            found = self._runs.get(key)
            if found is not None:
                found.wanted_s = now
                if cancel:
                    found.cancel()
            if begin and (found is None or found.error):
                if sum(not one.over for one in self._runs.values()) >= 2:
                    raise RequestError(409, "2 runs are under way; cancel one of them first")
                found = self._runs[key] = SlowRun(problem, settings.method)
            return found

    def coupling(self, settings: Settings) -> Coupling | None:
        """Return what the run of the settings has found; None where there is nothing yet."""
        run = self.run(settings)
        return None if run is None or run.result is None else run.result[0]

    def run_rows(self, settings: Settings) -> list[Row]:
        """Return the rows of the run of the settings: how far it is, or what it has found."""
        run = self.run(settings)
        label = "Recommendation" if settings.method == "recommend" else settings.method.capitalize()
        if run is None:
            return [row(label, "not computed for these settings yet: Run begins it")]
        if not run.over:
            return [row(label, f"running for {time.monotonic() - run.began_s:.0f} s{run.state}")]
        return [row(label, f"ended: {run.error}", mark=Mark.FAIL)] if run.result is None else run.result[1]

    def close(self) -> None:
        """End all runs."""
        for one in self._runs.values():
            one.cancel()
