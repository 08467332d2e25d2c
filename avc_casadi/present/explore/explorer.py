"""What stands behind the page: the problem it began with, answers kept for a while, and work in the background."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from avc_casadi._util.progress import Progress
from avc_casadi._util.units import Units
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.present.explore.background import Background
from avc_casadi.present.explore.forms import WALL, Form, form_of
from avc_casadi.present.explore.requests import RequestError
from avc_casadi.present.explore.settings import Settings, constant_gains, problem_of_settings
from avc_casadi.present.row import Mark
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.recommendation.answer import recommend

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem

T = TypeVar("T")

_KEPT = 24
_AT_ONCE = 2
# A page that was closed no longer asks: its work ends.
_UNASKED_S = 15.0
_IN_TABLE = {"Coupling", "Rigid object", "Free motion", "Stability"}


@dataclass
class Kept:
    """The last few results by key; what is asked for twice at a time is made once."""

    most: int = _KEPT
    _held: OrderedDict[str, Any] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __call__(self, key: str, make: Callable[[], T]) -> T:
        """Return what is kept, or make it."""
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                found: T = self._held[key]
                return found
            made = make()
            self._held[key] = made
            while len(self._held) > self.most:
                self._held.popitem(last=False)
            return made


@dataclass
class _Task:
    of: Background
    asked_s: float


@dataclass
class Explorer:
    """Everything that a server of the page needs; it keeps no state but caches."""

    base: Problem
    source: str
    versions: Mapping[str, str] = field(default_factory=dict)
    problems: Kept = field(default_factory=Kept)
    schedules: Kept = field(default_factory=Kept)
    heavy: Kept = field(default_factory=Kept)
    regions: Kept = field(default_factory=Kept)
    laws: Kept = field(default_factory=Kept)
    _tasks: dict[str, _Task] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def units(self) -> Units:
        """Names and units of the page."""
        return self.base.units

    @property
    def form(self) -> Form:
        """What the page asks."""
        return form_of(self.base)

    def problem(self, settings: Settings) -> Problem:
        """Return the problem that the settings mean."""
        return self.problems(
            f"{settings.method in WALL.live} {settings.method == 'constant' and settings.gains} {settings.stated}",
            lambda: problem_of_settings(self.base, settings),
        )

    def schedule(self, settings: Settings) -> GainSchedule | None:
        """Return the gains of the settings; None where they come from work that is not done."""
        if settings.method not in WALL.live:
            coupling = self.coupling(settings)
            return None if coupling is None else self.schedules(settings.key, lambda: _at_all_frequencies(coupling))
        return self.schedules(settings.key, lambda: _live(self.problem(settings), settings))

    def coupling(self, settings: Settings) -> Coupling | None:
        """Return the coupling of the settings; None where no row has gains, or its work is not done."""
        if settings.method in WALL.live:
            gains, problem = self.schedule(settings), self.problem(settings)
            if gains is None or not gains.usable.any():
                return None
            return self.heavy(f"coupling {settings.key}", lambda: Coupling.of(problem, gains, versions=self.versions))
        found: Coupling | None = self.found(settings)
        return None if found is None else replace(found, problem=self.problem(settings), versions=self.versions)

    def done(self, settings: Settings) -> bool:
        """Whether the work of the settings is done."""
        task = self._tasks.get(settings.run)
        return task is not None and task.of.result is not None

    def found(self, settings: Settings) -> Any:
        """Return the coupling that work has found; None where it found none, or is not done."""
        task = self._tasks.get(settings.run)
        return None if task is None or task.of.result is None else task.of.result[0]

    def work(self, settings: Settings, *, begin: bool) -> dict[str, Any]:
        """Say how far the work of the settings is; begin it where it is asked to."""
        if settings.method in self.form.live:
            raise RequestError(400, f"{settings.method} follows at once and is no work")
        problem, key = self.problem(settings), settings.run
        with self._lock:
            self._end_unasked()
            task = self._tasks.get(key)
            if begin and (task is None or task.of.error):
                running = sum(not one.of.over for one in self._tasks.values())
                if running >= _AT_ONCE:
                    return {"state": "refused", "error": f"{running} runs are under way; cancel one of them first"}
                task = _Task(Background(_worked, (problem, settings.method)), time.monotonic())
                self._tasks[key] = task
                self._forget()
            if task is None:
                return {"state": "not-begun"}
            task.asked_s = time.monotonic()
            return _state(task.of)

    def cancel(self, settings: Settings) -> dict[str, Any]:
        """End the work of the settings."""
        with self._lock:
            task = self._tasks.get(settings.run)
            if task is not None:
                task.of.cancel()
        return {"state": "not-begun"} if task is None else {"state": "error", "error": "cancelled"}

    def close(self) -> None:
        """End all work."""
        with self._lock:
            for task in self._tasks.values():
                task.of.cancel()

    def _end_unasked(self) -> None:
        for task in self._tasks.values():
            if not task.of.over and time.monotonic() - task.asked_s > _UNASKED_S:
                task.of.cancel()

    def _forget(self) -> None:
        over = [key for key, task in self._tasks.items() if task.of.over]
        for key in over[: max(0, len(self._tasks) - _KEPT)]:
            del self._tasks[key]


def _state(work: Background) -> dict[str, Any]:
    done, total, what = work.said
    told = {"done": done, "total": total, "what": what, "seconds": round(work.seconds, 1)}
    if not work.over:
        return {"state": "running"} | told
    if work.error:
        return {"state": "error", "error": work.error} | told
    return {"state": "done", "lines": work.result[1]} | told


def _live(problem: Problem, settings: Settings) -> GainSchedule:
    if settings.method != "constant":
        return solve(problem, settings.method)
    rows = len(problem.frequencies_hz())
    every = tuple(np.full(rows, value) for value in constant_gains(settings, WALL).values())
    return gain_schedule(problem, "constant", (every[0], every[1], every[2]), (Status.SOLVED,) * rows)


def _at_all_frequencies(coupling: Coupling) -> GainSchedule:
    """Return the gains that run at the problem's frequencies, where the method told them at others only."""
    schedule, frequency = coupling.schedule, coupling.problem.frequencies_hz()
    if np.array_equal(schedule.frequency_hz, frequency):
        return schedule
    b, k, contact = coupling.table(frequency)
    return gain_schedule(
        coupling.problem,
        coupling.method,
        (b, k, contact),
        (Status.SOLVED,) * len(frequency),
        state_feedback=coupling.runtime.state_feedback,
    )


def _worked(task: tuple[Problem, str], progress: Progress) -> tuple[Coupling | None, list[str]]:
    """Return the coupling of a slow method, and its rows as texts."""
    problem, method = task
    if method == "recommend":
        found = recommend(problem, progress=progress)
        rows = recommendation(found).rows
        # What is known of any pair stands in the table of the page.
        shown = [one for one in rows if one.rank == 0 and (found.pair is None or one.label not in _IN_TABLE)]
        marks = {mark: "" if mark is Mark.NONE else f"{mark.value} " for mark in Mark}
        return found.coupling, [f"{marks[one.mark]}{one.label}: {one.text(problem.units)}" for one in shown]
    gains = solve(problem, method, progress=progress)
    if not gains.usable.any():
        return None, list(dict.fromkeys(gains.reason))
    return Coupling.of(problem, gains), list(gains.notes)
