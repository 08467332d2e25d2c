"""`avc` as a user runs it: a process of its own, `python -m avc_casadi VERB ... --json`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent.parent
_PATH = os.pathsep.join([str(ROOT), str(ROOT / "hardware")])
_ENVIRONMENT = os.environ | {"PYTHONPATH": _PATH, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "120"}


def avc(*words: str, folder: Path) -> tuple[int, Any]:
    """Run a verb with --json in a folder; return its exit code and its document, None where it printed nothing."""
    done = subprocess.run(  # noqa: S603 - the project's own command
        [sys.executable, "-m", "avc_casadi", *words, "--json"],
        capture_output=True,
        cwd=folder,
        env=_ENVIRONMENT,
        timeout=7200,  # against what hangs; a machine may be busy
        check=False,
    )
    text = done.stdout.decode("ascii")
    return done.returncode, json.loads(text) if text else None
