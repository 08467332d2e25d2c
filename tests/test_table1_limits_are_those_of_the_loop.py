"""The stiffest wall is where the simulated loop turns from decay to growth, whatever computes it."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.loops.walls import damping_range, loop_radius, stiffest_wall
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.scene import Hold
from avc_casadi.simulation.population.operators import corner_subjects
from avc_casadi.simulation.population.trial import Conditions, judged

DEVICE = avc.load_problem("ve7").device
# Contact is never left: the wall acts as on both sides.
DEEP = Hold(end_m=0.02)


def walled(stiffness, damping):
    problem = avc.load_problem("ve7")
    return problem.changed(environment={"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping})


def test_radius_equals_that_of_the_certificate():
    people = corner_subjects("A")
    walls = np.array([2e4, 9e4, 1e5, 2e5])
    damping = np.array([0.0, 70.0, 90.0, 120.0])
    radius = loop_radius(DEVICE, people, walls, damping)
    for row, (k, d) in enumerate(zip(walls, damping, strict=True)):
        problem = walled(k, d)
        certified = linear_stability(DEVICE, frozen_parts(problem, 0.0, 1e14), 0.0, people).radius[0]
        assert radius[row] == pytest.approx(certified, abs=1e-8)


@pytest.mark.parametrize("population", ["A", "B"])
def test_edges_of_the_damping_stand_on_the_unit_circle(population):
    people = corner_subjects(population)
    found = damping_range(DEVICE, people, 6e4)
    assert 0 < found.lowest_ns_per_m < found.highest_ns_per_m
    edges = np.array([found.lowest_ns_per_m, found.highest_ns_per_m])
    assert loop_radius(DEVICE, people, np.full(2, 6e4), edges).max(axis=1) == pytest.approx(1, abs=1e-9)
    inside = np.linspace(found.lowest_ns_per_m, found.highest_ns_per_m, 9)[1:-1]
    assert np.all(loop_radius(DEVICE, people, np.full(7, 6e4), inside).max(axis=1) < 1)


@pytest.mark.parametrize(("population", "multiple"), [("A", 27.3), ("B", 17.8)])
def test_stiffest_wall_holds_and_a_stiffer_one_does_not(population, multiple):
    people = corner_subjects(population)
    found = stiffest_wall(DEVICE, people)
    assert found.stiffness_n_per_m == pytest.approx(multiple * 2 * DEVICE.damping_ns_per_m / 1e-3, rel=5e-3)
    middle = (found.lowest_ns_per_m + found.highest_ns_per_m) / 2
    stable = judged(walled(0.98 * found.stiffness_n_per_m, middle), NO_COUPLING, people, DEEP, Conditions()).stable
    assert stable.all()
    for damping in np.linspace(0.8, 1.2, 5) * middle:
        beyond = judged(walled(1.03 * found.stiffness_n_per_m, damping), NO_COUPLING, people, DEEP, Conditions()).stable
        assert not beyond.all()
