"""Each error of the printed paper has the effect that its table states, and one switch reproduces the printed form."""

import numpy as np

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.loop import loop_at

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


def test_the_missing_formula_for_k_inverts_the_coupling():
    z = np.exp(2j * np.pi * PROBLEM.frequencies_hz() * T)
    b, k = gains_by_17(7.0 + 5e3 * T * z / (z - 1), (z - 1) / (T * z))
    np.testing.assert_allclose(b, 7.0, rtol=1e-9)
    np.testing.assert_allclose(k, 5e3, rtol=1e-9)


def test_13_keeps_the_imaginary_part_that_the_print_leaves_open():
    impedance, target = project(PROBLEM).impedance, LOOP.target
    np.testing.assert_array_equal(impedance.imag, target.imag)
    np.testing.assert_allclose(impedance.real, np.maximum(target.real, 0), atol=1e-13)
