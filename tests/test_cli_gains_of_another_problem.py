"""Gains of another problem are refused or noted, and a table that cannot begin says so."""

import json

import pytest

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
@pytest.mark.parametrize("arguments", VERBS, ids=lambda arguments: arguments[0])
def test_another_sample_time_is_refused(arguments, gains, capsys):
    rewrite(gains | {"sample_time_s": 5e-4})
    code, out = call(capsys, *arguments)
    assert code == 2
    assert "sample_time_s: is 0.0005" in out.err
    assert "0.001" in out.err
