"""Every verdict can be derived again from the arrays of the document alone."""

import json

import numpy as np
import pytest
from drawn_problems import drawn_problem
from walled import has_wall

import avc_casadi as avc
from avc_casadi.design.comparison.document import comparison_document
from avc_casadi.model.problem import Frequency

PROBLEMS = [entry.name for entry in avc.catalogue() if has_wall(entry.name)][::3]


def impedance(document, name):
    return np.array(document[f"{name}_re"], dtype=float) + 1j * np.array(document[f"{name}_im"], dtype=float)


def thinned(name):
    """Every tenth frequency of a problem."""
    problem = avc.load_problem(name)
    return problem.changed(frequency=Frequency(values_hz=tuple(problem.frequencies_hz()[::10])))


@pytest.fixture(scope="module")
def documents():
    return {name: comparison_document(avc.compare(thinned(name))) for name in PROBLEMS}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PROBLEMS)
def test_verdicts(documents, name):
    document, problem = documents[name], avc.load_problem(name)
    closed, direct = document["methods"]["closed-form"], document["methods"]["direct"]
    target = np.abs(impedance(document, "target"))
    box = problem.coupling
    for row, verdict in enumerate(document["verdict"]):
        b, k = closed["requested_damping_ns_per_m"][row], closed["requested_stiffness_n_per_m"][row]
        inside = (
            b is not None
            and k is not None
            and box.damping_ns_per_m[0] <= b <= box.damping_ns_per_m[1]
            and box.stiffness_n_per_m[0] <= k <= box.stiffness_n_per_m[1]
        )
        feasible = direct["damping_ns_per_m"][row] is not None
        if verdict == "infeasible":
            assert not feasible
            continue
        assert feasible
        if verdict == "closed-form-not-realisable":
            assert not inside or problem.coupling.structure == "damped"
            continue
        assert inside
        gap = closed["magnitude_error"][row] - direct["magnitude_error"][row]
        assert gap > -1e-8 * target[row]
        if verdict == "direct-better":
            assert gap > 0
        else:
            assert gap < 1e-6 * target[row]
            assert (verdict == "bound-active") == (direct["status"][row] == "active-bound")


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", range(20))
def test_random_problems(seed):
    """Never an error or NaN, and the optimum is never worse than a closed form that can be built."""
    problem = drawn_problem(np.random.default_rng(seed))
    comparison = avc.compare(problem, mine=(100.0, 1.0))
    json.dumps(comparison_document(comparison), allow_nan=False)
    closed, direct = comparison.methods["closed-form"], comparison.methods["direct"]
    meets = closed.real_part >= problem.stability.margin_ns_per_m - 1e-12 * np.abs(closed.impedance)
    both = closed.usable & direct.usable & meets
    size = np.abs(comparison.target) + np.abs(closed.impedance)
    assert np.all((direct.magnitude_error - closed.magnitude_error)[both] <= 1e-8 * size[both])
    assert comparison.cross_check.agree
