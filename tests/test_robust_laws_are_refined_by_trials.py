"""Laws near one are chosen by who rests with them in a simulation of the whole device."""

import dataclasses

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling, Gains, Runtime, near_rigid_n_per_m
from avc_casadi.design.robust import Loops, Space, _search, refined, robust_at, search
from avc_casadi.problem import Press
from avc_casadi.stability import frozen_rendering
from avc_casadi.trial import Conditions, ends_of, people_of, try_coupling, unrest
from avc_casadi.trial._coupling_trial import TRIAL_S
from avc_casadi.trial._trial import Ends

HANDS = 20
PROBLEM = avc.load_problem("reference-r1")


@pytest.fixture(scope="module")
def rung():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_search, "MOST_LAWS", 12)
        return next(robust_at(PROBLEM, 3000.0))


def laws(rung):
    return [rung.found.law, *(one.law for one in rung.found.others)]


def coupling(rung, law):
    return Coupling.constant(PROBLEM, rung.gains, "robust", Runtime(state_feedback=law))


def one_hand_moves(speed):
    """Everybody rests but for one hand, whose speed depends on the law."""

    def ends(asked):
        found = np.full((len(asked), HANDS), 0.1)
        found[:, 0] = [speed(law) for law in asked]
        return found

    return ends


def test_laws_are_found_with_which_everybody_rests(rung):
    before = min(law.feedback[0] for law in laws(rung))

    def ends(asked):
        return one_hand_moves(lambda law: law.feedback[0] / before)(asked)

    better = refined(PROBLEM, rung, ends)
    assert better is not None
    assert better.stiffness_n_per_m == rung.stiffness_n_per_m
    assert (ends(laws(better)) < 1).all()
    assert all(one.cost.holds for one in (better.found, *better.found.others))


def test_what_nothing_helps_is_left(rung):
    assert refined(PROBLEM, rung, one_hand_moves(lambda _: 2.0)) is None


def test_where_many_move_with_every_law_the_search_ends_early(rung):
    asked = []

    def ends(some):
        asked.append(len(some))
        return np.full((len(some), HANDS), 2.0)

    assert refined(PROBLEM, rung, ends) is None
    assert asked[0] == len(laws(rung))
    assert 60 <= sum(asked[1:]) < 60 + 10


def test_a_simulation_that_ends_in_no_number_is_no_rest(rung):
    better = refined(PROBLEM, rung, one_hand_moves(lambda law: np.nan if law is rung.found.law else 0.2))
    assert better is not None
    assert rung.found.law not in laws(better)


def test_laws_of_one_scene_end_as_each_alone(rung):
    plain = Coupling.constant(PROBLEM, Gains(0.0, 2000.0, 2.0), "plain")
    restless = dataclasses.replace(rung.found.law, feedback=tuple(4.0 * one for one in rung.found.law.feedback))
    stiff = coupling(rung, restless)
    several = [coupling(rung, law) for law in laws(rung)[:2]] + [stiff, plain]
    people = people_of(PROBLEM.hands, HANDS)
    for friction, rests in ((True, "stable"), (False, "stable_without_friction")):
        speeds = unrest(several, people, friction=friction)
        assert speeds.shape == (len(several), HANDS)
        for one, speed in zip(several, speeds, strict=True):
            np.testing.assert_array_equal(speed < 1, getattr(try_coupling(one, people), rests))
            alone = ends_of(one, people, friction=friction)([one.runtime.state_feedback])
            np.testing.assert_array_equal(alone[0], speed)
    assert (speeds[2] > 1).any()


def test_who_strikes_too_ends_as_fast_as_in_the_fastest_motion(rung):
    """A strike drives the device to its force limit: a law that is hardly damped there does not come back."""
    one, people = coupling(rung, rung.found.law), people_of(PROBLEM.hands, HANDS)
    laws_asked = [one.runtime.state_feedback]
    conditions, gains = Conditions.of(one).without_friction(), one.table.at_rest
    struck = Ends(PROBLEM, gains, people, [((Press(speed_m_per_s=0.3), TRIAL_S),)], conditions)(laws_asked)
    calmly = ends_of(one, people, friction=False)(laws_asked)
    both = ends_of(one, people, friction=False, strike=True)(laws_asked)
    np.testing.assert_array_equal(both, np.maximum(struck, calmly))
    assert (struck != calmly).any()


@pytest.mark.parametrize(("stiffness", "passes"), [(3753.0, 2), (1000.0, 1)])
def test_a_search_that_ends_with_a_growing_loop_looks_for_a_damped_one(stiffness, passes, monkeypatch):
    """At the edge of what can be held the cheapest law lets some loop grow."""
    problem = PROBLEM.changed(
        device={
            "mass_kg": 0.0948,
            "damping_ns_per_m": 0.33,
            "sample_time_s": 1.3e-3,
            "delay_samples": 2.07,
            "coulomb_friction_n": 0.12,
            "encoder_resolution_m": 4.38e-6,
            "amplifier_bandwidth_hz": 866.0,
            "max_force_n": None,
            "resonance": {"frequency_hz": 112.0, "damping_ratio": 0.0314, "mass_ratio": 0.336},
        },
        environment={"stiffness_n_per_m": stiffness, "damping_ns_per_m": 0.0},
        frequency={"stop_hz": 300.0},
    )
    made, evolve = [], _search.evolve

    def noted(*args, **kwargs):
        made.append(args)
        return evolve(*args, **kwargs)

    monkeypatch.setattr(_search, "evolve", noted)
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    found = search(space, loops, frozen_rendering(problem, 0.0, near_rigid_n_per_m(problem.device)))
    assert len(made) == passes * len(space.starts)
    assert found.cost.growth_per_s == 0
    assert found.cost.holds
