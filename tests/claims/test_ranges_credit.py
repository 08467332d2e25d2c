"""Every method keeps its claim for every device of the range; the hand's damping counts in `schedule` alone."""

import numpy as np
import pytest
from schedule_problems import changed, figure5

from avc_casadi import solve
from avc_casadi.claims.passivity.llewellyn import llewellyn_margin
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.design.constant.static import static_coupling
from avc_casadi.loops.sampled_loop import SampledLoop
from avc_casadi.model.corners import least_damped
from avc_casadi.paper.loop import loop_at

DAMPED = {"structure": "damped", "contact_damping_ns_per_m": (0.0, 60.0)}
RANGE = {"damping_ns_per_m": (0.8, 2.5), "mass_kg": (0.07, 0.13)}


def least_real_part(problem, gains, damping):
    """Smallest Re Z_h with another damping of the device."""
    device = changed(problem, device={"damping_ns_per_m": damping, "range": type(problem.device.range)()})
    rows = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    return np.nanmin(np.where(gains.usable, loop_at(device, gains.frequency_hz).perceived(*rows).real, np.nan))


def ranged(**tables):
    problem = figure5(points=20, **tables)
    return problem.changed(device={"range": RANGE})


@pytest.mark.parametrize("coupling", [{}, DAMPED], ids=["series", "damped"])
@pytest.mark.parametrize(
    ("method", "require"), [("direct", "none"), ("exact", "none"), ("schedule", "none"), ("schedule", "jnd")]
)
def test_every_device_of_the_range_keeps_the_margin(method, require, coupling):
    problem = ranged(coupling=coupling, realism={"require": require, "jnd": 0.9})
    gains = solve(problem, method)
    assert gains.usable.any()
    assert least_real_part(problem, gains, 0.8) >= -1e-12
    if method != "schedule":
        # Nothing more than that is asked: without the range the least damped device would not keep it.
        assert least_real_part(problem, solve(figure5(points=20, coupling=coupling), method), 0.8) < -0.1


@pytest.mark.thorough
@pytest.mark.parametrize("coupling", [{}, DAMPED], ids=["series", "damped"])
def test_constant_gains_are_safe_with_every_device_of_the_range(coupling):
    problem, known = ranged(coupling=coupling), figure5(points=20, coupling=coupling)
    loop = SampledLoop.of(least_damped(problem))
    for condition, margin in (("llewellyn", llewellyn_margin), ("all", worst_margin)):
        values = []
        for case in (problem, known):
            found = static_coupling(case, condition)
            gains = found.damping_ns_per_m, found.stiffness_n_per_m, found.contact_damping_ns_per_m
            judged = margin(loop, *gains)
            values.append(judged[0][0] if condition == "llewellyn" else judged.margin_ns_per_m[0])
        assert values[0] >= -1e-12
        assert values[1] < -0.1


def test_closed_form_injects_what_the_range_lacks():
    problem = ranged()
    known, unknown = solve(figure5(points=20), "closed-form"), solve(problem, "closed-form")
    pushed = (known.real_part < 1e-9) & known.usable & unknown.usable
    assert pushed.any()
    np.testing.assert_allclose(unknown.real_part[pushed], 1.2, atol=1e-9)
