"""A problem to explore: results by settings, and the runs of slow methods in processes of their own."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import singledispatch
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from avc_casadi._errors import AvcError
from avc_casadi._util.parallel import begin_process, without_interrupts
from avc_casadi._util.progress import Progress
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS
from avc_casadi.model.admittance import AdmittanceProblem, Contact, VirtualImpedance
from avc_casadi.model.ends import End, Wall
from avc_casadi.present.explore.settings import (
    Explored,
    Form,
    RequestError,
    Settings,
    gain_fields,
    problem_fields,
    problem_of_settings,
)
from avc_casadi.present.explore.verdict import (
    NONE_DEPLOYABLE,
    Judged,
    Verdict,
    of_admittance,
    of_coupling,
    of_recommendation,
)
from avc_casadi.present.row import Mark, row
from avc_casadi.present.rows import admittance, subject
from avc_casadi.recommendation.admittance import recommend_admittance
from avc_casadi.recommendation.recommend import recommend

T = TypeVar("T")

_REPORT_S = 0.1
"""Shortest time, s, between two reports of progress."""

_MOST_RESULTS = 64
"""Results that are kept."""

_WANTED_S = 15
"""Time, s, after which a run that no page asks for is cancelled."""

_MOST_RUNS = 2
"""Runs that may be under way."""


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
        if now - self._last_s >= _REPORT_S:
            self._last_s = now
            self._connection.send(("state", f": {part}, {done} of {total or '?'}"))


def _work(work: Callable[[Any, Progress], Any], task: Any, connection: Connection) -> None:
    begin_process()
    try:
        connection.send(("result", work(task, _Piped(connection))))
    except AvcError as error:
        connection.send(("error", str(error)))


@dataclass(frozen=True)
class Solved:
    """What a slow method has found: a coupling, or None where it finds none, and its verdict.

    Of an admittance device it is a law.
    """

    coupling: Coupling | None
    judged: Judged
    admittance: VirtualImpedance | None = None


def _solved(task: tuple[Explored, str], progress: Progress) -> Solved:
    """Return what a slow method finds."""
    problem, method = task
    return solved(problem.end, problem, method, progress)


@singledispatch
def solved(end: End, problem: Any, method: str, progress: Progress) -> Solved:  # noqa: ARG001
    """Return what a slow method finds for an end."""
    if method == "recommend":
        result = recommend(problem, progress=progress)
        return Solved(result.coupling, of_recommendation(result))
    gains = solve(problem, method, progress=progress)
    usable = bool(gains.usable.any())
    coupling = Coupling.from_schedule(problem, gains) if usable else None
    verdict = None if coupling is None else deployable(coupling, progress)
    notes = [row("Note", note) for note in (gains.notes if usable else dict.fromkeys(gains.reason))]
    return Solved(coupling, Judged(of_coupling(verdict), [subject.deployable(verdict), *notes]))


@solved.register
def _solved_admittance(
    end: Contact,  # noqa: ARG001
    problem: AdmittanceProblem,
    method: str,  # noqa: ARG001 - there is one
    progress: Progress,
) -> Solved:
    """Return what `recommend` finds for an admittance device: its law, the verdict on it, and rows."""
    found = recommend_admittance(problem, progress=progress)
    rows = [shown for shown in admittance.recommendation(found).rows if shown.rank == 0]
    if found.certificate is None:
        return Solved(None, Judged(Verdict(Mark.FAIL, NONE_DEPLOYABLE), rows))
    return Solved(None, Judged(of_admittance(found.certificate), rows), found.law)


class SlowRun:
    """A slow method in a process of its own, with progress and cancellation."""

    def __init__(self, problem: Explored, method: str) -> None:
        """Start a slow method for a problem in a process of its own, and listen to it."""
        self.began_s = self.wanted_s = time.monotonic()
        self.state = self.error = ""
        self.result: Solved | None = None
        context = get_context("spawn")  # CasADi's threads do not survive a fork
        receiver, sender = context.Pipe(duplex=False)
        with without_interrupts():
            self._process = context.Process(target=_work, args=(_solved, (problem, method), sender), daemon=True)
            self._process.start()
        sender.close()
        threading.Thread(target=self._listen, args=(receiver,), daemon=True).start()

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
        """Take states from the process until it sends a result or an error, or ends without."""
        kind, content = "state", ""
        try:
            while kind == "state":
                self.state = content
                kind, content = connection.recv()
        except (EOFError, OSError):
            kind, content = "error", "the run ended without a result; there may be too little memory"
        if not self.error:
            self.result, self.error = (content, "") if kind == "result" else (None, content)  # type: ignore[assignment]
        self._process.join()


@singledispatch
def methods_of(end: End) -> tuple[tuple[str, ...], tuple[str, ...]]:  # noqa: ARG001
    """Return the methods beside `recommend` that find couplings to an end: at once, and in a run."""
    return (), ()


@methods_of.register
def _methods_of_wall(end: Wall) -> tuple[tuple[str, ...], tuple[str, ...]]:  # noqa: ARG001
    live = tuple(name for name, method in METHODS.items() if method.pointwise)
    return live, tuple(name for name, method in METHODS.items() if not method.pointwise)


class Explorer:
    """A problem to explore, and results by settings."""

    def __init__(self, base: Explored, source: str, versions: Mapping[str, str] | None = None) -> None:
        """Begin the page of a problem from a source: its form, and no results yet."""
        self.base: Any = base
        self.source = source
        self.versions = versions or {}
        # A law stands beside the recommendation alone: other methods need a wall.
        live, slow = methods_of(base.end) if base.law is None else ((), ())
        self.form = Form(problem_fields(base), gain_fields(base.end, base), live, ("recommend", *slow))
        self._cache: OrderedDict[str, tuple[threading.Lock, list[Any]]] = OrderedDict()
        self._lock = threading.Lock()
        self._runs: dict[str, SlowRun] = {}

    def problem(self, settings: Settings) -> Any:
        """Return the problem of the settings."""
        key = f"problem {settings.method in self.form.live} {settings.key('motion', 'gains')}"
        return self.cached(key, lambda: problem_of_settings(self.base, settings, self.form))

    def cached(self, key: str, make: Callable[[], T]) -> T:
        """Return a result by its key; two threads that want it compute it once."""
        with self._lock:
            lock, results = self._cache.setdefault(key, (threading.Lock(), []))
            self._cache.move_to_end(key)
            while len(self._cache) > _MOST_RESULTS:
                self._cache.popitem(last=False)
        with lock:
            if not results:
                results.append(make())
            result: T = results[0]
            return result

    def known(self, key: str) -> Any:
        """Return a result by its key; None where it is not there yet."""
        with self._lock:
            _, results = self._cache.get(key, (None, []))
        return results[0] if results else None

    def run(self, settings: Settings, *, begin: bool = False, cancel: bool = False) -> SlowRun | None:
        """Return the run of the settings; begin it or cancel it. None where there is none."""
        key, now = settings.key("method"), time.monotonic()
        problem = self.problem(settings) if begin else self.base
        with self._lock:
            for slow_run in self._runs.values():
                if now - slow_run.wanted_s > _WANTED_S:  # a page that was closed no longer asks
                    slow_run.cancel()
            run = self._runs.get(key)
            if run is not None:
                run.wanted_s = now
                if cancel:
                    run.cancel()
            if begin and (run is None or run.error):
                under_way = sum(not slow_run.over for slow_run in self._runs.values())
                if under_way >= _MOST_RUNS:
                    raise RequestError(409, f"{_MOST_RUNS} runs are under way; cancel one of them first")
                run = SlowRun(problem, settings.method)
                self._runs[key] = run
            return run

    def found(self, settings: Settings) -> Solved | None:
        """Return what the run of the settings has found; None where there is nothing yet."""
        run = self.run(settings)
        return None if run is None else run.result

    def coupling(self, settings: Settings) -> Coupling | None:
        """Return the coupling that the run of the settings has found; None where there is none yet."""
        found = self.found(settings)
        return None if found is None else found.coupling

    def judged(self, settings: Settings) -> Judged:
        """Return the verdict of the run of the settings: how far it is, or what it has found."""
        run = self.run(settings)
        label = "Recommendation" if settings.method == "recommend" else settings.method.capitalize()
        if run is None:
            text = "not computed yet for the values of the fields: press Run"
            return Judged(Verdict(Mark.NONE, "press Run"), [row(label, text)])
        if not run.over:
            running = f"running for {time.monotonic() - run.began_s:.0f} s"
            return Judged(Verdict(Mark.NONE, running), [row(label, f"{running}{run.state}")])
        if run.result is None:
            return Judged(Verdict(Mark.FAIL, "no result"), [row(label, f"ended: {run.error}", mark=Mark.FAIL)])
        return run.result.judged

    def close(self) -> None:
        """End all runs."""
        for run in self._runs.values():
            run.cancel()
