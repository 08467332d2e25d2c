"""Realism that the problem requires is kept at every row; a row without gains has none, as a lattice confirms."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from schedule_problems import figure5

from avc_casadi import InputError, UnsupportedError, parse_problem, solve
from avc_casadi.claims.scope import scope_slack
from avc_casadi.cli import main
from avc_casadi.design.comparison.comparison import compare
from avc_casadi.files.problem_file import dump_problem
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.realism import bound_magnitudes

ROUNDING = 1e-9
SEPARATE = {"slope_penalty": 0.0, "contact_damping_penalty": 0.0}
TOLERANCE = 4e-4
"""What the NLP's tolerance of 1e-8 in the mean of ten squared errors leaves to one of them."""
DAMPED = {"coupling": {"structure": "damped", "contact_damping_ns_per_m": (0.0, 150.0)}}
CASES: list[tuple[str, str, dict[str, dict[str, Any]]]] = [
    ("jnd", "pointwise", {}),
    ("bounds", "pointwise", {"device": {"delay_samples": 1}}),
    ("jnd", "band", {}),
    ("bounds", "band", {}),
    ("jnd", "all", {"stability": {"scope": "all", "model": "sampled-data"}}),
    ("bounds", "hands", {}),
    ("jnd", "pointwise", DAMPED),
]


def problem_with(require: str, scope: str, changes: dict[str, dict[str, Any]], points: int = 10) -> Problem:
    tables = {
        "stability": {"scope": scope},
        "realism": {"require": require, "jnd": 0.3},
        "schedule": SEPARATE,
    } | changes
    return figure5(points=points, **tables)


def real(problem: Problem, loop: Loop, z: np.ndarray, rounding: float) -> np.ndarray:
    """Whether impedances (..., n) are what the problem requires, written out anew."""
    if problem.realism.require == "jnd":
        return np.asarray(np.abs(z - loop.target) <= (problem.realism.jnd + rounding) * np.abs(loop.target))
    u, lower = problem.boundaries.upper, problem.boundaries.lower
    b, k = (
        np.array([u.damping_ns_per_m, lower.damping_ns_per_m]),
        np.array([u.stiffness_n_per_m, lower.stiffness_n_per_m]),
    )
    s = np.asarray(loop.environment - problem.environment.damping_ns_per_m) / problem.environment.stiffness_n_per_m
    ends = np.abs(loop.device + loop.hold * (b[:, None] + k[:, None] * s))
    size = np.abs(z)
    return np.asarray((size >= ends.min(axis=0) * (1 - rounding)) & (size <= ends.max(axis=0) * (1 + rounding)))


def lattice(problem: Problem) -> list[np.ndarray]:
    box = problem.coupling
    axes = [
        np.array([low]) if low == high else np.concatenate(([low], np.geomspace(high * 1e-7, high, points - 1)))
        for (low, high), points in (
            (box.damping_ns_per_m, 70),
            (box.stiffness_n_per_m, 70),
            (box.contact_damping_ns_per_m, 9),
        )
    ]
    return [grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")]


def gains_of(schedule: GainSchedule) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m


@pytest.mark.thorough
@pytest.mark.parametrize(("require", "scope", "changes"), CASES)
def test_rows_are_real_and_no_lattice_point_betters_them(
    require: str, scope: str, changes: dict[str, dict[str, Any]]
) -> None:
    problem = problem_with(require, scope, changes)
    loop, smooth = loop_at(problem, problem.frequencies_hz()), problem.changed(schedule={"slope_penalty": 1e-3})
    for found in (solve(smooth, "schedule"), solve(problem, "schedule")):
        assert {str(status) for status in found.status} <= {"solved", "active-bound", "infeasible"}, found.reason
        rows = found.usable
        assert rows.any()
        assert real(problem, loop, found.impedance, ROUNDING)[rows].all()
        b, k, p = (gain[rows] for gain in gains_of(found))
        assert scope_slack(problem, found.frequency_hz[rows], b, k, p).met.all()
        assert all(bool(text) is not bool(has) for text, has in zip(found.reason, rows, strict=True))

    b, k, p = lattice(problem)
    for row in range(0, found.rows, 2):
        own_loop = loop_at(problem, found.frequency_hz[row : row + 1])
        z, radius = own_loop.perceived(b[:, None], k[:, None], p[:, None]), abs(own_loop.target[0])
        own = found.magnitude_error[row] / radius if found.usable[row] else np.inf
        error = np.abs(np.abs(z[:, 0]) / radius - 1)
        better = np.flatnonzero(real(problem, own_loop, z, 0.0)[:, 0] & (error < own - TOLERANCE))
        better = better[np.argsort(error[better])][:600]
        if better.size:
            slack = scope_slack(problem, found.frequency_hz[row], b[better], k[better], p[better])
            assert not slack.met.any(), f"row {row}: {error[better][slack.met].min()} < {own}"


@pytest.mark.thorough
def test_reason_states_the_smallest_relaxation() -> None:
    problem = problem_with("jnd", "pointwise", {})
    found = solve(problem, "schedule")
    row = found.status.index("infeasible")
    error = float(found.reason[row].split("at best ")[1].split(" ")[0])
    for share, usable in ((1.0001, True), (0.9999, False)):
        relaxed = problem.changed(realism={"jnd": error * share})
        assert bool(solve(relaxed, "schedule").usable[row]) is usable


def test_bounds_that_cannot_be_met_are_named_with_the_miss() -> None:
    problem = problem_with("bounds", "pointwise", {"device": {"delay_samples": 1}})
    found = solve(problem, "schedule")
    row = found.status.index("infeasible")
    low, high = (end[row] for end in bound_magnitudes(problem, loop_at(problem, found.frequency_hz)))
    assert f"not {low:.6g} to {high:.6g}" in found.reason[row]
    assert not low <= float(found.reason[row].split("at best ")[1].split(",")[0]) <= high


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["closed-form", "exact", "static"])
def test_methods_without_realism_say_so(method: str) -> None:
    free, asked = (solve(problem_with(require, "pointwise", {}), method) for require in ("none", "jnd"))
    assert any("does not know realism.require" in note for note in asked.notes)
    assert not any("realism.require" in note for note in free.notes)
    assert np.array_equal(free.stiffness_n_per_m, asked.stiffness_n_per_m, equal_nan=True)


@pytest.mark.parametrize(("require", "scope"), [("jnd", "pointwise"), ("none", "band"), ("none", "hands")])
def test_direct_is_pointwise_alone(require: str, scope: str) -> None:
    with pytest.raises(UnsupportedError, match="use --method schedule"):
        solve(problem_with(require, scope, {}))


def test_equal_bounds_cannot_be_required() -> None:
    text = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\n[environment]\ndamping_ns_per_m = 10.0\n"
    text += 'stiffness_n_per_m = 1e5\n[realism]\nrequire = "bounds"\n'
    with pytest.raises(InputError, match=r"realism\.require.*equal"):
        parse_problem(text)
    with pytest.raises(InputError, match="did you mean"):
        parse_problem(text.replace('"bounds"', '"bound"'))


def test_comparison_stays_pointwise_and_says_what_is_demanded() -> None:
    problem = problem_with("jnd", "pointwise", {})
    comparison = compare(problem)
    assert comparison.cross_check is not None
    assert comparison.cross_check.agree
    assert comparison.scope == "pointwise, realism jnd"


@pytest.mark.thorough
def test_command_answers_with_the_reasons(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "real.toml"
    path.write_text(dump_problem(problem_with("jnd", "pointwise", {})), encoding="utf-8")
    assert main(["solve", str(path), "--method", "schedule", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    inside = [
        real_ for real_, b in zip(document["realism"]["inside_jnd"], document["damping_ns_per_m"], strict=True) if b
    ]
    assert inside
    assert all(inside)
    assert main(["compare", str(path), "--json"]) in {0, 1}
    assert json.loads(capsys.readouterr().out)["problem_scope"] == "pointwise, realism jnd"
