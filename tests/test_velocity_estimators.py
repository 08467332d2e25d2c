"""Estimators of velocity against their papers' algorithms in plain Python, on lines, at rest, and in scenes."""

import casadi as ca
import numpy as np
import plain_velocity
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_cases import HAND, QUICK
from scene_reference import scene_problem

import avc_casadi as avc
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.model.velocity import VELOCITY_ESTIMATORS, Foaw, Kalman, velocity_estimator
from avc_casadi.model.velocity_keys import VelocityFilterEffect

T, STEP = 1e-3, 2e-5
PLAIN = {
    "foaw": lambda start: plain_velocity.Foaw(T, start, STEP),
    "foaw-end": lambda start: plain_velocity.Foaw(T, start, 3e-5, 9, "end"),
    "levant": lambda start: plain_velocity.Levant(T, start, 40.0),
    "levant-explicit": lambda start: plain_velocity.Levant(T, start, 40.0, "explicit"),
    "kalman": lambda start: plain_velocity.Kalman(T, start, 5.0, STEP / 12**0.5),
}
KEYS = {
    "foaw": {},
    "foaw-end": {"band_m": 3e-5, "window_samples": 9, "fit": "end"},
    "levant": {"acceleration_m_per_s2": 40.0, "position": "estimated"},
    "levant-explicit": {"acceleration_m_per_s2": 40.0, "discretisation": "explicit", "position": "estimated"},
    "kalman": {"acceleration_m_per_s2": 5.0, "position": "estimated"},
}


def estimator(name, **keys):
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "sample_time_s": T, "encoder_resolution_m": STEP}
    wall = {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1e3}
    problem = avc.Problem.model_validate(
        {"device": device, "environment": wall, "scene": {"effects": [{"kind": "wall"}, {"kind": "encoder"}]}}
    )
    return velocity_estimator(problem, VelocityFilterEffect(estimator=name.partition("-")[0], **keys))


def run(found, positions):
    """Velocities and positions of an estimator that begins at rest at the first position."""
    state = found.initial(float(positions[0]))
    symbols = {name: ca.SX.sym(name) for name in state}
    x = ca.SX.sym("x")
    following, velocity, position = found.step(x, symbols)
    step = ca.Function(
        "step", [ca.vertcat(*symbols.values()), x], [ca.vertcat(*following.values()), velocity, position]
    )
    kept, rows = ca.DM(list(state.values())), []
    for value in positions:
        kept, *row = step(kept, value)
        rows.append([float(one) for one in row])
    return np.array(rows).T


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(sorted(PLAIN)), st.floats(0.5, 40.0), st.floats(0.05, 0.9), st.floats(0, 1), st.booleans())
def test_each_is_its_papers_algorithm(name, hz, travel_mm, phase, counted):
    times = T * np.arange(150)
    way = 1e-3 * travel_mm * np.sin(2 * np.pi * (hz * times + phase))
    way = STEP * np.round(way / STEP) if counted else way
    plain = PLAIN[name](float(way[0]))
    expected = np.array([(plain(value), plain.position) for value in way.tolist()]).T
    velocity, position = run(estimator(name, **KEYS[name]), way)
    np.testing.assert_allclose(velocity, expected[0], rtol=0, atol=1e-7 * max(1.0, np.abs(expected[0]).max()))
    np.testing.assert_allclose(position, expected[1], rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["foaw", "foaw-end", "levant", "kalman"])
@pytest.mark.parametrize("speed", [0.03, -0.4])
def test_a_ramp_gives_its_slope_and_a_standing_device_none(name, speed):
    found = estimator(name, **KEYS[name])
    still = 2e-3 * np.ones(50)
    np.testing.assert_array_equal(run(found, still)[0], 0.0)
    ramp, _ = run(found, np.concatenate([still, 2e-3 + speed * T * np.arange(1, 2000)]))
    np.testing.assert_allclose(ramp[-100:], speed, rtol=1e-9)


def test_the_explicit_step_chatters_by_what_is_stated():
    ramp, _ = run(estimator("levant", **KEYS["levant-explicit"]), 0.1 * T * np.arange(3000))
    assert 0.2 * 1.1 * 40.0 * T < np.ptp(ramp[-500:]) < 4 * 1.1 * 40.0 * T
    assert ramp[-500:].mean() == pytest.approx(0.1, abs=1.1 * 40.0 * T)


@given(st.floats(1e-3, 1e4), st.floats(-1, 1))
def test_the_poles_of_the_kalman_filter_are_its_velocity(acceleration, sign):
    keys = {"acceleration_m_per_s2": acceleration, "noise_rms_m": 1e-5}
    whole, poles = estimator("kalman", **keys, position="estimated"), estimator("kalman", **keys).poles
    way = 1e-3 * np.cumsum(np.sin(np.arange(80) ** 1.3 + sign))
    velocity, _ = run(whole, way)
    rates = [0.0, 0.0]
    for before, value in zip(np.append(way[0], way), way, strict=False):
        new = (1 + sum(poles)) * (value - before) / T - poles[0] * rates[-1] - poles[1] * rates[-2]
        rates.append(new)
    np.testing.assert_allclose(rates[2:], velocity, rtol=1e-6, atol=1e-9)


def test_an_encoder_at_rest_moves_foaw_less_than_the_difference():
    jump = np.where(np.arange(60) < 30, 0.0, STEP)
    velocity, _ = run(estimator("foaw"), jump)
    assert np.abs(velocity).max() < 0.2 * STEP / T


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"estimator": "first-order"}, "has no cutoff_hz"),
        ({"estimator": "foaw", "cutoff_hz": 50.0}, 'has cutoff_hz, no key of estimator "foaw"; allowed: band_m'),
        ({"estimator": "kalmann"}, 'did you mean "kalman"'),
        ({"estimator": "foaw", "window_samples": 1}, "allowed: an integer 2 to 64"),
        ({"estimator": "levant", "acceleration_m_per_s2": 0.0}, "acceleration_m_per_s2"),
        ({"estimator": "levant"}, "acceleration_m_per_s2: is missing; allowed: above 0 here, or device.max_force_n"),
        ({"estimator": "foaw"}, "band_m: is missing; allowed: above 0 here, or an encoder in the scene"),
        ({"estimator": "kalman", "acceleration_m_per_s2": 3.0}, "noise_rms_m: is missing"),
        ({"estimator": "kalman"}, "has no acceleration_m_per_s2"),
    ],
)
def test_what_is_missing_or_not_its_own_is_told(keys, told):
    free = scene_problem((HAND, 'kind = "wall"')).changed(device={"max_force_n": None})
    effects = [{"kind": "wall"}, {"kind": "velocity-filter", **keys}]
    with pytest.raises(avc.InputError) as caught:
        simulate(free.changed(scene={"effects": effects}), NO_COUPLING)
    assert told in str(caught.value)


def test_a_coupling_between_needs_a_linear_estimator():
    effects = (HAND, 'kind = "wall"', 'kind = "encoder"', 'kind = "velocity-filter"\nestimator = "foaw"')
    with pytest.raises(avc.InputError, match="the deflection of a coupling is none"):
        simulate(scene_problem(effects, motion=QUICK), Gains(10.0, 7e3))


def test_zwidth_takes_the_linear_ones_and_says_what_it_leaves_out():
    text = (
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\nencoder_resolution_m = 2e-5\nmax_force_n = 5.0\n"
        "[environment]\nstiffness_n_per_m = 1e3\ndamping_ns_per_m = 2.0\n[scene]\n"
        "[[scene.effects]]\nkind = 'encoder'\n[[scene.effects]]\nkind = 'velocity-filter'\nestimator = '{}'\n"
    )
    plain = avc.zwidth(avc.parse_problem(text.partition("[scene]")[0], name="p"))
    for name in VELOCITY_ESTIMATORS:
        keys = {"first-order": "cutoff_hz = 80.0\n", "kalman": "acceleration_m_per_s2 = 5.0\n"}.get(name, "")
        region = avc.zwidth(avc.parse_problem(text.format(name) + keys, name="p"))
        linear = name in {"first-order", "kalman"}
        same = np.array_equal(region.curves[-1].stiffness_n_per_m, plain.curves[-1].stiffness_n_per_m, equal_nan=True)
        assert same != linear
        said = "with the velocity filter" if linear else f"not by the scene's estimator {name}"
        assert all(said in curve.claim for curve in region.curves)
        assert ("scene.effects: velocity-filter" in region.used) == linear
        assert any(f"estimator {name}: not linear" in line for line in region.not_used) != linear


def test_defaults_are_those_that_are_told():
    foaw, kalman = estimator("foaw"), estimator("kalman", acceleration_m_per_s2=5.0)
    assert isinstance(foaw, Foaw)
    assert (foaw.band_m, foaw.window_samples, foaw.best) == (STEP, 15, True)
    assert isinstance(kalman, Kalman)
    assert kalman == estimator("kalman", acceleration_m_per_s2=5.0, noise_rms_m=STEP / 12**0.5)
