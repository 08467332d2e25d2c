"""The coupling that a scene names, solved, and the scene simulated with it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from avc_casadi.coupling import NO_COUPLING
from avc_casadi.design._solve import solve
from avc_casadi.problem import Problem, load_problem
from avc_casadi.scene import simulate as simulate_with

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling, Gains, GainSchedule, GainTable
    from avc_casadi.scene import Run


def scene_coupling(problem: Problem) -> Gains | GainSchedule:
    """Solve for the coupling that the problem's scene names; "none" joins device and environment rigidly."""
    name = problem.scene.coupling
    return NO_COUPLING if name == "none" else solve(problem, name)


def simulate(
    problem: Problem | str | Path,
    gains: Coupling | Gains | GainTable | GainSchedule | None = None,
    **options: Any,
) -> Run:
    """Simulate the scene of a problem.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        gains: a coupling, which brings its table and what runs beside it; gains or a gain table; None takes the one
            that the scene names.
        options: hand, interaction_hz, seed and engine, as in `avc_casadi.scene.simulate`.

    Raises:
        InputError: an impossible scene, or gains that are not there or were made for another sample time.
        UnsupportedError: an effect that scenes do not simulate.
    """
    stated = problem if isinstance(problem, Problem) else load_problem(problem)
    return simulate_with(stated, scene_coupling(stated) if gains is None else gains, **options)
