"""Hands that move with a candidate try the next laws first; who confirms one has tried none before."""

from dataclasses import replace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling, Gains
from avc_casadi.recommendation import _asked_first, _choice
from avc_casadi.recommendation._jury import Jury
from avc_casadi.support import SILENT
from avc_casadi.trial import people_of, try_coupling

PROBLEM = avc.load_problem("spring")
HANDS = 40


def jury():
    people = people_of(PROBLEM.hands, HANDS)
    return Jury(PROBLEM, people, 0, SILENT, lean_on_friction=False, executor=None), people


def coupling(stiffness):
    return Coupling.constant(PROBLEM, Gains(0.0, stiffness, 0.5), "x")


def moving(trial, *rows):
    return replace(trial, stable=np.array([trial.stable[i] and i not in rows for i in range(trial.hands)]))


def masses_asked(one, monkeypatch):
    """Return the masses of those who try a law first, and of those who follow."""
    groups = []

    def noted(_, people, *, friction, strike):
        assert strike
        assert not friction
        groups.append(people.mass_kg)

    monkeypatch.setattr(_asked_first, "ends_of", noted)
    one.asked_first().ends(coupling(300.0))
    first, others = groups
    return first, others


def test_one_of_many_who_moves_is_among_the_first(monkeypatch):
    hall, people = jury()
    before, loose = masses_asked(hall, monkeypatch)

    def with_one_who_moves(one, some, *_, **__):
        return moving(try_coupling(one, some), *([30] if len(some) == HANDS else []))

    monkeypatch.setattr(_choice, "try_coupling", with_one_who_moves)
    hall.ask([[coupling(200.0)]], "springs")
    first, others = masses_asked(hall, monkeypatch)
    np.testing.assert_array_equal(np.sort(first), np.sort([*before, people.mass_kg[30]]))
    np.testing.assert_array_equal(others, loose)


@pytest.mark.parametrize(("rows", "learned"), [((3,), True), ((1, 70), True), (tuple(range(20)), False)])
def test_others_who_refute_it_are_among_the_first_and_the_next_are_others_again(rows, learned, monkeypatch):
    hall, _ = jury()
    before, _ = masses_asked(hall, monkeypatch)
    met, real = [], _choice.try_on_devices

    def refuted(one, people, *rest):
        met.append(people)
        found = real(one, people, *rest)
        return moving(found, *rows) if len(met) == 1 else found

    monkeypatch.setattr(_choice, "try_on_devices", refuted)
    hall.ask([[coupling(300.0)], [coupling(150.0)]], "springs")
    assert hall.holds(100.0)
    first, _ = masses_asked(hall, monkeypatch)
    np.testing.assert_array_equal(np.sort(first), np.sort([*before, *(met[0].mass_kg[list(rows)] if learned else [])]))
    assert [len(one) for one in met] == [2 * HANDS, 2 * HANDS]
    assert not np.isin(met[0].mass_kg, met[1].mass_kg).any()
    assert hall.judged[0].asked is met[0]


def test_all_try_a_law_with_which_the_first_rest_and_nobody_else_one_with_which_they_move(monkeypatch):
    hall, _ = jury()
    asked = []

    class Known:
        def __init__(self, people):
            self.people = people

        def __call__(self, laws):
            asked.append((self.people, len(laws)))
            return np.array([[law + 0.001 * hand for hand in range(self.people)] for law in laws])

    monkeypatch.setattr(_asked_first, "ends_of", lambda _, people, **__: Known(len(people)))
    found = hall.asked_first().ends(coupling(300.0))([0.1, 2.0, 0.2])
    first, others = 16 + HANDS // 4, HANDS - HANDS // 4
    assert asked == [(first, 3), (others, 2)]
    assert found.shape == (3, first + others)
    np.testing.assert_allclose(found[0], [*(0.1 + 0.001 * np.arange(first)), *(0.1 + 0.001 * np.arange(others))])
    np.testing.assert_allclose(found[1], 2.0 + 0.001 * (np.arange(first + others) % first))
    assert (found[2] < 1).all()
