"""Guards against the energy that a sampled loop generates.

Both monitor the energy through the held force, f(k) (x(k+1) - x(k)), less the energy stored in the virtual side: its
reserve. In a passive loop the reserve never falls; it saturates at a ceiling, so that old losses do not cover new
activity.
"""

from __future__ import annotations

from avc_casadi._errors import UnsupportedError
from avc_casadi.simulation.runtime.step import Expr, Step, StepBuilder

GUARDS = ("passivity-controller", "energy-tank")


# Limits of the reserve.
_CEILING_J, _DEBT_J = 0.0, 0.01


def guard_step(method: str, sample_time_s: float, damping_limit_ns_per_m: float) -> Step:
    """Return the step from the desired to the allowed force.

    ``passivity-controller`` adds the damper that dissipates the deficit within one tick, up to the limit (Hannaford and
    Ryu 2002, with the held force in the observer). ``energy-tank`` reduces a force that would give out more in the next
    tick than reserve and stored energy together.
    """
    import casadi as ca  # noqa: PLC0415

    if method not in GUARDS:
        raise UnsupportedError(f'guard "{method}" is unknown; allowed: {", ".join(GUARDS)}')
    builder = StepBuilder()
    wanted, position, stored, held = (
        builder.input(name) for name in ("force_n", "position_m", "stored_j", "held_force_n")
    )
    started, last_position, last_stored = (builder.state(name) for name in ("started", "position_m", "stored_j"))
    reserve = builder.state("reserve_j")
    moved = ca.if_else(started, position - last_position, 0)
    change = held * moved - ca.if_else(started, stored - last_stored, 0)
    now = ca.fmax(ca.fmin(reserve + change, _CEILING_J), -_DEBT_J)
    if method == "passivity-controller":
        force = wanted + _damping(now, moved, damping_limit_ns_per_m / sample_time_s) * moved
    else:
        force = _within(wanted, moved, ca.fmax(now + stored, 0))
    builder.follow("started", 1)
    builder.follow("position_m", position)
    builder.follow("stored_j", stored)
    builder.follow("reserve_j", now)
    builder.output("force_n", force)
    builder.output("reserve_j", now)
    return builder.done("guard")


def _damping(reserve: Expr, moved: Expr, most: float) -> Expr:
    """Return the damping over T that dissipates the deficit if the next displacement equals the last."""
    import casadi as ca  # noqa: PLC0415

    square = moved * moved
    acts = ca.logic_and(reserve < 0, square > 0)
    return ca.if_else(acts, ca.fmin(-reserve / ca.if_else(acts, square, 1), most), 0)


def _within(wanted: Expr, moved: Expr, available: Expr) -> Expr:
    """Limit the energy given out if the next displacement equals the last."""
    import casadi as ca  # noqa: PLC0415

    gives = -wanted * moved
    over = gives > available
    return ca.if_else(over, wanted * available / ca.if_else(over, gives, 1), wanted)
