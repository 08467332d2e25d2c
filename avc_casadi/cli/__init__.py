"""The command `avc`: its verbs stand in six modules, listed in `dispatch`."""

from avc_casadi.cli.dispatch import VERBS as VERBS
from avc_casadi.cli.dispatch import main as main
