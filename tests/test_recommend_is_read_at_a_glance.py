"""`avc recommend` answers in ten aligned lines with the numbers of its document; all that is known stands behind -v."""

import contextlib
import io
import json
import re

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.present.pages.recommendation import recommendation_page
from avc_casadi.present.terminal import Page
from avc_casadi.recommendation.recommend import judged_as_recommended
from avc_casadi.recommendation.told import conclusion_lines

FACTORS = {"": 1.0, "k": 1e3, "M": 1e6}


def rows_of(text):
    """Return the rows by their label, with the mark of each."""
    found = [re.match(r"  ([✓✗! ]) (\w[\w ]*?)  +(\S.*)", line) for line in text.splitlines()]
    return {one[2]: (one[1], one[3]) for one in found if one}


def newtons_per_metre(text):
    number, prefix = re.search(r"([\d.]+) (k|M|)N/m", text).groups()
    return float(number) * FACTORS[prefix]


@pytest.fixture(scope="module")
def answers():
    """The text, the longer text and the document of one recommendation."""
    short, longer, document = (
        said(["recommend", "spring", "--hands", "8", *more]) for more in ([], ["-v"], ["--json"])
    )
    return short, longer, json.loads(document)


def said(arguments):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(arguments) == 0
    return out.getvalue()


@pytest.mark.thorough
def test_it_tells_the_numbers_of_its_document(answers):
    text, _, document = answers
    rows = rows_of(text)
    assert newtons_per_metre(rows["Rendered"][1]) == pytest.approx(document["felt"]["stiffness_n_per_m"], rel=6e-3)
    assert newtons_per_metre(rows["Linear limit"][1]) == pytest.approx(document["plain_wall_n_per_m"], rel=6e-3)
    hands = document["trial"]["hands"] + document["confirmed"]["hands"]
    settled = document["trial"]["at_rest"] + document["confirmed"]["at_rest"]
    assert rows["Simulated"][1].startswith(f"{settled} of {hands} hands settle")
    assert rows["Coupling"] == ("✓", "contact damper b_p 14.1 N.s/m, wall rendered directly: deployable")
    assert rows["Stability"][0] == "✓"
    assert "proved (L7)" in rows["Stability"][1]


@pytest.mark.thorough
def test_it_takes_fifteen_lines_at_most_and_says_all_with_v(answers):
    text, longer, document = answers
    assert len(text.splitlines()) <= 15
    assert longer.startswith(text.rstrip("\n"))
    assert len(re.findall(r"^settling: released in [\d.]+ s; worst hand: damping ratio", longer, re.MULTILINE)) == 1
    for gap in document["assumed"]:
        assert f"assumed: {gap}" in longer
        assert gap not in text


@pytest.mark.parametrize("method", ["static", pytest.param("direct", marks=pytest.mark.thorough)])
def test_what_is_not_deployable_is_told_with_its_fault(method):
    problem = avc.load_problem("figure5")
    found = judged_as_recommended(problem, avc.solve(problem, method), hands=8)
    text = recommendation_page(found.document(), problem, Page(), "figure5")
    rows = rows_of(text)
    assert not found.deployable
    assert rows["Coupling"][0] == "✗"
    assert "NOT deployable" in " ".join(text.split())
    assert rows["Stability"][0] == "✗"
    assert len(text.splitlines()) <= 15


def test_what_is_declared_and_not_used_weakens_the_verdict(answers, tmp_path):
    """Play before an encoder at the handle, and a filter of the scene that only a simulation runs."""
    case = avc.load_problem("spring").changed(
        device={
            "backlash_m": 1e-4,
            "encoder_at": "handle",
            "resonance": {"frequency_hz": 100.0, "damping_ratio": 0.05, "mass_ratio": 0.5},
        },
        scene={"effects": ({"kind": "velocity-filter", "cutoff_hz": 50.0},)},
        boundaries={side: vars(avc.load_problem("spring").environment) for side in ("upper", "lower")},
    )
    file = tmp_path / "play.toml"
    file.write_text(avc.dump_problem(case), encoding="utf-8")
    unused = json.loads(said(["check", str(file), "--json"]))["not_used"]
    assert [what.partition(" (")[0] for what in unused] == ["device.backlash_m", "scene.effects: velocity-filter"]
    checked = said(["check", str(file)])
    assert all(what in " ".join(checked.split()) for what in unused)
    document = answers[2] | {"not_used": unused}
    mark, verdict = rows_of(recommendation_page(document, case, Page(width=200), "play.toml"))["Coupling"]
    assert mark == "!"
    assert verdict.endswith(
        "deployable without device.backlash_m, scene.effects: velocity-filter, which is declared and not used"
    )
    assert conclusion_lines(document)[1].startswith("not used: device.backlash_m")


def test_where_nothing_is_deployable_the_reason_stands_first():
    problem = avc.load_problem("hard/massless")
    text = recommendation_page(avc.recommend(problem, hands=3).document(), problem, Page(), "hard/massless")
    mark, told = rows_of(text)["Coupling"]
    assert mark == "✗"
    assert "the device has no mass" in told


@pytest.mark.thorough
def test_a_device_that_turns_is_told_in_its_own_units():
    problem = avc.load_problem("knob")
    text = recommendation_page(avc.recommend(problem, hands=4).document(), problem, Page(), "knob")
    assert "N.m/rad" in text
    assert "g.m2" in text
    assert not re.search(r"\dN/m|N/m", text.replace("N.m/rad", ""))
