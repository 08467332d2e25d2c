"""What a release answered still holds: gains, recommendations, exported C and errors.

`tests/goldens/make.py` says what is compared, `tests/goldens/compared.py` with which tolerances and why.
"""

import shutil

import pytest
from goldens.compared import differences
from goldens.make import PARTS, changes, committed

# What together takes below 25 s; `tests/goldens/make.py --check` compares all.
QUICK = {
    "gains": {
        f"{name} {method}"
        for name in ("figure5", "ve2", "soft", "hard/rigid", "hard/massless")
        for method in ("closed-form", "direct", "exact")
    },
    "recommendations": set(),
    "exported_c": {"wall", "knob"},
    "errors": set(PARTS["errors"].cases),
}
CASES = [
    pytest.param(part, case, marks=[pytest.mark.slow] * (part != "errors"))
    for part in PARTS
    for case in sorted(QUICK[part])
]


@pytest.mark.parametrize(("part", "case"), CASES)
def test_the_answer_is_the_golden_one(part, case):
    if part in {"exported_c", "recommendations"} and shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    counting = [one for one in changes(part, case) if one.counts]
    assert not counting, "\n".join(f"{one.place}: {one.golden} -> {one.found}" for one in counting)


@pytest.mark.parametrize("part", PARTS)
def test_every_golden_is_of_a_case_that_is_computed(part):
    assert QUICK[part] <= set(committed(part)) <= set(PARTS[part].cases)


@pytest.mark.parametrize(
    ("key", "old", "new", "told"),
    [
        ("rendered", 3000.0, 2920.0, False),  # 2.7 % softer
        ("rendered", 3000.0, 2900.0, True),
        ("plant", [400, 400], [397, 400], False),  # within the exact interval of 400 of 400
        ("plant", [400, 400], [396, 400], True),
        ("plant", [396, 400], [400, 400], False),
        ("impedance_error", {"10": 0.02}, {"10": 0.01}, False),
        ("impedance_error", {"10": 0.02}, {"10": 0.03}, True),
        ("deployable", True, False, True),
        ("levels", {"L5": {"passed": True}}, {"L5": {"passed": False}}, True),
        ("levels", {"L5": {"passed": False}}, {"L5": {"passed": True}}, False),
    ],
)
def test_a_worse_recommendation_is_told_and_a_better_one_is_not(key, old, new, told):
    found = differences("recommendations", "case", {key: old}, {key: new})
    assert any(one.counts for one in found) == told
