"""Long work tells how far it has come, to its end and not too often, and its results do not depend on who listens."""

import io
import time
from contextlib import contextmanager

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli.console import Console
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.nlp_gains import nlp_gains


class Listener:
    def __init__(self):
        self.steps, self.told = [], []

    @contextmanager
    def step(self, what):
        self.steps.append(what)
        yield

    def advance(self, done, total, what=""):
        self.told.append((done, total, what))


def many(points):
    return avc.load_problem("figure5").changed(frequency={"points": points})


@pytest.mark.parametrize(("search", "points"), [(nlp_gains, 80), (exact_gains, 10_100)])
def test_frequencies_are_told_and_do_not_depend_on_their_neighbours(search, points):
    problem, listener = many(points), Listener()
    loop = loop_at(problem, problem.frequencies_hz())
    whole = search(problem, loop, progress=listener)
    assert listener.told[-1][:2] == (points, points)
    assert len(listener.told) == 2
    last = search(problem, loop.rows(np.arange(points - 30, points)))
    for gain, own in zip(whole, last, strict=True):
        np.testing.assert_array_equal(gain[-30:], own)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["direct", "exact", "schedule", "static-tuned"])
def test_methods_that_take_long_tell_of_it(method):
    listener = Listener()
    told = avc.solve(many(12), method, progress=listener)
    silent = avc.solve(many(12), method)
    assert listener.told
    assert all(0 <= done <= total for done, total, _ in listener.told)
    np.testing.assert_array_equal(told.stiffness_n_per_m, silent.stiffness_n_per_m)


def test_elsewhere_a_line_is_written_every_ten_seconds(monkeypatch):
    elsewhere = io.StringIO()
    monkeypatch.setattr("sys.stderr", elsewhere)
    monkeypatch.setattr("avc_casadi.cli.console._BETWEEN_LINES_S", 0.02)
    console = Console(as_json=False)
    with console.step("work"):
        console.advance(1, 2, "rows")
        while elsewhere.getvalue().count("\n") < 2:
            time.sleep(0.01)
    lines = elsewhere.getvalue().splitlines()
    assert all(line.startswith("work ...") for line in lines)
    assert "\x1b" not in elsewhere.getvalue()
