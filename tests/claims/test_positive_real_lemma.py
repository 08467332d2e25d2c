"""The margin by another road: zeros of Z(z) + Z(1/z) on the unit circle, from a state-space pencil.

By the Kalman-Yakubovich-Popov lemma Re Z > m at all frequencies if and only if the pencil of Z(z) + Z(1/z) - 2m has no
eigenvalue on the unit circle.
"""

import numpy as np
import pytest
from scipy.linalg import eig

from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, size_of_terms

T = 1e-3


def chain(*systems):
    """Series connection of discrete state-space systems (A, B, C, D), the first acting first."""
    a, b, c, d = systems[0]
    for a2, b2, c2, d2 in systems[1:]:
        a = np.block([[a, np.zeros((len(a), len(a2)))], [b2 @ c, a2]])
        b = np.vstack([b, b2 @ d])
        c = np.hstack([d2 @ c, c2])
        d = d2 @ d
    return a, b, c, d


def first_order(lead, lag, pole_lead, pole_lag):
    """(lead z - lag)/(pole_lead z - pole_lag)."""
    pole = pole_lag / pole_lead
    return tuple(
        np.array([[value]]) for value in (pole, 1.0, lead / pole_lead * pole - lag / pole_lead, lead / pole_lead)
    )


def rendered(model, delay, b_e, k_e, b, k, contact):
    """State space of H (b_p + Z_eavc)."""
    p1, q1 = b + k * T, b
    p2, q2 = (b_e + k_e * T / 2, b_e - k_e * T / 2) if model == "paper" else (b_e + k_e * T, b_e)
    a, b_, c, d = chain(first_order(p1, q1, 1, 1), first_order(p2, q2, p1 + p2, q1 + q2))
    system = (a, b_, c, d + contact)
    hold = first_order(0.5, -0.5, 1, 0) if model == "paper" else first_order(0, -1, 1, 0)
    return chain(system, hold, *[first_order(0, -1, 1, 0)] * delay)


def on_unit_circle(system, shift):
    a, b, c, d = system
    n = len(a)
    left = np.block(
        [
            [a, np.zeros((n, n)), b],
            [np.zeros((n, n)), np.eye(n), np.zeros((n, 1))],
            [c, b.T, 2 * d + 2 * shift],
        ]
    )
    right = np.zeros_like(left)
    right[:n, :n] = np.eye(n)
    right[n : 2 * n, n : 2 * n], right[n : 2 * n, 2 * n :] = a.T, c.T
    alpha, beta = eig(left, right, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-9
    zeros = alpha[finite] / beta[finite]
    # The integrator's own pole at z = 1 is no zero of the sum.
    return np.any((np.abs(np.abs(zeros) - 1) < 1e-8) & (np.abs(zeros - 1) > 1e-6))


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0, 1, 2, 6])
def test_margin_is_where_zeros_reach_the_unit_circle(model, delay):
    rng = np.random.default_rng(delay)
    for _ in range(40):
        b_e, b, contact = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-1, 2), rng.choice([0.0, 5.0])
        k_e, k = 10 ** rng.uniform(3, 5), 10 ** rng.uniform(3, 5)
        loop = SampledLoop(0.0, b_e, k_e, T, delay, model)
        found = worst_margin(loop, b, k, contact)
        if found.frequency_hz[0] < 1:
            continue  # the pencil sees the limit of zero frequency only through its pole there
        margin, step = found.margin_ns_per_m[0], 1e-3 * size_of_terms(loop, fractions(loop, b, k), contact)
        system = rendered(model, delay, b_e, k_e, b, k, contact)
        assert not on_unit_circle(system, -(margin - step))
        assert on_unit_circle(system, -(margin + step))
