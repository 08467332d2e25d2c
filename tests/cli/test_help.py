"""`avc --help` and the help of every verb load none of the libraries that take time."""

import pytest
from avc_process import avc

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
