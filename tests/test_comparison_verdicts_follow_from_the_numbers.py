"""Every verdict can be derived again from the arrays of the document alone."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from drawn_problems import drawn_problem
from walled import has_wall

import avc_casadi as avc
from avc_casadi.design.comparison.document import comparison_document
from avc_casadi.design.comparison.verdict import Verdict, judge
from avc_casadi.model.problem import Frequency
from avc_casadi.model.schedule import Status

PROBLEMS = [entry.name for entry in avc.catalogue() if has_wall(entry.name)]


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
@pytest.mark.parametrize("name", PROBLEMS)
def test_document_is_json_and_counts_add_up(documents, name):
    document = documents[name]
    rows = len(document["frequency_hz"])
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["counts"] == {v.value: document["verdict"].count(v.value) for v in Verdict}
    assert sum(document["counts"].values()) == rows
    assert all(document["reason"])
    for key in ("without_coupling_re", "target_im", "upper_re", "lower_im"):
        assert len(document[key]) == rows


@pytest.mark.thorough
@pytest.mark.parametrize("name", PROBLEMS)
def test_direct_and_exact_agree(documents, name):
    check = documents[name]["cross_check"]
    assert check["agree"]
    assert check["magnitude_error"] < 1e-8
    assert check["only_one"] == 0


@pytest.mark.thorough
def test_negative_stiffness_is_not_realisable(documents):
    """The stiff wall of figure 5: the closed form asks for negative stiffness near 300 Hz."""
    document = documents["figure5"]
    asked = document["methods"]["closed-form"]["requested_stiffness_n_per_m"]
    negative = [row for row, k in enumerate(asked) if k < 0]
    assert negative
    for row in negative:
        assert document["verdict"][row] == "closed-form-not-realisable"
        assert f"negative stiffness {asked[row]:.6g};" in document["reason"][row]


@pytest.mark.thorough
def test_bounds_are_what_the_hand_meets_where_they_are_rendered():
    """Independent of the package's equations: z = exp(j theta), Tustin, hold (z+1)/(2z)."""
    problem = avc.load_problem("figure5")
    comparison = avc.compare(problem, methods=("closed-form", "exact"))
    t = problem.device.sample_time_s
    z = np.exp(2j * np.pi * comparison.frequency_hz * t)
    s = 2 / t * (z - 1) / (z + 1)
    device = problem.device.mass_kg * s + problem.device.damping_ns_per_m
    for found, bound in (
        (comparison.upper, problem.boundaries.upper),
        (comparison.lower, problem.boundaries.lower),
        (comparison.without_coupling, problem.environment),
    ):
        expected = device + (z + 1) / (2 * z) * (bound.damping_ns_per_m + bound.stiffness_n_per_m / s)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def one_row(status, error):
    """A schedule of one row with this status and this magnitude error, target 1 N.s/m."""
    problem = avc.load_problem("soft")
    problem = problem.changed(frequency={"points": 1})
    gains = avc.solve(problem, "exact")
    return replace(gains, status=(status,), impedance=np.array([1 + error + 0j]), target=np.array([1 + 0j]))


@pytest.mark.thorough
@pytest.mark.parametrize(("closed", "optimum"), list(itertools.product(Status, Status)), ids=str)
@pytest.mark.parametrize("better", [False, True], ids=["equal", "better"])
def test_precedence(closed, optimum, better):
    (verdict,), (reason,) = judge(one_row(closed, 0.5), one_row(optimum, 0.1 if better else 0.5), np.array([1.0]))
    assert reason
    if not optimum.has_gains:
        assert verdict == "infeasible"
    elif not closed.has_gains:
        assert verdict == "closed-form-not-realisable"
    elif better:
        assert verdict == "direct-better"
    else:
        assert verdict == ("bound-active" if optimum is Status.ACTIVE_BOUND else "agree")


@pytest.mark.thorough
@pytest.mark.parametrize("methods", [(), ("direct",), ("closed-form",), ("exact", "direct")], ids=str)
def test_what_cannot_be_compared_is_refused(methods):
    with pytest.raises(avc.InputError, match="closed-form and at least one of direct, exact"):
        avc.compare(avc.load_problem("soft"), methods=methods)


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
