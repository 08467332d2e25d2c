"""Design methods by name: from a problem to gains."""

from avc_casadi._moved import lookup

__getattr__ = lookup("design")
