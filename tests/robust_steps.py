"""A wall and laws that hold it by damped loops alone, for tests."""

from avc_casadi.design.robust.cma_continuation import continuation
from avc_casadi.design.robust.lqg import Space


def step_at(problem, stiffness_n_per_m):
    """Return the last step of a continuation that begins at half the wall."""
    start = Space(problem.device, problem.hands).starts[0]
    last = continuation(problem, start, (stiffness_n_per_m / 2, stiffness_n_per_m))[-1]
    assert last.stiffness_n_per_m == stiffness_n_per_m
    return last
