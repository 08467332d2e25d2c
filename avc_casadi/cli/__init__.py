"""The command `avc`: its verbs stand in five modules, listed in `dispatch`."""

from avc_casadi.cli.dispatch import VERBS as VERBS
from avc_casadi.cli.dispatch import main as main
