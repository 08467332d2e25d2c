"""The command `avc`: its verbs stand in six modules, which declare them."""

from avc_casadi.cli.arguments import VERBS as VERBS
from avc_casadi.cli.dispatch import main as main
