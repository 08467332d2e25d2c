"""Verbs of release 0.2 do what their new names do, with the same exit code, and say the new name on standard error."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from avc_process import ENVIRONMENT, avc

import avc_casadi
from avc_casadi.cli import main
from avc_casadi.cli._verbs import OLD_VERBS, VERBS

SAME = {
    "screen": ("screen", "scenes/free-motion", "--tolerance", "0.5"),
    "ports": ("ports",),
    "limits": ("limits", "--port", "emulator"),
    "store": ("store", "--port", "emulator", "--no-coupling"),
    "clear": ("clear", "--port", "emulator"),
    "accuracy": ("accuracy", "no-such-problem"),
    "table1": ("table1", "--hands", "8", "--merge"),
}


def told(capsys, *arguments):
    code = main([*arguments, "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out), err


def without_times(document):
    """Seconds differ from run to run."""
    if isinstance(document, dict):
        timed = {"ns_per_step", "scatter_ns", "number", "unique_id"}
        return {key: without_times(value) for key, value in document.items() if key not in timed}
    return [without_times(one) for one in document] if isinstance(document, list) else document


@pytest.mark.thorough
@pytest.mark.parametrize("verb", OLD_VERBS)
def test_an_old_verb_answers_as_the_new_one(verb, capsys):
    code, document, err = told(capsys, *SAME[verb])
    new = " ".join(OLD_VERBS[verb])
    assert f"avc {verb} is avc {new} since 0.3" in err
    again, same, silent = told(capsys, *OLD_VERBS[verb], *SAME[verb][1:])
    assert (again, without_times(same)) == (code, without_times(document))
    assert " is avc " not in silent


def test_no_old_verb_is_listed():
    assert not set(OLD_VERBS) & set(VERBS)
    assert {new for new, *_ in OLD_VERBS.values()} <= set(VERBS)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("device", "--port", "emulator", "--acts"), "--acts: goes with --store, not with --limits"),
        (("device", "--port", "emulator", "--clear", "--torque-nm", "3"), "--force-n: goes with --limits"),
        (("device", "--port", "emulator", "--clear", "--store"), "not allowed with argument"),
        (("simulate", "soft", "--screen", "--explain"), "--explain: does not go with --screen"),
        (("simulate", "soft", "--tolerance", "0.1"), "--tolerance: goes with --screen alone"),
    ],
)
def test_options_of_something_else_are_refused(arguments, words, capsys):
    assert main(list(arguments)) == 2
    assert words in capsys.readouterr().err


def test_doctor_lists_the_ports_too(capsys):
    _, alone, _ = told(capsys, "doctor", "--ports")
    _, whole, _ = told(capsys, "doctor")
    assert [port["port"] for port in whole["ports"]] == [port["device"] for port in alone["ports"]]


def test_studies_are_listed_and_explain_themselves(capsys):
    code, document, _ = told(capsys, "study")
    assert code == 0
    assert set(document["studies"]) == {"accuracy", "table1"}
    for name in document["studies"]:
        done = avc("study", name, "--help")
        assert done.returncode == 0
        assert f"usage: avc study {name}" in done.stdout.decode()
    code, document, _ = told(capsys, "study", "tabel1")
    assert code == 2
    assert "allowed: accuracy, table1" in document["errors"][0]["message"]


@pytest.mark.thorough
def test_a_wheel_says_where_studies_come_from(tmp_path):
    """The package without the folder beside it, as a wheel installs it."""
    shutil.copytree(Path(avc_casadi.__file__).parent, tmp_path / "avc_casadi")
    environment = ENVIRONMENT | {"PYTHONPATH": str(tmp_path)}
    for arguments in (("study", "table1"), ("study",), ("table1", "--hands", "5")):
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-m", "avc_casadi", *arguments, "--json"],
            capture_output=True,
            cwd=tmp_path,
            env=environment,
            check=False,
        )
        assert done.returncode == 2
        (error,) = json.loads(done.stdout)["errors"]
        assert "source distribution" in error["message"]
        assert "python -m avc_casadi study" in error["message"]
