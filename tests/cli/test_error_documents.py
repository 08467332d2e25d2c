"""Errors of --json name the file, the problem or the port that they are about, and their message does not repeat it."""

import json

import pytest
from quick import first

from avc_casadi.cli import main

JOINT = "[simulation]\ntool_mass_kg = 0.01\nstep_s = 0.005\nintegrator = 'implicit-damping'\n"


@pytest.mark.parametrize(
    ("typed", "file", "code"),
    first(
        [
            (["solve", "admittance/cobot"], "admittance/cobot", 2),
            (["simulate", "joint.toml"], "joint.toml", 2),
            (["solve", "hard/undamped-device", "--method", "static"], "hard/undamped-device", 2),
            (["monitor", "--port", "/dev/no-such-port"], "/dev/no-such-port", 2),
            (["export", "c.json", "--c", "out"], "c.json", 1),
        ]
    ),
    ids=["admittance", "joint", "method", "port", "not deployable"],
)
def test_an_error_names_its_file(typed, file, code, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "joint.toml").write_text(JOINT, encoding="utf-8")
    if "c.json" in typed:
        assert main(["solve", "figure5", "--method", "exact", "--out", "c.json"]) == 0
        capsys.readouterr()
    assert main([*typed, "--json"]) == code
    (error,) = json.loads(capsys.readouterr().out)["errors"]
    assert error["file"] == file
    assert not error["message"].startswith(file)
