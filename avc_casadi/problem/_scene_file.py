"""The scene of a problem file: motion of the hand's target, coupling and the effects to simulate."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from avc_casadi.problem._effect_file import Effect
from avc_casadi.problem._motion_file import Motion, Press
from avc_casadi.problem._quantity import Hertz, Span, Substeps, refusal, shown
from avc_casadi.problem._table import Table

CouplingChoice = Literal["none", "static", "static-tuned", "closed-form", "direct", "schedule"]
Integrator = Literal["exact", "projected", "rk4"]


def _tables(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        raise refusal(f"is {shown(value)}; allowed: one [[scene.effects]] for each effect")
    return tuple(value)


class Scene(Table):
    """What is simulated: the motion of the hand's target, the coupling and the effects.

    Attributes:
        duration_s: of the simulation.
        coupling: whose gains are simulated.
        interaction_hz: where a gain table is read; None: its lowest frequency.
        integrator: exact; projected and rk4 to compare.
        substeps: of projected and rk4.
        motion: of the hand's target.
        effects: these and nothing else; none listed: a hand, a wall and all that the device declares.
    """

    duration_s: Span = 3.0
    coupling: CouplingChoice = "static"
    interaction_hz: Hertz | None = None
    integrator: Integrator = "exact"
    substeps: Substeps = 1
    motion: Motion = Press()
    effects: Annotated[tuple[Effect, ...], BeforeValidator(_tables)] = ()
