"""Closed forms without delay, and limits that no passive rendering passes, against the general search."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.sampled_loop import (
    SampledLoop,
    fractions,
    real_part,
    size_of_terms,
)

T = 1e-3
damping = st.floats(-3, 4).map(lambda x: 10**x)
stiffness = st.floats(-1, 7).map(lambda x: 10**x)
maybe_damping = st.one_of(st.just(0.0), damping)
maybe_stiffness = st.one_of(st.just(0.0), stiffness)


@pytest.mark.thorough
@given(damping, maybe_damping, maybe_stiffness, maybe_damping, maybe_stiffness, maybe_damping)
def test_sampled_data_worst_point_is_nyquist(b_d, b_e, k_e, b, k, contact):
    loop = SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data")
    found = worst_margin(loop, b, k, contact)
    a1, a2 = b + k * T / 2, b_e + k_e * T / 2
    series = a1 * a2 / (a1 + a2) if a1 + a2 > 0 else 0.0
    size = size_of_terms(loop, fractions(loop, b, k), contact)
    assert abs(found.margin_ns_per_m[0] - (b_d - contact - series)) <= 1e-13 * size


@given(damping, maybe_damping, stiffness, maybe_damping, stiffness, maybe_damping, st.floats(-5, 0), st.floats(-5, 0))
def test_sampled_data_worst_point_of_a_band_is_an_end(b_d, b_e, k_e, b, k, contact, low, high):
    low, high = sorted((500 * 10**low, 500 * 10**high))
    loop = SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data")
    parts = fractions(loop, b, k)
    ends = real_part(loop, parts, contact, np.array([low, high]))
    found = worst_margin(loop, b, k, contact, low, high)
    assert abs(found.margin_ns_per_m[0] - ends.min()) <= 1e-13 * size_of_terms(loop, parts, contact)


def lead_bound(b_d, b_e, k_e, contact):
    """Bound on a_1 = b + kT/2 for passivity: Re Z_h is lowest at Nyquist, b_d - b_p - a_1 a_2/(a_1 + a_2)."""
    budget, wall = b_d - contact, b_e + k_e * T / 2
    if budget >= wall:
        return np.inf
    return wall * budget / (wall - budget) if budget >= 0 else -1.0


@pytest.mark.thorough
@given(damping, maybe_damping, stiffness, damping, maybe_damping)
def test_lead_bound_is_necessary_and_sufficient(b_d, b_e, k_e, b, contact):
    loop = SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data")
    bound = lead_bound(b_d, b_e, k_e, contact)
    if bound < 0:
        assert worst_margin(loop, 0.0, 0.0, contact).margin_ns_per_m[0] < 0
        return
    if np.isinf(bound):
        assert worst_margin(loop, np.inf, 1.0, contact).margin_ns_per_m[0] >= -1e-12 * b_d
        return
    share = min(b / bound, 0.9) if bound > 0 else 0.0
    for factor, passive in ((1 - 1e-6, True), (1 + 1e-6, False)):
        lead = bound * factor
        k = (1 - share) * lead * 2 / T
        margin = worst_margin(loop, share * lead, k, contact).margin_ns_per_m[0]
        assert (margin >= 0) == passive or abs(margin) <= 1e-12 * (b_d + contact)


@pytest.mark.thorough
@given(st.integers(0, 6), maybe_damping, stiffness, maybe_damping, stiffness)
def test_no_passive_rendering_is_stiffer_than_the_limit(delay, b_e, k_e, b, k):
    lowest = worst_margin(SampledLoop(0.0, b_e, k_e, T, delay, "sampled-data"), b, k)
    needed = -lowest.margin_ns_per_m[0]  # the least device damping that makes the rendering passive
    assert lowest.dc_stiffness_n_per_m[0] <= 2 * needed / ((1 + delay) * T) * (1 + 1e-9)


@pytest.mark.parametrize("delay", [0, 1, 2, 20])
def test_pure_spring_needs_half_a_sample_and_the_delay(delay):
    stiff = 1000.0
    found = worst_margin(SampledLoop(0.0, 0.0, stiff, T, delay, "sampled-data"), np.inf, 1.0)
    assert -found.margin_ns_per_m[0] == pytest.approx(stiff * (1 + 2 * delay) * T / 2, rel=1e-12)


@pytest.mark.thorough
@given(st.floats(0.01, 100), st.floats(-50, 50), stiffness)
def test_colgate_schenkel_condition_of_a_spring_and_damper(b_d, b_e, k_e):
    margin = worst_margin(SampledLoop(b_d, b_e, k_e, T, 0, "sampled-data"), np.inf, 1.0).margin_ns_per_m[0]
    assert margin == pytest.approx(b_d - k_e * T / 2 - abs(b_e), abs=1e-12 * (b_d + k_e * T + abs(b_e)))


@given(damping, damping, stiffness)
def test_paper_hold_does_not_see_the_coupling_stiffness_at_a_rigid_wall(b_d, b, k):
    loop = SampledLoop(b_d, 0.0, 1e14, T, 0, "paper")
    margin = worst_margin(loop, b, k).margin_ns_per_m[0]
    assert margin >= b_d * (1 - 1e-9) - 1e-6 * (b + k * T)
