"""What the two hold models say of stiffness, delay and walls, each fact against a formula of its own."""

import numpy as np
import pytest

from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import SampleAngle, backward_difference, coupling_impedance, hold, loop_at, tustin
from avc_casadi.paper.numbers import NUMPY, abs2

T = 1e-3
FREQUENCY = np.geomspace(0.01, 499.0, 400)
ANGLE = SampleAngle.at(NUMPY, FREQUENCY, T)
THETA = 2 * np.pi * FREQUENCY * T
Z = np.exp(1j * THETA)


def loop_of(model="paper", delay=0, *, device=2.0, b_e=10.0, k_e=1e5, desired=None, frequency=FREQUENCY):
    b_ds, k_ds = desired or (b_e, k_e)
    impedance = {"damping_ns_per_m": b_ds, "stiffness_n_per_m": k_ds}
    problem = Problem.model_validate(
        {
            "device": {"mass_kg": 0.1, "damping_ns_per_m": device, "sample_time_s": T, "delay_samples": delay},
            "environment": {"damping_ns_per_m": b_e, "stiffness_n_per_m": k_e},
            "boundaries": {"upper": impedance, "lower": impedance},
            "stability": {"model": model},
        }
    )
    return loop_at(problem, frequency)


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


def test_a_tustin_spring_on_backward_difference_velocity_costs_half_a_sample_more():
    """b_d > K T instead of K T/2."""
    stiffness = 1e4
    s_b, s_t = backward_difference(ANGLE), tustin(ANGLE)
    asked = colgate_schenkel(stiffness * s_b / s_t)
    assert asked.max() == pytest.approx(stiffness * T, rel=1e-4)
    assert asked[0] == pytest.approx(stiffness * T, rel=1e-4)


def test_an_edge_of_the_gain_box_becomes_a_circle_arc():
    """The cross ratio of four points of a circle is real."""
    loop = loop_of("sampled-data", 1)
    for gains in ([(20.0, k) for k in (0.0, 1e3, 3e4, 1e6)], [(b, 2e4) for b in (0.0, 10.0, 300.0, 1e4)]):
        p, q, r, s = (loop.perceived(*pair) for pair in gains)
        ratio = (p - r) * (q - s) / ((p - s) * (q - r))
        assert np.max(np.abs(ratio.imag / ratio)) < 1e-6


def test_the_magnitude_has_no_extremum_inside_the_box():
    """Mean value property: ln|Z| is harmonic in Z_avc wherever Z is not 0, so that it equals its mean on a circle."""
    loop = loop_of()
    around = np.exp(2j * np.pi * np.arange(64) / 64)
    for row in (0, 200, 399):
        centre = 30.0 + 10j

        def log_magnitude(coupling, row=row):
            environment = loop.environment[row]
            return np.log(np.abs(loop.device[row] + loop.hold[row] * environment * coupling / (environment + coupling)))

        assert np.mean(log_magnitude(centre + 5 * around)) == pytest.approx(log_magnitude(centre), rel=1e-12)


@pytest.mark.parametrize(("b_e", "side"), [(200.0, 1), (10.0, -1)])
def test_constraint_is_a_disc_in_the_coupling_plane(b_e, side):
    """Outside of a disc where b_d + Re(H Z_e) > 0, inside of it otherwise."""
    loop = loop_of(b_e=b_e)
    leading = 2.0 + (loop.hold * loop.environment).real
    assert np.all(np.sign(leading[:50]) == side)
    slope = loop.hold * abs2(loop.environment) + 2 * 2.0 * np.conj(loop.environment)
    centre = -np.conj(slope) / (2 * leading)
    radius2 = abs2(centre) - 2.0 * abs2(loop.environment) / leading
    turn = np.exp(2j * np.pi * np.arange(12) / 12)[:, None]
    for share, sign in ((0.9, -side), (1.1, side)):
        coupling = centre + share * np.sqrt(radius2) * turn
        real = (loop.device + loop.hold * loop.environment * coupling / (loop.environment + coupling)).real
        assert np.all(np.sign(real[:, :50]) == sign)


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 4])
def test_a_contact_damper_is_held_and_late_like_every_other_force(model, delay):
    """The computer's damper alone: b_p times the mean of two samples, or one sample old, and z^-delay."""
    contact = 37.0
    loop = loop_of(model, delay)
    found = loop.perceived(0.0, 0.0, contact) - loop.device
    held = (Z + 1) / (2 * Z) if model == "paper" else 1 / Z
    np.testing.assert_allclose(found, contact * held * Z**-delay, rtol=1e-10, atol=1e-10)
