"""`python -m avc_casadi`: the command line, also in a plain checkout, where avc_hardware lies in hardware/."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from avc_casadi._entry import run

if __name__ == "__main__":
    if find_spec("avc_hardware") is None:
        sys.path.append(str(Path(__file__).resolve().parent.parent / "hardware"))
    sys.exit(run())
