"""What accuracy of a simulated scene costs: integrators and substeps against the exact scheme."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.scene import AnyGains, compile_for, settled, staged
from avc_casadi.simulation.screen import ns_per_step

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.scene import Integrator

CHOICES: tuple[tuple[Integrator, int], ...] = (
    ("exact", 1),
    ("projected", 1),
    ("projected", 4),
    ("projected", 16),
    ("projected", 64),
    ("rk4", 1),
    ("rk4", 4),
    ("rk4", 16),
)
# The exact scheme is judged by itself in substeps: it has no error but rounding.
_REFERENCE_SUBSTEPS = 4


@dataclass(frozen=True)
class IntegratorAccuracy:
    """One integrator on one scene.

    Attributes:
        scene: name of the problem.
        integrator: exact, projected or rk4.
        substeps: steps of the integrator in one sample.
        error: largest error of the position over the scene, m; not a number where the run diverges.
        seconds: time of the whole scene in CasADi's loop.
        instructions: instructions of one sample.
    """

    scene: str
    integrator: str
    substeps: int
    error: float
    seconds: float
    instructions: int


def integrator_accuracy(
    problem: Problem,
    gains: AnyGains,
    choices: tuple[tuple[Integrator, int], ...] = CHOICES,
) -> tuple[IntegratorAccuracy, ...]:
    """Run a scene by several integrators.

    Without dry friction `projected` is the exact scheme and left out.

    Args:
        problem: the problem; its scene's own integrator and substeps do not matter.
        gains: as in `simulate`.
        choices: integrators and substeps.

    Raises:
        InputError: an impossible scene.
        UnsupportedError: an integrator that does not take the scene.
    """
    problem = staged(problem, gains)
    effects, chosen, _ = settled(problem, build_effects(problem), gains)
    frictionless = all(effect.friction_n == 0 for effect in effects)

    def run(integrator: Integrator, substeps: int) -> tuple[np.ndarray, float, int]:
        integrated = problem.changed(scene={"integrator": integrator, "substeps": substeps})
        compiled = compile_for(integrated, effects, chosen)
        traces = execute(compiled, compiled.parameter_values(chosen), compiled.input_values(), engine="casadi")
        return traces["position_m"][0], ns_per_step(compiled, chosen) * 1e-9 * compiled.samples, compiled.instructions

    reference = run("exact", _REFERENCE_SUBSTEPS)[0]
    rows = []
    for integrator, substeps in choices:
        if integrator == "projected" and frictionless:
            continue
        position, seconds, instructions = run(integrator, substeps)
        with np.errstate(invalid="ignore", over="ignore"):
            error = float(np.abs(position - reference).max())
        rows.append(IntegratorAccuracy(problem.name, integrator, substeps, error, seconds, instructions))
    return tuple(rows)
