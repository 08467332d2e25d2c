"""The problem of tuned couplings and its gains: goal without sampling, all training hands, the whole band."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.constant.static_tuned import tuned_margin
from avc_casadi.design.methods import solve
from avc_casadi.model.effects import HandEffect, WallEffect
from avc_casadi.model.gains import Gains, gains_at
from avc_casadi.model.problem import Boundaries, Frequency, Impedance
from avc_casadi.model.scene import Scene

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem, Structure
    from avc_casadi.model.schedule import GainSchedule

# From a sustained press, in which a damper without a spring would creep, to contact transients.
TUNED_HZ = (0.01, 100.0)
TUNED_POINTS = 50
TUNED_SLOPE_PENALTY = 1e-4
# Upper limit of the frequency as a share of Nyquist, for devices of low sample rate.
_OF_NYQUIST = 0.9


def physical_wall(problem: Problem) -> Problem:
    """Return the problem with the continuous-time wall as goal.

    A spring on a sampled position, held for T, has the negative damping k_e T/2. The goal compensates it, so that
    H Z_ds is b_e + k_e/(j omega) up to the second power of omega T.
    """
    wall = problem.environment
    made_up = wall.damping_ns_per_m + wall.stiffness_n_per_m * problem.device.sample_time_s / 2
    goal = Impedance(damping_ns_per_m=made_up, stiffness_n_per_m=wall.stiffness_n_per_m)
    return problem.changed(boundaries=Boundaries(upper=goal, lower=goal))


def tuning_problem(problem: Problem, structure: Structure, margin_ns_per_m: float | None = None) -> Problem:
    """Return the problem of both tuned designs: same goal, structure, gain box, frequencies and training hands.

    The contact damper may reach 2 m/T of the device alone, beyond which it is unstable by itself. Constant gains
    are tried in a press without dry friction and encoder quantisation, against which no damping reserve helps; other
    motions and the complete device are left to a trial.

    Args:
        problem: device and wall.
        structure: series or damped.
        margin_ns_per_m: damping reserve: every training hand must be stable with the device's damping reduced by
            it; None is that of `tuned_margin`.
    """
    device = problem.device
    margin = tuned_margin(problem) if margin_ns_per_m is None else margin_ns_per_m
    most = 2 * device.mass_kg / device.sample_time_s if structure == "damped" else 0.0
    stop = min(TUNED_HZ[1], _OF_NYQUIST * 0.5 / device.sample_time_s)
    return physical_wall(problem).changed(
        coupling={"structure": structure, "contact_damping_ns_per_m": (0.0, most)},
        stability={"model": "sampled-data", "scope": "hands", "margin_ns_per_m": margin},
        realism={"objective": "complex"},
        schedule={"slope_penalty": TUNED_SLOPE_PENALTY},
        frequency=Frequency(start_hz=TUNED_HZ[0], stop_hz=stop, points=TUNED_POINTS),
        scene=Scene(effects=(HandEffect(), WallEffect())),
    )


def tuned(
    problem: Problem,
    *,
    scheduled: bool,
    margin_ns_per_m: float,
    structure: Structure = "damped",
    progress: Progress = SILENT,
) -> Gains | GainSchedule | None:
    """Tune constant or scheduled gains for the training hands; None where the margin cannot be met.

    Args:
        problem: device and wall.
        scheduled: gains that follow frequency; otherwise the best constant gains of the same problem.
        margin_ns_per_m: damping reserve, by which the device's damping is reduced while the frozen loop must stay
            stable.
        structure: series or damped.
        progress: reports the starts or reserves tried.
    """
    stated = tuning_problem(problem, structure, margin_ns_per_m)
    table = solve(stated, "schedule" if scheduled else "static-tuned", progress=progress)
    if not table.usable.all():
        return None
    return table if scheduled else gains_at(table)
