"""The settings of `avc explore` are a problem like any other: same rules, same files, same answers."""

import numpy as np
import pytest
from engine_simulator import EngineSimulator
from hypothesis import event, given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi._util.progress import SILENT
from avc_casadi.loops.damped_wall import RINGS_BELOW
from avc_casadi.model.hands import hand_corners
from avc_casadi.present.explore.explorer import Explorer, _solved
from avc_casadi.present.explore.server import answer
from avc_casadi.present.explore.settings import problem_of_settings, settings_of
from avc_casadi.present.row import Mark, text_of
from avc_casadi.present.rows.judge import own_law
from avc_casadi.present.rows.recommend import recommendation

BASE = avc.load_problem("figure5").changed(frequency={"points": 12})
KNOB = avc.load_problem("knob").changed(frequency={"points": 12}, detent=None)
TOOL = avc.load_problem("tool/mujoco-500hz")
FRESH = {"values": {}, "gains": {}, "method": "direct", "motion": "press"}
PAIR = {"stiffness_n_per_m": 5000.0, "damping_ns_per_m": 20.0}


def fresh(base, changes):
    method = "direct" if base.simulation is None else "recommend"
    return FRESH | {"method": method} | changes


def problem_with(values, base=BASE, **changes):
    form = Explorer(base, base.name).form
    return problem_of_settings(base, settings_of(fresh(base, {"values": values} | changes), form), form)


EXPLORERS = {id(base): Explorer(base, base.name) for base in (BASE, KNOB, TOOL)}


def ask(part, base=BASE, **changes):
    return answer(EXPLORERS[id(base)], part, {"settings": fresh(base, changes)})


def rows_of(found, part="own"):
    return {row["label"]: row["text"] for row in found["rows"][part]}


@pytest.mark.parametrize("base", [BASE, KNOB, TOOL], ids=["wall", "knob", "simulation"])
def test_without_changes_the_problem_is_the_base(base):
    problem = problem_with({}, base)
    assert problem.changed(scene={}) == base.changed(scene=problem.scene)


@pytest.mark.slow
@given(st.data())
@settings(max_examples=100)
def test_any_settings_are_a_problem_or_faults_with_their_fields(data):
    base = data.draw(st.sampled_from([BASE, KNOB, TOOL]))
    fields = Explorer(base, base.name).form.fields
    value = st.one_of(st.none(), st.floats(-1e9, 1e9), st.integers(-9, 2000), st.text(max_size=4), st.booleans())
    keys = st.sampled_from([field.key for field in fields])
    values = data.draw(st.dictionaries(keys, value, max_size=4))
    try:
        problem = problem_with(values, base)
    except avc.InputError as error:
        event(f"{len(error.faults)} faults")
        return
    assert avc.parse_problem(avc.dump_problem(problem), name=problem.name) == problem


@pytest.mark.parametrize("base", first([BASE, KNOB, TOOL]), ids=["wall", "knob", "simulation"])
def test_each_slider_reaches_the_value_that_the_problem_has(base):
    begun = ask("start", base)
    values = ask("evaluate", base, gains=PAIR)["values"]
    assert len(begun["fields"]) > 20
    for field in begun["fields"]:
        value = values[field["key"]]
        if isinstance(value, float) and value > 0:
            assert field["low"] <= value / field["factor"] <= field["high"], field["key"]


@pytest.mark.slow
def test_the_rows_of_a_law_are_those_of_certify():
    gains = {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 4.0}
    expected = own_law(avc.certify_law(BASE, k=900.0, b=4.0)).rows
    shown = {one.label: one.text(BASE.units) for one in expected if one.rank == 0}
    whole = answer(EXPLORERS[id(BASE)], "evaluate", {"settings": fresh(BASE, {"gains": gains}), "extent": "whole"})
    assert rows_of(whole) == shown
    # The verdict and the other rows do not wait for the limits.
    at_once = ask("evaluate", gains=gains)
    assert rows_of(at_once).pop("Limits") == "not computed"
    limits = ("Limits", "Stable k", "Stable b")
    at_once_without = {label: text for label, text in rows_of(at_once).items() if label not in limits}
    assert at_once_without == {label: text for label, text in shown.items() if label not in limits}
    assert at_once["verdicts"]["own"] == whole["verdicts"]["own"]
    marks = {row["label"]: row["mark"] for row in at_once["rows"]["own"]}
    assert marks["Deployable"] == Mark.PASS.name.lower()


LAW = {
    "stiffness_n_per_m": 900.0,
    "damping_ns_per_m": 4.0,
    "virtual_mass_kg": -0.005,
    "velocity": {"kind": "low-pass", "cutoff_hz": 120.0},
    "filters": [{"kind": "notch", "frequency_hz": 150.0}],
}
STATED = BASE.changed(law=LAW)
EXPLORERS[id(STATED)] = Explorer(STATED, "stated")


def ask_law(part, gains=None, **more):
    changes = FRESH | {"method": "recommend", "gains": gains or {}}
    return answer(EXPLORERS[id(STATED)], part, {"settings": changes} | more)


def test_each_number_of_a_stated_law_has_a_slider_about_its_value():
    begun = {field["key"]: field for field in ask_law("start")["gains"]}
    numbers = {number.key.replace("[", ".").replace("]", "") for number in STATED.law.numbers(1e-3)}
    assert {f"law.{key}" for key in numbers} <= set(begun)
    values = ask_law("evaluate", extent="pictures")["gains"]
    for key, field in begun.items():
        assert field["low"] <= values[key] / field["factor"] <= field["high"], key
    assert begun["law.filters.0.frequency_hz"]["label"] == "notch: frequency"


@pytest.mark.slow
def test_the_rows_of_a_stated_law_follow_its_sliders_and_are_saved():
    gains = {"law.filters.0.frequency_hz": 120.0, "law.stiffness_n_per_m": 500.0}
    law = LAW | {"stiffness_n_per_m": 500.0, "filters": [{"kind": "notch", "frequency_hz": 120.0}]}
    changed = STATED.changed(law=None).changed(law=law)
    # The verdict follows at once; limits of each number come with the simulated touch.
    whole = ask_law("evaluate", gains, extent="whole")
    for found, limits in ((ask_law("evaluate", gains, extent="rows"), False), (whole, True)):
        expected = own_law(avc.certify_law(changed, remedies=False, limits=limits)).rows
        assert rows_of(found) == {one.label: one.text(BASE.units) for one in expected if one.rank == 0}
        assert ("Stable k" in rows_of(found)) == limits
    assert [chart["id"] for chart in whole["charts"]] == ["law", "position", "force"]
    saved = avc.parse_problem(ask_law("file", gains, kind="problem")["text"])
    assert saved.law == changed.law
    beyond = ask_law("evaluate", {"law.filters.0.frequency_hz": 900.0})
    assert [error["key"] for error in beyond["errors"]] == ["law.filters.0.frequency_hz"]


@pytest.mark.parametrize("method", ["direct", "closed-form", "exact"])
def test_the_charts_show_what_solve_gives(method):
    found = ask("evaluate", method=method)
    (line,) = next(one for one in found["charts"] if one["id"] == "stiffness")["series"]
    shown = np.array([np.nan if value is None else value for value in line["y"]])
    np.testing.assert_allclose(shown, avc.solve(BASE, method).stiffness_n_per_m, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("base", [KNOB, TOOL.changed(simulation={"clock": "device"})], ids=["wall", "simulation"])
def test_the_verdict_of_a_run_is_what_recommend_says(base):
    expected = avc.recommend(base)
    solved = _solved((base, "recommend"), SILENT)
    least_damped = expected.transients.worst_hand if base.simulation is None else expected.pair.mode
    lightly_damped = least_damped.damping_ratio < RINGS_BELOW
    assert expected.deployable
    assert solved.judged.verdict.word == f"deployable{', rings' if lightly_damped else ''}"
    margin = text_of(solved.judged.verdict.margin, base.units)
    if base.simulation is None:
        sides = expected.margins.released.disk, expected.margins.worst_hand.disk
        assert margin == f"disk margin {min(sides):.2g}"
    else:
        assert margin == f"gain margin {expected.pair.gain_margin:.3g}"
    labels = [shown.label for shown in solved.judged.rows]
    assert labels[0] == "Deployable"
    assert labels[1:] == [shown.label for shown in recommendation(expected).rows if shown.rank == 0]


def grows(pair, hand, tool_mass_kg):
    """Whether device and tool swing against each other ever more, by a plain simulation."""
    k, b = pair["stiffness_n_per_m"], pair["damping_ns_per_m"]
    engine = EngineSimulator((0.12, 0.8, 1e-3, 1), hand, (tool_mass_kg, 0.0), 0.002)
    device, tool = engine.run(k, b, 6000, kick=1e-3, force=1e300)
    apart = np.abs(device - tool)
    return bool(apart[-1000:].max() > apart[1000:2000].max())


@pytest.mark.slow
@pytest.mark.parametrize("pair", [(5000.0, 20.0), (17000.0, 37.0), (5000.0, 70.0), (600.0, 0.2), (18500.0, 55.0)])
def test_who_is_stable_with_what_is_so_in_a_plain_simulation(pair):
    gains = dict(zip(PAIR, pair, strict=True))
    stability = rows_of(ask("evaluate", TOOL, gains=gains))["Stability"]
    hands = hand_corners(TOOL.hands)
    every = [(0.0, 0.0, 0.0), *zip(hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m, strict=True)]
    unstable = any(grows(gains, hand, mass_kg) for mass_kg in (0.2, np.inf) for hand in every)
    assert stability.startswith("not all of") == unstable
