"""Hard cases of the schedule: corners, resonance, one stage and five thousand, Ctrl-C."""

import numpy as np
import pytest
from schedule_problems import figure5

from avc_casadi import solve
from avc_casadi.model.schedule import Status


def cost(gains):
    return float(gains.notes[0].split()[1].rstrip(":"))


def test_stages_on_the_edge_of_the_box():
    problem = figure5(coupling={"damping_ns_per_m": (0.0, 5.0), "stiffness_n_per_m": (0.0, 2e3)})
    gains = solve(problem, "schedule")
    # The wall is far stiffer than the box allows: while the whole scope is met, k stands on its end to the last bit.
    on_edge = gains.stiffness_n_per_m == 2e3
    assert on_edge[:15].all()
    assert (gains.damping_ns_per_m <= 5.0).all()
    assert {status for status, at in zip(gains.status, on_edge, strict=True) if at} == {Status.ACTIVE_BOUND}


@pytest.mark.thorough
def test_five_thousand_stages_have_the_optimum_of_two_hundred():
    few, many = (solve(figure5(points=points), "schedule") for points in (200, 5000))
    assert many.usable.all()
    assert cost(many) == pytest.approx(cost(few), rel=0.02)
    between = np.interp(np.log(few.frequency_hz), np.log(many.frequency_hz), np.log(many.damping_ns_per_m + 1))
    np.testing.assert_allclose(between, np.log(few.damping_ns_per_m + 1), atol=0.15)
