"""Tuned constant gains: stable with hands never seen, no better ones nearby, honest about the budget."""

import numpy as np
import pytest
from scene_reference import scene_problem

import avc_casadi as avc
from avc_casadi import UnsupportedError
from avc_casadi.coupling import Gains, Status
from avc_casadi.design.constant import Budget, tune_static
from avc_casadi.loop import hand_set, loop_at
from avc_casadi.scene import simulate_batch
from avc_casadi.scene.effects import Hand
from avc_casadi.stability import frozen_parts, linear_stability

SMALL = Budget(series_points=15, damped_points=9, refinements=2, scenes=8, hands=16)


def problem(structure="series", contact=0.0, objective="magnitude", effects=('kind = "hand"', 'kind = "wall"')):
    base = scene_problem(effects, scene="duration_s = 1.5\n")
    coupling = {
        "structure": structure,
        "damping_ns_per_m": (0.0, 300.0),
        "stiffness_n_per_m": (0.0, 1e6),
        "contact_damping_ns_per_m": (0.0, contact),
    }
    changes = {
        "coupling": base.coupling.model_copy(update=coupling),
        "realism": base.realism.model_copy(update={"objective": objective}),
        "frequency": base.frequency.model_copy(update={"start_hz": 0.2, "stop_hz": 50.0, "points": 40}),
    }
    return base.model_copy(update=changes)


def error(case, gains):
    loop = loop_at(case, case.frequencies_hz())
    perceived = loop.perceived(*vars(gains).values())
    if case.realism.objective == "complex":
        return np.sqrt(np.mean(np.abs(perceived / loop.target - 1) ** 2))
    return np.sqrt(np.mean((np.abs(perceived) / np.abs(loop.target) - 1) ** 2))


@pytest.fixture(scope="module")
def series():
    return problem(), tune_static(problem(), SMALL)


@pytest.fixture(scope="module")
def damped():
    case = problem("damped", 200.0, "complex")
    return case, tune_static(case, SMALL)


@pytest.mark.parametrize("name", ["series", "damped"])
def test_tuned_gains_hold_for_hands_never_seen(name, request):
    case, found = request.getfixturevalue(name)
    draw = np.random.default_rng(99).uniform
    hands = Hand(draw(0.05, 0.3, 200), draw(3, 20, 200), draw(200, 800, 200))
    share = simulate_batch(case, hands, found.gains).stable.mean()
    assert share > 0.97
    assert simulate_batch(case, hand_set(case.hands, draws=8), found.gains).stable.all()
    assert found.error == pytest.approx(error(case, found.gains), rel=1e-9)


def test_half_of_the_wall_is_what_constant_series_gains_reach(series):
    case, found = series
    k = found.gains.stiffness_n_per_m
    assert 0.4 < k / (k + case.environment.stiffness_n_per_m) < 0.55


def test_damping_injection_reaches_more_than_series(series, damped):
    assert damped[1].gains.contact_damping_ns_per_m > 10
    assert error(damped[0], damped[1].gains) < error(damped[0], series[1].gains)


def test_gains_beyond_the_tuned_ones_are_unstable_or_farther_off(series):
    case, found = series
    hands = hand_set(case.hands, draws=8)
    for b in (0.8, 1.0, 1.25):
        for k in (1.3, 2.0):
            beyond = Gains(b * found.gains.damping_ns_per_m, k * found.gains.stiffness_n_per_m)
            linear = linear_stability(case.device, frozen_parts(case, *list(vars(beyond).values())[:2]), 0.0, hands)
            rests = linear.stable[0] and simulate_batch(case, hands, beyond).stable.all()
            assert not rests or error(case, beyond) > found.error


def test_the_budget_is_kept_and_stated(series):
    _, found = series
    assert found.tried == SMALL.series_points**2 + SMALL.refinements * 7**2
    assert found.linear <= found.tried
    assert found.simulated <= (2 + SMALL.refinements) * SMALL.scenes
    assert found.hands == SMALL.hands
    for words in (str(found.tried), str(found.simulated), "16 hands (seed 0)"):
        assert words in found.sentence()


def test_the_same_seed_gives_the_same_gains(series):
    assert tune_static(problem(), SMALL) == series[1]


def test_a_box_without_stable_gains_is_said_to_have_none():
    case = problem()
    box = case.coupling.model_copy(update={"stiffness_n_per_m": (5e5, 1e6), "damping_ns_per_m": (0.0, 1.0)})
    found = tune_static(case.model_copy(update={"coupling": box}), SMALL)
    assert found.gains is None
    assert "no constant gains" in found.sentence()


def test_a_pinned_box_is_judged_as_it_is():
    case = problem()
    box = case.coupling.model_copy(update={"stiffness_n_per_m": (7e3, 7e3), "damping_ns_per_m": (10.0, 10.0)})
    found = tune_static(case.model_copy(update={"coupling": box}), SMALL)
    assert (found.gains.damping_ns_per_m, found.gains.stiffness_n_per_m) == pytest.approx((10.0, 7e3), rel=1e-12)


def test_solve_gives_a_table_of_equal_rows():
    case = problem()
    box = case.coupling.model_copy(update={"stiffness_n_per_m": (7e3, 7e3), "damping_ns_per_m": (10.0, 10.0)})
    table = avc.solve(case.model_copy(update={"coupling": box}), "static-tuned")
    assert table.method == "static-tuned"
    assert set(table.status) == {Status.SOLVED}
    assert np.ptp(table.stiffness_n_per_m) == 0
    assert "hands" in table.notes[0]


def test_another_kind_of_hand_is_refused_by_name():
    with pytest.raises(UnsupportedError, match="stylus-hand"):
        tune_static(problem(effects=('kind = "stylus-hand"', 'kind = "wall"')), SMALL)


def test_the_margin_is_kept_in_reserve():
    case = problem()
    stability = case.stability.model_copy(update={"margin_ns_per_m": 1.0})
    careful = tune_static(case.model_copy(update={"stability": stability}), SMALL)
    bold = tune_static(case, SMALL)
    hands = hand_set(case.hands, draws=SMALL.hands)

    def stable_without(damping, found):
        parts = frozen_parts(case, found.gains.damping_ns_per_m, found.gains.stiffness_n_per_m)
        return linear_stability(case.device, parts, 0.0, hands, -damping).stable.all()

    assert stable_without(1.0, careful)
    assert careful.error >= bold.error
