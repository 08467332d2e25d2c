"""The command `avc`: its verbs stand in five modules, listed in `_verbs`."""

from avc_casadi._util.text import number as number
from avc_casadi.cli._main import main as main
from avc_casadi.cli._verbs import VERBS as VERBS
