"""Long work tells how far it has come, to its end and not too often, and its results do not depend on who listens."""

import io
import time
from contextlib import contextmanager

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.cli._console import Console
from avc_casadi.coupling import Coupling
from avc_casadi.identification.excitation.design import plan_excitation
from avc_casadi.model.device import Device
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.nlp_gains import nlp_gains
from avc_casadi.recommendation.recommend import judged_as_recommended


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


def test_direct_tells_of_its_frequencies():
    listener = Listener()
    avc.solve(many(120), "direct", progress=listener)
    assert [done for done, _, _ in listener.told] == [50, 100, 120]


def test_a_certificate_tells_of_its_levels():
    problem, listener = many(20), Listener()
    avc.certify(problem, avc.solve(problem, "exact"), progress=listener)
    assert {"passivity", "Llewellyn", "spectral radius"} <= {what for _, _, what in listener.told}


@pytest.mark.thorough
def test_the_region_tells_of_its_curves():
    listener = Listener()
    region = zwidth(avc.load_problem("soft"), listener)
    assert [done for done, _, _ in listener.told] == list(range(len(region.curves)))


def test_the_verdict_on_deployment_tells_of_each_claim():
    problem, listener = many(20), Listener()
    avc.deployable(Coupling.of(problem, avc.solve(problem, "exact")), listener)
    assert [what for _, _, what in listener.told] == ["spectral radius"] * 2
    assert all(done == total for done, total, _ in listener.told)


@pytest.mark.thorough
def test_a_recommendation_tells_of_candidates_that_are_tried():
    listener = Listener()
    found = avc.recommend("soft", hands=2, progress=listener)
    tried = [told[:2] for told in listener.told if told[2] == "candidates tried, springs and dampers"]
    assert tried[0][0] == 1
    assert all(what != "candidates tried, " for _, _, what in listener.told)
    assert all(1 <= done <= total <= found.considered for done, total in tried)


@pytest.mark.thorough
def test_the_trial_of_a_method_tells_of_its_motions():
    listener, problem = Listener(), many(3)
    judged_as_recommended(problem, avc.solve(problem, "static"), hands=2, progress=listener)
    motions = [told for told in listener.told if told[2].startswith("motions")]
    assert [told[:2] for told in motions] == [(1, 3), (2, 3), (3, 3)]
    assert "Llewellyn" in {what for _, _, what in listener.told}


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


def test_a_plan_of_excitation_tells_of_its_search_and_its_simulations():
    listener = Listener()
    device = Device(mass_kg=0.1, damping_ns_per_m=0.5, coulomb_friction_n=0.1, max_force_n=8.0)
    plan_excitation(device, seconds=2.0, progress=listener)
    assert {what.split()[-1] for _, _, what in listener.told} == {"tones", "simulated"}
    assert all(0 <= done <= total for done, total, _ in listener.told)


def test_nothing_is_written_where_nobody_looks(monkeypatch):
    elsewhere = io.StringIO()
    monkeypatch.setattr("sys.stderr", elsewhere)
    console = Console(as_json=False)
    with console.step("work"):
        console.advance(1, 2, "rows")
    assert elsewhere.getvalue() == ""
