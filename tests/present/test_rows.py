"""Each kind of answer: few rows of a terminal's width, each number in its data, units of the device."""

import re
import shlex
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi._util.text import quantity
from avc_casadi.cli import build_parser
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.row import MOST_LINES, MOST_ROWS, WIDTH, Mark, Page, Value
from avc_casadi.present.rows.answers import answer_of
from avc_casadi.present.rows.recommend import rows_of
from avc_casadi.recommendation.recommend import judged_as_recommended

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
contact_stiffness_n_per_m = 1000.0
"""
FEW = {"points": 6}
LAGGING = {"amplifier_bandwidth_hz": 300.0}


@cache
def judged(wall_n_per_m):
    """A rigid coupling to a wall of soft's device: stable at 500 N/m, unstable at 1 MN/m."""
    problem = avc.load_problem("soft").changed(frequency=FEW, environment={"stiffness_n_per_m": wall_n_per_m})
    found = judged_as_recommended(problem, Coupling.constant(problem, Gains(0.0, 1e8), "mine").schedule, hands=4)
    return problem, found


def certificate():
    problem = avc.load_problem("figure5").changed(frequency=FEW)
    return avc.certify(problem, avc.solve(problem, "closed-form"))


ANSWERS = {
    "wall": lambda: judged(500.0)[1],
    "nothing deployable": lambda: avc.recommend("hard/massless", hands=3),
    "certificate": certificate,
    "gains": lambda: avc.solve(avc.load_problem("knob").changed(frequency=FEW), "exact"),
    "methods": lambda: avc.compare(avc.load_problem("soft").changed(frequency=FEW), mine=(2e3, 7.0)),
    "walls": lambda: avc.zwidth(avc.load_problem("knob").changed(frequency=FEW)),
    "walls, lagging amplifier": lambda: avc.zwidth(
        avc.load_problem("soft").changed(device={"amplifier_bandwidth_hz": 300.0})
    ),
    "motion": lambda: avc.simulate("scenes/teaching-plant"),
    "own law": lambda: avc.certify_law("figure5", k=2e3, b=4.0),
    "own law, unstable": lambda: avc.certify_law("soft", k=1e6),
}
SLOW = {
    "refused": lambda: judged(1e6)[1],
    "own law, turning": lambda: avc.certify_law("smartknob", k=0.06, b=0.001),
    "follower": lambda: avc.recommend(avc.parse_problem(FOLLOWER), 4),
    "knob": lambda: avc.recommend("knob", hands=4),
    "simulation": lambda: avc.recommend(
        avc.load_problem("tool/mujoco-500hz").changed(simulation={"clock": "device"}), hands=3
    ),
    "wheel": lambda: avc.recommend("tool/wheel-game-62hz", hands=3),
    "own law, turning, unstable": lambda: avc.certify_law("smartknob", k=60.0),
}
CASES = [*ANSWERS.items(), *(pytest.param(*one, marks=pytest.mark.slow) for one in SLOW.items())]


def numbers(value):
    """Every number of JSON values, sizes of negative ones too; keys that are numbers."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from numbers(one)
            if re.fullmatch(r"[\d.]+", key):
                yield float(key)
    elif isinstance(value, list | tuple):
        yield float(len(value))
        for one in value:
            yield from numbers(one)
    elif isinstance(value, int | float):
        yield abs(float(value))


# Words that no engineer looks for, and levels without their meaning.
NO_TERM = re.compile(r"\b(rings?|shaken|off|told|asked|least bad|gives? way|zeta|let go|bears?|edge|L\d)\b")
OF_OTHERS = {
    True: re.compile(r"\d [munkMG]?(N\.m|rad|g\.m2)"),
    False: re.compile(r"\d [munkMG]?(N/m|N\.s/m|m/s|N|g|m)(?![./\w])"),
}


@pytest.mark.parametrize(("name", "make"), CASES)
def test_an_answer_is_a_few_rows_whose_numbers_are_its_data(name, make):
    result = make()
    answer = answer_of(result)
    assert str(result) == Page().rendered(answer), name
    text = Page().rendered(answer)
    assert len(text.splitlines()) <= MOST_LINES
    assert sum(one.rank == 0 for one in answer.rows) <= MOST_ROWS
    whole = f"{text}\n{Page().rendered(answer, verbose=True)}"
    assert max(map(len, whole.splitlines())) <= WIDTH
    assert not re.search(r"\b(nan|inf|None|True|False)\b", whole)
    assert [found[0] for one in answer.rows if (found := NO_TERM.search(one.text(answer.units)))] == []
    assert OF_OTHERS[answer.units.linear].findall(whole) == []
    for command in answer.commands:
        assert build_parser().parse_args(shlex.split(command)[1:]).run, command
    # A power of ten stands before no unit that takes a prefix.
    assert not re.search(r"\d(\.\d+)?e[+-]?\d+ ?(N|kg|g|m|Hz|s|J|rad)\b", text)
    known = np.array(sorted(numbers(answer.document())))
    counted = sum(numbers_of_row.number is not None for one in answer.rows for numbers_of_row in values(one))
    for one in answer.rows:
        for value in values(one):
            if value.number is not None and np.isfinite(value.number):
                near = np.abs(known - abs(value.number)).min()
                assert near <= 1e-6 * abs(value.number), f"{one.label}: {value.number} is not in the data"
    assert counted > 2 or name == "nothing deployable"


def values(one):
    return [value for value in one.values if isinstance(value, Value)]


LINEAR = {"stiffness": "N/m", "damping": "N.s/m", "mass": "g", "force": "N", "length": "m", "speed": "m/s"}
ROTARY = {
    "stiffness": "N.m/rad",
    "damping": "N.m.s/rad",
    "mass": "kg.m2",
    "force": "N.m",
    "length": "rad",
    "speed": "rad/s",
}


@pytest.mark.parametrize(("problem", "units"), [("soft", LINEAR), ("knob", ROTARY)])
def test_a_quantity_has_the_unit_of_the_device(problem, units):
    stated = avc.load_problem(problem).units
    for of, unit in units.items():
        assert re.fullmatch(rf"1\.23 [munkMG]?{re.escape(unit)}", Value(1.23, of).text(stated)), of
    for of, text in (("time", "1.23 s"), ("frequency", "1.23 Hz"), ("gain", "1.8 dB"), ("phase", "1.23 deg")):
        assert Value(1.23, of).text(stated) == text
    assert Value(None, "gain").text(stated) == "unlimited"


def marks(found):
    return {one.label: one.mark for one in rows_of(found)}


@pytest.mark.parametrize(("wall_n_per_m", "deployable"), [(500.0, True), (1e6, False)])
def test_marks_are_the_verdicts_of_the_data(wall_n_per_m, deployable):
    _, found = judged(wall_n_per_m)
    data = found.data()
    assert data["deployable"] is found.deployable is deployable
    told = marks(found)
    verdict = Mark.PASS if deployable else Mark.FAIL
    assert told["Coupling"] is told["Stability"] is verdict
    trial = data["trial"]
    assert (told["Simulated"] is Mark.PASS) == (trial["at_rest"] == trial["at_rest_without_friction"] == trial["hands"])


FACTORS = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


@given(st.floats(1e-8, 1e11), st.sampled_from([1, -1]), st.integers(2, 5))
def test_a_quantity_is_read_back_within_half_of_its_last_digit(size, sign, digits):
    number, prefix = re.fullmatch(r"(-?[\d.]+) (n|u|m|k|M|G|)N/m", quantity(sign * size, "N/m", digits)).groups()
    assert float(number) * FACTORS[prefix] == pytest.approx(sign * size, rel=0.5001 * 10 ** (1 - digits))
