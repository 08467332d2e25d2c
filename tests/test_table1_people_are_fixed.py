"""The same seed gives the same people; training people are never test people."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.model.hands import STYLUS_RANGES
from avc_casadi.simulation.population.operators import draw_hands, draw_population


def numbers(subjects):
    return np.array([list(subjects.values(row).values()) for row in range(len(subjects))])


@pytest.mark.parametrize("population", ["A", "B"])
def test_a_few_are_the_first_of_many(population):
    few, many = (numbers(draw_population(population, count, 7)) for count in (5, 50))
    assert np.array_equal(few, many[:5])
    assert not np.any(np.isin(many, numbers(draw_population(population, 50, 8))))


@pytest.mark.parametrize("population", ["A", "B"])
def test_training_and_test_share_nobody(population):
    test, training = (numbers(draw_population(population, 200, 7, split)) for split in ("test", "training"))
    assert not np.any(np.isin(test, training))


def test_people_stay_in_their_ranges_and_fill_them():
    hands = avc.load_problem("figure5").hands
    for population, ranges in (
        ("A", {name: getattr(hands, name) for name in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")}),
        ("B", STYLUS_RANGES),
    ):
        drawn = numbers(draw_population(population, 2000, 1))
        for column, (low, high) in zip(drawn.T, ranges.values(), strict=True):
            assert low <= column.min() <= low + 0.02 * (high - low)
            assert high - 0.05 * (high - low) <= column.max() <= high


def test_people_of_a_problem_are_drawn_from_its_hands():
    problem = avc.load_problem("figure5")
    assert draw_hands(problem.hands, 20, 4, "training") == draw_population("A", 20, 4, "training")
    heavy = problem.changed(hands={"mass_kg": (0.5, 0.6)}).hands
    drawn = draw_hands(heavy, 50, 4)
    assert 0.5 <= drawn.mass_kg.min() <= drawn.mass_kg.max() <= 0.6
    assert np.array_equal(drawn.damping_ns_per_m, draw_population("A", 50, 4).damping_ns_per_m)
