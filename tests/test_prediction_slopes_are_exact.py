"""A model's prediction: the same compiled and evaluated by CasADi, its slopes those of finite differences.

A fit survives models that run away.
"""

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.identification import run as _run
from avc_casadi.identification.fit import Window, fit
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import Structure
from avc_casadi.simulation import native

VALUES = {
    "mass_kg": 0.11,
    "damping_ns_per_m": 2.1,
    "delay_samples": 1.4,
    "offset_n": 0.01,
    "coulomb_friction_n": 0.35,
    "damping_asymmetry_ns_per_m": 0.1,
    "breakaway_excess_n": 0.15,
    "stribeck_speed_m_per_s": 0.012,
    "resonance.frequency_hz": 150.0,
    "resonance.damping_ratio": 0.04,
    "resonance.mass_ratio": 0.3,
    "amplifier_bandwidth_hz": 200.0,
    "amplifier_damping_ratio": 0.5,
    "stiffness_n_per_m": 3.0,
    "offset_drift_n_per_s": 0.01,
    "backlash_m": 4e-5,
    "dead_zone_n": 0.05,
    "drag_ns2_per_m2": 3.0,
}
MODELS = {
    "rigid": ("base",),
    "friction": ("base", "coulomb", "drift"),
    "current loop": ("base", "coulomb", "amplifier", "loop-damping"),
    "drag behind a dead zone": ("base", "coulomb", "dead-zone", "drag"),
    "all": ("base", "coulomb", "asymmetry", "stribeck", "resonance", "amplifier", "stiffness", "drift", "play"),
}


@pytest.fixture(scope="module")
def predictor():
    random = np.random.default_rng(7)
    truth = Truth(coulomb=0.4, delay=1.3, spring=50.0, encoder=2e-5)
    _, position, force = measured(truth, multisine(random, 0.6, 1e-3, 2.0, 300.0, 2.0), random)
    return Predictor([Record("simulated", 1e-3, position, force)], 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("terms", MODELS.values(), ids=MODELS)
def test_compiled_and_evaluated_agree(predictor, terms, monkeypatch):
    structure = Structure(terms, {}, {"backlash_m": 2e-5})
    search = structure.start(VALUES)
    monkeypatch.setattr(_run, "_WORTH_COMPILING", 0)
    (compiled,) = predictor.predict(structure, search, Observer(40.0))
    monkeypatch.setattr(_run, "compiler", lambda: None)
    monkeypatch.setattr(_run, "_COMPILING", {})
    (evaluated,) = predictor.predict(structure, search, Observer(40.0))
    (alone,) = predictor.predict(structure, search, Observer(40.0), slopes=False)
    np.testing.assert_array_equal(compiled.error_m, evaluated.error_m)
    np.testing.assert_array_equal(alone.error_m, evaluated.error_m)
    np.testing.assert_array_equal(compiled.slopes, evaluated.slopes)
    assert alone.slopes is None


def test_a_compiler_that_does_not_know_the_machine_s_own_vectors_will_do(predictor, monkeypatch):
    structure = Structure(MODELS["friction"], {}, {"backlash_m": 2e-5})
    asked = (structure, structure.start(VALUES), Observer(40.0))
    monkeypatch.setattr(_run, "_WORTH_COMPILING", 0)
    (own,) = predictor.predict(*asked)
    monkeypatch.setattr(native, "_VECTORS", "-march=no-such-machine")
    monkeypatch.setattr(_run, "_COMPILING", {})
    _run._native.cache_clear()
    (common,) = predictor.predict(*asked)
    _run._native.cache_clear()
    np.testing.assert_array_equal(own.error_m, common.error_m)
    np.testing.assert_array_equal(own.slopes, common.slopes)


@pytest.mark.thorough
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("side", ["motor", "handle"])
def test_slopes_are_those_of_differences(predictor, side, order):
    """The observer's gain counts as constant in the slopes: it is all but off here."""
    structure = Structure(MODELS["all"], {}, {"backlash_m": 2e-5}, side, amplifier_order=order)
    assert_slopes(predictor, structure, VALUES)


@pytest.mark.thorough
@pytest.mark.parametrize("delay", np.linspace(1.01, 1.99, 15))
def test_slopes_are_those_of_differences_wherever_in_a_sample_the_force_arrives(predictor, delay):
    """Where one of the times at which friction looks at the velocity leaves the sample, all of them changed places."""
    structure = Structure(MODELS["current loop"], {}, {}, amplifier_order=2)
    bandwidth = VALUES["amplifier_bandwidth_hz"]
    turn = np.pi * bandwidth * 1e-3
    looks = -np.log1p(np.arange(8) / 8 * np.expm1(-turn)) / turn
    # Next to where one of them leaves the sample, on either side.
    near = [*(1 + (1 - looks[1:]) - 1e-4), *(1 + (1 - looks[1:]) + 1e-4)]
    nearest = min(near, key=lambda one: abs(one - delay))
    for place in (delay, nearest):
        assert_slopes(predictor, structure, {**VALUES, "delay_samples": float(place)}, within=0.02)


@pytest.mark.thorough
def test_slopes_by_a_dead_zone_and_by_drag_are_those_of_differences(predictor):
    structure = Structure(MODELS["drag behind a dead zone"], {}, {"dead_zone_n": 0.1})
    assert_slopes(predictor, structure, VALUES, within=0.02)


def assert_slopes(predictor, structure, values, within=1e-3):
    search, still = structure.start(values), Observer(1e-3)
    (found,) = predictor.predict(structure, search, still)
    for index, one in enumerate(structure.free):
        step = np.zeros(search.size)
        step[index] = 1e-5 * max(1.0, abs(search[index]))
        ends = [predictor.predict(structure, search + by * step, still, slopes=False)[0] for by in (1, -1)]
        by_difference = (ends[0].error_m - ends[1].error_m) / (2 * step[index])
        scale = np.abs(found.slopes[:, index]).max()
        # A sample in which the motor stops or goes on at once has a corner; few do.
        apart = np.abs(by_difference - found.slopes[:, index]) / scale
        assert np.quantile(apart, 0.9) < within, one.name


@pytest.mark.parametrize("size", [1e160, np.inf, np.nan])
@pytest.mark.parametrize("where", ["error_m", "slopes"])
@pytest.mark.parametrize("first", [0, 1])
def test_a_fit_survives_models_that_run_away(predictor, size, where, first):
    """Their numbers are finite, but their squares are not; at the start of the search, or later."""
    structure, window = Structure(MODELS["rigid"], {}, {}), Window.of([predictor.records[0].position_m.size], 1e-3)
    asked = 0

    class RunsAway(Predictor):
        def predict(self, *args, **kwargs):
            nonlocal asked
            found = super().predict(*args, **kwargs)
            asked += 1
            if asked > first:
                getattr(found[0], where)[200:] = size
            return found

    found = fit(RunsAway(predictor.records, 0.0), structure, VALUES, Observer(40.0), window)
    assert asked > 1
    assert np.isfinite(found.search).all()
    assert np.isfinite(found.rms_m)
    assert np.isfinite(found.blocks[0].curvature).all()
