"""A hand-tuned pair is judged by the same equations, and never beats the optimum inside the gain box."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.model.problem import Frequency

PROBLEM = avc.load_problem("figure5").changed(frequency={"points": 40})


def perceived(k, b):
    """Independent of the package's equations."""
    device, wall = PROBLEM.device, PROBLEM.environment
    t = device.sample_time_s
    z = np.exp(2j * np.pi * PROBLEM.frequencies_hz() * t)
    s = 2 / t * (z - 1) / (z + 1)
    environment = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    coupling = b + k * t * z / (z - 1)
    return device.mass_kg * s + device.damping_ns_per_m + (z + 1) / (2 * z) / (1 / environment + 1 / coupling)


@pytest.mark.thorough
@settings(max_examples=15)
@given(k=st.floats(1, 1e7), b=st.floats(0.1, 1e4))
def test_judged_by_the_same_equations(k, b):
    comparison = avc.compare(PROBLEM, methods=("closed-form", "exact"), mine=(k, b))
    mine = comparison.mine
    expected = perceived(k, b)
    np.testing.assert_allclose(mine.impedance, expected, rtol=1e-7)
    clear = np.abs(expected.real) > 1e-7 * np.abs(expected)
    assert np.array_equal(mine.meets_margin[clear], (expected.real >= 0)[clear])
    assert mine.inside_box
    assert mine.compared == "exact"
    assert mine.share_pair_better == 0.0
    exact = comparison.methods["exact"].magnitude_error
    tolerance = 1e-6 * np.abs(comparison.target)
    surely = (mine.real_part < -tolerance) | (mine.magnitude_error > exact + tolerance)
    assert mine.share_schedule_better >= np.mean(surely)


def test_the_optimum_itself_is_a_tie():
    problem = PROBLEM.changed(frequency=Frequency(values_hz=(40.0,)))
    gains = avc.solve(problem, "exact")
    pair = (float(gains.stiffness_n_per_m[0]), float(gains.damping_ns_per_m[0]))
    mine = avc.compare(problem, methods=("closed-form", "exact"), mine=pair).mine
    assert (mine.share_schedule_better, mine.share_pair_better) == (0.0, 0.0)
    assert mine.meets_margin.all()
