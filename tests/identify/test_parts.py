"""Parts of an identification against what is known independently of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured_device import Truth, measured, multisine
from quick import first
from scipy import signal

from avc_casadi.identification.fit import Block, Fit, bootstrap, cross_validation
from avc_casadi.identification.log import Record, lattice_step
from avc_casadi.identification.predictor import Predictor, SteadyObserver
from avc_casadi.identification.regression import Motion
from avc_casadi.identification.terms import RUNGS, ModelStructure

VALUES = {
    "mass_kg": 0.11,
    "damping_ns_per_m": 2.1,
    "delay_samples": 1.4,
    "offset_n": 0.01,
    "coulomb_friction_n": 0.35,
    "amplifier_bandwidth_hz": 200.0,
    "amplifier_damping_ratio": 0.5,
    "resonance.frequency_hz": 150.0,
    "resonance.damping_ratio": 0.04,
    "resonance.mass_ratio": 0.3,
    "stiffness_n_per_m": 3.0,
}
MODELS = [("rigid",), ("rigid", "friction"), ("rigid", "friction", "loop", "resonance", "spring")]


@pytest.fixture(scope="module")
def predictor():
    random = np.random.default_rng(7)
    truth = Truth(coulomb=0.4, delay=1.3, spring=50.0, encoder=2e-5)
    _, position, force = measured(truth, multisine(random, 0.6, 1e-3, 2.0, 300.0, 2.0), random)
    return Predictor([Record("simulated", 1e-3, position, force)])


@pytest.mark.parametrize("delay", first(np.linspace(1.01, 1.99, 8), 3))
def test_slopes_hold_wherever_in_a_sample_the_force_arrives(predictor, delay):
    """Where one of the times at which friction looks at the velocity leaves the sample, all of them changed places."""
    structure = ModelStructure(MODELS[-1], {})
    search = structure.start({**VALUES, "delay_samples": delay})
    observer = SteadyObserver(1e-6)
    (found,) = predictor.predict(structure, search, observer)
    place, step = structure.names.index("amplifier_bandwidth_hz"), 2e-3
    ends = [
        predictor.predict(structure, search + move * np.eye(search.size)[place], observer)[0].error_m
        for move in (-step, step)
    ]
    expected = (ends[1] - ends[0]) / (2 * step)
    error = np.sqrt(np.mean((found.slopes[:, place] - expected) ** 2)) / np.sqrt(np.mean(expected**2))
    assert error < 0.05


@pytest.mark.parametrize("delay", [0.0, 1.0, 1.4])
@pytest.mark.parametrize("friction_n", [0.3, 0.8])
def test_a_device_predicted_without_its_log_stays_where_a_simulation_of_its_friction_puts_it(delay, friction_n):
    """Over a second from rest, in which friction turns, stops and holds it inside samples, fifty times and more."""
    random = np.random.default_rng(7)
    wanted = multisine(random, 1.0, 1e-3, 5.0, 300.0, 2.0)
    wanted[:60] = 0.0
    truth = Truth(mass=0.05, damping=4.0, coulomb=friction_n, delay=delay, encoder=1e-10)
    _, position, force = measured(truth, wanted, random)
    structure = ModelStructure(MODELS[1], {})
    known = {"mass_kg": 0.05, "damping_ns_per_m": 4.0, "delay_samples": delay, "offset_n": 0.0}
    search = structure.start({**known, "coulomb_friction_n": friction_n})
    (found,) = Predictor([Record("simulated", 1e-3, position, force)]).predict(structure, search, SteadyObserver(1e-6))
    moved_in_a_sample_m = friction_n / 0.05 * 1e-3**2 / 2
    assert np.abs(found.error_m).max() < 0.02 * moved_in_a_sample_m


@pytest.mark.parametrize("name", VALUES)
def test_a_search_that_ran_to_a_bound_has_slopes_there(predictor, name):
    """Such a model is worse than others, and no reason to stop: the neighbour of the slope lies within the bounds."""
    structure = ModelStructure(MODELS[-1], {})
    place = structure.names.index(name)
    for bound, inwards in zip(structure.bounds(), (1, -1), strict=True):
        if np.isfinite(bound[place]):
            search = structure.start(VALUES)
            search[place] = bound[place] + inwards * 1e-9 * max(1.0, abs(bound[place]))
            (found,) = predictor.predict(structure, search, SteadyObserver(60.0))
            assert np.isfinite(found.slopes[:, place]).all()


def linear_fit(seed, count=40, size=60, noise=1.0):
    """A linear problem as a fit: e = noise - J q at the least-squares estimate."""
    random, names = np.random.default_rng(seed), ("mass_kg", "damping_ns_per_m")
    slopes = random.normal(size=(count * size, len(names)))
    error = noise * random.normal(size=count * size)
    error -= slopes @ np.linalg.lstsq(slopes, error, rcond=None)[0]
    parts = zip(np.split(error, count), np.split(slopes, count), strict=True)
    blocks = tuple(Block(size, float(e @ e), j.T @ e, j.T @ j) for e, j in parts)
    structure = ModelStructure(("rigid",), {}, fixed=dict.fromkeys({*RUNGS["rigid"]} - {*names}, 0.0))
    return Fit(structure, np.zeros(len(names)), SteadyObserver(1.0), (error,), blocks, 1.0, 0.0), slopes


def test_bootstrap_of_a_linear_problem_is_its_least_squares_interval():
    found, slopes = linear_fit(3)
    exact = 2.02 * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    np.testing.assert_allclose(bootstrap(found), exact, rtol=0.3)


def test_error_of_a_block_that_was_held_out_is_that_of_a_fit_without_it():
    found, slopes = linear_fit(4, count=5)
    (error,) = found.error_m
    expected = []
    for part in np.split(np.arange(error.size), 5):
        rest = np.setdiff1d(np.arange(error.size), part)
        q = np.linalg.lstsq(slopes[rest], error[rest], rcond=None)[0]
        expected.append(np.sum((error[part] - slopes[part] @ q) ** 2))
    np.testing.assert_allclose(cross_validation(found), expected, rtol=1e-9)


def test_regression_starts_near_the_device():
    random = np.random.default_rng(1)
    truth = Truth(mass=0.2, damping=3.0, coulomb=0.3, delay=1.5, encoder=2e-5, spring=50.0)
    _, position, force = measured(truth, multisine(random, 8.0, 1e-3, 0.5, 80.0, 2.0), random)
    start = Motion([Record("log", 1e-3, position, force)], 1).start()
    assert start.values["mass_kg"] == pytest.approx(0.2, rel=0.05)
    assert start.values["damping_ns_per_m"] == pytest.approx(3.0, rel=0.1)
    assert start.values["delay_samples"] == pytest.approx(1.5, abs=0.3)


@pytest.mark.parametrize("stiffness", [5.0, 50.0, 500.0, 2000.0])
def test_a_start_explains_as_much_of_the_force_as_it_says(stiffness):
    random, step_s = np.random.default_rng(3), 1e-3
    system = [np.array(part) for part in ([[0, 1], [-stiffness / 0.1, -10.0]], [[0], [10.0]], [[1, 0]], [[0]])]
    system = signal.cont2discrete(system, step_s)
    force = multisine(random, 8.0, step_s, 1.0, 60.0, 2.0)
    position = signal.dlsim((*system[:4], step_s), force)[1][:, 0]
    start = Motion([Record("log", step_s, position, force)], 1).start()
    velocity = np.gradient(position, step_s)
    of = {"mass_kg": np.gradient(velocity, step_s), "damping_ns_per_m": velocity, "stiffness_n_per_m": position}
    explained = sum(start.values.get(key, 0.0) * motion for key, motion in of.items())
    explained = explained + start.values["coulomb_friction_n"] * np.sign(velocity)
    # The force of a hold acts half a sample later.
    acting = force - np.gradient(force) / 2
    share = 1 - np.var((acting - explained)[500:-500]) / np.var(acting[500:-500])
    assert start.r_squared == pytest.approx(share, abs=0.05)


ROUNDED = {
    "as they are": lambda position, _: position,
    "float32": lambda position, _: position.astype(np.float32).astype(float),
    "a tenth of a step": lambda position, step: np.round(position / (0.1 * step)) * (0.1 * step),
}


def readings(seed, step, travel_steps, samples):
    random = np.random.default_rng(seed)
    motion = np.cumsum(np.cumsum(random.normal(size=samples)))
    motion = (motion - motion.min()) / np.ptp(motion) * step * travel_steps
    return np.round(motion / step + random.uniform()) * step


@pytest.mark.parametrize("rounded", ROUNDED)
@given(
    seed=st.integers(0, 2**32 - 1),
    step=st.floats(-7, -4).map(lambda power: 10**power),
    travel_steps=st.floats(1.3, 5).map(lambda power: 10**power),
)
def test_the_step_of_the_encoder_is_that_of_its_readings(rounded, seed, step, travel_steps):
    position = ROUNDED[rounded](readings(seed, step, travel_steps, 4000), step)
    found = lattice_step(position)
    assert found == pytest.approx(step, rel=1e-3)


@given(seed=st.integers(0, 2**32 - 1))
def test_noise_has_no_step(seed):
    random = np.random.default_rng(seed)
    position = readings(seed, 1e-6, 1e3, 4000) + 1e-6 * random.normal(size=4000)
    assert lattice_step(position) is None
