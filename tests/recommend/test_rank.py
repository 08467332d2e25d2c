"""The choice among judged couplings is a rule told in one sentence, and hands that did not choose test it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import regulator
from avc_casadi.model.corners import device_with
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.evaluator import Evaluator
from avc_casadi.recommendation.rank import Judged, best_of
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
    assert near.distance < quiet.distance - 0.1
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
            if mine == quiet:
                assert best.distance <= one.distance + 0.1


@pytest.mark.parametrize("free", [10, 4])
def test_rest_by_friction_is_enough_only_for_who_leans_on_it(free):
    one = replace(judged(0, 0.9, 10, 10, 10), others=trial(10, free, 10))
    assert one.complete(lean_on_friction=True)
    assert one.complete(lean_on_friction=False) == (free == 10)


def test_an_observer_meets_devices_whose_delay_it_does_not_look_over():
    problem = avc.load_problem("spring").changed(device={"encoder_resolution_m": 2e-5, "delay_samples": 1})
    coupling = Coupling.constant(problem, Gains(0.0, 500.0, 0.5), "x", Runtime(observer_mass_kg=0.2))
    people, device = people_of(problem.hands, 6), problem.device
    late = device_with(device, {"delay_samples": 1.6, "encoder_resolution_m": 5e-5})
    every = try_on_devices(coupling, people, [device, late])
    assert every.hands == 6
    np.testing.assert_array_equal(every.vibration[::2], try_coupling(coupling, people).vibration[::2])


def test_hands_that_had_no_part_in_the_choice_can_refute_it():
    """A rigid wall without a damper vibrates in any hand; its first trial is made up."""
    evaluator = Evaluator(PROBLEM, people_of(PROBLEM.hands, HANDS), 0, stiffest=True)
    lucky = Judged(Coupling.constant(PROBLEM, Gains(0.0, 1e8), "x"), trial(10, 10, 10), 0)
    soft = Gains(0.0, spring_before(PROBLEM, 0.005 * WALL), 3.0)
    honest = Judged(Coupling.constant(PROBLEM, soft, "x"), trial(10, 10, 10), 1)
    evaluator.judged = [lucky, honest]
    best = evaluator.best()
    assert best.coupling is honest.coupling
    assert best.others.hands == 2 * HANDS
    refuted = next(one for one in evaluator.judged if one.coupling is lucky.coupling)
    assert refuted.safety == 2


def test_a_law_is_made_for_the_coarsest_encoder_of_the_declared_range():
    stated = avc.load_problem("reference-r1")
    ranged = stated.changed(device={"range": {"encoder_resolution_m": [1e-5, 6e-5]}})
    zones = [regulator(one.device, one.hands, 3000.0, 0).dead_zone_m for one in (stated, ranged)]
    assert zones[1] / zones[0] == pytest.approx(6e-5 / stated.device.encoder_resolution_m)
