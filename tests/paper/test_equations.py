"""What the two hold models say of stiffness, delay and walls, each fact against a formula of its own."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.paper.equations import SampleAngle, coupling_impedance, hold, loop_at
from avc_casadi.paper.numbers import NUMPY

T = 1e-3
FREQUENCY = np.geomspace(0.01, 499.0, 400)
ANGLE = SampleAngle.at(NUMPY, FREQUENCY, T)
THETA = 2 * np.pi * FREQUENCY * T
Z = np.exp(1j * THETA)


def test_the_papers_hold_does_not_see_a_spring():
    """Re{H k/s_b} = 0 without delay; with d samples -(k T/2) cot(phi) sin(d theta)."""
    k = 4e4
    spring = coupling_impedance(ANGLE, 0.0, k)
    assert np.max(np.abs((hold(ANGLE, "paper", 0) * spring).real) / np.abs(spring)) < 1e-15
    for delay in (1, 2, 20):
        real = (hold(ANGLE, "paper", delay) * spring).real
        expected = -(k * T / 2) / np.tan(THETA / 2) * np.sin(delay * THETA)
        np.testing.assert_allclose(real, expected, atol=1e-13 * np.abs(spring).max())


def colgate_schenkel(position_to_force):
    """Device damping that the condition of Colgate and Schenkel asks for, at each frequency."""
    return T / 2 / (1 - np.cos(THETA)) * ((1 - 1 / Z) * position_to_force).real


@pytest.mark.parametrize(("damping", "stiffness"), [(0.0, 1e4), (5.0, 1e4), (5.0, 0.0)])
def test_one_sample_of_hold_is_the_condition_of_colgate_and_schenkel(damping, stiffness):
    rendered = coupling_impedance(ANGLE, damping, stiffness)
    ours = -(hold(ANGLE, "sampled-data", 0) * rendered).real
    theirs = colgate_schenkel(stiffness + damping * (Z - 1) / (T * Z))
    # Their form divides by 1 - cos(theta), which cancels at low frequency.
    np.testing.assert_allclose(ours[100:], theirs[100:], atol=1e-8 * (stiffness * T + damping))
    at_nyquist = SampleAngle.at(NUMPY, np.array([0.5 / T]), T)
    worst = -(hold(at_nyquist, "sampled-data", 0) * coupling_impedance(at_nyquist, damping, stiffness)).real[0]
    assert worst == pytest.approx(stiffness * T / 2 + damping, rel=1e-12)
    assert np.all(ours <= worst * (1 + 1e-12))


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 4])
def test_a_contact_damper_is_held_and_late_like_every_other_force(model, delay):
    """The computer's damper alone: b_p times the mean of two samples, or one sample old, and z^-delay."""
    contact = 37.0
    problem = avc.load_problem("figure5").changed(device={"delay_samples": delay}, stability={"model": model})
    loop = loop_at(problem, FREQUENCY)
    found = loop.perceived(0.0, 0.0, contact) - loop.device
    held = (Z + 1) / (2 * Z) if model == "paper" else 1 / Z
    np.testing.assert_allclose(found, contact * held * Z**-delay, rtol=1e-10, atol=1e-10)
