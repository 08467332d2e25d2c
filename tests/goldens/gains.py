"""Gains of every problem of the catalogue, of single frequencies and of a schedule, and the levels that they meet."""

from __future__ import annotations

from typing import Any

import numpy as np

import avc_casadi as avc

METHODS = ("closed-form", "direct", "exact", "schedule")
ROWS = 12
# Designs for every hand take half a minute and more over 200 frequencies: these problems are solved at fewer.
_FEW = dict.fromkeys(("reference-r1", "reference-r2", "reference-r3", "scenes/adaptive-press-series"), 12)
_FEW["scenes/stiff-wall-tuned"] = 12


def gain_cases() -> tuple[str, ...]:
    """Return "problem method" of all problems of the catalogue that have a wall; `direct` knows one scope."""
    problems = {one.name: avc.load_problem(one.name) for one in avc.catalogue()}
    walled = {name: one.stability.scope for name, one in problems.items() if one.simulation is None}
    cases = ((name, method) for method in METHODS for name in walled)
    return tuple(f"{name} {method}" for name, method in cases if method != "direct" or walled[name] == "pointwise")


def gains(case: str) -> dict[str, Any]:
    """Return rows, counts, sums of errors and levels; or the class of the refusal and its keys."""
    name, method = case.split(" ")
    problem = avc.load_problem(name)
    if name in _FEW:
        problem = problem.changed(frequency={"points": _FEW[name]})
    try:
        schedule = avc.solve(problem, method)
    except avc.AvcError as error:
        faults = getattr(error, "faults", ())
        return {"refused": type(error).__name__, "keys": [one.key for one in faults] or [getattr(error, "key", "")]}
    columns = schedule.to_dict()
    statuses = [str(one) for one in columns["status"]]
    rows = np.unique(np.linspace(0, len(statuses) - 1, ROWS).round().astype(int))
    named = {"b": "damping_ns_per_m", "k": "stiffness_n_per_m", "b_p": "contact_damping_ns_per_m"}
    return {
        "counts": {status: statuses.count(status) for status in sorted(set(statuses))},
        "rows": rows.tolist(),
        **{short: np.asarray(columns[key], dtype=float)[rows].tolist() for short, key in named.items()},
        "magnitude_error_sum": float(np.nansum(columns["magnitude_error_ns_per_m"])),
        "complex_error_sum": float(np.nansum(columns["complex_error"])),
        "levels": levels(avc.certify(problem, schedule)),
    }


def levels(certificate: avc.Certificate) -> dict[str, Any]:
    """Return of each level whether it holds, its margin in N.s/m and where it stands."""
    told = certificate.to_dict()
    every = zip(told["level"], told["passed"], told["margin_ns_per_m"], told["frequency_hz"], strict=True)
    # A margin of nothing, as at an active bound, has a place by rounding alone.
    return {
        str(level): {
            "passed": None if passed is None else bool(passed),
            "margin": float(margin),
            "frequency_hz": float(where) if abs(margin) > 1e-6 else None,
        }
        for level, passed, margin, where in every
    }
