"""`avc --help` and the help of every verb load none of the libraries that take time."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from avc_process import avc

import avc_casadi
from avc_casadi.cli.dispatch import VERBS

PROGRAM = """
import sys
from avc_casadi.cli import main
code = main(sys.argv[1:])
sys.stderr.write(" ".join(sys.modules))
sys.exit(code)
"""
HEAVY = {"casadi", "matplotlib", "numpy", "pydantic", "serial", "unicorn", "avc_hardware"}


def test_help():
    done = avc("--help", program=PROGRAM)
    assert done.returncode == 0
    assert not HEAVY & set(done.stderr.decode().split())
    lines = done.stdout.decode().splitlines()
    for verb in VERBS:
        assert any(line.split()[:1] == [verb] for line in lines)


@pytest.mark.parametrize("verb", [*VERBS][::6])
def test_help_of_verbs(verb):
    done = avc(verb, "--help", program=PROGRAM)
    assert done.returncode == 0
    assert not HEAVY & set(done.stderr.decode().split())
    assert b"--json" in done.stdout


@pytest.mark.thorough
def test_plain_checkout_finds_the_hardware_module(tmp_path):
    """With the package's folder alone on the path, `python -m avc_casadi` finds avc_hardware beside it or installed."""
    root = Path(avc_casadi.__file__).resolve().parent.parent
    done = subprocess.run(
        [sys.executable, "-m", "avc_casadi", "doctor", "--ports", "--json"],
        capture_output=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
