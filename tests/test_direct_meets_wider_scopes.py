"""`direct` with scopes band, all and hands: met exactly at every row, and no lattice point does better."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from avc_casadi import UnsupportedError, load_problem, solve
from avc_casadi.claims.certify import certify
from avc_casadi.claims.stability.scope import scope_slack
from avc_casadi.model.problem import Problem
from avc_casadi.paper.loop import loop_at

DAMPED = {"coupling": {"structure": "damped", "contact_damping_ns_per_m": (0.0, 150.0)}}
CASES: list[tuple[str, dict[str, dict[str, Any]]]] = [
    ("band", {}),
    ("band", {"stability": {"model": "sampled-data"}}),
    ("band", {"device": {"delay_samples": 2}}),
    ("all", {}),
    ("all", {"stability": {"model": "sampled-data"}}),
    ("hands", {}),
    ("band", DAMPED),
    ("hands", DAMPED),
]


def problem_with(scope: str, changes: dict[str, dict[str, Any]], points: int = 9) -> Problem:
    problem = load_problem("figure5")
    merged = {"stability": {"scope": scope}, "frequency": {"points": points}}
    for table, values in changes.items():
        merged[table] = {**merged.get(table, {}), **values}
    tables = {name: getattr(problem, name).model_copy(update=values) for name, values in merged.items()}
    return problem.model_copy(update=tables)


def lattice(problem: Problem) -> list[np.ndarray]:
    box = problem.coupling
    axes = [
        np.array([low]) if low == high else np.concatenate(([low], np.geomspace(high * 1e-7, high, points - 1)))
        for (low, high), points in (
            (box.damping_ns_per_m, 40),
            (box.stiffness_n_per_m, 40),
            (box.contact_damping_ns_per_m, 7),
        )
    ]
    return [grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")]


@pytest.mark.thorough
@pytest.mark.parametrize(("scope", "changes"), CASES)
def test_scope_is_met_exactly_and_no_lattice_point_is_better(scope: str, changes: dict[str, dict[str, Any]]) -> None:
    problem = problem_with(scope, changes)
    gains = solve(problem)
    assert gains.usable.all(), gains.reason
    found = (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    assert scope_slack(problem, gains.frequency_hz, *found).met.all()

    b, k, p = lattice(problem)
    for row in range(0, gains.rows, 2):
        frequency = gains.frequency_hz[row]
        loop = loop_at(problem, np.array([frequency]))
        radius = abs(loop.target[0])
        own = gains.magnitude_error[row] / radius
        error = np.abs(np.abs(loop.perceived(b, k, p)) / radius - 1)
        better = np.flatnonzero(error < own - 1e-6)
        better = better[np.argsort(error[better])][:1500]
        if better.size:
            slack = scope_slack(problem, frequency, b[better], k[better], p[better])
            assert not slack.met.any(), f"{frequency} Hz: {error[better][slack.met].min()} < {own}"


@pytest.mark.thorough
def test_wider_scope_never_has_the_smaller_error() -> None:
    errors = [solve(problem_with(scope, {}, 24)).magnitude_error for scope in ("pointwise", "band", "all")]
    scale = 1e-6 * np.abs(solve(problem_with("pointwise", {}, 24)).target)
    assert (errors[1] >= errors[0] - scale).all()
    assert (errors[2] >= errors[1] - scale).all()


@pytest.mark.thorough
def test_certificate_of_the_scope_passes() -> None:
    for scope, level in (("band", "L1"), ("all", "L2"), ("hands", "L5")):
        problem = problem_with(scope, {}, 24)
        assert certify(problem, solve(problem)).document()["levels"][level]["pass"]


@pytest.mark.thorough
def test_infeasible_scope_says_by_how_much_and_relaxing_by_it_makes_it_feasible() -> None:
    problem = problem_with("band", {"coupling": {"stiffness_n_per_m": (5e4, 1e7), "damping_ns_per_m": (500.0, 1e4)}}, 5)
    gains = solve(problem)
    missed = [float(text.split("missed by ")[1].split(" N.s/m")[0]) if text else 0.0 for text in gains.reason]
    worst = int(np.argmax(missed))
    assert missed[worst] > 0
    assert not gains.usable[worst]
    for share, usable in ((1.001, True), (0.99, False)):
        damping = problem.device.damping_ns_per_m + share * missed[worst]
        assert bool(solve(problem.changed(device={"damping_ns_per_m": damping})).usable[worst]) is usable


def test_solver_that_knows_no_scope_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedError, match=r"ipopt.*scope band.*leave out --solver"):
        solve(problem_with("band", {}), solver="ipopt")


@pytest.mark.thorough
@pytest.mark.parametrize("scope", ["band", "all"])
def test_no_frequency_is_worse_than_in_the_schedule(scope: str) -> None:
    problem = problem_with(scope, {}, 200)
    gains, schedule = solve(problem), solve(problem, "schedule")
    radius = np.abs(gains.target)
    assert (gains.magnitude_error <= schedule.magnitude_error + 1e-7 * radius).all()


# The bound of the hands is known to a few 1e-6 of spectral radius.
@pytest.mark.thorough
@pytest.mark.parametrize(("scope", "tolerance"), [("band", 1e-6), ("all", 1e-5), ("hands", 1e-4)])
def test_no_frequency_is_better_served_by_the_gains_of_another(scope: str, tolerance: float) -> None:
    problem = problem_with(scope, {}, 60)
    gains = solve(problem)
    found = (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    for row, frequency in enumerate(gains.frequency_hz):
        loop = loop_at(problem, np.array([frequency]))
        radius = abs(loop.target[0])
        error = np.abs(np.abs(loop.perceived(*found)) / radius - 1)
        better = error < gains.magnitude_error[row] / radius - tolerance
        if better.any():
            slack = scope_slack(problem, frequency, *(gain[better] for gain in found))
            assert not slack.met.any(), f"{frequency} Hz"
