"""Realism that the problem requires is kept at every row; a row without gains has none, as a lattice confirms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from schedule_problems import figure5

from avc_casadi import solve
from avc_casadi.claims.hands import scope_slack
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import ImpedanceLoop, loop_at

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


def real(problem: Problem, loop: ImpedanceLoop, z: np.ndarray, rounding: float) -> np.ndarray:
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


@pytest.mark.slow
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
