"""Where somebody moves with the best law and nobody with another, the nearest between is taken with which all rest."""

from dataclasses import replace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.stability.declared_device import plants_with_forces
from avc_casadi.claims.stability.frozen_loop import frozen_rendering
from avc_casadi.claims.stability.state_feedback import largest_radius, state_feedback_loop
from avc_casadi.design.robust.between import between
from avc_casadi.design.robust.ladder import robust_at
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.recommendation import candidates as _candidates

WALL_N_PER_M = 5000.0
PROBLEM = avc.load_problem("reference-r1").changed(
    environment={"stiffness_n_per_m": WALL_N_PER_M, "damping_ns_per_m": 0.0}
)
SPACE, LOOPS = Space(PROBLEM.device, PROBLEM.hands), Loops.of(PROBLEM.device, PROBLEM.hands)


@pytest.fixture(scope="module")
def rung():
    """Return a wall with two laws."""
    found = next(robust_at(PROBLEM, WALL_N_PER_M))
    return replace(found, found=found.found.beside(found.found.others[:1]))


def known(speeds):
    """Answer how fast one hand ends with laws, in the order in which they are asked about."""
    return lambda *_: lambda laws: np.array([[speeds[place]] for place in range(len(laws))])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("speeds", "tenths"),
    [
        ([0.1] * 9, 1),
        ([2.0, 2.0, 2.0, 0.4, 3.0, 0.4, 0.4, 0.4, 0.4], 4),
        ([2.0, 0.51, 0.49, 0.9, 2.0, 0.1, 0.1, 0.1, 0.1], 3),
        ([2.0] * 8 + [0.1], 9),
        ([2.0] * 8 + [0.9], None),
        ([np.nan] * 9, None),
    ],
)
def test_the_nearest_with_which_all_clearly_rest_is_found(rung, speeds, tenths):
    first, last = rung.found, rung.found.others[0]
    found = between(PROBLEM, WALL_N_PER_M, first, last, known(speeds))
    if tenths is None:
        assert found is None
        return
    expected = 0.1 * ((10 - tenths) * first.logarithms + tenths * last.logarithms)
    np.testing.assert_allclose(found.logarithms, expected, rtol=1e-12)
    assert found.cost.holds
    plants = plants_with_forces(sampled_plant(PROBLEM.device, hand_corners(PROBLEM.hands)))
    rendering = frozen_rendering(PROBLEM, 0.0, rung.gains.stiffness_n_per_m)
    assert largest_radius(state_feedback_loop(plants, found.law, rendering)).max() < 1


class Asked:
    """Who rest with some of the laws of a wall off the file, and with all that lie on a line or are climbed to."""

    def __init__(self, speeds, everybody=0.1):
        self.speeds, self.everybody = speeds, everybody

    def only_off(self):
        return Asked(self.speeds)

    def and_off(self):
        return Asked([self.everybody] * 20)

    def ends(self, _):
        return known(self.speeds)()


def test_the_best_law_stays_the_first_where_all_rest_with_it_off_the_file_too(rung):
    assert _candidates._surely(PROBLEM, rung, Asked([0.5, 2.0])) is rung


def test_laws_with_which_all_rest_off_the_file_come_before_those_with_which_some_move(rung):
    best, other = rung.found, rung.found.others[0]
    found = _candidates._surely(PROBLEM, rung, Asked([2.0, 0.5])).found
    assert found.cost.holds
    np.testing.assert_allclose(
        found.logarithms - best.logarithms, 0.1 * (found.others[0].logarithms - best.logarithms), rtol=1e-9, atol=1e-12
    )
    places = [id(one) for one in found.others]
    assert id(best) in places
    assert id(other) in places
    assert len(set(places)) == len(places)
    assert places.index(id(other)) < places.index(id(best))
    sure = [_candidates._softness(one) for one in found.others[: places.index(id(best))]]
    assert sure == sorted(sure)


class Only:
    """Who rest with one law and with no other."""

    off = ()

    def __init__(self, law=None):
        self.law = law

    def ends(self, _):
        return lambda laws: np.array([[0.1 if self.law is not None and same(one, self.law) else 2.0] for one in laws])


def same(one, other):
    return all(np.array_equal(value, vars(other)[name]) for name, value in vars(one).items())


@pytest.mark.thorough
def test_of_the_laws_that_a_search_finds_those_are_taken_with_which_all_rest():
    """Nobody rests with what is climbed to; that all loops of a law are damped is not enough."""
    assert _candidates._at_once(PROBLEM, WALL_N_PER_M, Only()) == []
    other = next(robust_at(PROBLEM, WALL_N_PER_M)).found.others[1]
    (taken,) = _candidates._at_once(PROBLEM, WALL_N_PER_M, Only(other.law))
    assert same(taken.found.law, other.law)
    assert taken.found.others == ()
