"""Run `avc` as a user does: in a process of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import avc_casadi
import avc_hardware

_ROOTS = [str(Path(module.__file__).resolve().parent.parent) for module in (avc_casadi, avc_hardware)]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(_ROOTS)}
AVC = [sys.executable, "-W", "error", "-m", "avc_casadi"]


def avc(*arguments, cwd=None, program=None):
    """Return the finished process; with ``program`` run that Python text in place of the command."""
    command = AVC if program is None else [sys.executable, "-c", program]
    return subprocess.run(  # noqa: S603
        [*command, *map(str, arguments)], capture_output=True, cwd=cwd, env=ENVIRONMENT, timeout=120, check=False
    )


def strict_json(data):
    """Parse bytes that must be one JSON document and not a byte more; NaN and infinity are refused."""

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    text = data.decode("ascii")
    document = json.loads(text, parse_constant=refuse)
    assert text == json.dumps(document, indent=1) + "\n"
    return document
