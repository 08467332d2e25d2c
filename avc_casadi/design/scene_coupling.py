"""The coupling that a scene names, solved, and the scene simulated with it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi.design.methods import solve
from avc_casadi.files.problem_file import AnyProblem, as_problem
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.scene import simulate as simulate_with
from avc_casadi.simulation.screen import screen as screen_with

if TYPE_CHECKING:
    from avc_casadi.design.registry import MethodName
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.simulation.execute import Engine
    from avc_casadi.simulation.run import Run
    from avc_casadi.simulation.scene import AnyGains
    from avc_casadi.simulation.screen import Screening


def scene_coupling(problem: Problem) -> Gains | GainSchedule:
    """Return the coupling that the problem's scene names, solved; "none" joins device and environment rigidly."""
    name = problem.scene.coupling
    return NO_COUPLING if name == "none" else scene_gains(problem, name)


def scene_gains(problem: Problem, method: MethodName) -> GainSchedule:
    """Solve by the method that the scene names.

    The one of a scene that names none knows whole samples of delay only: it is designed for the next one.
    """
    return solve(problem.changed(device={"delay_samples": _designed_for(problem)}), method)


def scene_notes(problem: Problem) -> list[str]:
    """Say where the coupling of a scene is designed for another device than the one that is simulated."""
    declared, whole = problem.device.delay_samples, _designed_for(problem)
    if whole == declared:
        return []
    note = (
        f"the scene names no coupling: {problem.scene.coupling}, designed for {whole:g} samples of delay, simulated "
        f"with {declared:g}; avc recommend P --out c.json makes one for this device, for --gains c.json"
    )
    return [note]


def _designed_for(problem: Problem) -> float:
    named = "coupling" in problem.scene.model_fields_set
    return problem.device.delay_samples if named else math.ceil(problem.device.delay_samples)


def simulate(
    problem: AnyProblem,
    gains: AnyGains | None = None,
    *,
    hand: Hand | None = None,
    interaction_hz: float | None = None,
    seed: int = 0,
    engine: Engine = "auto",
) -> Run:
    """Simulate the scene of a problem.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        gains: a coupling, which brings its table and what runs beside it; gains or a gain table; None takes the one
            that the scene names.
        hand: a hand in place of the scene's.
        interaction_hz: frequency at which a gain table is read, Hz; None is the scene's, or the table's lowest.
        seed: added to the seeds of all noises, 0 or more.
        engine: what runs the samples; all give the same bits.

    Raises:
        InputError: an impossible scene, or gains that are not there or were made for another sample time.
        UnsupportedError: an effect that scenes do not simulate.

    Example:
        >>> run = avc.simulate("scenes/stiff-wall-pressed")
        >>> run.claim
        'asymptotic'
    """
    stated = as_problem(problem)
    chosen = scene_coupling(stated) if gains is None else gains
    return simulate_with(stated, chosen, hand=hand, interaction_hz=interaction_hz, seed=seed, engine=engine)


def screen(
    problem: AnyProblem,
    gains: AnyGains | None = None,
    *,
    interaction_hz: float | None = None,
    seed: int = 0,
    tolerance: float = 0.01,
) -> Screening:
    """Leave out each effect of a scene in turn and say which ones it needs.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        gains: as in `simulate`.
        interaction_hz: as in `simulate`.
        seed: as in `simulate`.
        tolerance: largest relative change of position, force and stiffness that does not count, from 0 to below 1.

    Raises:
        InputError: as `simulate`; or the tolerance is outside its range.

    Example:
        >>> avc.screen("scenes/free-motion", tolerance=0.05).unneeded
        ()
    """
    stated = as_problem(problem)
    chosen = scene_coupling(stated) if gains is None else gains
    return screen_with(stated, chosen, interaction_hz=interaction_hz, seed=seed, tolerance=tolerance)
