"""What the page of `avc explore` sets is a problem like any other: same rules, same files, same answers."""

import json

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.coupling import Gains
from avc_casadi.explore import PARTS, Explorer, problem_of_settings
from avc_casadi.explore._answers import answer
from avc_casadi.explore._fields import FIELDS
from avc_casadi.explore._settings import LIVE, settings_of, values_of

BASE = avc.load_problem("figure5").changed(frequency={"points": 30})
FRESH = {"device": None, "values": {}, "method": "direct", "gains": {}, "motion": "press"}


def asked(**changes):
    return {"settings": FRESH | changes}


def told(part, base=BASE, **changes):
    return answer(Explorer(base, "figure5"), PARTS[part], asked(**changes))


def test_nothing_changed_is_the_problem_itself():
    problem = problem_of_settings(BASE, settings_of(FRESH))
    assert problem.changed(scene={}) == BASE.changed(scene=problem.scene)


@given(
    st.dictionaries(
        st.sampled_from([field.key for field in FIELDS]),
        st.one_of(st.none(), st.floats(-1e9, 1e9), st.integers(-9, 2000), st.text(max_size=4), st.booleans()),
        max_size=4,
    ),
    st.sampled_from([None, "novint-falcon", "reference-r1", "no-such-device"]),
)
@settings(max_examples=60)
def test_any_settings_are_a_problem_or_faults_with_their_fields(values, device):
    try:
        problem = problem_of_settings(BASE, settings_of(FRESH | {"values": values, "device": device}))
    except avc.InputError as error:
        event(f"{len(error.faults)} faults")
        return
    assert avc.parse_problem(avc.dump_problem(problem), name=problem.name) == problem
    kept = values_of(problem)
    for key, value in values.items():
        if isinstance(value, float) and kept[key] is not None:
            assert kept[key] == value


def test_bounds_keep_their_ratio_to_the_wall():
    found = problem_of_settings(BASE, settings_of(FRESH | {"values": {"environment.stiffness_n_per_m": 5e4}}))
    assert found.boundaries.upper.stiffness_n_per_m == pytest.approx(5.5e4)
    assert found.boundaries.lower.damping_ns_per_m == BASE.boundaries.lower.damping_ns_per_m


def test_a_device_of_the_catalogue_brings_its_ranges_and_a_value_given_anew_has_none():
    falcon = problem_of_settings(BASE, settings_of(FRESH | {"device": "novint-falcon"}))
    assert falcon.device == avc.load_device("novint-falcon").device
    lighter = FRESH | {"device": "novint-falcon", "values": {"device.mass_kg": 0.3}}
    assert problem_of_settings(BASE, settings_of(lighter)).device.range.mass_kg is None


@pytest.mark.parametrize("method", [method for method in LIVE if method != "constant"])
def test_the_picture_shows_what_solve_gives(method):
    found = told("now", method=method)["gains"]
    gains = avc.solve(BASE, method)
    shown = np.array([np.nan if value is None else value for value in found["stiffness_n_per_m"]])
    np.testing.assert_allclose(shown, gains.stiffness_n_per_m, rtol=1e-5)
    assert found["counts"] == gains.counts()


def test_the_verdict_is_that_of_certify_and_deployable():
    found = told("judge", method="constant", gains={"stiffness_n_per_m": 900.0})
    problem = problem_of_settings(BASE, settings_of(FRESH))
    coupling = avc.Coupling.constant(problem, Gains(0.0, 900.0), "constant")
    assert found["deployable"]["pass"] == avc.deployable(coupling).passed
    levels = avc.certify(problem, coupling.schedule).levels
    assert {one["level"]: one["pass"] for one in found["levels"]} == {name: one.passed for name, one in levels.items()}


def test_a_saved_coupling_is_one():
    question = asked(method="constant", gains={"stiffness_n_per_m": 900.0}) | {"kind": "coupling"}
    found = answer(Explorer(BASE, "figure5"), PARTS["file"], question)
    document = json.loads(found["text"])
    assert document["schema"] == "avc-coupling/1"
    assert document["certificate"]["deployable"]["pass"] is True


def test_gains_that_are_none_are_told_with_their_fields():
    found = told("now", method="constant", gains={"stiffness_n_per_m": -1, "damping_ns_per_m": "much"})
    assert {fault["key"] for fault in found["errors"]} == {"gains.stiffness_n_per_m", "gains.damping_ns_per_m"}


def test_what_would_take_minutes_is_refused_beside_its_field():
    slow = {"device.sample_time_s": 1e-5, "device.delay_samples": 1000, "frequency.points": 1_000_000}
    for part in ("now", "touch", "judge"):
        faults = told(part, values=slow)["errors"]
        assert {fault["key"] for fault in faults} == set(slow)
        assert all("allowed on this page" in fault["message"] for fault in faults)


def test_a_device_file_that_is_wrong_says_where():
    found = answer(
        Explorer(BASE, "figure5"), PARTS["device"], {"text": "[device]\nmass_kg = -1\n", "file": "mine.toml"}
    )
    faults = [(fault["file"], fault["line"], fault["key"]) for fault in found["errors"]]
    assert ("mine.toml", 2, "device.mass_kg") in faults
