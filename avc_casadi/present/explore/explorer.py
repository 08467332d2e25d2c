"""What stands behind the page: the problem that it began with, a cache of results, and runs in processes."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.registry import METHODS
from avc_casadi.present.explore.background import Background
from avc_casadi.present.explore.fields import gain_fields, problem_fields
from avc_casadi.present.explore.settings import Form, RequestError, Settings, problem_of_settings, settings_of
from avc_casadi.present.row import Mark, Row, row
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.recommendation.answer import recommend

if TYPE_CHECKING:
    from avc_casadi._util.progress import Progress
    from avc_casadi.model.problem import Problem

T = TypeVar("T")
_KEPT, _AT_ONCE = 64, 2
# A page that was closed no longer asks: its runs end.
_IDLE_S = 15.0


class Explorer:
    """A problem to explore, and results by settings."""

    def __init__(self, base: Problem, source: str, versions: Mapping[str, str] | None = None) -> None:
        self.base, self.source, self.versions = base, source, versions or {}
        self._cache: OrderedDict[str, tuple[threading.Lock, list[Any]]] = OrderedDict()
        self._lock = threading.Lock()
        self._runs: dict[str, tuple[Background, list[float]]] = {}

    @cached_property
    def form(self) -> Form:
        """What the page asks of its problem."""
        live: tuple[str, ...] = ()
        slow: tuple[str, ...] = ("recommend",)
        if self.base.simulation is None and self.base.follower is None:
            live = tuple(name for name, one in METHODS.items() if one.pointwise)
            slow += tuple(name for name, one in METHODS.items() if not one.pointwise)
        return Form(problem_fields(self.base), gain_fields(self.base), live, slow)

    def settings(self, question: Mapping[str, Any]) -> Settings:
        """Return the settings of a question."""
        return settings_of(question.get("settings"), self.form)

    def problem(self, settings: Settings) -> Problem:
        """Return the problem of the settings."""
        live = settings.method in self.form.live
        key = f"problem {live} {settings.key('motion')}"
        return self.cached(key, lambda: problem_of_settings(self.base, settings, self.form))

    def cached(self, key: str, make: Callable[[], T]) -> T:
        """Return a result by its key; two threads that want it compute it once."""
        with self._lock:
            lock, found = self._cache.setdefault(key, (threading.Lock(), []))
            self._cache.move_to_end(key)
            while len(self._cache) > _KEPT:
                self._cache.popitem(last=False)
        with lock:
            if not found:
                found.append(make())
            result: T = found[0]
            return result

    def run(self, settings: Settings, *, begin: bool = False, cancel: bool = False) -> Background | None:
        """Return the run of the settings; begin it or cancel it. None where there is none."""
        key = settings.key("method")
        with self._lock:
            now = time.monotonic()
            for one, last in self._runs.values():
                if not one.over and now - last[0] > _IDLE_S:
                    one.cancel()
            found, last = self._runs.get(key, (None, [now]))
            last[0] = now
            if cancel and found is not None:
                found.cancel()
            if not begin or (found is not None and not found.error):
                return found
        problem = self.problem(settings)
        with self._lock:
            if sum(not one.over for one, _ in self._runs.values()) >= _AT_ONCE:
                raise RequestError(409, f"{_AT_ONCE} runs are under way; cancel one of them first")
            self._runs[key] = (Background(_found, (problem, settings.method)), [now])
            for old in [old for old, (one, _) in self._runs.items() if one.over][:-_KEPT]:
                del self._runs[old]
            return self._runs[key][0]

    def close(self) -> None:
        """End all runs."""
        for one, _ in self._runs.values():
            one.cancel()


def run_rows(run: Background | None, method: str) -> list[Row]:
    """Return the rows of a run: how far it is, or what it has found."""
    label = "Recommendation" if method == "recommend" else method.capitalize()
    if run is None:
        return [row(label, "not computed for these settings yet: Run begins it")]
    if not run.over:
        done, total, what = run.state
        step = f": {what}, {done} of {total or '?'}" if what else ""
        return [row(label, f"running for {run.seconds:.0f} s{step}")]
    if run.error:
        return [row(label, f"ended: {run.error}", mark=Mark.FAIL)]
    found: list[Row] = run.result[1]
    return found


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
