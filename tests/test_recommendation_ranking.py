"""The choice among judged couplings is a rule told in one sentence, and hands that did not choose test it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust.lqg import Space
from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.corners import device_with
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_casadi.recommendation import evaluate as _evaluate
from avc_casadi.recommendation import generate as _generate
from avc_casadi.recommendation import rank as _rank
from avc_casadi.recommendation import search_schedule as _stages
from avc_casadi.recommendation.evaluate import confirmed
from avc_casadi.recommendation.generate import static_stiffness_n_per_m
from avc_casadi.recommendation.rank import Judged, best_of
from avc_casadi.recommendation.search_schedule import judged_candidates
from avc_casadi.simulation.population.coupling_trial import CouplingTrial, try_coupling, try_on_devices
from avc_casadi.simulation.population.operators import people_of

HANDS = 10
PROBLEM = avc.load_problem("figure5")
WALL = PROBLEM.environment.stiffness_n_per_m


def trial(stable: int, free: int, quiet: int) -> CouplingTrial:
    """So many of ten hands at rest, without friction, and without a vibration that is felt."""
    nothing = np.zeros(HANDS)
    return CouplingTrial(
        seed=0,
        effects=(),
        stable=np.arange(HANDS) < stable,
        stable_without_friction=np.arange(HANDS) < free,
        by_motion={},
        vibration=np.where(np.arange(HANDS) < quiet, 0.0, 10.0),
        stiffness_n_per_m=np.full(HANDS, np.nan),
        at_force_limit=nothing > 0,
        tap_force_n=nothing,
        tap_depth_m=nothing,
        wall_n_per_m=WALL,
    )


def judged(order: int, share: float, stable: int, free: int, quiet: int) -> Judged:
    gains = Gains(0.0, spring_before(PROBLEM, share * WALL))
    return Judged(Coupling.constant(PROBLEM, gains, "x"), trial(stable, free, min(quiet, stable)), order)


def test_what_a_press_has_not_reached_yet_is_not_counted():
    """A slow observer creeps towards the stiffness at rest for longer than a press lasts."""
    quick, slow = (judged(order, share, HANDS, HANDS, HANDS) for order, share in enumerate((0.5, 0.8)))
    assert best_of([quick, slow]) is slow
    pressed = replace(slow.trial, stiffness_n_per_m=np.full(HANDS, 0.4 * WALL))
    slow = replace(slow, trial=pressed)
    assert slow.felt_n_per_m == pytest.approx(0.4 * WALL)
    assert best_of([quick, slow]) is quick
    at_the_limit = replace(slow, trial=replace(pressed, stiffness_n_per_m=np.full(HANDS, np.nan)))
    assert at_the_limit.felt_n_per_m == pytest.approx(0.8 * WALL)


def test_of_equally_safe_ones_what_is_quiet_wins_over_what_is_nearer_and_the_simpler_one_of_equals():
    near, quiet = (
        Judged(Coupling.constant(PROBLEM, Gains(0.0, spring_before(PROBLEM, share * WALL), damping), "x"), tried, order)
        for order, (share, damping, tried) in enumerate(((0.5, 50.0, trial(10, 10, 8)), (0.2, 20.0, trial(10, 10, 10))))
    )
    assert near.distance < 0.5 * quiet.distance
    assert best_of([near, quiet]) is quiet
    assert best_of([replace(near, trial=trial(10, 10, 9)), quiet]).order == 0
    simpler, other = judged(0, 0.5, 10, 10, 10), judged(1, 0.5, 10, 10, 10)
    assert best_of([other, simpler]) is best_of([simpler, other]) is simpler


def test_who_moves_on_a_device_that_is_asked_for_beyond_the_file_makes_a_coupling_unsafe():
    one, rest = judged(0, 0.5, 10, 10, 10), np.ones(6, dtype=bool)
    assert replace(one, beyond=(rest, rest)).safety == 0
    assert replace(one, beyond=(rest, np.arange(6) > 0)).safety == 2


COUNTS = st.sampled_from([0, 5, 8, 9, 10])
CANDIDATES = st.lists(
    st.tuples(st.sampled_from([0.2, 0.5, 0.8, 0.95]), COUNTS, COUNTS, COUNTS), min_size=1, max_size=6
).map(lambda rows: [judged(order, *row) for order, row in enumerate(rows)])


def safety(one: Judged, lean: bool) -> tuple[int, int]:
    everybody, free = one.trial.stable.all(), one.trial.stable_without_friction.all()
    if not everybody:
        return 2, -int(one.trial.stable.sum())
    return (0 if free or lean else 1), 0


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(CANDIDATES, st.booleans())
def test_nothing_that_is_safer_or_as_safe_and_better_is_passed_over(candidates, lean):
    best = best_of(candidates, lean_on_friction=lean)
    rank = safety(best, lean)
    if lean:
        rank = (max(rank[0], 1), rank[1])
    for one in candidates:
        other = safety(one, lean)
        if lean:
            other = (max(other[0], 1), other[1])
        assert rank <= other
        if other == rank:
            quiet, mine = one.trial.quiet.mean() >= 0.9, best.trial.quiet.mean() >= 0.9
            assert mine or not quiet
            # Springs that never settle are all as near: of those more hands below the threshold decide.
            if mine == quiet and best.trial.quiet.sum() <= one.trial.quiet.sum():
                assert static_stiffness_n_per_m(best.coupling) >= 0.99 * static_stiffness_n_per_m(one.coupling)


def test_hands_that_had_no_part_in_the_evaluate_can_refute_it(monkeypatch):
    lucky, honest = judged(0, 0.95, 10, 10, 10), judged(1, 0.5, 10, 10, 10)
    failing = {lucky.coupling.id: trial(9, 9, 9)}
    asked = []

    def tried(coupling, people, devices, seed, _executor):
        asked.append((coupling.id, people, len(devices), seed))
        return failing.get(coupling.id, trial(10, 10, 10))

    monkeypatch.setattr(_evaluate, "try_on_devices", tried)
    others = iter(["some others", "still others"])
    found = confirmed([lucky, honest], range(HANDS), others, 3, lean_on_friction=False)
    best = best_of(found)
    assert best.coupling is honest.coupling
    assert best.others is not None
    assert [one[0] for one in asked] == [lucky.coupling.id, honest.coupling.id]
    assert [one[1:] for one in asked] == [("some others", 1, 3), ("still others", 1, 3)]
    assert [one.asked for one in found] == ["some others", "still others"]
    assert found[0].safety == 2


@pytest.mark.thorough
@pytest.mark.parametrize("held", [0.7, 0.5, 0.3, 0.2])
def test_where_others_refute_a_softened_wall_a_softer_one_is_looked_for(held, monkeypatch):
    """Those who choose rest at every wall below 0.9 of what spring and damper hold, the others only at `held`."""
    people = people_of(PROBLEM.hands, HANDS)
    limit = stiffest_wall(PROBLEM.device, with_released(hand_corners(PROBLEM.hands)))

    def rests(coupling, most):
        everybody = HANDS if static_stiffness_n_per_m(coupling) < most * limit.stiffness_n_per_m else HANDS - 1
        return trial(everybody, everybody, everybody)

    monkeypatch.setattr(_evaluate, "try_coupling", lambda coupling, *_, **__: rests(coupling, 0.9))
    monkeypatch.setattr(_evaluate, "try_on_devices", lambda coupling, *_, **__: rests(coupling, held))
    monkeypatch.setattr(_rank, "likely_provable", lambda left: left)
    monkeypatch.setattr(_generate, "why_no_law", lambda *_: "springs and dampers alone")
    monkeypatch.setattr(_stages, "tuned_candidates", lambda *_: iter(()))
    found = judged_candidates(PROBLEM, people, 0, limit, lean_on_friction=False).judged
    best = best_of(found)
    assert best.safety == 0
    assert 0.75 * held < static_stiffness_n_per_m(best.coupling) / limit.stiffness_n_per_m < held


@pytest.mark.thorough
@pytest.mark.parametrize(("law", "held", "best_of_all"), [(0.46, 0.57, 0.56), (0.46, 0.47, 0.44)])
def test_springs_between_a_law_and_what_they_do_not_hold_are_tried(law, held, best_of_all, monkeypatch):
    """Springs were looked at at 0.45 and 0.6 of their limit; what the others hold lies between."""
    people = people_of(PROBLEM.hands, HANDS)
    limit = stiffest_wall(PROBLEM.device, with_released(hand_corners(PROBLEM.hands)))
    plainly = min(WALL, limit.stiffness_n_per_m)
    gains = Gains(0.0, spring_before(PROBLEM, law * plainly))
    feedback = StateFeedback(((1.0,),), (0.0,), (1.0,), (1.0,), (0,), 0)
    behind = Coupling.constant(PROBLEM, gains, "robust", Runtime(state_feedback=feedback))

    def rests(coupling, most):
        springs = coupling.runtime.state_feedback is None and static_stiffness_n_per_m(coupling) >= most * plainly
        everybody = HANDS - 1 if springs else HANDS
        return trial(everybody, everybody, everybody)

    monkeypatch.setattr(_evaluate, "try_coupling", lambda coupling, *_, **__: rests(coupling, 0.9))
    monkeypatch.setattr(_evaluate, "try_on_devices", lambda coupling, *_, **__: rests(coupling, held))
    monkeypatch.setattr(_evaluate, "deployable", lambda _: SimpleNamespace(passed=True))
    monkeypatch.setattr(_rank, "likely_provable", lambda left: left)
    monkeypatch.setattr(_evaluate, "likeliest", lambda alternatives, *_, **__: (alternatives, True))
    monkeypatch.setattr(_stages, "_behind_laws", lambda evaluator, *_, **__: evaluator.ask([[behind]], "laws"))
    monkeypatch.setattr(_stages, "tuned_candidates", lambda *_: iter(()))
    found = judged_candidates(PROBLEM, people, 0, limit, lean_on_friction=False).judged
    best = best_of(found)
    assert best.safety == 0
    assert static_stiffness_n_per_m(best.coupling) / plainly == pytest.approx(best_of_all, rel=0.03)


@pytest.mark.parametrize("free", [10, 4])
def test_rest_by_friction_is_enough_only_for_who_leans_on_it(free):
    one = replace(judged(0, 0.9, 10, 10, 10), others=trial(10, free, 10))
    assert one.complete(lean_on_friction=True)
    assert one.complete(lean_on_friction=False) == (free == 10)


def test_a_vibration_that_only_others_feel_counts():
    one = judged(0, 0.9, 10, 10, 10)
    assert one.quiet
    assert not replace(one, others=trial(10, 10, 7)).quiet
    assert replace(one, others=trial(10, 10, 9)).quiet


@pytest.mark.thorough
def test_what_is_best_is_confirmed_though_nobody_rests_without_friction(monkeypatch):
    people = people_of(PROBLEM.hands, HANDS)
    limit = stiffest_wall(PROBLEM.device, with_released(hand_corners(PROBLEM.hands)))
    monkeypatch.setattr(_evaluate, "try_coupling", lambda *_, **__: trial(10, 0, 10))
    monkeypatch.setattr(_evaluate, "try_on_devices", lambda *_, **__: trial(10, 0, 10))
    monkeypatch.setattr(_rank, "likely_provable", lambda left: left)
    monkeypatch.setattr(_generate, "why_no_law", lambda *_: "springs and dampers alone")
    monkeypatch.setattr(_stages, "tuned_candidates", lambda *_: iter(()))
    found = judged_candidates(PROBLEM, people, 0, limit, lean_on_friction=False).judged
    assert best_of(found).safety == 1
    assert best_of(found).others is not None


@pytest.mark.thorough
def test_hands_are_dealt_out_to_devices_and_told_in_their_own_order():
    problem = avc.load_problem("spring").changed(device={"coulomb_friction_n": 0.1, "max_force_n": 1.0})
    coupling = Coupling.constant(problem, Gains(0.0, 500.0, 0.5), "x")
    people, device = people_of(problem.hands, 7), problem.device
    devices = [device, *(device_with(device, values) for values in ({"mass_kg": 0.3}, {"coulomb_friction_n": 0.0}))]
    every = try_on_devices(coupling, people, devices, seed=5)
    assert (every.hands, every.devices, every.seed) == (7, 3, 5)
    for place, one in enumerate(devices):
        alone = try_coupling(replace(coupling, problem=problem.changed(device=one)), people)
        assert len(alone.to_dict()) == len(every.to_dict()) > 1
        for name in set(alone.to_dict()) - {"hand"}:
            values = alone.to_dict()[name]
            np.testing.assert_array_equal(every.to_dict()[name][place::3], values[place::3])
        assert set(alone.effects) <= set(every.effects)


def test_an_observer_meets_devices_whose_delay_it_does_not_look_over():
    problem = avc.load_problem("spring").changed(device={"encoder_resolution_m": 2e-5, "delay_samples": 1})
    coupling = Coupling.constant(problem, Gains(0.0, 500.0, 0.5), "x", Runtime(observer_mass_kg=0.2))
    people, device = people_of(problem.hands, 6), problem.device
    late = device_with(device, {"delay_samples": 1.6, "encoder_resolution_m": 5e-5})
    every = try_on_devices(coupling, people, [device, late])
    assert every.hands == 6
    np.testing.assert_array_equal(every.vibration[::2], try_coupling(coupling, people).vibration[::2])


def test_who_confirms_it_does_so_on_devices_all_over_the_declared_ranges():
    problem = avc.load_problem("spring").changed(device={"range": {"delay_samples": [0.0, 3.0]}})
    devices = _evaluate._devices(problem.device, 0)
    assert devices[0] == problem.device
    assert {one.delay_samples for one in devices[1:]} >= {0.0, 3.0}
    assert len(devices) == 16
    assert len(_evaluate._devices(avc.load_problem("spring").device, 0)) == 1


def test_a_law_is_made_for_the_coarsest_encoder_of_the_declared_range():
    device, wide = avc.load_problem("reference-r1").device, {"encoder_resolution_m": [1e-5, 6e-5]}
    hands = avc.load_problem("reference-r1").hands
    ranged = avc.load_problem("reference-r1").changed(device={"range": wide}).device
    zones = [Space(one, hands).law(Space(one, hands).starts[0], 3000.0).dead_zone_m for one in (device, ranged)]
    assert zones[1] / zones[0] == pytest.approx(6e-5 / device.encoder_resolution_m)
