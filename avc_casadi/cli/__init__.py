"""The command `avc`: its verbs stand in five modules, listed in `main`."""

from avc_casadi.cli.main import VERBS as VERBS
from avc_casadi.cli.main import main as main
