"""From logs to a device file."""

from avc_casadi._moved import lookup

__getattr__ = lookup("identification")
