"""Refusals name the option or key to change, and a mark or number that could be misread says what it means."""

import json

import pytest

from avc_casadi.cli import main
from avc_casadi.cli._text import number
from avc_casadi.present.pages.certificate import beside_hands

TABLE = "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n"


@pytest.mark.parametrize(
    ("arguments", "key", "words"),
    [
        (("solve", "hard/undamped-device", "--method", "static"), "device.damping_ns_per_m", "static needs"),
        (("export", "gains.csv", "--c", "c"), "", "Give the problem that it was made for beside it: --problem P"),
        (("export", "gains.csv", "--c", "gains.csv", "--problem", "soft"), "--c", "choose another folder"),
        (("compare", "soft", "--mine", "-1,nan"), "--mine", "--mine=VALUE"),
        (("compare", "soft", "--mine=-1,nan"), "--mine", "finite and >= 0"),
    ],
    ids=" ".join,
)
def test_refusals_name_what_to_change(arguments, key, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gains.csv").write_text(TABLE + "1.0,1.0,100.0\n")
    assert main([*arguments, "--json"]) == 2
    (error,) = json.loads(capsys.readouterr().out)["errors"]
    assert error["key"] == key
    assert words in error["message"]


@pytest.mark.parametrize("method", ["direct", "closed-form"])
def test_nobody_is_told_to_do_what_was_done(method, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["solve", "hard/infeasible-box", "--method", method, "--out", "gains.json"]) == 1
    capsys.readouterr()
    assert main(["export", "gains.json", "--problem", "hard/infeasible-box", "--c", "firmware"]) == 2
    said = capsys.readouterr().err
    assert f"by {method} has no row with gains; choose another method" in said
    assert f"--method {method}" not in said


@pytest.mark.parametrize(
    ("passed", "radius", "words"), [(True, 0.9, "settles"), (False, 1.0, "free mass"), (False, 1.1, "not stable")]
)
def test_a_free_mass_is_not_called_unstable(passed, radius, words):
    level = {"released_pass": passed, "released_spectral_radius": radius, "margin_ns_per_m": 0.5}
    lines = beside_hands(level)
    assert words in lines[1]
    assert lines[0].startswith("L5's margin is the device damping")


def test_a_negative_zero_is_a_zero():
    assert number(-0.0) == "0"
    assert number(-0.5) == "-0.5"


@pytest.mark.thorough
def test_the_dash_of_zwidth_is_explained(capsys):
    assert main(["zwidth", "soft", "-v"]) == 0
    assert "-: no stiffness meets the claim" in capsys.readouterr().out


def test_the_default_solver_is_named(capsys):
    assert main(["solve", "--help"]) == 0
    assert "sqpmethod-qrqp (default)" in " ".join(capsys.readouterr().out.split())
