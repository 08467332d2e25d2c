"""The stiffest wall is one that simulated hands rest at, and what would help is judged in the same way."""

import functools

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.recommendation import stiffest as _stiffest
from avc_casadi.recommendation.search_schedule import CONTINUATIONS
from avc_casadi.recommendation.stiffest import stiffest
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import draw_hands

# From the law of the device as it is on, and that as it is.
WAYS = ("_changed", "_kept")
DEVICE = {"encoder_resolution_m": 1e-5, "backlash_m": 1e-5, "max_force_n": 8.0}


def device(**changes):
    return avc.load_problem("reference-r2").changed(device={**DEVICE, **changes})


@functools.cache
def searched():
    """Of the changes that linear stability knows one is enough here, and of those that only a simulation knows two.

    Returns what is told, and what each way to search found for the device of each change.
    """
    each = []

    def recorded(way, *args):
        each.append((args[-2].device, way(*args)))
        return each[-1][1]

    def some(changes, *names):
        return lambda problem: {name: changes(problem)[name] for name in names}

    with pytest.MonkeyPatch.context() as patch:
        # Two continuations; whoever asks has four.
        patch.setattr(_stiffest, "_AS_IT_IS", (range(1), range(2, 3)))
        patch.setattr(_stiffest, "linear_changes", some(_stiffest.linear_changes, "no delay"))
        patch.setattr(_stiffest, "simulated_changes", some(_stiffest.simulated_changes, "no play", "twice the force"))
        for way in WAYS:
            patch.setattr(_stiffest, way, functools.partial(recorded, getattr(_stiffest, way)))
        return stiffest(device(), hands=16), each


def found():
    return searched()[0]


def safety(told):
    return told["at_rest_without_friction"] == told["hands"], told["at_rest"] == told["hands"]


@pytest.mark.thorough
def test_hands_that_had_no_part_in_it_rest_at_the_stiffest_wall():
    wall = found()["stiffest_wall_n_per_m"]
    assert safety(found()) == (True, True)
    assert found()["confirmed"]["at_rest_without_friction"] == found()["confirmed"]["hands"]
    problem = device().changed(environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0})
    best = avc.recommend(problem, hands=16)
    assert best.trial.stiffness > 0.7 * wall
    fresh = try_coupling(best.coupling, draw_hands(problem.hands, 60, 77), 77)
    assert fresh.stable_without_friction.mean() > 0.9


@pytest.mark.thorough
def test_no_change_for_the_better_is_less_safe_or_softer_by_more_than_a_step():
    helps = {one["change"]: one for one in found()["what_would_help"]}
    for change in ("no play", "twice the force", "no delay"):
        assert safety(helps[change]) >= safety(found())
        assert helps[change]["stiffest_wall_n_per_m"] > 0.85 * found()["stiffest_wall_n_per_m"], change
    # Force need not be used.
    assert helps["twice the force"]["stiffest_wall_n_per_m"] >= found()["stiffest_wall_n_per_m"]
    order = [(*safety(one), one["stiffest_wall_n_per_m"]) for one in found()["what_would_help"]]
    assert order == sorted(order, reverse=True)


@pytest.mark.thorough
def test_a_change_is_told_by_the_way_that_leads_furthest():
    told = {one["change"]: one for one in found()["what_would_help"]}["no delay"]
    judged = [one for other, one in searched()[1] if other.delay_samples == 0 < device().device.delay_samples]
    assert len(judged) == len(WAYS)
    some = [one.judged for one in judged if one is not None]
    reached = [(safety(one.trial.counts()), one.felt_n_per_m) for one in some]
    assert len(reached) > 1
    assert (safety(told), told["stiffest_wall_n_per_m"]) == max(reached)


@pytest.mark.thorough
@pytest.mark.parametrize("key", ["encoder_resolution_m", "max_force_n"])
def test_a_range_changes_with_its_value(key):
    low, high = 0.8 * DEVICE[key], 1.5 * DEVICE[key]
    ranged = device(range={key: [low, high]})
    changes = _stiffest.simulated_changes(ranged)
    factor = 0.5 if key == "encoder_resolution_m" else 2
    (other,) = (one for one in changes.values() if getattr(one.device, key) == pytest.approx(factor * DEVICE[key]))
    np.testing.assert_allclose(getattr(other.device.range, key), (factor * low, factor * high))


@pytest.mark.thorough
def test_a_wall_and_detents_of_the_problem_do_not_matter():
    knob = avc.load_problem("knob")
    reached, walled = _stiffest._unreachable_wall(knob)
    assert walled.detent is None
    assert walled.environment.stiffness_n_per_m > 100 * reached.stiffness_n_per_m


@pytest.mark.thorough
def test_a_device_that_nothing_holds_has_none():
    told = stiffest(avc.load_problem("hard/massless"), hands=3)
    assert told["stiffest_wall_n_per_m"] is None
    assert {one["stiffest_wall_n_per_m"] for one in told["what_would_help"]} == {None}


@pytest.mark.thorough
def test_the_device_as_it_is_is_searched_as_for_a_recommendation_and_more():
    """So that before a wall out of reach nothing stiffer is recommended, but for rounding."""
    first, *beside = _stiffest._AS_IT_IS
    assert {*CONTINUATIONS} <= {*first}
    assert all(not set(others) & set(first) for others in beside)
