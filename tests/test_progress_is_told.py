"""Long work tells how far it has come, to its end and not too often, and its results do not depend on who listens."""

import io
import time
from contextlib import contextmanager

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli._console import Console
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


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_is_written_to_five_times_a_second(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    console = Console(as_json=False)
    with console.step("work"):
        for done in range(1000):
            now[0] = done * 2e-3
            console.advance(done, 1000, "rows")
    lines = terminal.getvalue().split("\r")
    assert 8 <= sum(" of 1000 rows" in line for line in lines) <= 10
    assert lines[-1].endswith("work ... 2.00 s\n")


def test_rate_and_what_is_left_are_told_of_the_present_piece(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    console = Console(as_json=False)
    with console.step("work"):
        for total, seconds in ((100, 0.1), (10, 4.0)):
            for done in range(1, total + 1):
                now[0] += seconds
                console.advance(done, total, "rows")
    lines = terminal.getvalue().split("\r")
    # Ten rows a second, of which the first was done when it began to count; then one in four seconds.
    assert any(line.endswith("51 of 100 rows; 10 a second, 5 s left") for line in lines)
    assert any(line.endswith("6 of 10 rows; 16 s left") for line in lines)
    # The new piece begins anew, and guesses nothing at once.
    assert any(line.endswith(" 1 of 10 rows") for line in lines)


def test_nothing_is_written_where_nobody_looks(monkeypatch):
    elsewhere = io.StringIO()
    monkeypatch.setattr("sys.stderr", elsewhere)
    console = Console(as_json=False)
    with console.step("work"):
        console.advance(1, 2, "rows")
    assert elsewhere.getvalue() == ""
