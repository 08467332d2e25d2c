"""What a robust law is weighed by: against eigenvalues of every loop, laws stepped in time and every share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.passivity.rendered_impedance import dead_zone_gain
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust import solve
from avc_casadi.design.robust.goal import BAND_HZ, DECAY_PER_S, cost_of, distance, responses
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops, why_no_law
from avc_casadi.loops.wall import Laws, frozen_rendering, observed_wall
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.shaken import shaken

STIFFNESS = 3000.0
PROBLEM = avc.load_problem("reference-r1").changed(
    environment={"stiffness_n_per_m": STIFFNESS, "damping_ns_per_m": 0.0}
)
T = PROBLEM.device.sample_time_s
SPACE, LOOPS = Space(PROBLEM.device, PROBLEM.hands), Loops.of(PROBLEM)
RENDERING = frozen_rendering(PROBLEM, 0.0, 1e12)
LAWS = [SPACE.law(start, STIFFNESS) for start in SPACE.starts]
SOFT, DAMPED = 1, 2


def test_to_settle_four_times_as_long_is_worth_a_third_of_the_stiffness():
    a_third = abs(np.log(1 - 1 / 3))
    assert distance(0.2, 4.0, 1.0) - distance(0.2, 1.0, 1.0) == pytest.approx(a_third, rel=0.05)
    assert distance(0.2, 0.01, 1.0) == distance(0.2, 0.25, 1.0) == pytest.approx(0.2)


def test_a_share_at_rest_is_worth_a_fifth_of_the_same_share_in_motion():
    softer_in_motion = distance(0.2 + np.log(2), 0.25, 1.0) - distance(0.2, 0.25, 1.0)
    assert distance(0.2, 0.25, 0.5) - distance(0.2, 0.25, 1.0) == pytest.approx(softer_in_motion / 5)
    assert distance(0.2, 0.25, 1.01) == distance(0.2, 0.25, 1.0)
    assert distance(0.2, 0.25, 0.0) < np.inf


def test_the_share_at_rest_is_that_of_the_wall():
    for wall, share in (({"stiffness_n_per_m": 2 * STIFFNESS}, 0.5), ({"stiffness_n_per_m": 0.0}, 1.0)):
        loops = Loops.of(PROBLEM.changed(environment=wall | {"damping_ns_per_m": 5.0}))
        assert cost_of(LAWS[DAMPED], RENDERING, loops).facts["static_share"] == pytest.approx(share)


def radius(plants, law, shares=(1.0,)):
    return np.abs(np.linalg.eigvals(observed_wall(plants, Laws.of(law), RENDERING, shares)[0])).max()


def test_the_radius_of_a_law_is_that_of_all_hands_and_of_the_released_device():
    cost = cost_of(LAWS[DAMPED], RENDERING, LOOPS)
    held, released = (radius(plants, LAWS[DAMPED]) for plants in (LOOPS.varied, LOOPS.free))
    assert released > held
    assert cost.radius == pytest.approx(released, abs=1e-12)
    every_share = radius(LOOPS.nominal, LAWS[DAMPED], tuple(DECAY_PER_S))
    assert cost.radius_any_share == pytest.approx(every_share, abs=1e-12)
    assert cost.holds


def test_a_law_that_lets_the_released_device_or_some_share_of_the_innovation_grow_holds_no_wall():
    late = Loops.of(PROBLEM.changed(device={"delay_samples": 4}))
    for part, shares in (("free", (1.0,)), ("nominal", tuple(DECAY_PER_S))):
        grows = np.log(radius(getattr(late, part), LAWS[DAMPED], shares)) / T
        assert grows > 0
        cost = cost_of(LAWS[DAMPED], RENDERING, replace(LOOPS, **{part: getattr(late, part)}))
        assert not cost.holds
        assert cost.lacks_per_s == pytest.approx(grows) or cost.lacks_per_s == np.inf


def test_of_hands_on_a_stylus_and_fingertips_those_count_that_decay_least():
    stylus, fingertip = (
        cost_of(LAWS[DAMPED], RENDERING, replace(LOOPS, beside=(one, one))).total for one in LOOPS.beside
    )
    assert stylus != fingertip
    assert cost_of(LAWS[DAMPED], RENDERING, LOOPS).total == max(stylus, fingertip)


def test_the_sensitivity_of_any_share_is_the_largest_of_laws_with_less_of_their_innovation():
    laws, buzz = Laws.of(LAWS[SOFT]), LOOPS.frequency_hz > 40.0
    found = responses(laws, RENDERING, LOOPS)
    less = [replace(laws, innovation=share * laws.innovation) for share in np.linspace(1e-3, 1.0, 400)]
    each = [responses(one, RENDERING, LOOPS).sensitivity[..., buzz] for one in less]
    np.testing.assert_allclose(found.sensitivity_any_share, np.max(each, axis=0), rtol=5e-3)
    assert found.sensitivity_any_share.max() > 1.5 * found.sensitivity[..., buzz].max()


def force_over_position(law, hz):
    """Lead the measured position of a law along a sine, without its dead zone; return force over K times position."""
    a, b, gain, weight = (np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback))
    time = T * np.arange(round(6.0 / T))
    state, force = np.zeros(len(b)), np.empty(len(time))
    for at, x in enumerate(np.sin(2 * np.pi * hz * time)):
        state = state + gain * (x - state[law.measures])
        force[at] = STIFFNESS * (weight @ state)
        state = a @ state + b * force[at]
    last = slice(round(4.0 / T), None)
    wave = np.exp(-2j * np.pi * hz * time[last])
    return 2j * (force[last] @ wave) / wave.size / STIFFNESS


def test_a_law_gives_way_as_it_does_in_time():
    law = LAWS[DAMPED]
    found = cost_of(law, RENDERING, LOOPS).facts
    assert found["softness_3hz"] == pytest.approx(abs(force_over_position(law, 3.0) - 1), rel=0.02)
    assert found["softness_10hz"] == pytest.approx(abs(force_over_position(law, 10.0) - 1), rel=0.02)


@pytest.mark.parametrize(("encoder_m", "off"), [(0.0, 1e-3), (2e-5, 0.02), (1e-4, 0.05), (4e-4, 0.15)])
def test_the_search_aims_at_the_mismatch_that_a_shaken_handle_measures(encoder_m, off):
    """By formula in the search, in the scene where it is told; of the coarsest encoder two steps are shaken."""
    problem = PROBLEM.changed(device={"encoder_resolution_m": encoder_m})
    law = Space(problem.device, problem.hands).law(SPACE.starts[DAMPED], STIFFNESS)
    coupling = Coupling.constant(problem, Gains(0.0, 1e12), "robust", Runtime(state_feedback=law))
    measured = np.sqrt(np.mean(shaken(coupling, STIFFNESS, BAND_HZ).mismatch ** 2))
    assert cost_of(law, RENDERING, Loops.of(problem)).facts["mismatch"] == pytest.approx(measured, rel=off)


@pytest.mark.parametrize("loop", [0.0, 5.0, 40j, -0.3 + 2j])
@pytest.mark.parametrize("amplitude", [1.2, 4.0, 50.0])
def test_the_gain_of_a_dead_zone_is_that_of_the_sine_that_reaches_it(loop, amplitude):
    half = 1.0
    gain = float(dead_zone_gain(np.array([loop], dtype=complex), amplitude, half)[0])
    size = amplitude / abs(1 + gain * loop)
    wave = np.sin(2 * np.pi * (np.arange(100_000) + 0.5) / 100_000)
    passed = np.sign(wave) * np.maximum(np.abs(size * wave) - half, 0.0)
    assert gain == pytest.approx(2 * np.mean(passed * wave) / size, abs=1e-6)


def test_a_law_that_is_too_soft_at_10_hz_is_looked_at_no_further():
    cost = cost_of(LAWS[SOFT], RENDERING, LOOPS)
    assert cost.facts["softness_3hz"] < 0.9
    assert cost.facts["softness_10hz"] > 1.0
    assert cost.radius == np.inf


def test_the_filter_follows_readings_as_far_as_it_believes_in_what_moves_the_device():
    """Next to no noise of the process: readings hardly count; far more than the encoder's: they are the state."""
    noises = np.array([knob.name.startswith(("walk", "force")) for knob in SPACE.knobs])
    low, high = SPACE.bounds
    start = SPACE.starts[0]
    points = [np.where(noises, low, start), start, np.where(noises, high, start)]
    gains = [law.innovation[law.measures] for law in (SPACE.law(point, STIFFNESS) for point in points)]
    assert gains[0] < 0.05
    assert gains[0] < gains[1] < gains[2] < 1
    assert gains[2] > 0.99


def test_a_law_may_believe_in_what_the_lightest_hand_and_the_device_weigh():
    wide = PROBLEM.changed(hands={"mass_kg": (0.02, 5.0)})
    mass = next(knob for knob in Space(wide.device, wide.hands).knobs if knob.name == "believed mass")
    assert mass.low < wide.device.mass_kg + 0.02


@pytest.mark.parametrize("place", range(3))
def test_of_many_loops_the_one_that_is_nearest_to_growing_is_kept(place):
    kept = LOOPS.hardest(LAWS[place], RENDERING)
    assert len(kept.varied.a) < len(LOOPS.varied.a)
    for some, every in ((kept.varied, LOOPS.varied), *zip(kept.beside, LOOPS.beside, strict=True)):
        assert radius(some, LAWS[place]) == radius(every, LAWS[place])
    shares = tuple(DECAY_PER_S)
    assert radius(kept.nominal, LAWS[place], shares) == radius(LOOPS.nominal, LAWS[place], shares)


def test_of_the_walls_that_searches_reach_the_stiffest_is_refined_and_none_begins_beyond_the_wanted_one(monkeypatch):
    wanted, asked = 100.0, []
    reached = iter([[20.0, 60.0], [70.0, 90.0], [30.0]])

    def climbed(_, __, walls):
        asked.append(walls)
        return [SimpleNamespace(stiffness_n_per_m=wall) for wall in next(reached)]

    monkeypatch.setattr(solve, "continuation", climbed)
    monkeypatch.setattr(solve, "refined", lambda _, step: step)
    softer = PROBLEM.changed(environment={"stiffness_n_per_m": wanted})
    assert solve._stiffest(softer, solve.SILENT).stiffness_n_per_m == 90.0
    assert asked == [(wanted, wanted)] * 3


def test_a_device_whose_force_comes_too_late_has_no_law_and_says_so():
    late = PROBLEM.changed(device={"delay_samples": 9})
    with pytest.raises(avc.UnsupportedError, match="delay of 9 samples"):
        avc.solve(late, "robust")
    assert not why_no_law(PROBLEM.changed(device={"delay_samples": 8}))
