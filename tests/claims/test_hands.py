"""The worst hand may stand inside the box of hands: searches, certificates and designs against brute force."""

import itertools

import numpy as np
import pytest
from boxes_of_hands import INSIDE, brute_force, random_gains, random_problem

import avc_casadi as avc
from avc_casadi.claims.hands import scope_slack, worst_on_device
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import frozen_law, linear_stability
from avc_casadi.model.hands import hand_ranges, hand_set

BROKEN = 562.19, 0.0


def test_a_set_of_hands_has_every_corner_of_the_box_and_draws_within():
    ranges = hand_ranges(INSIDE.hands)
    found = np.array(list(vars(hand_set(INSIDE.hands, draws=40)).values())).T
    assert set(itertools.product(*ranges.tolist())) <= set(map(tuple, found.tolist()))
    assert (found >= ranges[:, 0]).all()
    assert (found <= ranges[:, 1]).all()
    assert len(found) >= 40


def test_a_hand_inside_the_box_breaks_what_corners_and_draws_pass():
    known = linear_stability(INSIDE.device, frozen_law(INSIDE, *BROKEN), hand_set(INSIDE.hands))
    assert known.radius.max() < 1
    family = PlantFamily.of(INSIDE)
    (worst,) = worst_on_device(family, INSIDE.device, frozen_law(INSIDE, *BROKEN), family.drawn().held)
    assert worst.radius == pytest.approx(1.00102, abs=2e-5)
    assert worst.radius >= brute_force(INSIDE, *(np.array([gain]) for gain in BROKEN), 0.0, 25)[0]
    assert worst.hand["mass_kg"] == pytest.approx(0.111, abs=2e-3)
    assert scope_slack(INSIDE, 3.3, *BROKEN).slack[0] < 0


@pytest.mark.slow
def test_a_schedule_with_scope_hands_holds_the_whole_box():
    table = avc.solve(INSIDE, "schedule")
    gains = table.damping_ns_per_m, table.stiffness_n_per_m, table.contact_damping_ns_per_m
    assert table.usable.all()
    assert np.all(brute_force(INSIDE, *gains, points=21) < 1)


@pytest.mark.slow
def test_the_search_finds_what_a_lattice_finds():
    generator = np.random.default_rng(5)
    for _ in range(12):
        problem, gains = random_problem(generator), random_gains(generator, 15)
        family = PlantFamily.of(problem)
        worst = worst_on_device(family, problem.device, frozen_law(problem, *gains), family.drawn().held)
        assert np.all(np.array([case.radius for case in worst]) >= brute_force(problem, *gains) - 1e-6)
