"""Every method keeps its claim for every device of the range; the hand's damping counts in `schedule` alone."""

import numpy as np
import pytest
from schedule_problems import changed, figure5

from avc_casadi import solve
from avc_casadi.claims.certify import certify
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


@pytest.mark.thorough
@pytest.mark.parametrize("solver", [None, "ipopt"])
def test_backends_of_direct_agree_on_it(solver):
    problem = ranged()
    gains, exact = solve(problem, solver=solver), solve(problem, "exact")
    assert (np.abs(gains.magnitude_error - exact.magnitude_error) <= 1e-6 * np.abs(gains.target)).all()
    assert certify(problem, gains, draws=0).levels["L0"].passed


def test_row_that_no_device_of_the_range_can_keep_says_by_how_much():
    problem = ranged(coupling={"stiffness_n_per_m": (5e4, 1e7), "damping_ns_per_m": (500.0, 1e4)})
    gains = solve(problem)
    row = gains.status.index("infeasible")
    missed = float(gains.reason[row].split("missed by ")[1].split(":")[0])
    for share, usable in ((1.0001, True), (0.99, False)):
        ends = tuple(end + share * missed for end in RANGE["damping_ns_per_m"])
        moved = problem.changed(
            device={"damping_ns_per_m": 2.0 + share * missed, "range": {"damping_ns_per_m": ends, "mass_kg": None}}
        )
        assert bool(solve(moved).usable[row]) is usable


def test_direct_does_not_credit_the_hand_and_says_so():
    plain = figure5(points=8)
    trusting = changed(plain, schedule={"hand_damping_ns_per_m": 7.0})
    without, gains = solve(plain), solve(trusting)
    assert np.array_equal(without.impedance, gains.impedance, equal_nan=True)
    assert any("hand_damping_ns_per_m is not credited" in note for note in gains.notes)
    assert not any("hand_damping" in note for note in without.notes)


def test_schedule_says_what_it_credits():
    trusting = figure5(points=12, schedule={"hand_damping_ns_per_m": 7.0})
    gains = solve(trusting, "schedule")
    assert -7 <= least_real_part(trusting, gains, 2.0) < 0
    assert any("schedule.hand_damping_ns_per_m" in note for note in gains.notes)


@pytest.mark.thorough
def test_ranges_that_no_design_uses_are_named():
    problem = figure5(points=5, device={"delay_samples": 1}).changed(device={"range": {"delay_samples": (0.0, 2.0)}})
    for method in ("direct", "static"):
        assert any("device.range.delay_samples" in note for note in solve(problem, method).notes)
    assert not any("range" in note for note in solve(ranged()).notes)
