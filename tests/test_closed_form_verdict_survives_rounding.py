"""The closed form's verdict is that of exact numbers: rounding neither forbids a gain nor asks for a rigid coupling."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.model.problem import Frequency
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.equations import environment_impedance
from avc_casadi.paper.loop import loop_at


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


@pytest.mark.parametrize("structure", ["series", "damped"])
def test_free_space_has_nothing_to_render(structure):
    gains = solve(avc.load_problem("hard/free-space").changed(coupling={"structure": structure}), "closed-form")
    assert gains.usable.all()
    assert not gains.requested_rigid.any()
    np.testing.assert_array_equal(gains.impedance, gains.target)
    assert gains.notes[-1].startswith("nothing to render")


def test_free_space_renders_no_wall():
    wall = {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e4}
    problem = avc.load_problem("hard/free-space").changed(boundaries={"upper": wall, "lower": wall})
    gains = solve(problem, "closed-form")
    assert not gains.usable.any()
    assert all("no coupling renders in free space" in reason for reason in gains.reason)


def test_a_goal_of_the_environment_stays_rigid():
    gains = solve(avc.load_problem("hard/rigid"), "closed-form")
    assert gains.requested_rigid.any()


@pytest.mark.parametrize("room", [0.0, -1e-16, 1e-16, 3e-15, 1e-14, -1e-14, 1e-13, -1e-13, 1e-12])
@pytest.mark.parametrize("hertz", [1.0, 12.0, 100.0])
@pytest.mark.parametrize("method", ["exact", "direct"])
def test_a_constraint_met_with_no_room_is_told_in_numbers(room, hertz, method):
    problem = avc.load_problem("figure5").changed(
        coupling={"stiffness_n_per_m": (50.0, 1e5)}, frequency=Frequency(values_hz=(hertz,))
    )
    top = _largest_real_part(problem)
    gains = solve(problem.changed(stability={"margin_ns_per_m": top * (1 - room)}), method)
    assert "nan" not in gains.reason[0]
    if method == "exact" and abs(room) >= 1e-14:
        assert gains.usable[0] == (room > 0)


def _largest_real_part(problem):
    """Of Re Z_h over the edges of the gain box, by golden sections of its own."""
    loop = loop_at(problem, problem.frequencies_hz())
    (b0, b1), (k0, k1) = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
    best = -np.inf
    for edge in (
        lambda t: (b0, k0 + t * (k1 - k0)),
        lambda t: (b1, k0 + t * (k1 - k0)),
        lambda t: (b0 + t * (b1 - b0), k0),
        lambda t: (b0 + t * (b1 - b0), k1),
    ):
        low, high = 0.0, 1.0
        for _ in range(60):
            t = low + (high - low) * np.linspace(0, 1, 101)
            value = loop.perceived(*map(np.asarray, edge(t[:, None]))).real
            value = np.broadcast_to(value, (101, 1))[:, 0]
            at = int(np.argmax(value))
            best = max(best, float(value[at]))
            low, high = t[max(at - 1, 0)], t[min(at + 1, 100)]
    return best


def test_the_printed_tustin_has_no_half_sample_of_stiffness_in_its_real_part():
    """s as printed in (10) is imaginary: Re Z_ds is the damper alone, whatever the hold model."""
    problem = avc.load_problem("figure5").changed(stability={"model": "sampled-data"})
    loop = loop_at(problem, problem.frequencies_hz())
    printed = project(problem, as_printed=True)
    desired = printed.rendered - printed.injected_damping_ns_per_m / loop.hold
    bounds, period = problem.boundaries, problem.device.sample_time_s
    b = (bounds.upper.damping_ns_per_m + bounds.lower.damping_ns_per_m) / 2
    k = (bounds.upper.stiffness_n_per_m + bounds.lower.stiffness_n_per_m) / 2
    right = environment_impedance(loop.angle, "paper", b, k)
    scale = np.abs(printed.rendered)
    assert np.all(np.abs(desired.real - b) <= 1e-12 * scale)
    assert np.all(np.abs(desired.imag - right.imag * 4 / period**2) <= 1e-12 * scale)
