"""A file of another kind is named, with the command that accepts it; no parser's message stands in its place."""

import json

import pytest

from avc_casadi.cli import main

LAW = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\n\n[law]\nstiffness_n_per_m = 300.0\n"
LOG = "time_s,position_m,force_n\n0,0,0\n0.001,0.0001,0.1\n"
FILES = {"p.toml": LAW, "log.csv": LOG, "log.txt": LOG.replace(",", "\t"), "other.json": '{"a": 1}', "notes.md": "hi\n"}


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "folder").mkdir()
    (tmp_path / "coupling.json").write_text(json.dumps({"schema": "avc-coupling/1"}), encoding="utf-8")

    def run(command):
        assert main(command.split()) == 2, command
        return " ".join(capsys.readouterr().err.split())

    return run


@pytest.mark.parametrize("verb", ["certify", "recommend", "check", "zwidth", "explore", "simulate"])
@pytest.mark.parametrize("log", ["log.csv", "log.txt"])
def test_a_log_in_place_of_a_problem_is_named(said, verb, log):
    if (verb, log) == ("simulate", "log.csv"):  # simulate accepts a table of gains, and names its columns
        assert "frequency_hz,damping_ns_per_m" in said("simulate log.csv")
        return
    message = said(f"{verb} {log}")
    assert "is a table of numbers, such as a log; allowed: a problem file (TOML)" in message
    assert f"avc diagnose {log}" in message


@pytest.mark.parametrize("verb", ["recommend", "zwidth", "explore"])
def test_json_in_place_of_a_problem_is_a_coupling_or_none(said, verb):
    assert "is a coupling or gain file" in said(f"{verb} coupling.json")
    assert "is JSON, but no coupling" in said(f"{verb} other.json")


def test_a_problem_in_place_of_a_coupling_says_how_to_make_one(said, tmp_path):
    message = said("push p.toml --port /dev/null")
    assert "is a problem file (TOML); allowed: a coupling file (JSON)" in message
    assert "avc recommend p.toml --out coupling.json" in message
    assert "avc export p.toml --c DIR" in message
    (tmp_path / "wall.toml").write_text(LAW.partition("[law]")[0], encoding="utf-8")
    assert "avc export" not in said("push wall.toml --port /dev/null")


@pytest.mark.parametrize("verb", ["diagnose", "identify"])
def test_what_is_no_log_is_named(said, verb):
    assert "is a directory; give a log of the device" in said(f"{verb} folder")
    assert "give the log first" in said(f"{verb} p.toml")
