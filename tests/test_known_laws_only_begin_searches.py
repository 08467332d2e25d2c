"""Laws known from other devices: judged like any other law, and nothing hangs on their table."""

import csv
from pathlib import Path

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust import known_laws
from avc_casadi.design.robust.known_laws import KnownLaws
from avc_casadi.design.robust.lqg import Space
from avc_casadi.model.runtime import Runtime


@pytest.mark.parametrize("name", ["figure5", "reference-r1", "reference-r3"])
def test_known_points_lie_in_the_space_of_a_device(name):
    problem = avc.load_problem(name)
    space = Space(problem.device, problem.hands)
    low, high = space.bounds
    points = known_laws.known_points(space)
    assert len(points) > 10
    assert points.shape[1] == len(space.knobs)
    assert np.all((low <= points) & (points <= high))


@pytest.mark.parametrize(("name", "resonant"), [("figure5", False), ("reference-r1", True)])
def test_known_points_are_those_of_devices_of_the_same_structure_as_far_from_where_searches_begin(name, resonant):
    problem = avc.load_problem(name)
    space = Space(problem.device, problem.hands)
    with Path(known_laws.__file__).with_name("known_laws.csv").open(encoding="utf-8") as table:
        rows = [row for row in csv.DictReader(table) if bool(row["believed frequency of the resonance"]) == resonant]
    guesses, (low, high) = len(space.starts), space.bounds
    np.testing.assert_array_equal(known_laws.known_points(space)[:guesses], np.clip(space.starts, low, high))
    points = known_laws.known_points(space)[guesses:]
    assert len(points) == len(rows)
    inside = (low < points) & (points < high)
    away = np.array([[float(row[knob.name]) for knob in space.knobs] for row in rows])
    np.testing.assert_allclose((points - space.starts[0])[inside], away[inside], atol=1e-12)
    assert inside.mean() > 0.9


@pytest.mark.parametrize("name", ["figure5", "reference-r1"])
def test_a_known_law_that_is_taken_is_deployable_on_this_device(name):
    problem = avc.load_problem(name)
    step = KnownLaws(problem).before(problem.environment.stiffness_n_per_m)
    assert step is not None
    away = [one.cost.distance for one in step.candidates]
    assert away == sorted(away)
    for one in step.candidates:
        runtime = Runtime(state_feedback=one.law)
        assert deployable(Coupling.constant(problem, step.gains, "robust", runtime)).passed


def test_a_wall_that_no_law_holds_is_held_by_no_known_one():
    problem = avc.load_problem("reference-r1").changed(environment={"stiffness_n_per_m": 1e6})
    assert KnownLaws(problem).before(1e6) is None


def test_the_softer_wall_that_known_laws_hold_is_the_same_for_all_stiffer_wanted_ones():
    """The next rung is held by none; so a stiffer wanted wall brings none that is softer."""
    laws = KnownLaws(avc.load_problem("reference-r1").changed(environment={"stiffness_n_per_m": 1e6}))
    held = laws.softer(100.0, 1e6)
    assert held is not None
    rung = held.stiffness_n_per_m
    assert laws.before(1.4 * rung) is None
    for wanted in (1.01 * rung, 1.4 * rung, 1.5 * rung, 9e5):
        assert laws.softer(100.0, wanted).stiffness_n_per_m == pytest.approx(rung)
    below = laws.softer(100.0, 0.999 * rung)
    assert below.stiffness_n_per_m == pytest.approx(rung / 1.4)
    assert laws.softer(100.0, 100.0) is None


@pytest.mark.parametrize("wanted", [1.0001, 1e9])
def test_the_number_of_softer_walls_that_are_tried_is_bounded(monkeypatch, wanted):
    walls = []
    monkeypatch.setattr(KnownLaws, "before", lambda _, wall: walls.append(wall))
    assert KnownLaws(avc.load_problem("figure5")).softer(100.0, 100.0 * wanted) is None
    assert walls[-1] == 100
    assert len(walls) <= 20
    assert walls == sorted(walls, reverse=True)
    assert max(walls) < 100 * wanted


@pytest.mark.thorough
def test_without_its_table_a_recommendation_is_as_safe(monkeypatch):
    monkeypatch.setattr(known_laws, "_rows", tuple)
    found = avc.recommend("reference-r1")
    assert found.deployable
    assert found.trial.counts()["at_rest_without_friction"] == 100
    assert found.felt()["share_of_wall"] > 0.8
