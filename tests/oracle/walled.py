"""Which problems of the catalogue have a wall in the device's own loop: the others, `tool/`, refuse to be solved."""

import avc_casadi as avc


def has_wall(name):
    """Whether a problem has an environment; one with [simulation] alone couples to an engine."""
    return avc.load_problem(name).simulation is None
