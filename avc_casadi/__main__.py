"""`python -m avc_casadi`: the command line."""

from __future__ import annotations

import sys

from avc_casadi._entry import run

if __name__ == "__main__":
    sys.exit(run())
