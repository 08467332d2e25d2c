"""Which coupling to deploy, how stiff it renders, what limits it."""

from avc_casadi._moved import lookup

__getattr__ = lookup("recommendation")
