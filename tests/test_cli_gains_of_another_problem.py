"""Gains of another problem are refused or noted, and a table that cannot begin says so."""

import json

import pytest

from avc_casadi import dump_problem, load_problem
from avc_casadi._util.text import quantity
from avc_casadi.cli import main

VERBS = [("certify", "soft", "gains.json"), ("simulate", "soft", "--gains", "gains.json")]


def call(capsys, *arguments):
    code = main(list(arguments))
    return code, capsys.readouterr()


@pytest.fixture
def gains(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["solve", "soft", "--method", "exact", "--out", "gains.json"]) == 0
    capsys.readouterr()
    return json.loads((tmp_path / "gains.json").read_text())


def rewrite(document):
    with open("gains.json", "w", encoding="utf-8") as file:  # noqa: PTH123
        json.dump(document, file)


@pytest.mark.thorough
@pytest.mark.usefixtures("gains")
@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: arguments[0])
def test_own_gains_pass_without_a_note(arguments, capsys):
    code, out = call(capsys, *arguments, "--json")
    assert code == 0
    assert json.loads(out.out)["notes"] == []


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: arguments[0])
def test_another_sample_time_is_refused(arguments, gains, capsys):
    rewrite(gains | {"sample_time_s": 5e-4})
    code, out = call(capsys, *arguments)
    assert code == 2
    assert "sample_time_s: is 0.0005" in out.err
    assert "0.001" in out.err


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: arguments[0])
def test_another_problem_model_and_structure_are_noted(arguments, gains, capsys):
    other = "paper" if gains["model"] == "sampled-data" else "sampled-data"
    bare = {key: value for key, value in gains.items() if key != "problem_file"}
    rewrite(bare | {"schema": "avc-gains/1", "problem": "hard", "model": other, "structure": "damped"})
    _, out = call(capsys, *arguments, "--json")
    notes = json.loads(out.out)["notes"]
    assert [note.split(" for ")[1].split(" ")[0] for note in notes] == ["problem", "model", "structure"]
    _, out = call(capsys, *arguments)
    text = " ".join(out.out.split())
    for note in notes:
        assert f"! Note {note}" in text


@pytest.mark.thorough
def test_simulate_says_from_which_row_its_gains_are(gains, capsys):
    _, out = call(capsys, *VERBS[1])
    assert f"the table at {quantity(gains['frequency_hz'][0], 'Hz')}" in out.out


@pytest.mark.thorough
def test_simulate_says_at_which_frequency_the_scene_reads_the_gains(gains, capsys):
    text = dump_problem(load_problem("soft").changed(scene={"interaction_hz": gains["frequency_hz"][7]}))
    with open("soft7.toml", "w", encoding="utf-8") as file:  # noqa: PTH123
        file.write(text)
    _, out = call(capsys, "simulate", "soft7.toml", "--gains", "gains.json")
    assert f"spring k {quantity(gains['stiffness_n_per_m'][7], 'N/m')}" in out.out
    assert f"the table at {quantity(gains['frequency_hz'][7], 'Hz')}" in out.out


@pytest.mark.thorough
def test_constant_gains_are_read_at_no_frequency(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, out = call(capsys, "simulate", "scenes/stiff-wall-pressed")
    assert "the table at" not in out.out


@pytest.mark.thorough
def test_gains_that_are_infeasible_end_in_a_no(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["solve", "hard/infeasible-box", "--method", "exact", "--out", "gains.json"]) == 1
    capsys.readouterr()
    code, out = call(capsys, "simulate", "hard/infeasible-box", "--gains", "gains.json")
    assert code == 1
    assert "--gains: no gains at 1 Hz" in out.err
    assert out.err.rstrip().endswith(".")
    code, out = call(capsys, "simulate", "hard/infeasible-box", "--json")
    assert code == 1
    assert json.loads(out.out)["errors"][0]["key"] == "scene.coupling"
