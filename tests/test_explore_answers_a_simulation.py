"""`avc explore` of a problem with [simulation]: the numbers of certify, zwidth, recommend and simulate, as typed."""

import json
import re
import time

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.model.virtual_tool import RIGID_N_PER_M
from avc_casadi.present.explore.answers import PARTS, answer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.forms import TOOL
from avc_casadi.present.explore.requests import RequestError
from avc_casadi.present.explore.settings import problem_of_settings, settings_of, values_of
from avc_casadi.present.explore.tool_answers import TOOL_PARTS
from avc_casadi.present.rows.judge import passivity, stability
from avc_casadi.present.rows.recommend import pair_rows

NAMES = ("tool/mujoco-500hz", "tool/unity-60hz", "tool/sofa-implicit", "tool/wheel-game-62hz")
MUJOCO = avc.load_problem("tool/mujoco-500hz")
PAIR = {"stiffness_n_per_m": 5000.0, "damping_ns_per_m": 20.0}
FRESH = {"device": None, "values": {}, "method": "constant", "gains": PAIR, "motion": "press"}


def explorer_of(name):
    return Explorer(avc.load_problem(name), name)


def told(part, explorer=None, **asked):
    beside = {key: asked.pop(key) for key in ("kind", "column", "begin") if key in asked}
    question = {"settings": FRESH | asked} | beside
    return answer(explorer or explorer_of("tool/mujoco-500hz"), TOOL_PARTS[part], question)


def command(capsys, *words):
    code = main([*words, "--json"])
    return code, json.loads(capsys.readouterr().out)


def rows_of(found):
    return {row["label"]: row["text"] for row in found["rows"]}


def undotted(text):
    return text.replace("·", ".").replace("²", "2")


def problem_with(values, base=MUJOCO):
    return problem_of_settings(base, settings_of(FRESH | {"values": values}, TOOL))


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_every_number_is_that_of_recommend_certify_zwidth_and_simulate(name, tmp_path, capsys):
    """The recommended pair, typed on the page: its rows, its region, the limit, what is felt, and one touch."""
    file, coupling = tmp_path / "p.toml", str(tmp_path / "c.json")
    file.write_text(avc.catalogue_path(name).read_text(encoding="utf-8") + "\n[scene]\nduration_s = 1.5\n")
    explorer = Explorer(avc.load_problem(file), str(file))
    problem = explorer.base
    _, recommended = command(capsys, "recommend", str(file), "--out", coupling)
    read = problem.units.read(recommended)["pair"]
    pair = {key: read["gains"][key] for key in ("stiffness_n_per_m", "damping_ns_per_m", "local_damping_ns_per_m")}
    now, judged = (told(part, explorer, gains=pair) for part in ("now", "judge"))
    assert judged["stiffest"]["stiffness_n_per_m"] == read["stiffest"]["stiffness_n_per_m"]
    shown = {label: undotted(text) for label, text in rows_of(now).items()}
    rows = pair_rows(problem.units.read(recommended), problem)
    expected = {row.label: row.text(problem.units) for row in rows}
    assert expected["Rigid object"].endswith(shown["Rigid object"])
    assert shown.get("Free motion") == expected.get("Free motion")
    _, certified = command(capsys, "certify", coupling)
    certified = problem.units.read(certified)
    assert now["stable"] is certified["stable"] is True
    claims = stability(certified)
    if problem.simulation.tool_mass_kg is not None:
        claims += passivity(certified["passivity"], problem)
    assert {row.label: row.text(problem.units) for row in claims}.items() <= shown.items()
    _, zwidth = command(capsys, "zwidth", str(file))
    zwidth = problem.units.read(zwidth)
    region, declared = told("region", explorer, gains=pair), told("curve", explorer, gains=pair)
    np.testing.assert_allclose(region["damping_ns_per_m"], zwidth["damping_ns_per_m"], rtol=1e-5)
    for curve, other in zip(region["curves"], zwidth["curves"], strict=True):
        mine = [0.0 if k is None else k for k in curve["stiffness_n_per_m"]]
        np.testing.assert_allclose(mine, other["stiffness_n_per_m"], rtol=1e-5)
        assert curve["declared"] == other["declared"]
    assert declared["curves"] == [curve for curve in region["curves"] if curve["declared"]]
    _, simulated = command(capsys, "simulate", coupling)
    touch = told("touch", explorer, gains=pair)["touch"]
    assert touch["claim"] == simulated["outcome"]
    assert touch["stiffness_n_per_m"] == pytest.approx(problem.units.read(simulated)["apparent_stiffness_n_per_m"])


def test_a_number_is_moved_whole_and_a_range_by_its_ends():
    lighter = problem_with({"simulation.tool_mass_kg.0": 0.1}).simulation
    assert lighter.tool_mass_kg == (0.1, 0.1)
    spread = problem_with({"simulation.tool_mass_kg.1": 0.3, "simulation.tool_mass_kg.0": 0.1})
    assert spread.simulation.tool_mass_kg == (0.1, 0.3)
    assert problem_with({"simulation.tool_mass_kg.0": 0.2}, spread).simulation.tool_mass_kg == (0.2, 0.3)
    assert problem_with({"simulation.tool_mass_kg.1": None}, spread).simulation.tool_mass_kg == (0.1, 0.1)
    assert problem_with({"simulation.tool_mass_kg.0": None}, spread).simulation.tool_mass_kg is None
    assert values_of(MUJOCO)["simulation.tool_mass_kg.1"] is None
    assert values_of(spread)["simulation.tool_mass_kg.1"] == 0.3
    soft = problem_with({"simulation.contact_stiffness_n_per_m.1": 3000.0})
    assert soft.simulation.contact_stiffness_n_per_m == (0.0, 3000.0)
    assert values_of(MUJOCO)["simulation.contact_stiffness_n_per_m.1"] is None
    rigid = problem_with({"simulation.contact_stiffness_n_per_m.1": None}, soft).simulation
    assert rigid.contact_stiffness_n_per_m == (0.0, RIGID_N_PER_M)


@pytest.mark.thorough
@given(
    st.dictionaries(
        st.sampled_from([field.key for field in TOOL.fields]),
        st.one_of(st.none(), st.floats(-1e9, 1e9), st.floats(1e-3, 1.0), st.integers(-9, 20), st.text(max_size=4)),
        max_size=4,
    ),
    st.sampled_from(NAMES),
)
@settings(max_examples=60)
def test_any_settings_are_a_problem_or_faults_with_their_fields(values, name):
    base = avc.load_problem(name)
    try:
        problem = problem_with(values, base)
    except avc.InputError as error:
        event(f"{len(error.faults)} faults")
        for fault in error.faults:
            assert fault.key in TOOL.keys or fault.key.startswith(("device.", "simulation", "frequency.", "hands."))
        return
    assert avc.parse_problem(avc.dump_problem(problem), name=problem.name) == problem
    kept = values_of(problem)
    for key, value in values.items():
        if isinstance(value, float) and kept[key] is not None:
            assert kept[key] == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("simulation.step_s.0", -0.002, "is -2; allowed: 0.0001 to 10000 ms"),
        ("simulation.step_s.0", 0.5, "takes too long to follow here; allowed on this page: 0.01 to 100 ms"),
        ("simulation.tool_mass_kg.0", "heavy", 'is "heavy", not a number; allowed: 1e-9 to 1e6 kg'),
        ("simulation.tool_mass_kg.1", 0.1, "reversed"),
        ("simulation.contact_stiffness_n_per_m.1", -5.0, "is -5.0; allowed: 0 or 1e-9 to 1e12 N/m"),
        ("simulation.steps_late", 1.5, "not an integer; allowed: an integer 0 to 8"),
        ("simulation.position_scale", 0.0, "is 0.0; allowed: 1e-6 to 1e6"),
        ("device.mass_kg", -1.0, "is -1.0; allowed: 0 or 1e-9 to 1e6 kg"),
    ],
)
def test_faults_stand_beside_their_fields_in_their_units(key, value, message):
    (fault,) = told("now", values={key: value})["errors"]
    assert fault["key"] == key
    assert message in fault["message"]


def test_neither_page_knows_the_fields_of_the_other():
    wall = Explorer(avc.load_problem("figure5"), "figure5")
    of_tool = {"settings": FRESH | {"gains": {}, "values": {"simulation.step_s.0": 0.002}}}
    with pytest.raises(RequestError, match="values name fields"):
        answer(wall, PARTS["now"], of_tool)
    for odd in ({"values": {"environment.stiffness_n_per_m": 1e3}}, {"method": "direct"}):
        with pytest.raises(RequestError):
            told("now", **odd)


def test_the_region_knows_the_damper_of_the_pair():
    """A held force allows with a damper of its own what it does not without: the star lies below that curve."""
    explorer = explorer_of("tool/unity-60hz")
    pair = {"stiffness_n_per_m": 1200.0, "damping_ns_per_m": 2.585, "local_damping_ns_per_m": 23.2}
    assert told("now", explorer, gains=pair)["stable"]
    curve = told("curve", explorer, gains=pair)
    assert curve["critical_damper"]
    beside = np.array([k or 0.0 for k in curve["with_own_damper"]])
    assert np.interp(2.585, curve["damping_ns_per_m"], beside) > 1200.0
    bare = told("now", explorer, gains=pair | {"local_damping_ns_per_m": 0.0})
    assert not bare["stable"]
    assert told("curve", gains=PAIR)["with_own_damper"] is None


@pytest.mark.thorough
def test_a_run_is_tried_by_hands_and_until_then_the_page_shows_what_it_begins_with():
    explorer = explorer_of("tool/mujoco-500hz")
    ask = {"method": "recommend", "gains": {}}
    before = told("now", explorer, **ask)
    assert before["awaited"]
    assert "not tried yet" in rows_of(before)["Coupling"]
    found = told("work", explorer, **ask, begin=True)
    while found["state"] == "running":
        time.sleep(0.1)
        found = told("work", explorer, **ask)
    assert found["state"] == "done"
    assert any(line.startswith("✓ Simulated: 100 of 100 hands settle") for line in found["lines"])
    after = told("now", explorer, **ask)
    assert not after["awaited"]
    assert " pressed, " in rows_of(after)["Rigid object"]
    expected = avc.recommend("tool/mujoco-500hz")
    assert after["gains"]["stiffness_n_per_m"] == expected.coupling.gains.stiffness_n_per_m
    saved = json.loads(told("file", explorer, **ask, kind="coupling")["text"])
    assert saved["trial"] == json.loads(json.dumps(expected.data()["trial"]))
    assert saved["damping_ns_per_m"] == expected.coupling.gains.damping_ns_per_m


def test_files_and_commands_ask_for_what_is_shown(tmp_path, capsys):
    values = {"simulation.tool_mass_kg.0": 0.123456789012, "simulation.exchange": "late"}
    problem = tmp_path / "p.toml"
    problem.write_text(told("file", values=values, kind="problem")["text"])
    simulation = avc.load_problem(problem).simulation
    assert (simulation.tool_mass_kg, simulation.exchange) == ((0.123456789012,) * 2, "late")
    found = told("file", values=values, kind="coupling")
    (tmp_path / found["name"]).write_text(found["text"])
    _, certified = command(capsys, "certify", str(tmp_path / found["name"]))
    assert (certified["stiffness_n_per_m"], certified["damping_ns_per_m"]) == (5000.0, 20.0)
    typed = told("file", values=values, kind="command")["text"]
    assert "avc zwidth mujoco-500hz-explored.toml" in typed.replace("tool-", "")
    assert f"avc certify {found['name']}" in typed
    parsed = avc.parse_problem(typed.partition("'AVC_PROBLEM'\n")[2].partition("AVC_PROBLEM\n")[0])
    assert parsed.simulation == simulation
    run = told("file", method="recommend", gains={}, kind="command")["text"]
    assert run.startswith("avc recommend tool/mujoco-500hz --out ")


def test_a_wheel_has_its_units_everywhere():
    explorer = explorer_of("tool/wheel-game-62hz")
    pair = {"stiffness_n_per_m": 3.0, "damping_ns_per_m": 0.4, "local_damping_ns_per_m": 1.0}
    found = [told(part, explorer, gains=pair) for part in ("start", "now", "judge", "curve")]
    units = {field["key"]: field["unit"] for field in (*found[0]["fields"], *found[0]["gains"])}
    assert units["gains.stiffness_n_per_m"] == "N·m/rad"
    assert units["simulation.tool_mass_kg.0"] == "kg·m²"
    assert "simulation.step_s.0" in units
    texts = re.sub(r'"[a-z_.0-9]+"', "", json.dumps(found, ensure_ascii=False))  # keys stay inside
    assert not re.search(r"N[.·]s/m|N/m|\d k?g(?![·\w])", texts)
    assert {"Coupling", "Stability", "Worst loop", "Fixed place", "Rigid object"} <= set(rows_of(found[1]))


@pytest.mark.parametrize("name", NAMES)
def test_the_slider_of_every_value_of_the_catalogue_reaches_it(name):
    begun = told("start", explorer_of(name))
    for field in begun["fields"]:
        value = begun["values"][field["key"]]
        if isinstance(value, float) and value > 0:
            assert field["low"] <= value / field["factor"] <= field["high"], field["key"]
