"""Tuned constant gains: stable with hands never seen, no better ones nearby, honest about what was tried."""

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi.design.constant.static_tuned import Budget, tune_static
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand, hand_set
from avc_casadi.model.problem import Frequency
from avc_casadi.paper.loop import loop_at
from avc_casadi.simulation.scene import simulate_batch

SMALL = Budget(draws=8)
COARSE = 'kind = "encoder"\nresolution_m = 5e-6'


def problem(structure="series", contact=0.0, objective="magnitude", effects=('kind = "hand"', 'kind = "wall"')):
    base = scene_problem(effects, scene="duration_s = 1.5\n")
    coupling = {
        "structure": structure,
        "damping_ns_per_m": (0.0, 300.0),
        "stiffness_n_per_m": (0.0, 1e6),
        "contact_damping_ns_per_m": (0.0, contact),
    }
    frequency = Frequency(start_hz=0.2, stop_hz=50.0, points=40)
    return base.changed(coupling=coupling, realism={"objective": objective}, frequency=frequency)


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


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["series", "damped"])
def test_tuned_gains_hold_for_hands_never_seen(name, request):
    case, found = request.getfixturevalue(name)
    draw = np.random.default_rng(99).uniform
    hands = Hand(draw(0.05, 0.3, 200), draw(3, 20, 200), draw(200, 800, 200))
    share = simulate_batch(case, hands, found.gains).stable.mean()
    assert share > 0.97
    assert simulate_batch(case, hand_set(case.hands, draws=8), found.gains).stable.all()
    assert found.error == pytest.approx(error(case, found.gains), rel=1e-9)


@pytest.mark.thorough
def test_damping_injection_reaches_more_than_series(series, damped):
    assert damped[1].gains.contact_damping_ns_per_m > 10
    assert error(damped[0], damped[1].gains) < error(damped[0], series[1].gains)


def test_gains_beyond_the_tuned_ones_are_unstable_or_farther_off(series):
    case, found = series
    hands = hand_set(case.hands, draws=8)
    for b in (0.8, 1.0, 1.25):
        for k in (1.3, 2.0):
            beyond = Gains(b * found.gains.damping_ns_per_m, k * found.gains.stiffness_n_per_m)
            parts = frozen_parts(case, *list(vars(beyond).values())[:2])
            linear = linear_stability(case.device, parts, 0.0, hands, -found.reserve_ns_per_m)
            rests = linear.stable[0] and simulate_batch(case, hands, beyond).stable.all()
            assert not rests or error(case, beyond) > found.error


@pytest.mark.thorough
def test_where_somebody_does_not_rest_the_reserve_is_raised():
    case = problem("damped", 200.0, "complex", effects=('kind = "hand"', 'kind = "wall"', COARSE))
    found = tune_static(case, SMALL)
    assert found.raised > 0
    hands = hand_set(case.hands, draws=SMALL.draws)
    assert simulate_batch(case, hands, found.gains).stable.all()
    before = case.changed(stability={"margin_ns_per_m": found.reserve_ns_per_m / 1.5})
    least = tune_static(before, Budget(draws=8, raises=0))
    assert least.gains is None
    assert f"{least.rested} of 16" in least.sentence()


@pytest.mark.thorough
def test_the_margin_is_kept_in_reserve():
    case = problem()
    careful = tune_static(case.changed(stability={"margin_ns_per_m": 4.0}), SMALL)
    bold = tune_static(case.changed(stability={"margin_ns_per_m": 2.0}), SMALL)
    hands = hand_set(case.hands)

    def stable_without(damping, found):
        parts = frozen_parts(case, found.gains.damping_ns_per_m, found.gains.stiffness_n_per_m)
        return linear_stability(case.device, parts, 0.0, hands, -damping).stable.all()

    assert (careful.reserve_ns_per_m, bold.reserve_ns_per_m) == (4.0, 2.0)
    assert stable_without(4.0, careful)
    assert stable_without(2.0, bold)
    assert not stable_without(4.0, bold)
    assert careful.error > bold.error
