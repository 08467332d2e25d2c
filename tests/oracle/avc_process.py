"""Run `avc` as a user does: in a process of its own."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import avc_casadi
import avc_hardware

_ROOTS = [str(Path(module.__file__).resolve().parent.parent) for module in (avc_casadi, avc_hardware)]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(_ROOTS)}
AVC = [sys.executable, "-W", "error", "-m", "avc_casadi"]


def command(*arguments, cwd=None, program=None):
    """Return the finished process; with ``program`` run that Python text in place of the command."""
    command = AVC if program is None else [sys.executable, "-c", program]
    return subprocess.run(  # noqa: S603
        [*command, *map(str, arguments)], capture_output=True, cwd=cwd, env=ENVIRONMENT, timeout=7200, check=False
    )


def answered(*arguments, cwd):
    """Return the exit code of a verb with --json and its document, None where it printed nothing."""
    done = command(*arguments, "--json", cwd=cwd)
    return done.returncode, json.loads(done.stdout) if done.stdout else None


def wait_until_begun(process, library, *, workers=0):
    """Wait until a process has loaded a library that its work needs, and so many workers of its own have too."""
    if sys.platform != "linux":
        time.sleep(5)
        return
    while process.poll() is None:
        children = Path(f"/proc/{process.pid}/task").glob("*/children")  # of every thread
        begun = [_has_loaded(library, pid) for path in children for pid in _text(path).split() if _runs(pid)]
        if _has_loaded(library, process.pid) and sum(begun) >= workers:
            return
        time.sleep(0.01)


def _runs(pid):
    """Return whether a worker is past its fork, where it has its parent's libraries still."""
    return "spawn_main" in _text(Path(f"/proc/{pid}/cmdline"))


def _has_loaded(library, pid):
    return library in _text(Path(f"/proc/{pid}/maps"))


def _text(path):
    try:
        return path.read_text()
    except OSError:
        return ""


def strict_json(data):
    """Parse bytes that must be one JSON document and not a byte more; NaN and infinity are refused."""

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    text = data.decode("ascii")
    document = json.loads(text, parse_constant=refuse)
    assert text == json.dumps(document, indent=1) + "\n"
    return document
