"""The package's forms keep at least 13 digits of 50 where the plain formulas lose half of theirs."""

import numpy as np
import pytest
from reference_optimum import MP, NUMBERS

from avc_casadi.model.problem import Problem
from avc_casadi.paper.arcs import real_roots
from avc_casadi.paper.equations import (
    SampleAngle,
    backward_difference,
    coupling_gains,
    coupling_impedance,
    environment_impedance,
    series,
)
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY


def differences():
    """Re s_b at 0.01 Hz and 10 kHz, which is 2 sin^2(phi)/T: plain (z-1)/(T z)."""
    f, t = 0.01, 1e-4
    z = complex(np.exp(2j * np.pi * f * t))
    truth = backward_difference(SampleAngle.at(NUMBERS, MP.mpf(f), MP.mpf(t))).real
    return ((z - 1) / (t * z)).real, backward_difference(SampleAngle.at(NUMPY, f, t)).real, truth


def parallel():
    """Real part of a soft undamped wall behind a coupling a million times as stiff: plain Z_1 Z_2/(Z_1 + Z_2)."""
    f, t, b, k, b_e, k_e = 3.0, 1e-3, 20.0, 1e9, 0.0, 1e3

    def both(numbers, n):
        angle = SampleAngle.at(numbers, n(f), n(t))
        return coupling_impedance(angle, n(b), n(k)), environment_impedance(angle, "paper", n(b_e), n(k_e))

    c, e = both(NUMPY, float)
    truth = series(*both(NUMBERS, MP.mpf), numbers=NUMBERS).real
    return complex(c * e / (c + e)).real, series(c, e, numbers=NUMPY).real, truth


def nearly_rigid():
    """Stiffness of the closed form where the desired wall is 1 - 1e-9 of the environment: plain by (15), (16)."""
    share, f = 1 - 1e-9, 3.0
    bound = {"damping_ns_per_m": 10.0 * share, "stiffness_n_per_m": 1e5 * share}
    problem = Problem.model_validate(
        {
            "device": {"mass_kg": 0.1, "damping_ns_per_m": 200.0},
            "environment": {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e5},
            "boundaries": {"upper": bound, "lower": bound},
        }
    )
    loop, exact = loop_at(problem, f), loop_at(problem, MP.mpf(f), NUMBERS)
    rendered = (loop.target - loop.device) / loop.hold
    plain = coupling_gains(loop.angle, loop.environment * rendered / (loop.environment - rendered))[1]
    ours = coupling_gains(loop.angle, loop.environment * loop.desired / loop.desired_gap)[1]
    truth = coupling_gains(exact.angle, exact.environment * exact.desired / (exact.environment - exact.desired))[1]
    return plain, ours, truth


def roots():
    """The smaller root of an edge's quadratic whose roots are 1e-4 and 1e8: plain (-b - sqrt(b^2 - 4 a c))/(2 a)."""
    a, b, c = 1.0, -(1e8 + 1e-4), 1e4
    truth = 2 * MP.mpf(c) / (-MP.mpf(b) + MP.sqrt(MP.mpf(b) ** 2 - 4 * MP.mpf(a) * MP.mpf(c)))
    plain = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return plain, np.min(real_roots(np.array(a), np.array(b), np.array(c))), truth


@pytest.mark.parametrize("form", [differences, parallel, nearly_rigid, roots], ids=lambda form: form.__name__)
def test_digits(form):
    plain, ours, truth = form()
    wrong = [abs(MP.mpf(float(value)) - truth) / abs(truth) for value in (plain, ours)]
    assert wrong[1] <= 1e-13
    assert wrong[0] >= 1e-12
