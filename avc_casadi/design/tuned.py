"""Method `static-tuned`: the best constant gains with which every hand of the set settles.

The joint programme finds the gains of least error that are linearly stable with every hand with the damping of the
device reduced by a reserve. All hands try them in the problem's scene, without dry friction and with it; where some
hand does not settle, the reserve is raised and the programme solved again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.design.schedule import solve_schedule
from avc_casadi.design.static import ConstantDesign, constant_schedule
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.effects import HandEffect, WallEffect
from avc_casadi.model.gains import Gains, GainSchedule, gains_at
from avc_casadi.model.hands import Hand, hand_set
from avc_casadi.model.problem import Boundaries, Frequency, Impedance, Problem, Structure
from avc_casadi.model.scene import Scene
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import relative_errors
from avc_casadi.simulation.scene import simulate_batch

_SEED = 0
# Factor by which the reserve is raised where some hand does not settle.
_RAISE = 1.5
# Default reserve, as a share of k_e T/2, and the reserve, N.s/m, below which it counts as none.
_RESERVE_SHARE = 0.12
_SMALLEST_RESERVE_NS_PER_M = 1e-9
# Band of a tuned design: from a sustained press, in which a damper without a spring would creep, to contact
# transients; not beyond a share of the sampling frequency.
_LOWEST_HZ = 0.01
_HIGHEST_HZ = 100.0
_HIGHEST_TURNS = 0.45
_BAND_POINTS = 50
_SLOPE_PENALTY = 1e-4


@dataclass(frozen=True)
class StaticTuned:
    """Tuned constant gains and their last trial.

    Attributes:
        gains: the gains; None where there are none.
        error: root mean square of the relative error over the problem's frequencies.
        reserve_ns_per_m: damping of the device that was in reserve, N.s/m.
        rested: how many hands came to rest.
        hands: how many hands tried.
        reason: why there are no gains; empty where there are.
    """

    gains: Gains | None
    error: float
    reserve_ns_per_m: float
    rested: int
    hands: int
    reason: str = ""

    def sentence(self, damping: str) -> str:
        """Return a line on the result and its trial; ``damping`` is the unit of the reserve."""
        if self.gains is None:
            return self.reason
        return (
            f"tuned constant gains: error {100 * self.error:.4g} %; linearly stable with every hand, even "
            f"with {quantity(self.reserve_ns_per_m, damping)} less damping; "
            f"{self.hands} hands (seed {_SEED}) come to rest in the scene"
        )


def tuned_margin(problem: Problem) -> float:
    """Return the default damping reserve, N.s/m: a share of k_e T/2, which sampling takes."""
    reserve = _RESERVE_SHARE * problem.environment.stiffness_n_per_m * problem.device.sample_time_s / 2
    return reserve if reserve >= _SMALLEST_RESERVE_NS_PER_M else 0.0


def tune_static(problem: Problem, *, draws: int = 32, raises: int = 8, progress: Progress = SILENT) -> StaticTuned:
    """Return the constant gains of least error with which every hand of the problem's set comes to rest in its scene.

    The gains are linearly stable with a reserve of device damping, which is raised by half, up to ``raises`` times,
    where some hand does not rest. Hands are the corners of [hands] and ``draws`` drawn ones.
    """
    kinds = {effect.kind for effect in scene_effects(problem)}
    if "hand" not in kinds:
        raise UnsupportedError(
            f"{problem.name}: the scene simulates no hand, and the method static-tuned needs one; add the effect "
            f"'hand' to these: {', '.join(sorted(kinds))}"
        )
    hands = hand_set(problem.hands, draws=draws, seed=_SEED)
    damping_unit = problem.units.unit("N.s/m")
    reserve = problem.stability.margin_ns_per_m or tuned_margin(problem)
    # The trial without friction costs least and comes first; where it fails the next is skipped.
    frictions = (False, True) if "coulomb-friction" in kinds else (False,)
    rested = 0
    why = ""
    for raised in range(1 + raises):
        progress.advance(raised, 1 + raises, f"{quantity(reserve, damping_unit)} in reserve")
        # Realism applies to tables: the best constant gains may be unrealistic at some row.
        stated = problem.changed(stability={"scope": "hands", "margin_ns_per_m": reserve}, realism={"require": "none"})
        table = solve_schedule(stated, constant=True)
        if not table.usable.all():
            why = f"{why}, and with more none are found" if raised else table.reason[0]
            return StaticTuned(None, np.inf, reserve, rested, len(hands), why)
        gains = gains_at(table)
        rested = _rested(problem, hands, gains, frictions)
        if rested == len(hands):
            return StaticTuned(gains, _rms_error(problem, gains), reserve, rested, len(hands))
        why = (
            f"no constant gains of [coupling] make every hand settle in the scene: the last gains settle {rested} of "
            f"{len(hands)}; narrow [hands], widen [coupling], add device damping or soften the wall"
        )
        reserve *= _RAISE
    return StaticTuned(None, np.inf, reserve / _RAISE, rested, len(hands), why)


def _rested(problem: Problem, hands: Hand, gains: Gains, frictions: tuple[bool, ...]) -> int:
    """Return how many hands come to rest in the scene in the first trial that some of them fail, or in the last."""
    rest = np.ones(len(hands), dtype=bool)
    for friction in frictions:
        if rest.all():
            rest = simulate_batch(problem, hands, gains, friction=friction).stable
    return int(np.count_nonzero(rest))


def _rms_error(problem: Problem, gains: Gains) -> float:
    """Return the root mean square over the frequencies of the relative error of the impedance of constant gains."""
    loop = loop_at(problem, problem.frequencies_hz())
    realism = problem.realism
    perceived = loop.perceived(gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    errors = relative_errors(perceived, np.asarray(loop.target), realism.objective, realism.jnd)
    return float(np.sqrt(np.mean(errors**2)))


def solve_static_tuned(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by tuned constant gains; the same at every row; the notes report their trial."""
    started = time.perf_counter()
    tuned = tune_static(problem, progress=progress)
    notes = (tuned.sentence(problem.units.unit("N.s/m")),)
    return constant_schedule(problem, ConstantDesign("static-tuned", tuned.gains, tuned.reason, notes), started)


def tuning_problem(problem: Problem, structure: Structure, margin_ns_per_m: float | None = None) -> Problem:
    """Return the problem of tuned designs: goal without sampling, all training hands with a reserve, the whole band.

    The goal is the wall with the damping b_e + k_e T/2, which makes up for what sampling takes. `margin_ns_per_m` is
    the reserve of device damping; None takes that of `tuned_margin`.
    """
    device = problem.device
    wall = problem.environment
    # The goal is rendered without sampling: its damping makes up for the k_e T/2 that sampling takes.
    goal_damping = wall.damping_ns_per_m + wall.stiffness_n_per_m * device.sample_time_s / 2
    goal = Impedance(damping_ns_per_m=goal_damping, stiffness_n_per_m=wall.stiffness_n_per_m)
    margin = tuned_margin(problem) if margin_ns_per_m is None else margin_ns_per_m
    most_contact_damping = 2 * device.mass_kg / device.sample_time_s if structure == "damped" else 0.0
    highest_hz = min(_HIGHEST_HZ, _HIGHEST_TURNS / device.sample_time_s)
    band = Frequency(start_hz=_LOWEST_HZ, stop_hz=highest_hz, points=_BAND_POINTS)
    return problem.changed(
        boundaries=Boundaries(upper=goal, lower=goal),
        coupling={"structure": structure, "contact_damping_ns_per_m": (0.0, most_contact_damping)},
        stability={"model": "sampled-data", "scope": "hands", "margin_ns_per_m": margin},
        realism={"objective": "complex"},
        schedule={"slope_penalty": _SLOPE_PENALTY},
        frequency=band,
        scene=Scene(effects=(HandEffect(), WallEffect())),
    )


def tune(problem: Problem, margin_ns_per_m: float, progress: Progress = SILENT) -> Gains | None:
    """Tune constant gains with a contact damper for the training hands; None where the margin cannot be met."""
    return tune_static(tuning_problem(problem, "damped", margin_ns_per_m), progress=progress).gains
