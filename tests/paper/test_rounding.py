"""The closed form's verdict is that of exact numbers: rounding neither forbids a gain nor asks for a rigid coupling."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve


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
