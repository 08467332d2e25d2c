"""Walls are raised while laws are searched, as long as everybody who is simulated comes to rest."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from robust_steps import step_at

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust import cma_continuation
from avc_casadi.design.robust.cma_continuation import continuation, weighed
from avc_casadi.design.robust.goal import cost_of, costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.refinement import refined
from avc_casadi.design.robust.uncertainty_set import Loops
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import largest_radius
from avc_casadi.loops.wall import Laws, frozen_rendering, observed_wall
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.runtime import Runtime
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.scene import Press
from avc_casadi.simulation.population.coupling_trial import TRIAL_S, try_coupling
from avc_casadi.simulation.population.motions import course_of
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.settled import prepared_residual_speeds, residual_speeds
from avc_casadi.simulation.population.trial import Conditions, Ends

HANDS = 20
PROBLEM = avc.load_problem("reference-r1")
HELD = Body.of(sampled_plant(PROBLEM.device, hand_corners(PROBLEM.hands))).flat()
FAR = 1e6
BEFORE_FAR = PROBLEM.changed(environment={"stiffness_n_per_m": FAR, "damping_ns_per_m": 0.0})


@pytest.fixture(scope="module")
def step():
    return step_at(PROBLEM, 3000.0)


def laws(step):
    return [one.law for one in step.candidates]


def coupling(step, law):
    return Coupling.constant(PROBLEM, step.gains, "robust", Runtime(state_feedback=law))


class OneHand:
    """Everybody rests but for one hand, whose speed depends on the wall and the law; what was asked is kept."""

    def __init__(self, speed):
        self.speed, self.walls = speed, []

    def at(self, gains, _):
        wall = gains.stiffness_n_per_m * FAR / (gains.stiffness_n_per_m + FAR)
        self.walls.append(wall)

        def ends(asked):
            found = np.full((len(asked), HANDS), 0.1)
            found[:, 0] = [self.speed(wall, law) for law in asked]
            return found

        return ends


def start_of(step):
    return step.best.logarithms


@pytest.mark.thorough
def test_walls_rise_up_to_the_one_that_nobody_rests_at(step):
    hand = OneHand(lambda wall, _: 0.2 if wall < 4200 else 2.0)
    held = continuation(BEFORE_FAR, start_of(step), (3000.0, 1e5), hand.at, close=1.05)
    walls = [one.stiffness_n_per_m for one in held]
    assert walls == sorted(walls)
    assert walls[0] == pytest.approx(3000)
    assert 4200 / 1.05 <= walls[-1] < 4200
    for one in held:
        space, loops = Space(BEFORE_FAR.device, BEFORE_FAR.hands), Loops.of(BEFORE_FAR)
        rendering = frozen_rendering(BEFORE_FAR, 0.0, one.gains.stiffness_n_per_m)
        for law in one.candidates:
            assert law.cost.holds
            assert cost_of(space.law(law.logarithms, one.stiffness_n_per_m), rendering, loops).holds


def test_a_continuation_ends_at_the_wanted_wall(step):
    hand = OneHand(lambda *_: 0.2)
    held = continuation(BEFORE_FAR, start_of(step), (3000.0, 3900.0), hand.at)
    assert held[-1].stiffness_n_per_m == pytest.approx(3900)
    assert max(hand.walls) == pytest.approx(3900)
    costs = [[one.cost.total for one in wall.candidates] for wall in held]
    assert costs == [sorted(some) for some in costs]
    assert max(map(len, costs)) > 1


def test_a_wall_is_raised_by_two_fifths_at_most_and_by_as_much_where_laws_are_found_at_once(monkeypatch):
    def held(point, wall):
        return SimpleNamespace(stiffness_n_per_m=wall, best=SimpleNamespace(logarithms=point)), 1

    monkeypatch.setattr(cma_continuation, "_Search", lambda *_: SimpleNamespace(held=held))
    walls = [step.stiffness_n_per_m for step in continuation(PROBLEM, None, (100.0, 5000.0))]
    rises = np.divide(walls[1:], walls[:-1])
    assert walls[-1] == 5000.0
    assert rises.max() == pytest.approx(1.4)
    np.testing.assert_allclose(rises[1:-1], 1.4)


@pytest.mark.thorough
def test_halfway_to_a_wall_that_is_not_held_is_no_wall_beyond_it(step):
    hand = OneHand(lambda wall, _: 0.2 if wall < 3200 else 2.0)
    held = continuation(BEFORE_FAR, start_of(step), (3000.0, 3300.0), hand.at)
    assert 3000 <= held[-1].stiffness_n_per_m < 3200
    assert max(hand.walls) == pytest.approx(3300)


@pytest.mark.thorough
def test_a_continuation_begins_softer_where_the_first_wall_is_too_stiff(step):
    hand = OneHand(lambda wall, _: 0.2 if wall < 1700 else 2.0)
    held = continuation(BEFORE_FAR, start_of(step), (3000.0, 3000.0), hand.at)
    assert 1700 / 1.1 < held[-1].stiffness_n_per_m < 1700
    assert continuation(BEFORE_FAR, start_of(step), (3000.0, 3000.0), hand.at, softer=0) == []


def test_the_speed_of_the_hands_leads_the_search(step):
    """The law of the start moves somebody; laws with less feedback, which are near, do not."""
    before = step.best.law.feedback[0]
    hand = OneHand(lambda _, law: law.feedback[0] / before / 0.97)
    held = continuation(BEFORE_FAR, start_of(step), (3000.0, 3000.0), hand.at)
    assert held
    assert all(law.feedback[0] / before < 0.97 for law in laws(held[-1]))


def test_a_simulation_that_ends_in_no_number_is_no_rest(step):
    hand = OneHand(lambda *_: np.nan)
    assert continuation(BEFORE_FAR, start_of(step), (3000.0, 3000.0), hand.at, softer=0) == []


def test_a_law_that_ends_in_no_number_is_worth_less_than_one_with_which_somebody_moves(step):
    space, loops = Space(PROBLEM.device, PROBLEM.hands), Loops.of(PROBLEM)
    three = Laws.of(step.best.law).pick(np.zeros(3, dtype=int))
    costs = costs_of(three, frozen_rendering(PROBLEM, 0.0, step.gains.stiffness_n_per_m), loops)
    ends = np.array([[0.2, np.nan], [0.2, 2.0], [0.2, 0.2]])
    value, settled = weighed(space, three, costs, lambda _: ends)
    assert value[0] > value[1] > value[2]
    assert settled == [2]


def test_laws_of_one_scene_end_as_each_alone(step):
    plain = Coupling.constant(PROBLEM, Gains(0.0, 2000.0, 2.0), "plain")
    restless = dataclasses.replace(step.best.law, feedback=tuple(12.0 * one for one in step.best.law.feedback))
    stiff = coupling(step, restless)
    several = [coupling(step, law) for law in laws(step)[:2]] + [stiff, plain]
    people = people_of(PROBLEM.hands, HANDS)
    for friction, rests in ((True, "stable"), (False, "stable_without_friction")):
        speeds = residual_speeds(several, people, friction=friction)
        assert speeds.shape == (len(several), HANDS)
        for one, speed in zip(several, speeds, strict=True):
            np.testing.assert_array_equal(speed < 1, getattr(try_coupling(one, people), rests))
            alone = prepared_residual_speeds(one, people, friction=friction)([one.runtime.state_feedback])
            np.testing.assert_array_equal(alone[0], speed)
    assert (speeds[2] > 1).any()


def test_who_strikes_and_touches_lightly_too_ends_as_fast_as_in_the_fastest_motion(step):
    """A strike drives the device to its force limit: a law that is hardly damped there does not come back.

    The lightest touch has the declared friction in any case.
    """
    one, people = coupling(step, step.best.law), people_of(PROBLEM.hands, HANDS)
    laws_asked = [one.runtime.state_feedback]
    rough, gains = Conditions.of(one), one.table.at_rest
    smooth = rough.without_friction()
    pressed = (
        (Press(speed_m_per_s=0.3), smooth),
        (Press(end_m=5e-4, speed_m_per_s=0.03), smooth),
        (Press(end_m=2e-4, speed_m_per_s=0.03), rough),
    )
    beyond = [Ends(PROBLEM, gains, people, [((one, TRIAL_S), how)])(laws_asked) for one, how in pressed]
    calmly = prepared_residual_speeds(one, people, friction=False)(laws_asked)
    both = prepared_residual_speeds(one, people, friction=False, beyond=True)(laws_asked)
    np.testing.assert_array_equal(both, np.maximum.reduce([*beyond, calmly]))
    assert (beyond[0] != calmly).any()
    assert rough.friction_n > 0


def test_a_law_with_which_somebody_moves_is_out_of_the_race_and_with_another_all_try_everything(step):
    """Who is left ends as without a race; who is out ends as in the motions so far, and somebody is not at rest."""
    one, people = coupling(step, step.best.law), people_of(PROBLEM.hands, HANDS)
    law = one.runtime.state_feedback
    both = [law, dataclasses.replace(law, feedback=tuple(12.0 * value for value in law.feedback))]
    everything = prepared_residual_speeds(one, people, beyond=True)(both)
    raced = prepared_residual_speeds(one, people, beyond=True, racing=True)(both)
    assert (everything[0] < 1).all()
    np.testing.assert_array_equal(raced[0], everything[0])
    gains, taps = one.table.at_rest, course_of(PROBLEM).motions["tap"]
    first = Ends(PROBLEM, gains, people, [(taps, Conditions.of(one))])(both)
    assert (first[1] > 1).any()
    np.testing.assert_array_equal(raced[1], np.maximum(first[1], 1.0))


@pytest.mark.thorough
@pytest.mark.parametrize("stiffness", [3753.0, 1000.0])
def test_a_search_that_begins_with_a_growing_loop_finds_a_damped_one(stiffness):
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
    space, loops = Space(problem.device, problem.hands), Loops.of(problem)
    rendering = frozen_rendering(problem, 0.0, near_rigid_n_per_m(problem.device))
    assert not cost_of(space.law(space.starts[0], stiffness), rendering, loops).holds
    found = continuation(problem, space.starts[0], (stiffness / 3, stiffness))[-1]
    assert found.stiffness_n_per_m == stiffness
    assert found.best.cost.lacks_per_s == 0
    assert found.best.cost.holds


def test_a_law_whose_press_settles_too_slowly_holds_no_wall(step):
    """An observer that hardly believes in a push that changes takes seconds until the wall is as stiff as at rest."""
    space, loops = Space(PROBLEM.device, PROBLEM.hands), Loops.of(PROBLEM)
    rendering = frozen_rendering(PROBLEM, 0.0, step.gains.stiffness_n_per_m)
    walk, soft = [knob.name for knob in space.knobs].index("walk of the push"), space.starts[2]
    felt, costs = [], []
    for quicker in (0.0, -5.0):
        law = space.law(soft + quicker * (np.arange(len(space.knobs)) == walk), step.stiffness_n_per_m)
        costs.append(cost_of(law, rendering, loops))
        pressed = try_coupling(coupling(step, law), people_of(PROBLEM.hands, HANDS)).stiffness
        felt.append(pressed / step.stiffness_n_per_m)
    assert felt[0] > 0.98
    assert felt[1] < 0.96
    assert [cost.holds for cost in costs] == [True, False]
    assert [cost.radius < 1 and cost.radius_any_share < 1 for cost in costs] == [True, True]
    assert costs[0].lacks_per_s == 0 < costs[1].lacks_per_s


def test_a_continuation_ends_after_some_generations_however_near_the_next_wall(monkeypatch):
    taken = []

    def held(point, wall):
        taken.append(wall)
        return SimpleNamespace(stiffness_n_per_m=wall, best=SimpleNamespace(logarithms=point)), 12

    monkeypatch.setattr(cma_continuation, "_Search", lambda *_: SimpleNamespace(held=held))
    walls = continuation(PROBLEM, None, (100.0, 1e9), rise=1.01)
    # Those of the first wall do not count: to find any law takes as long as it takes.
    assert len(walls) == len(taken) == 1 + 60 // 12


@pytest.mark.parametrize("wanted", [3000.0, 4000.0])
def test_where_the_wanted_wall_is_stiffer_a_refinement_chooses_the_stiffness_too(wanted):
    before = PROBLEM.changed(environment={"stiffness_n_per_m": wanted})
    first = step_at(before, 3000.0)
    nearer = refined(before, first, wanted_n_per_m=wanted)
    assert nearer.best.cost.distance < first.best.cost.distance
    assert nearer.stiffness_n_per_m <= wanted * (1 + 1e-9)
    assert (nearer.stiffness_n_per_m != first.stiffness_n_per_m) == (wanted > 3000)
    loops, rendering = Loops.of(before), frozen_rendering(before, 0.0, nearer.gains.stiffness_n_per_m)
    for one in nearer.candidates:
        assert cost_of(one.law, rendering, loops).distance == pytest.approx(one.cost.distance)


def test_a_refined_law_gives_way_less_and_all_who_are_asked_still_settle(step):
    """Nobody is asked, then hands who settle only with laws of less feedback than the first."""
    nearer = refined(PROBLEM, step)
    assert nearer.stiffness_n_per_m == step.stiffness_n_per_m
    distances = [one.cost.distance for one in nearer.candidates]
    assert distances == sorted(distances)
    assert distances[0] < 0.9 * step.best.cost.distance
    before = step.best.law.feedback[0]
    hand = OneHand(lambda _, law: law.feedback[0] / before / 1.001)
    asked = refined(PROBLEM, dataclasses.replace(step, candidates=(step.best,)), hand.at)
    loops = Loops.of(PROBLEM)
    rendering = frozen_rendering(PROBLEM, 0.0, step.gains.stiffness_n_per_m)
    for one in (*nearer.candidates, *asked.candidates):
        assert cost_of(one.law, rendering, loops).holds
        assert one.cost.distance <= step.best.cost.distance
        assert largest_radius(observed_wall(HELD, Laws.of(one.law), rendering)[0]).max() < 1
    assert all(one.law.feedback[0] / before <= 1.001 for one in asked.candidates)
