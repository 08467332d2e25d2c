"""The conclusion of a recommendation says where a force begins before the wall, and whom a median leaves out."""

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.recommendation.contact_onset import NOTICED_N, contact_onset_m


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("damping", [0.5, 30.0])
def test_a_contact_damper_that_pushes_early_is_told(damping, soft):
    """Cut at 0, k x + b v begins at -b v/k, with k of wall and coupling together."""
    problem = avc.load_problem("spring").changed(
        environment={"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 0.0}, device={"sample_time_s": 1e-4}
    )
    coupling = Coupling.constant(problem, Gains(0.0, 6000.0 if soft else 1e8, damping), "x")
    felt = 1500.0 if soft else 2000.0
    for speed, depth in contact_onset_m(coupling).items():
        # A sample late at most, and the force grows from 0 to what is noticed.
        assert depth == pytest.approx((NOTICED_N - damping * float(speed)) / felt, abs=2e-4 * float(speed) + 2e-5)
