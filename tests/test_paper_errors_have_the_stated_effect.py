"""What the table of the paper's errors says of their effect is true in numbers."""

import numpy as np

import avc_casadi as avc

PROBLEM = avc.load_problem("figure5")
T = PROBLEM.device.sample_time_s
Z = np.exp(2j * np.pi * PROBLEM.frequencies_hz() * T)


def test_printed_tustin_is_t_squared_over_four_times_the_right_one():
    np.testing.assert_allclose(T * (Z - 1) / (2 * (Z + 1)) / (2 * (Z - 1) / (T * (Z + 1))), T**2 / 4, rtol=1e-12)


def test_forward_difference_turns_the_sign_of_the_springs_real_part():
    np.testing.assert_allclose((T * Z / (Z - 1)).real, T / 2, rtol=1e-9)
    np.testing.assert_allclose((T / (Z - 1)).real, -T / 2, rtol=1e-9)


def test_tustin_in_17_makes_b_too_large_by_half_a_sample_of_stiffness():
    coupling = 30.0 + 2e4 * T * Z / (Z - 1)
    s = 2 * (Z - 1) / (T * (Z + 1))
    k = -coupling.imag * np.abs(s) ** 2 / s.imag
    b = coupling.real - k * s.real / np.abs(s) ** 2
    np.testing.assert_allclose(k, 2e4, rtol=1e-9)
    np.testing.assert_allclose(b - 30.0, 2e4 * T / 2, rtol=1e-9)
