"""Hard cases of the schedule: corners, resonance, one stage and five thousand, Ctrl-C."""

import signal
import threading

import numpy as np
import pytest
from schedule_problems import changed, figure5

from avc_casadi import InputError, solve
from avc_casadi.files.problem_file import load_problem, parse_problem
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


def test_box_of_one_point():
    problem = figure5(coupling={"damping_ns_per_m": (3.0, 3.0), "stiffness_n_per_m": (2e3, 2e3)})
    gains = solve(problem, "schedule")
    assert set(gains.damping_ns_per_m) == {3.0}
    assert set(gains.stiffness_n_per_m) == {2e3}


def test_resonance_in_the_band():
    problem = changed(load_problem("hard/resonance"), stability={"scope": "band"})
    gains = solve(problem, "schedule")
    assert gains.usable.all()
    assert np.isfinite(gains.magnitude_error).all()


def test_free_space_needs_nothing():
    gains = solve(load_problem("hard/free-space"), "schedule")
    assert gains.usable.all()
    assert gains.magnitude_error.max() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.thorough
def test_five_thousand_stages_have_the_optimum_of_two_hundred():
    few, many = (solve(figure5(points=points), "schedule") for points in (200, 5000))
    assert many.usable.all()
    assert cost(many) == pytest.approx(cost(few), rel=0.02)
    between = np.interp(np.log(few.frequency_hz), np.log(many.frequency_hz), np.log(many.damping_ns_per_m + 1))
    np.testing.assert_allclose(between, np.log(few.damping_ns_per_m + 1), atol=0.15)


def test_frequencies_out_of_order_are_refused_by_the_problem():
    text = "[device]\nmass_kg=0.1\ndamping_ns_per_m=2\n[environment]\ndamping_ns_per_m=1\nstiffness_n_per_m=1e3\n"
    with pytest.raises(InputError, match="allowed: increasing values"):
        parse_problem(text + "[frequency]\nvalues_hz=[1.0, 3.0, 2.0]\n")


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("objective", ["magnitude", "complex", "perceptual"])
@pytest.mark.parametrize("penalty", [0.0, 1e-9, 1e-3, 10.0])
def test_any_objective_with_any_smoothness(objective, penalty):
    problem = figure5(
        points=25,
        realism={"objective": objective},
        stability={"scope": "band"},
        schedule={"slope_penalty": penalty},
        coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, 50.0)},
    )
    assert solve(problem, "schedule").usable.all()


def solve_again_and_again(problem, timer):
    timer.start()  # here: its signal may come at once
    for _ in range(50):
        solve(problem, "schedule")


def test_interrupt_is_passed_on():
    problem = figure5(points=5000, stability={"scope": "band"})
    main = threading.main_thread().ident
    timer = threading.Timer(0.5, lambda: signal.pthread_kill(main, signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            solve_again_and_again(problem, timer)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
