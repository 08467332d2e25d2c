"""Each kind of answer as text: few rows of a terminal's width, units, no odd numbers, and the marks of its document."""

import copy
import re
from functools import cache

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.pages.recommendation import recommendation_rows
from avc_casadi.present.terminal import Mark
from avc_casadi.recommendation.bilateral import recommend_bilateral
from avc_casadi.recommendation.recommend import judged_as_recommended

MOST_ROWS, WIDTH = 15, 120
FOLLOWER = """
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
delay_samples = 1
[follower]
mass_kg = 0.3
damping_ns_per_m = 1.0
delay_s = 0.001
stiffness_n_per_m = 50.0
"""
FEW = {"points": 6}


@cache
def judged(wall_n_per_m):
    """A rigid coupling to a wall of soft's device: held at 500 N/m, unstable at 1 MN/m."""
    problem = avc.load_problem("soft").changed(frequency=FEW, environment={"stiffness_n_per_m": wall_n_per_m})
    found = judged_as_recommended(problem, Coupling.constant(problem, Gains(0.0, 1e8), "mine").schedule, hands=4)
    return problem, found


def certificate():
    problem = avc.load_problem("figure5").changed(frequency=FEW)
    return avc.certify(problem, avc.solve(problem, "closed-form"))


ANSWERS = {
    "wall": (lambda: judged(500.0)[1], "N/m"),
    "refused": (lambda: judged(1e6)[1], "N/m"),
    "nothing deployable": (lambda: avc.recommend("hard/massless", hands=3), "Hz"),
    "certificate": (certificate, "N.s/m"),
    "gains": (lambda: avc.solve(avc.load_problem("knob").changed(frequency=FEW), "exact"), "N.m/rad"),
    "methods": (lambda: avc.compare(avc.load_problem("soft").changed(frequency=FEW), mine=(2e3, 7.0)), "N/m"),
    "walls": (lambda: avc.zwidth(avc.load_problem("knob").changed(frequency=FEW)), "N.m/rad"),
    "motion": (lambda: avc.simulate("scenes/teaching-plant"), "N"),
}
SLOW = {
    "knob": (lambda: avc.recommend("knob", hands=4), "N.m/rad"),
    "simulation": (lambda: avc.recommend("tool/unity-60hz", hands=3), "N/m"),
    "follower": (lambda: recommend_bilateral(avc.parse_problem(FOLLOWER), 4), "N/m"),
}
CASES = [*ANSWERS.items(), *(pytest.param(*one, marks=pytest.mark.thorough) for one in SLOW.items())]


@pytest.mark.parametrize(("name", "answer"), CASES)
def test_an_answer_is_a_few_rows_with_units(name, answer):
    make, unit = answer
    text = str(make())
    lines = text.splitlines()
    assert 2 < len(lines) <= MOST_ROWS, name
    assert max(map(len, lines)) <= WIDTH
    assert not re.search(r"\b(nan|inf|None|True|False)\b", text)
    assert re.search(rf"\d [a-zA-Z]*{re.escape(unit)}\b", text), text
    # A power of ten stands before no unit that takes a prefix.
    assert not re.search(r"\d(\.\d+)?e[+-]?\d+ ?(N|kg|g|m|Hz|s|J|rad)\b", text)
    if unit == "N.m/rad":
        assert not re.search(r"\bN/m\b|\bN\.s/m\b|\b[kmu]?g\b(?!\.m2)", text)


def marks(document, problem):
    return {row.label: row.mark for row in recommendation_rows(document, problem)}


@pytest.mark.parametrize(("wall_n_per_m", "deployable"), [(500.0, True), (1e6, False)])
def test_marks_are_the_verdicts_of_the_document(wall_n_per_m, deployable):
    problem, found = judged(wall_n_per_m)
    document = found.document()
    assert document["deployable"] is found.deployable is deployable
    told = marks(document, problem)
    verdict = Mark.PASS if deployable else Mark.FAIL
    assert told["Coupling"] is told["Stability"] is verdict
    trial = document["trial"]
    assert (told["Simulated"] is Mark.PASS) == (trial["at_rest"] == trial["at_rest_without_friction"] == trial["hands"])


# What of the document of a wall that is held becomes another number, and the mark of a row then.
CHANGES = [
    ({}, "Coupling", Mark.PASS),
    ({"deployable": False}, "Coupling", Mark.FAIL),
    ({"not_used": ["device.backlash_m (no model of it)"]}, "Coupling", Mark.CAUTION),
    ({"felt": {"share_of_wall": 0.17, "stiffness_in_motion_n_per_m": {"1": 10.0}}}, "Coupling", Mark.CAUTION),
    ({"felt": {"share_of_wall": 1.13}}, "Rendered", Mark.CAUTION),
    ({"felt": {"complex_error": {"1": 0.3, "10": 0.1}}}, "Impedance error", Mark.CAUTION),
    ({"felt": {"complex_error": {"1": 0.1, "50": 1.4}}}, "Impedance error", Mark.NONE),
    ({"felt": {"rest_error_m": 1.2e-3}}, "Dry friction", Mark.CAUTION),
    ({"felt": {"rest_error_m": 0.8e-3}}, "Dry friction", None),
    ({"with_friction_n_per_m": 700.0}, "With friction", Mark.NONE),
    ({"with_friction_n_per_m": 520.0}, "With friction", None),
    ({"trial": {"at_rest": 3}}, "Simulated", Mark.FAIL),
    ({"trial": {"quiet": 2}}, "Simulated", Mark.CAUTION),
]


@pytest.mark.parametrize(("change", "label", "mark"), CHANGES, ids=str)
def test_a_number_beyond_its_limit_marks_its_row(change, label, mark):
    problem, found = judged(500.0)
    document = copy.deepcopy(found.document())
    for key, value in change.items():
        document[key] = document[key] | value if isinstance(value, dict) else value
    assert marks(document, problem).get(label) is mark
