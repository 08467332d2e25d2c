"""0 done, 1 the answer is no, 2 bad input, 130 interrupted; never a traceback; refusals obey --json."""

import json
import os
import subprocess

import pytest
from avc_process import AVC, ENVIRONMENT, command

import avc_casadi as avc
from avc_casadi.cli import VERBS, build_parser, main
from avc_casadi.coupling import Coupling


@pytest.mark.parametrize(
    ("arguments", "key", "words"),
    [
        (("solve", "figgure5"), "", "figure5"),
        (("solve", "figure5", "--out", "nowhere/gains.json"), "--out", "nowhere"),
        (("solve", "figure5", "--method", "direct", "--as-printed"), "--as-printed", "closed-form"),
        (("compare", "figure5", "--mine", "7000"), "--mine", "K,B"),
        (("push", "missing.json", "--port", "emulator"), "", "does not exist"),
        (("monitor", "--port", "emulator", "--rate-hz", "0"), "--rate-hz", "above 0"),
        (("monitor", "--port", "emulator", "--baud", "9600"), "--baud", "115200"),
        (("run", "figure5", "--out", "file"), "--out", "file"),
        (("paint",), "VERB", "solve"),
        ((), "", "VERB"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_bad_input(arguments, key, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way of a folder")
    assert main(arguments) == 2
    plain = capsys.readouterr()
    assert plain.out == ""
    assert words in plain.err

    assert main([*arguments, "--json"]) == 2
    answered = capsys.readouterr()
    (error,) = json.loads(answered.out)["errors"]
    assert error["key"] == key
    assert words in error["message"] or words in error["file"]
    assert answered.err == ""


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("list",), ("--help",), ("solve", "figure5", "--json")], ids=" ".join)
def test_broken_pipe(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(  # noqa: S603
        [*AVC, *arguments], stdout=writer, stderr=subprocess.PIPE, env=ENVIRONMENT, check=False
    )
    os.close(writer)
    assert done.returncode == 141
    assert done.stderr == b""


@pytest.mark.slow
def test_what_a_command_reads_it_does_not_write_over(tmp_path, capsys):
    gains = tmp_path / "c.json"
    main(["solve", "soft", "--out", str(gains)])
    before = gains.read_text()
    for arguments in (["solve", str(gains), "--out", str(gains)], ["simulate", "soft", "--gains", str(gains)]):
        extra = [] if "--out" in arguments else ["--trace", str(tmp_path / "c.npz")]
        assert main([*arguments, *extra]) == 2
        capsys.readouterr()
    assert gains.read_text() == before
    assert not (tmp_path / "c.npz").exists()


EXIT_CODES_VERBS = [("certify", "soft", "gains.json"), ("simulate", "soft", "--gains", "gains.json")]


@pytest.mark.parametrize("arguments", EXIT_CODES_VERBS, ids=lambda arguments: arguments[0])
def test_another_sample_time_is_refused(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fast = avc.load_problem("soft").changed(device={"sample_time_s": 5e-4}, frequency={"points": 5})
    avc.write_coupling(Coupling.from_schedule(fast, avc.solve(fast, "exact")), "gains.json")
    assert main(list(arguments)) == 2
    told = capsys.readouterr().err
    assert "sample_time_s: is 0.0005" in told
    assert "0.001" in told


# `avc --help` and the help of every verb load none of the libraries that take time.

PROGRAM = """
import sys
from avc_casadi.cli import main
code = main(sys.argv[1:])
sys.stderr.write(" ".join(sys.modules))
sys.exit(code)
"""
HEAVY = {"casadi", "matplotlib", "numpy", "pydantic", "serial", "unicorn"}


def test_help():
    done = command("--help", program=PROGRAM)
    assert done.returncode == 0
    assert not HEAVY & set(done.stderr.decode().split())
    lines = done.stdout.decode().splitlines()
    for verb in VERBS:
        assert any(line.split()[:1] == [verb] for line in lines)


@pytest.mark.parametrize("verb", [*VERBS][::6])
def test_help_of_verbs(verb):
    done = command(verb, "--help", program=PROGRAM)
    assert done.returncode == 0
    assert not HEAVY & set(done.stderr.decode().split())
    assert b"--json" in done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_fits_a_screen(verb, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        build_parser().parse_args([verb, "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 100


NOISE = """
import ctypes, os, sys
from avc_casadi.cli.console import Console
from avc_casadi.present.row import Answer, row
console = Console(as_json="--json" in sys.argv)
os.write(1, b"straight to the descriptor ")
ctypes.CDLL(None).printf(b"left in the buffer of the C library ")
print("printed")
console.say("live")
console.answer(Answer("found", {"found": 1}, rows=(row("text"),)))
"""


def test_libraries_that_print_do_not_reach_standard_output():
    done = command("--json", program=NOISE)
    assert done.stdout == b'{\n "schema": "avc/1",\n "kind": "found",\n "found": 1\n}\n'
    for noise in (b"straight to the descriptor", b"left in the buffer", b"printed"):
        assert noise in done.stderr
