"""Hands that move with a candidate try the next laws first; who confirms one has tried none before."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.corners import RIGID_KEYS, device_corners
from avc_casadi.model.gains import Gains
from avc_casadi.recommendation import evaluate as _evaluate
from avc_casadi.recommendation import screening as _asked_first
from avc_casadi.recommendation.evaluate import Evaluator
from avc_casadi.recommendation.screening import Group, Screening, elsewhere, off_file
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import loose_grips, people_of

PROBLEM = avc.load_problem("spring")
HANDS = 40


def jury():
    people = people_of(PROBLEM.hands, HANDS)
    return Evaluator(PROBLEM, people, 0, lean_on_friction=False, executor=None), people


def coupling(stiffness):
    return Coupling.constant(PROBLEM, Gains(0.0, stiffness, 0.5), "x")


def moving(trial, *rows):
    return replace(trial, stable=np.array([trial.stable[i] and i not in rows for i in range(trial.hands)]))


def masses_asked(one, monkeypatch):
    """Return the masses of those who try a law first, and of those who follow."""
    groups = []

    def noted(_, people, *, friction, beyond, device, effects, racing):
        assert beyond
        assert effects == ()
        assert racing
        assert device is None
        assert not friction
        groups.append(people.mass_kg)

    monkeypatch.setattr(_asked_first, "prepared_residual_speeds", noted)
    one.screening().ends(coupling(300.0))
    first, others = groups
    return first, others


def test_one_of_many_who_moves_is_among_the_first(monkeypatch):
    hall, people = jury()
    before, loose = masses_asked(hall, monkeypatch)

    def with_one_who_moves(one, some, *_, **__):
        return moving(try_coupling(one, some), *([30] if len(some) == HANDS else []))

    monkeypatch.setattr(_evaluate, "try_coupling", with_one_who_moves)
    hall.ask([[coupling(200.0)]], "springs")
    first, others = masses_asked(hall, monkeypatch)
    np.testing.assert_array_equal(np.sort(first), np.sort([*before, people.mass_kg[30]]))
    np.testing.assert_array_equal(others, loose)


@pytest.mark.parametrize(("rows", "learned"), [((3,), True), ((1, 70), True), (tuple(range(20)), False)])
def test_others_who_refute_it_are_among_the_first_and_the_next_are_others_again(rows, learned, monkeypatch):
    hall, _ = jury()
    before, _ = masses_asked(hall, monkeypatch)
    met, real = [], _evaluate.try_on_devices

    def refuted(one, people, *rest):
        met.append(people)
        found = real(one, people, *rest)
        return moving(found, *rows) if len(met) == 1 else found

    monkeypatch.setattr(_evaluate, "try_on_devices", refuted)
    hall.ask([[coupling(300.0)], [coupling(150.0)]], "springs")
    assert hall.holds(100.0)
    first, _ = masses_asked(hall, monkeypatch)
    np.testing.assert_array_equal(np.sort(first), np.sort([*before, *(met[0].mass_kg[list(rows)] if learned else [])]))
    assert [len(one) for one in met] == [2 * HANDS, 2 * HANDS]
    assert not np.isin(met[0].mass_kg, met[1].mass_kg).any()
    assert hall.judged[0].asked is met[0]


STYLUS = PROBLEM.changed(device={"held": "stylus"})


@pytest.mark.parametrize(("rows", "learned"), [((40,), True), ((3, 20, 50), True), (tuple(range(20)), False)])
def test_stylus_hands_who_refute_it_screen_from_then_on_once_each(rows, learned, monkeypatch):
    """However many couplings they refute; a refined law is screened by all of them."""
    hall = Evaluator(STYLUS, people_of(STYLUS.hands, HANDS), 0, lean_on_friction=False, executor=None)
    first, every = groups_asked(hall)[-1].people, hall.screening(whole=True).stages[-1][-1].people
    assert (len(first), len(every)) == (16, 60)
    real = Group.residual_speeds

    def refuted(group, couplings, **how):
        found = real(group, couplings, **how)
        if len(group.people) == len(every):
            found[:, list(rows)] = np.inf
        return found

    monkeypatch.setattr(Group, "residual_speeds", refuted)
    hall.ask([[coupling(300.0)], [coupling(150.0)]], "springs")
    assert not hall.holds(100.0)
    rows_now = sorted({*range(16), *(rows if learned else ())})
    np.testing.assert_array_equal(groups_asked(hall)[-1].people.mass_kg, every.mass_kg[rows_now])


RANGED = PROBLEM.changed(
    device={"range": {"mass_kg": (0.05, 0.2), "damping_ns_per_m": (0.0, 2.0), "delay_samples": (0, 3)}}
)


def groups_asked(one):
    """Return who tries a law on other devices."""
    few, elsewhere, others = one.screening().stages
    assert all(group.device is None for group in (*few, *others))
    return elsewhere


def test_where_the_device_has_ranges_some_try_a_law_on_light_devices_and_on_some_within():
    people = people_of(RANGED.hands, HANDS)
    corners = device_corners(RANGED.device)
    light = {
        (one.damping_ns_per_m, one.delay_samples) for one in corners if one.mass_kg == min(RANGED.device.range.mass_kg)
    }
    groups = groups_asked(Evaluator(RANGED, people, 0, lean_on_friction=False, executor=None))
    met = [group.device for group in groups]
    assert {(one.damping_ns_per_m, one.delay_samples) for one in met if one in corners} == light
    within = [one for one in met if one not in corners]
    assert len(within) == 2
    for key, (low, high) in (("mass_kg", (0.05, 0.2)), ("damping_ns_per_m", (0.0, 2.0)), ("delay_samples", (0, 3))):
        assert all(low < getattr(one, key) < high for one in within)
    assert len({tuple(group.people.mass_kg) for group in groups}) == len(groups)
    corner_hands = set(people.mass_kg[:16])
    assert all(0 < sum(mass in corner_hands for mass in group.people.mass_kg) < len(group.people) for group in groups)


def test_of_many_light_corners_those_that_differ_most_are_tried():
    """Of 32 corners 16 are light; any two of four of them that differ most differ in no less than two keys of four."""
    problem = avc.load_problem("reference-r1")
    ends = {key: (0.5 * getattr(problem.device, key), 2 * getattr(problem.device, key)) for key in RIGID_KEYS}
    ranges = ends | {"max_force_n": (5.0, 9.0), "coulomb_friction_n": (0.0, 0.3)}
    known = problem.changed(device={"range": ranges}).device
    people = people_of(PROBLEM.hands, HANDS)
    for seed in range(5):
        met = [group.device for group in elsewhere(known, (people, people), seed)][:4]
        told = [[getattr(one, key) for key in ranges] for one in met]
        assert len({numbers[0] for numbers in told}) == 1
        apart = [sum(a != b for a, b in zip(one, other, strict=True)) for one, other in combinations(told, 2)]
        assert min(apart) >= 2


@pytest.mark.thorough
def test_who_moves_on_another_device_tries_the_next_laws_on_that_one(monkeypatch):
    people = people_of(RANGED.hands, HANDS)
    hall = Evaluator(RANGED, people, 0, lean_on_friction=False, executor=None)
    before, met, real = groups_asked(hall), [], _evaluate.try_on_devices

    def refuted(one, some, devices, *rest):
        met.append((some, devices))
        found = real(one, some, devices, *rest)
        return moving(found, 5, 7 + len(devices)) if len(met) == 1 else found

    monkeypatch.setattr(_evaluate, "try_on_devices", refuted)
    ask = [[Coupling.constant(RANGED, Gains(0.0, stiffness, 0.5), "x")] for stiffness in (60.0, 30.0)]
    hall.ask(ask, "springs")
    assert hall.holds(25.0)
    (some, devices), after = met[0], groups_asked(hall)
    assert after[: len(before)] == before
    added = {(group.people.mass_kg[0], group.device) for group in after[len(before) :]}
    assert [len(group.people) for group in after[len(before) :]] == [1, 1]
    assert {mass for mass, _ in added} == {some.mass_kg[5], some.mass_kg[7 + len(devices)]}
    assert {id(device) for _, device in added} == {id(devices[5]), id(devices[7])}


def test_with_whom_fewest_move_on_other_devices_is_tried_first():
    class Known:
        def __init__(self, speeds):
            self.speeds = speeds

        def residual_speeds(self, some, *, friction):
            assert not friction
            return np.array([[self.speeds[one.table.at_rest.stiffness_n_per_m], 0.1] for one in some])

    some = [coupling(stiffness) for stiffness in (1.0, 2.0, 3.0)]
    first, slow = Known({1.0: 0.1, 2.0: 0.1, 3.0: 2.0}), Known({1.0: 3.0, 2.0: 0.2, 3.0: 0.1})
    assert _evaluate.likeliest(some, (first,), (slow,), lean_on_friction=False) == ([some[1]], True)
    all_move = Known({1.0: 3.0, 2.0: 3.0, 3.0: 3.0})
    assert _evaluate.likeliest(some, (first,), (slow, all_move), lean_on_friction=False) == ([some[1], some[0]], False)
    assert _evaluate.likeliest(some, (first,), lean_on_friction=False) == (some[:2], True)


def test_all_try_a_law_with_which_the_first_rest_and_nobody_else_one_with_which_they_move(monkeypatch):
    hall, _ = jury()
    asked = []

    class Known:
        def __init__(self, people):
            self.people = people

        def __call__(self, laws):
            asked.append((self.people, len(laws)))
            return np.array([[law + 0.001 * hand for hand in range(self.people)] for law in laws])

    monkeypatch.setattr(_asked_first, "prepared_residual_speeds", lambda _, people, **__: Known(len(people)))
    found = hall.screening().ends(coupling(300.0))([0.1, 2.0, 0.2, 0.99])
    first, others = 16 + 100 // 4, 100 - 100 // 4
    # With the last one some of the first rest, and some do not.
    assert asked == [(first, 4), (others, 2)]
    assert found.shape == (4, first + others)
    np.testing.assert_allclose(found[0], [*(0.1 + 0.001 * np.arange(first)), *(0.1 + 0.001 * np.arange(others))])
    np.testing.assert_allclose(found[1], 2.0 + 0.001 * (np.arange(first + others) % first))
    assert (found[2] < 1).all()


@pytest.mark.parametrize("hands", [1, 2])
def test_few_who_are_asked_are_all_among_the_first(hands):
    one = Evaluator(PROBLEM, people_of(PROBLEM.hands, hands), 0, lean_on_friction=False, executor=None)
    stages = one.screening().stages
    assert all(len(group.people) for stage in stages for group in stage)
    ends = one.screening().ends(coupling(300.0))
    assert ends([None]).shape == (1, sum(len(group.people) for stage in stages for group in stage))


FIRST = avc.load_problem("reference-r1")


def off(changes):
    device = FIRST.changed(device=changes).device
    return off_file(device, people_of(FIRST.hands, HANDS), people_of(FIRST.hands, HANDS, 1)), device


@pytest.mark.parametrize(
    ("known", "masses", "modes", "late"),
    [
        ({}, {0.9}, {0.9, 1.1}, {0.0, 0.25}),
        ({"mass_kg": (0.05, 0.2)}, {1.0}, {0.9, 1.1}, {0.0, 0.25}),
        ({"delay_samples": (0.5, 2)}, {0.9}, {0.9, 1.1}, {0.0}),
        ({"resonance": {"frequency_hz": (100.0, 200.0)}}, {0.9}, {1.0}, {0.0, 0.25}),
    ],
)
def test_some_may_try_a_law_on_light_devices_that_are_a_little_off_what_the_file_does_not_bound(
    known, masses, modes, late
):
    groups, device = off({"range": known})
    assert len(groups) == len(masses) * len(modes) * len(late)
    met = [group.device for group in groups]
    assert {round(one.mass_kg / device.mass_kg, 9) for one in met} == masses
    assert {round(one.resonance.frequency_hz / device.resonance.frequency_hz, 9) for one in met} == modes
    assert {round(one.delay_samples - device.delay_samples, 9) for one in met} == late


@pytest.mark.parametrize("mass", [1e-9, 1e-3])
def test_a_device_at_the_end_of_what_it_may_be_is_off_to_the_other_side_only(mass):
    lightest = min(group.device.mass_kg for group in off({"mass_kg": mass})[0])
    assert lightest == pytest.approx(1.1e-9 if mass == 1e-9 else 0.9e-3)


def test_nobody_tries_a_law_on_other_devices_where_the_file_bounds_all_that_may_be_off():
    known = {"mass_kg": (0.05, 0.2), "delay_samples": (0.5, 2), "resonance": {"frequency_hz": (100.0, 200.0)}}
    assert off({"range": known})[0] == ()


def test_hands_on_devices_off_the_file_are_asked_where_that_is_wanted():
    group = Group(people_of(PROBLEM.hands, HANDS))
    ends = Screening(((group,),), friction=False).ends(coupling(300.0))([None])
    both = Screening(((group,),), friction=False, off=(group,))
    np.testing.assert_array_equal(both.ends(coupling(300.0))([None]), ends)
    np.testing.assert_array_equal(both.and_off().ends(coupling(300.0))([None]), np.concatenate([ends, ends], axis=1))
    np.testing.assert_array_equal(both.only_off().ends(coupling(300.0))([None]), ends)


ROUGH = PROBLEM.changed(device={"coulomb_friction_n": 0.3, "max_force_n": 10.0})


@pytest.mark.parametrize("lean", [False, True])
@pytest.mark.parametrize(("problem", "rough"), [(PROBLEM, False), (ROUGH, True)])
def test_some_try_a_law_with_dry_friction_too_where_others_try_it_without(problem, rough, lean):
    """Some laws vibrate only with it."""
    people = people_of(problem.hands, HANDS)
    screening = Evaluator(problem, people, 0, lean_on_friction=lean, executor=None).screening()
    asked = [group.friction for stage in screening.stages for group in stage]
    assert sum(asked) == (rough and not lean)
    assert screening.friction == lean


def test_a_group_with_dry_friction_is_simulated_with_it():
    loose, rough = Group(people_of(ROUGH.hands, HANDS)), Group(people_of(ROUGH.hands, HANDS), friction=True)
    one = Coupling.constant(ROUGH, Gains(0.0, 300.0, 0.5), "x")
    with_it, without = (loose.residual_speeds([one], friction=friction) for friction in (True, False))
    assert np.abs(with_it - without).max() > 0.01
    np.testing.assert_array_equal(rough.residual_speeds([one], friction=False), with_it)
    np.testing.assert_array_equal(rough.ends(one, friction=False)([None]), loose.ends(one, friction=True)([None]))


def test_all_hands_of_the_trial_try_a_refined_law():
    hall, people = jury()
    few, whole = (
        sum(len(group.people) for stage in hall.screening(whole=one).stages for group in stage) for one in (False, True)
    )
    own, loose = HANDS - _evaluate.FIRST, 2 * 100
    assert whole - few == own + loose
    last = hall.screening(whole=True).stages[-1][0].people.mass_kg
    np.testing.assert_array_equal(last[:own], people.mass_kg[_evaluate.FIRST :])
    grips = loose_grips(PROBLEM.hands, loose, 1).mass_kg
    np.testing.assert_array_equal(last[own:], grips)
    assert not np.isin(grips, loose_grips(PROBLEM.hands, 100, 0).mass_kg).any()
