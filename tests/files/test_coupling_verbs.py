"""A coupling file is read and checked as a coupling by every verb: beside a problem as without one."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
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
