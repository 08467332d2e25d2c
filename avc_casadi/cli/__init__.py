"""The command `avc`: one file a verb, listed in `_verbs`."""

from avc_casadi.cli._main import main as main
