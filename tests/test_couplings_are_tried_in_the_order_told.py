"""Which couplings are tried, and in which order: those that stand in stable intervals, the stiffest that is held."""

from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust.cma_continuation import Step
from avc_casadi.design.robust.lqg import Space
from avc_casadi.loops.walls import damping_range, stiffest_wall
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_casadi.recommendation import generate, search_schedule
from avc_casadi.recommendation.evaluate import likeliest
from avc_casadi.recommendation.generate import (
    RobustCandidates,
    plain_candidates,
    softened_to,
    static_stiffness_n_per_m,
    stiffer_n_per_m,
)
from avc_casadi.recommendation.shaken import shaken as handle_shaken

PROBLEM = avc.load_problem("figure5")
CORNERS = hand_corners(PROBLEM.hands)
LIMIT = stiffest_wall(PROBLEM.device, with_released(CORNERS))


def before(stiffness_n_per_m, damping_ns_per_m=0.0):
    wall = {"stiffness_n_per_m": stiffness_n_per_m, "damping_ns_per_m": damping_ns_per_m}
    return PROBLEM.changed(environment=wall)


def test_a_contact_damper_leaves_what_the_wall_damps_of_itself():
    """Both together are what a bare wall of the same stiffness is given."""
    wall = 0.5 * LIMIT.stiffness_n_per_m

    def dampers(damping):
        found = [one for some in plain_candidates(before(wall, damping), CORNERS, LIMIT) for one in some]
        return [one.table.at_rest.contact_damping_ns_per_m for one in found if one.method == "contact damper"]

    bare = dampers(0.0)
    own = float(np.mean(bare))
    assert len(bare) > 2
    assert dampers(own) == pytest.approx([max(0.0, one - own) for one in bare])


def test_springs_that_are_as_stiff_stand_within_what_is_stable_the_nearest_in_motion_first():
    problem, felt = before(4 * LIMIT.stiffness_n_per_m), 0.6 * LIMIT.stiffness_n_per_m
    alike = next(iter(softened_to(problem, CORNERS, felt)))
    assert [static_stiffness_n_per_m(one) for one in alike] == pytest.approx([felt] * len(alike))
    dampings = [one.table.at_rest.contact_damping_ns_per_m for one in alike]
    stable = damping_range(problem.device, with_released(CORNERS), felt)
    assert stable.lowest_ns_per_m <= min(dampings) < max(dampings) <= stable.highest_ns_per_m
    shaken = [np.sqrt(np.mean(handle_shaken(one, felt, [1.0, 3.0, 10.0, 30.0]).mismatch ** 2)) for one in alike]
    assert shaken == pytest.approx(sorted(shaken), rel=0.02)


def test_the_next_stiffer_wall_is_never_far():
    """From the softest on, the walls that are looked at follow each other until the one that is wanted."""
    wanted = 1.5 * LIMIT.stiffness_n_per_m
    felt, passed = 0.2 * LIMIT.stiffness_n_per_m, []
    while (following := stiffer_n_per_m(before(wanted), LIMIT, felt)) is not None:
        assert following > felt
        felt = following
        passed.append(felt / LIMIT.stiffness_n_per_m)
    assert passed[-1] == pytest.approx(1.5)
    assert set(np.round(passed, 9)) >= {0.75, 0.82, 0.9, 1.0}


def test_whoever_leans_on_friction_rests_with_room_to_spare():
    """At 0.8 of the speed of rest: enough without friction, too fast for who needs it."""
    feedback = StateFeedback(((1.0,),), (0.0,), (1.0,), (1.0,), (0,), 0)
    law = Coupling.constant(PROBLEM, Gains(0.0, 500.0), "robust", Runtime(state_feedback=feedback))
    people = SimpleNamespace(residual_speeds=lambda some, **_: np.full((len(some), 3), 0.8))
    assert likeliest([law], (people,), lean_on_friction=False) == ([law], True)
    assert likeliest([law], (people,), lean_on_friction=True) == ([law], False)


@pytest.mark.parametrize(("held", "asked"), [(250.0, [400.0, 300.0, 200.0]), (1e3, [400.0])])
def test_of_the_walls_of_a_climb_the_stiffest_is_asked_about_first(held, asked):
    climb = [SimpleNamespace(stiffness_n_per_m=wall) for wall in (100.0, 200.0, 300.0, 400.0)]
    met = []

    class Hands:
        """Everybody rests at walls up to one."""

        def holds(self, wall):
            return any(wall <= one <= held for one in met)

        def finds(self, _, wall, __):
            met.append(wall)
            return wall <= held

    laws = SimpleNamespace(alternatives=lambda step: [step])
    search_schedule._stiffest_held(Hands(), laws, climb)
    assert met == asked


class Springs:
    """Hands who settle with springs up to one, beside a law that holds more at some distance from the wall."""

    def __init__(self, held, at_rest, distance, law):
        self.met, self._held = [], held
        self._nearest = SimpleNamespace(
            distance=distance, coupling=SimpleNamespace(runtime=SimpleNamespace(state_feedback=law))
        )
        self._spring = None if at_rest is None else SimpleNamespace(felt_n_per_m=at_rest)

    def holds(self, felt, *, plain):
        return plain and felt <= self._held

    def ask(self, felt, _):
        self.met.append(felt)

    def nearest(self):
        return self._nearest

    def stiffest(self, *, plain):
        return self._spring if plain else None

    def halved(self, low, high):
        """Follow the bisection; return where it ends."""
        for felt in self.met:
            assert felt == pytest.approx(np.sqrt(low * high))
            low, high = (felt, high) if felt <= self._held else (low, felt)
        return low, high


@pytest.mark.parametrize("share", [0.16, 0.2, 0.23])
def test_the_way_from_what_is_held_to_what_is_not_is_halved(share, monkeypatch):
    """From 0.15 of what springs hold the next wall that was looked at stands at 0.24 of it."""
    problem, limit = before(2 * LIMIT.stiffness_n_per_m), LIMIT.stiffness_n_per_m
    monkeypatch.setattr(search_schedule, "softened_to", lambda _, __, felt: felt)
    hands = Springs(share * limit, 0.15 * limit, 0.5, None)
    search_schedule._closer(problem, hands, LIMIT)
    low, high = hands.halved(0.15 * limit, 0.24 * limit)
    assert len(hands.met) == 4
    assert low <= share * limit < high


@pytest.mark.parametrize("spring", [None, 0.1])
@pytest.mark.parametrize("distance", [0.3, 0.8])
def test_springs_that_may_be_nearer_than_a_law_are_tried_beside_it(spring, distance, monkeypatch):
    """A spring that softens the wall to exp(-d) of it is off by d already."""
    limit = LIMIT.stiffness_n_per_m
    wall = 0.9 * limit
    monkeypatch.setattr(search_schedule, "softened_to", lambda _, __, felt: felt)
    hands = Springs(0.7 * wall, spring and spring * wall, distance, "a law")
    search_schedule._closer(before(wall), hands, LIMIT)
    assert len(hands.met) >= 2
    low, high = hands.halved(np.exp(-distance) * wall, wall)
    assert low < high


def test_no_spring_is_tried_beside_a_law_that_is_nearer_than_the_stiffest_of_them(monkeypatch):
    monkeypatch.setattr(search_schedule, "softened_to", lambda _, __, felt: felt)
    hands = Springs(np.inf, None, 0.5, "a law")
    search_schedule._closer(before(2 * LIMIT.stiffness_n_per_m), hands, LIMIT)
    assert hands.met == []


def wall_at(stiffness_n_per_m, *distances):
    """A wall with laws of these distances, the first of which is the likeliest."""
    laws = tuple(
        SimpleNamespace(cost=SimpleNamespace(distance=one), logarithms=stiffness_n_per_m, law=one) for one in distances
    )
    return Step(None, stiffness_n_per_m, laws)


def test_the_nearest_of_the_laws_found_with_which_all_settle_is_refined(monkeypatch):
    asked = []
    monkeypatch.setattr(generate, "_refined", lambda _, step, who: asked.append((step, who)) or "refined")
    monkeypatch.setattr(generate, "_settles", lambda _, step, who: step.best.law > 0.6 and who == "hands")
    robust = RobustCandidates(before(1e4), LIMIT)
    assert robust.refined("hands") == []
    robust.steps = [wall_at(5e3, 0.9), wall_at(4e3, 0.5, 0.65), wall_at(3e3, 0.7)]
    assert robust.refined("hands") == ["refined"]
    ((step, who),) = asked
    assert (step.stiffness_n_per_m, who) == (4e3, "hands")
    assert [one.law for one in step.candidates] == [0.65]
    assert robust.steps.pop() == "refined"
    # Where nobody settles with any, laws about the nearest may be better.
    robust.refined("others")
    assert asked[-1][0].best.law == 0.5


@pytest.mark.parametrize("known", [True, False])
def test_every_other_continuation_begins_at_the_wall_that_a_known_law_holds_else_at_initial_guesses(known, monkeypatch):
    held, asked = wall_at(2e3, 0.5), []
    monkeypatch.setattr(generate, "_known", lambda *_: held if known else None)

    def continued(_, point, walls, who, **how):
        asked.append((point, walls, who, how["seed"]))
        return [how["seed"]]

    monkeypatch.setattr(generate, "_continued", continued)
    found = list(RobustCandidates(before(4e5), LIMIT).continuations("hands", range(2)))
    assert found == ([[held]] if known else []) + [[0], [1]]
    points, walls, who, seeds = zip(*asked, strict=True)
    first = pytest.approx(0.9 * LIMIT.stiffness_n_per_m)
    assert walls == ((2e3 if known else first, 4e5), (first, 4e5))
    assert who == ("hands",) * 2
    assert seeds == (0, 1)
    guesses = Space(PROBLEM.device, PROBLEM.hands).starts
    for place, point in enumerate(points):
        np.testing.assert_array_equal(point, 2e3 if known and place == 0 else guesses[place])
