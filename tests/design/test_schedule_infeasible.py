"""Without a schedule the reasons name the constraint, the frequency and the amount, and that amount is enough."""

import re

import pytest
from schedule_problems import changed

from avc_casadi import solve
from avc_casadi.files.problem_file import load_problem


def amount(reason, pattern):
    return float(re.search(pattern, reason).group(1))


@pytest.mark.parametrize(
    ("scope", "model"), [("pointwise", "sampled-data"), ("band", "sampled-data"), ("all", "paper")]
)
def test_box_without_passive_gains(scope, model):
    problem = changed(
        load_problem("hard/infeasible-box" if model == "sampled-data" else "hard/pinned-box"),
        stability={"scope": scope, "model": model},
        frequency={"points": 20},
    )
    gains = solve(problem, "schedule")
    assert gains.counts() == {"infeasible": 20}
    assert gains.notes == ("no row can meet its scope: no schedule",)
    missed = max(amount(reason, r"short by (\S+)") for reason in gains.reason)
    assert f"scope {scope}" in gains.reason[0]
    damping = problem.device.damping_ns_per_m
    enough = changed(problem, device={"damping_ns_per_m": damping + missed * (1 + 1e-5) + 1e-4})
    assert solve(enough, "schedule").usable.all()
    short = changed(problem, device={"damping_ns_per_m": damping + missed * 0.98})
    assert not solve(short, "schedule").usable.all()


def test_hands_that_no_gains_can_hold():
    problem = changed(load_problem("hard/infeasible-box"), stability={"scope": "hands"}, frequency={"points": 3})
    gains = solve(problem, "schedule")
    assert gains.counts() == {"infeasible": 3}
    assert amount(gains.reason[0], r"spectral radius is (\S+) with") > 1


def test_slope_limit_that_the_scopes_exclude():
    # With a sample of delay and this spring, 1 Hz needs b >= 6.5 N.s/m and 250 Hz needs b <= 0.5 N.s/m.
    problem = changed(
        load_problem("figure5"),
        device={"delay_samples": 1, "damping_ns_per_m": 4.0},
        environment={"stiffness_n_per_m": 1e9},
        coupling={"stiffness_n_per_m": (7e3, 7e3)},
        stability={"model": "sampled-data"},
        frequency={"values_hz": (1.0, 2.0, 250.0)},
    )
    assert solve(problem, "schedule").usable.all()
    gains = solve(changed(problem, schedule={"slope_limit": 1e-3}), "schedule")
    assert gains.counts() == {"failed": 3}
    assert "schedule.slope_limit" in gains.reason[0]
