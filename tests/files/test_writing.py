"""A file that is written is there whole or as it was before, whatever ends the process."""

import json
import signal
import subprocess
import sys

import pytest
from avc_process import ENVIRONMENT

# A full disk would cut off what Python caches of a module too.
NO_CACHE = ENVIRONMENT | {"PYTHONDONTWRITEBYTECODE": "1"}
FULL_DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
"""
KILLED_WHILE_IT_WRITES = """
import os, signal
os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
"""


def run(before, arguments, cwd):
    program = f"{before}\nimport sys\nfrom avc_casadi.cli import main\nsys.exit(main({arguments!r}))"
    return subprocess.run(  # noqa: S603
        [sys.executable, "-c", program], cwd=cwd, env=NO_CACHE, capture_output=True, text=True, check=False
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("before", "code"), [(FULL_DISK, 2), (KILLED_WHILE_IT_WRITES, -signal.SIGKILL)])
def test_a_file_is_the_old_one_or_the_new_one(before, code, tmp_path):
    out = tmp_path / "c.json"
    out.write_text("what was there\n")
    arguments = ["solve", "soft", "--method", "static", "--out", "c.json"]
    done = run(before, arguments, tmp_path)
    assert done.returncode == code, done.stderr
    assert out.read_text() == "what was there\n"
    assert run("", arguments, tmp_path).returncode == 0
    assert json.loads(out.read_text())["method"] == "static"
