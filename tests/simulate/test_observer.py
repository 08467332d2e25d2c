"""The observer against a mass integrated exactly: never off the count, between its steps, ahead of a delay."""

import numpy as np
import pytest
from exported import Exported
from scene_reference import scene_problem

from avc_casadi.coupling import Coupling
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.runtime.observer import ObserverSettings, observer_step

T, MASS, STEP_M = 1e-3, 0.2, 2e-5


def moved(force, load):
    """Positions of a free mass under held forces (against +x) and a constant load, exact."""
    acceleration = (load - force) / MASS
    velocity = np.concatenate([[0.0], np.cumsum(acceleration * T)])
    return np.concatenate([[0.0], np.cumsum(velocity[:-1] * T + 0.5 * acceleration * T**2)])[: len(force)]


def observed(asked, position, ahead):
    """Run the observer; asked[k] is asked for at tick k."""
    step = observer_step(T, ObserverSettings(STEP_M, MASS, ahead))
    counted = STEP_M * np.round(position / STEP_M)
    return counted, step.run(np.array([counted, np.concatenate([[0.0], asked[:-1]])]))["position_m"]


@pytest.fixture
def asked():
    time = np.arange(3000) * T
    return 1.0 + 0.2 * np.sin(2 * np.pi * 7 * time) + 0.1 * np.sign(np.sin(2 * np.pi * 3 * time))


def test_it_never_contradicts_the_encoder_and_is_closer_than_it(asked):
    position = moved(asked, 1.0)
    counted, found = observed(asked, position, 0)
    assert np.all(np.abs(found - counted) <= 0.5 * STEP_M * (1 + 1e-9))
    late = slice(1000, None)
    assert np.sqrt(np.mean((found - position)[late] ** 2)) < 0.6 * np.sqrt(np.mean((counted - position)[late] ** 2))


@pytest.mark.parametrize("ahead", [1, 2, 5])
def test_it_says_where_the_mass_will_be_when_the_next_force_acts(asked, ahead):
    acting = np.concatenate([np.zeros(ahead), asked[:-ahead]])
    position = moved(acting, 1.0)
    _, found = observed(asked, position, ahead)
    late = slice(1000, 3000 - ahead)
    coming = position[ahead:][late.start : late.stop]
    error = np.abs(found[late] - coming).max()
    unpredicted = np.abs(position[late] - coming).max()
    assert error < STEP_M
    assert error < 0.2 * unpredicted


DELAYED = """
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
encoder_resolution_m = 2e-5
delay_samples = {delay}
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = 2e4
"""


@pytest.mark.parametrize("ahead", [1, 2, 5])
def test_forces_under_way_act_in_the_order_in_which_they_were_asked_for(ahead):
    """Without steps and without a load the model is the mass itself: the prediction is exact, whatever was asked."""
    asked = np.random.default_rng(2).normal(0, 1.0, 400)
    position = moved(np.concatenate([np.zeros(ahead), asked[:-ahead]]), 0.0)
    step = observer_step(T, ObserverSettings(0.0, MASS, ahead))
    found = step.run(np.array([position, np.concatenate([[0.0], asked[:-1]])]))["position_m"]
    np.testing.assert_allclose(found[:-ahead], position[ahead:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("ahead", [0.25, 0.5, 1.75, 2.5])
def test_parts_of_a_sample_are_looked_ahead_too(ahead):
    """The mass on a grid of quarters of a sample, on which each force acts when its delay is over."""
    parts, asked = 4, np.random.default_rng(3).normal(0, 1.0, 300)
    late = int(parts * ahead)
    acceleration = -np.concatenate([np.zeros(late), np.repeat(asked, parts)])[: parts * len(asked)] / MASS
    h = T / parts
    velocity = np.concatenate([[0.0], np.cumsum(acceleration * h)])[:-1]
    position = np.concatenate([[0.0], np.cumsum(velocity * h + 0.5 * acceleration * h * h)])[:-1]
    step = observer_step(T, ObserverSettings(0.0, MASS, ahead))
    found = step.run(np.array([position[::parts], np.concatenate([[0.0], asked[:-1]])]))["position_m"]
    coming = position[late::parts]
    np.testing.assert_allclose(found[: len(coming)], coming, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("delay", "step_m", "believed"),
    [(1, 2e-5, 1), (2, 2e-5, 1), (0, 2e-5, 1), (1, 5e-5, 1), (3, 1e-5, 1), (2, 2e-5, 0), (2, 2e-5, 0.5)],
)
def test_on_another_device_it_is_the_exported_one_of_the_device_that_it_was_made_for(delay, step_m, believed):
    """Delay and steps are those of the device, what the observer believes of them is not."""
    gains, mass = Gains(20.0, 1e4), 0.2
    made = Coupling.constant(
        scene_problem((), head=DELAYED.format(delay=believed)), gains, "x", Runtime(observer_mass_kg=mass)
    )
    effects = (
        'kind = "hand"',
        'kind = "wall"',
        f'kind = "encoder"\nresolution_m = {step_m}',
        f'kind = "observer"\nmass_kg = {mass}\nresolution_m = 2e-5\nahead_samples = {believed}',
        *((f'kind = "delay"\nsamples = {delay}',) if delay else ()),
    )
    run = simulate(scene_problem(effects, scene="duration_s = 0.4\n", head=DELAYED.format(delay=believed)), gains)
    forces = Exported(made).forces(step_m * np.floor(run.position_m / step_m + 0.5))
    assert np.abs(forces).max() > 1.0
    np.testing.assert_allclose(run.force_n[delay:], forces[: len(forces) - delay], rtol=0, atol=2e-3)
