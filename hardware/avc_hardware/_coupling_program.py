"""The firmware's coupling: the scene's own expressions with gains and wall as inputs, turned into C.

The scene bakes its wall into the expression; a device receives wall and gains by message, so here they are symbols. The
functions that build the force law are the scene's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from avc_casadi.scene._coupling import COUPLING_PARAMETERS, Environment, contact_damper, series_force
from avc_casadi.scene._tick import Tick
from avc_hardware._float_program import FloatProgram

STATES = ("coupling_deflection_before_m", "environment_deflection_before_m", "contact_depth_before_m")
INPUTS = (
    "position_m",
    "damping_ns_per_m",
    "stiffness_n_per_m",
    "contact_damping_ns_per_m",
    "wall_damping_ns_per_m",
    "wall_stiffness_n_per_m",
    "sample_time_s",
)


@dataclass(frozen=True)
class _AnyWall(Environment):
    """A wall whose numbers are symbols: it may have a damper."""

    @property
    def present(self) -> bool:
        return True

    @property
    def damped(self) -> bool:
        return True


def coupling_function() -> Any:
    """Return the CasADi function (inputs, states) -> (force_n, tool_m, next states), all scalars."""
    import casadi as ca  # noqa: PLC0415

    x, b, k, b_p, wall_b, wall_k, sample_time = (ca.SX.sym(name) for name in INPUTS)
    tick = Tick(sample_time, 0.0, position=x)
    environment = _AnyWall(wall_k, wall_b, one_sided=True)
    force = contact_damper(tick, series_force(tick, environment, rigid=False), one_sided=True)
    # `coupling_parameters`, once more with symbols: a coupling without gains transmits nothing
    kappa = k + b / sample_time
    kappa_e = wall_k + wall_b / sample_time
    settled = {
        COUPLING_PARAMETERS[0]: ca.if_else(kappa > 0, b / kappa, 0),
        COUPLING_PARAMETERS[1]: ca.if_else(kappa > 0, 1 / kappa, 0),
        COUPLING_PARAMETERS[2]: kappa * (kappa_e / (kappa + kappa_e)),
        "contact_damping_ns_per_m": b_p,
    }
    states = {slot.name: slot.symbol for slot in tick.states}
    results = [force, tick.traces["tool_m"], *tick.successors()]
    results = ca.substitute(
        results, [slot.symbol for slot in tick.parameters], [settled[slot.name] for slot in tick.parameters]
    )
    return ca.Function(
        "avc_coupling",
        [x, b, k, b_p, wall_b, wall_k, sample_time, *(states[name] for name in STATES)],
        ca.cse(results),
        [*INPUTS, *STATES],
        ["force_n", "tool_m", *(f"next_{name}" for name in STATES)],
    )


def coupling_c() -> str:
    """Return the C source of the firmware's coupling step."""
    program = FloatProgram(coupling_function())

    def of_input(name: str) -> str:
        if name in STATES:
            return f"state->{name}"
        return {
            "position_m": "position_m",
            "sample_time_s": "sample_time_s",
            "wall_damping_ns_per_m": "wall_damping_ns_per_m",
            "wall_stiffness_n_per_m": "wall_stiffness_n_per_m",
        }.get(name, f"gains->{name}")

    def of_output(name: str) -> str:
        return "const float force_n" if name == "force_n" else f"state->{name.removeprefix('next_')}"

    body = program.c_body(of_input, of_output)
    lines = [
        "/* Coupling and wall in series at one sample: generated from the scene's CasADi expressions, do not edit.",
        " * Made by python -m avc_hardware.firmware_build generate */",
        '#include "avc_coupling.h"',
        "",
        "float avc_coupling_step(avc_coupling_t *state, float position_m, const avc_gains_t *gains,",
        "                        float wall_damping_ns_per_m, float wall_stiffness_n_per_m, float sample_time_s)",
        "{",
        *(f"    {line}" for line in body),
        "    return force_n;",
        "}",
    ]
    return "\n".join(lines) + "\n"
