"""Gains of another problem are refused or noted, and a table that cannot begin says so."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling

VERBS = [("certify", "soft", "gains.json"), ("simulate", "soft", "--gains", "gains.json")]


@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: arguments[0])
def test_another_sample_time_is_refused(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fast = avc.load_problem("soft").changed(device={"sample_time_s": 5e-4}, frequency={"points": 5})
    avc.write_coupling(Coupling.of(fast, avc.solve(fast, "exact")), "gains.json")
    assert main(list(arguments)) == 2
    told = capsys.readouterr().err
    assert "sample_time_s: is 0.0005" in told
    assert "0.001" in told


@pytest.mark.thorough
def test_gains_that_are_infeasible_end_in_a_no(capsys):
    assert main(["simulate", "hard/infeasible-box", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["errors"][0]["key"] == "scene.coupling"
