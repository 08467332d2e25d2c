"""The projection is the desired wall, a damper and a virtual mass; computed here from z = exp(j theta) alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.design.comparison.comparison import damping_injection
from avc_casadi.model.problem import Impedance
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.loop import loop_at

FREQUENCY = np.geomspace(0.5, 480.0, 40)
BASE = avc.load_problem("figure5")


def problem_of(b, k, *, model="paper", delay=0, margin=0.0):
    wall = Impedance(damping_ns_per_m=b, stiffness_n_per_m=k)
    return BASE.changed(
        device={"delay_samples": delay},
        boundaries={"upper": wall, "lower": wall},
        stability={"model": model, "margin_ns_per_m": margin},
        frequency=type(BASE.frequency)(values_hz=tuple(FREQUENCY)),
    )


def wall_and_hold(b, k):
    t = BASE.device.sample_time_s
    z = np.exp(2j * np.pi * FREQUENCY * t)
    s = 2 / t * (z - 1) / (z + 1)
    device = BASE.device.mass_kg * s + BASE.device.damping_ns_per_m
    return device, (z + 1) / (2 * z), b + k / s, s


WALLS = {name: st.just(0.0) | st.floats(1e-9, most) for name, most in (("b", 100), ("k", 1e6), ("margin", 5))}


@pytest.mark.thorough
@given(**WALLS)
def test_damper_and_mass_render_the_projection(b, k, margin):
    problem = problem_of(b, k, margin=margin)
    injection = damping_injection(problem, loop_at(problem, FREQUENCY))
    device, hold, wall, s = wall_and_hold(b, k)
    rendered = wall + injection.injected_damping_ns_per_m + injection.virtual_mass_kg * s
    projected = device + hold * rendered
    scale = np.abs(device) + np.abs(hold * wall)
    np.testing.assert_allclose(projected / scale, project(problem).impedance / scale, atol=1e-9)
    assert np.all(projected.real >= margin - 1e-9 * scale)
    t = problem.device.sample_time_s
    np.testing.assert_allclose(injection.virtual_mass_kg, injection.injected_damping_ns_per_m * t / 2, rtol=1e-9)


@pytest.mark.thorough
@given(**WALLS)
def test_contact_damper_reaches_the_margin_and_errs_as_stated(b, k, margin):
    problem = problem_of(b, k, margin=margin)
    injection = damping_injection(problem, loop_at(problem, FREQUENCY))
    device, hold, wall, _ = wall_and_hold(b, k)
    target = device + hold * wall
    damped = target + hold * injection.contact_damper_ns_per_m
    scale = np.abs(device) + np.abs(hold * wall)
    needed = target.real < margin - 1e-9 * scale
    np.testing.assert_allclose((damped.real / scale)[needed], (margin / scale)[needed], atol=1e-9)
    error = np.abs(damped - (target + injection.injected_damping_ns_per_m)) / np.abs(target)
    np.testing.assert_allclose(injection.residual_error[needed], error[needed], rtol=1e-6, atol=1e-9)
