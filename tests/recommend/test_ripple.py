"""The steps of the encoder as the force of a moving handle has them, against the pulses of a damper written out."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.recommendation.ripple import SPEEDS_M_PER_S, ripple


def damper(step, period, damping, **device):
    wall = {"stiffness_n_per_m": 0.0, "damping_ns_per_m": damping}
    problem = avc.load_problem("figure5").changed(
        device={"encoder_resolution_m": step, "sample_time_s": period, "delay_samples": 0, "coulomb_friction_n": 0.0}
        | {"mass_kg": 0.06, "max_force_n": 3.3}
        | device,
        environment=wall,
        boundaries={"upper": wall, "lower": wall},
        frequency={"stop_hz": 0.4 / period},
    )
    return Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device)), "none")


@pytest.mark.thorough
@settings(max_examples=12)
@given(step=st.floats(1e-5, 2e-4), period=st.sampled_from([5e-4, 1e-3, 2e-3]), damping=st.floats(0.5, 8.0))
def test_ripple_of_a_damper_is_that_of_its_pulses(step, period, damping):
    found = ripple(damper(step, period, damping)).force_n
    for speed in SPEEDS_M_PER_S:
        # So many whole steps in a sample, and one more for a part of the samples.
        shares = np.modf(np.linspace(1.0, 1.1, 2001) * speed * period / step)[0]
        expected = damping * step / period * math.sqrt(np.mean(shares * (1 - shares)))
        assert found[f"{speed:g}"] == pytest.approx(expected, rel=0.1, abs=0.05 * damping * step / period)


def test_hands_feel_the_pulses_of_a_coarse_encoder_and_none_of_a_fine_one():
    coarse, fine = (ripple(damper(step, 1e-3, 5.0)) for step in (55e-6, 0.2e-6))
    assert coarse.quiet < coarse.hands
    assert coarse.force_n["0.02"] == pytest.approx(0.13, abs=0.01)
    assert fine.quiet == fine.hands
