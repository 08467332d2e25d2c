"""The paper's projection is the desired wall with a damper and a virtual mass beside it, which gains seldom render."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.model.problem import Problem
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.equations import loop_at, tustin


def wall(*, share, model="paper", device=2.0, start=0.05):
    goal = {"damping_ns_per_m": share * 10.0, "stiffness_n_per_m": share * 1e5}
    return Problem.model_validate(
        {
            "device": {"mass_kg": 0.1, "damping_ns_per_m": device},
            "environment": {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e5},
            "boundaries": {"upper": goal, "lower": goal},
            "stability": {"model": model},
            "frequency": {"start_hz": start, "stop_hz": 450.0, "points": 300},
        }
    )


def test_it_renders_the_wall_plus_a_damper_and_half_a_sample_of_mass():
    """Z_eavc = Z_ds + delta (1 + s_t T/2), delta = max(0, -(b_d + Re(H Z_ds)))."""
    problem = avc.load_problem("figure5")
    loop = loop_at(problem, problem.frequencies_hz())
    projection = project(problem)
    delta = np.maximum(0.0, -(problem.device.damping_ns_per_m + (loop.hold * loop.desired).real))
    half_sample = tustin(loop.angle) * problem.device.sample_time_s / 2
    expected = loop.desired + delta * (1 + half_sample)
    # By steps (13) and (15), which subtract Z_d again.
    by_steps = (np.maximum(loop.target.real, 0) + 1j * loop.target.imag - loop.device) / loop.hold
    assert delta.max() > 30.0
    np.testing.assert_allclose(projection.rendered, expected, rtol=1e-13)
    np.testing.assert_allclose(projection.rendered, by_steps, rtol=1e-9)
    np.testing.assert_allclose(projection.injected_damping_ns_per_m, delta, rtol=1e-12)


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("share", [0.3, 0.9, 1 - 1e-9, 1.1, 2.0])
def test_case_1_has_a_formula(model, share):
    """Z_ds = r Z_e: k = r k_e/(1-r), b = r b_e/(1-r) - k T/2 (sampled-data: without the k T/2)."""
    problem = wall(share=share, model=model, device=200.0)
    schedule = solve(problem, "closed-form")
    assert np.all(project(problem).injected_damping_ns_per_m == 0)
    k = share * 1e5 / (1 - share)
    b = share * 10.0 / (1 - share) - (k * 1e-3 / 2 if model == "paper" else 0.0)
    tolerance = 1e-12 / abs(1 - share)
    np.testing.assert_allclose(schedule.requested_stiffness_n_per_m, k, rtol=tolerance)
    np.testing.assert_allclose(schedule.requested_damping_ns_per_m, b, rtol=tolerance)
    realisable = np.array([status != "not-realisable" for status in schedule.status])
    assert np.all(realisable == (b >= 0 and k >= 0 and b <= 1e4 and k <= 1e7))


def test_a_stiff_wall_asks_for_negative_stiffness_and_for_enormous_damping():
    problem = wall(share=1.0, start=0.16)
    schedule = solve(problem, "closed-form")
    b, k = schedule.requested_damping_ns_per_m[0], schedule.requested_stiffness_n_per_m[0]
    assert k == pytest.approx(-2.105e4, rel=1e-3)
    assert b == pytest.approx(2.6e8, rel=2e-2)
    assert k * 1e5 / (k + 1e5) < 0, "DC stiffness of the frozen pair"
    assert set(schedule.status) == {"not-realisable"}


def test_damped_structure_renders_it_but_for_the_mass():
    """On the hold of a real loop, where 1/H is a damper and more than a mass: Im Z_h is off by delta Im H/Re H."""
    goal = {"damping_ns_per_m": 9.0, "stiffness_n_per_m": 9e4}
    problem = Problem.model_validate(
        {
            "device": {"mass_kg": 0.1, "damping_ns_per_m": 2.0},
            "environment": {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e5},
            "boundaries": {"upper": goal, "lower": goal},
            "coupling": {"structure": "damped", "contact_damping_ns_per_m": [0.0, 150.0]},
            "stability": {"model": "sampled-data"},
            "frequency": {"stop_hz": 150.0, "points": 50},
        }
    )
    loop = loop_at(problem, problem.frequencies_hz())
    schedule = solve(problem, "closed-form")
    delta = project(problem).injected_damping_ns_per_m
    assert schedule.usable.all()
    assert np.all(delta > 0)
    np.testing.assert_allclose(schedule.stiffness_n_per_m, 9e5, rtol=1e-9)
    np.testing.assert_allclose(schedule.damping_ns_per_m, 90.0, rtol=1e-9)
    expected = project(problem).impedance + 1j * delta * loop.hold.imag / loop.hold.real
    np.testing.assert_allclose(schedule.impedance, expected, rtol=1e-11)


# Each error of the printed paper has the effect that its table states, and one switch reproduces the printed form.

PROBLEM = avc.load_problem("figure5")
LOOP = loop_at(PROBLEM, PROBLEM.frequencies_hz())
T = PROBLEM.device.sample_time_s


def gains_by_17(coupling, s):
    """k = -Im(Z) |s|^2/Im(s), b = Re Z - k Re(s)/|s|^2, for any s."""
    k = -coupling.imag * np.abs(s) ** 2 / s.imag
    return coupling.real - k * s.real / np.abs(s) ** 2, k


def test_as_printed_makes_the_desired_wall_of_10_stiffer_by_4_over_t_squared():
    printed = project(PROBLEM, as_printed=True)
    wall = printed.rendered - printed.injected_damping_ns_per_m / LOOP.hold
    np.testing.assert_allclose(wall.real, LOOP.desired.real, rtol=1e-6)
    np.testing.assert_allclose(wall.imag, LOOP.desired.imag * 4 / T**2, rtol=1e-9)


def test_as_printed_recovers_gains_with_the_printed_s():
    """(17) with s = T(z-1)/(2(z+1)), which is imaginary: b = Re Z_avc, k = -Im(Z_avc) Im(s)."""
    coupling = project(PROBLEM, as_printed=True).coupling
    b, k = gains_by_17(coupling, 1j * T / 2 * np.tan(np.pi * PROBLEM.frequencies_hz() * T))
    schedule = solve(PROBLEM, "closed-form", as_printed=True)
    assert schedule.solver == "as-printed"
    np.testing.assert_allclose(schedule.requested_damping_ns_per_m, b, rtol=1e-9)
    np.testing.assert_allclose(schedule.requested_stiffness_n_per_m, k, rtol=1e-9)
    right = solve(PROBLEM, "closed-form")
    assert not np.allclose(right.requested_stiffness_n_per_m, k, rtol=0.5)


# The closed form's verdict is that of exact numbers: rounding neither forbids a gain nor asks for a rigid coupling.


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("share", [0.3, 0.7, 0.9, 0.95])
@pytest.mark.parametrize("stiffness", [2e4, 1e5, 3.3e3])
def test_gains_that_are_zero_in_exact_numbers_are_not_negative(model, share, stiffness):
    """Of a spring, share by share: b = 0 with the backward difference; in the paper's model b = -k T/2, a clear no."""
    wanted = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": share * stiffness}
    problem = avc.load_problem("spring").changed(
        environment={"damping_ns_per_m": 0.0, "stiffness_n_per_m": stiffness},
        boundaries={"upper": wanted, "lower": wanted},
        device={"damping_ns_per_m": 500.0},
        stability={"model": model},
    )
    gains = solve(problem, "closed-form")
    assert gains.usable.all() == (model == "sampled-data")
    if model == "sampled-data":
        assert np.all((gains.damping_ns_per_m >= 0.0) & (gains.damping_ns_per_m < 1e-9))
    else:
        assert all("negative damping" in reason for reason in gains.reason)


@pytest.mark.parametrize("structure", ["series", "damped"])
def test_a_gain_beside_its_box_by_more_than_rounding_is_refused(structure):
    problem = avc.load_problem("spring").changed(
        device={"damping_ns_per_m": 500.0}, stability={"model": "sampled-data"}, coupling={"structure": structure}
    )
    top = float(solve(problem, "closed-form").stiffness_n_per_m[0])
    for off, allowed in ((1e-15, True), (1e-9, False)):
        box = problem.changed(coupling={"stiffness_n_per_m": (0.0, top * (1 - off))})
        assert solve(box, "closed-form").usable.all() == allowed
