"""A coupling file is read and checked as a coupling by every verb: beside a problem as without one."""

import json

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.files.gain_file import gain_csv
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime

SOFT = avc.load_problem("soft")
EVERY_VERB = (
    ("certify", "c.json"),
    ("certify", "soft", "c.json"),
    ("simulate", "c.json"),
    ("simulate", "soft", "--gains", "c.json"),
    ("simulate", "soft", "--gains", "c.json", "--screen"),
    ("push", "c.json", "--port", "emulator"),
    ("stream", "c.json", "--port", "emulator"),
    ("export", "c.json", "--c", "firmware"),
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def errors(capsys, *arguments):
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)["errors"]


def written(folder, change=None):
    avc.write_coupling(Coupling.of(SOFT, avc.solve(SOFT, "exact")), folder / "c.json")
    document = json.loads((folder / "c.json").read_text())
    if change is not None:
        change(document)
    (folder / "c.json").write_text(json.dumps(document))


CHANGES = {
    "id": lambda document: document["table"]["stiffness_n_per_m"].__setitem__(0, 5e5),
    "schema": lambda document: document.update(schema="avc-gains/1"),
    "runtime.observer_mass_kg": lambda document: document["runtime"].update(observer_mass_kg=1e300),
    "table.stiffness_n_per_m[0]": lambda document: document["table"]["stiffness_n_per_m"].__setitem__(0, 1e300),
}


@pytest.mark.one_of(2)
@pytest.mark.parametrize("key", CHANGES)
@pytest.mark.parametrize("arguments", EVERY_VERB, ids=" ".join)
def test_a_changed_file_is_refused_by_file_and_key(arguments, key, folder, capsys):
    written(folder, CHANGES[key])
    code, found = errors(capsys, *arguments)
    assert code == 2
    assert key in [error["key"] for error in found]
    assert {error["file"] for error in found} == {"c.json"}


@pytest.mark.thorough
def test_what_runs_beside_the_table_runs_beside_a_problem_too(capsys):
    """The observer's coupling: the same document with the file alone, beside its problem, and from Python."""
    problem = avc.load_problem("figure5")
    made = Coupling.constant(problem, Gains(5.0, 2e3), "mine", Runtime(observer_mass_kg=0.15, guard="energy-tank"))
    avc.write_coupling(made, "c.json")
    run = avc.simulate(problem, made)
    assert {"observer", "guard"} <= set(run.effects)
    for arguments in (("simulate", "c.json"), ("simulate", "figure5", "--gains", "c.json")):
        main([*arguments, "--json"])
        document = json.loads(capsys.readouterr().out)
        assert {effect["kind"] for effect in document["effects"]} == set(run.effects)
        assert document["peak_velocity_m_per_s"] == float(run.judgement.peak_velocity_m_per_s)
        assert document["notes"] == []


@pytest.mark.thorough
def test_on_another_problem_the_table_is_judged_there_and_this_is_noted(capsys):
    made = Coupling.constant(SOFT, Gains(5.0, 2e3), "mine", Runtime(observer_mass_kg=0.15))
    avc.write_coupling(made, "c.json")
    for verb in (("certify", "ve4", "c.json"), ("simulate", "ve4", "--gains", "c.json")):
        main([*verb, "--json"])
        document = json.loads(capsys.readouterr().out)
        (note,) = document["notes"]
        assert "made for soft" in note
        assert "[environment]" in note
    other = made.on(avc.load_problem("ve4"))
    assert (other.table, other.runtime, other.problem) == (made.table, made.runtime, avc.load_problem("ve4"))
    assert other.certificate is None
    with pytest.raises(avc.InputError, match="sample_time_s"):
        made.on(SOFT.changed(device={"sample_time_s": 5e-4}))


PROBLEM_VERBS = ("run", "recommend", "check", "solve", "compare", "zwidth", "accuracy")


@pytest.mark.parametrize("verb", PROBLEM_VERBS)
@pytest.mark.parametrize("name", ["c.json", "g.csv"])
def test_a_coupling_in_place_of_a_problem_is_refused(verb, name, folder, capsys):
    (folder / "c.json").write_text('\ufeff {"schema": "avc-coupling/1"}', encoding="utf-8")
    (folder / "g.csv").write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n1,1,100\n")
    code, (error,) = errors(capsys, *verb.split(), name)
    assert code == 2
    assert error["file"] == name


def test_a_table_beside_its_problem_does_not_lack_the_problem(folder, capsys):
    (folder / "old.csv").write_text(gain_csv(avc.solve(SOFT, "static-tuned")))
    assert main(["export", "old.csv", "--problem", "soft", "--c", "firmware", "--json"]) == 0
    lacks = json.loads(capsys.readouterr().out)["lacks"]
    assert any("observer" in one for one in lacks)
    assert not any("problem" in one for one in lacks)


def test_rows_that_become_one_on_the_device_are_a_fault_of_the_file(folder, capsys):
    rows = "".join(f"{hz!r},5.0,{k}\n" for hz, k in ((1.0, 100.0), (1.0 + 1e-12, 200.0), (2.0, 150.0)))
    (folder / "g.csv").write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n" + rows)
    arguments = ("export", "g.csv", "--problem", "soft", "--c", "firmware", "--unsafe")
    code, (error,) = errors(capsys, *arguments)
    assert (code, error["file"], error["key"]) == (2, "g.csv", "table.frequency_hz")
    assert np.float32(1.0 + 1e-12) == np.float32(1.0)
