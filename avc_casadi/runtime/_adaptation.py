"""Changing the gains of the coupling without creating energy.

The spring of the coupling acts on the deflection e from an anchor a: f = k (e - a) + b de/dt. A stiffness that changes
at constant deflection changes the stored energy k (e - a)^2/2. Therefore

- k rises with the force held: the anchor moves so that k (e - a) stays, and the energy falls by the ratio of the two;
- k falls with the deflection held: force and energy fall with it;
- the anchor returns to 0, without which each cycle of both would soften the wall: at once where the device leaves the
  wall (the coupling relaxes there and no force acts), otherwise only as far as it is paid for from a tank.

The tank holds what the virtual side has taken in through the held force and neither stores nor has spent, at most the
given ceiling: f(k-1) (x(k) - x(k-1)) less the change of the stored energy. A loop that generates energy empties it.
The damper stores nothing, so that b and b_p may change at will.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from avc_casadi.runtime._step import Expr, Step, StepBuilder

GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True)
class AdaptationSettings:
    """How fast and how gains change.

    Attributes:
        slew_per_s: largest change a second as a share of the larger of the gains before and after; None for no limit.
        passive: with anchor and tank; otherwise the stiffness changes at constant deflection, as firmware without them
            does, and creates energy.
        return_s: time constant of the anchor's return.
        tank_j: ceiling of the tank, and most that it remembers to be missing.
    """

    slew_per_s: float | None = None
    passive: bool = True
    return_s: float = 0.05
    tank_j: float = 0.01


def adaptation_step(sample_time_s: float, settings: AdaptationSettings) -> Step:
    """Return the step from wanted gains to gains in force and the anchor.

    Args:
        sample_time_s: T.
        settings: slew, anchor and tank.

    Returns:
        Wanted b, k, b_p; of the tick before: the deflection e (m), the environment's stored energy (J) and the held
        force (N, positive against +x); the position (m) of now and whether the device touches the environment
        -> b, k, b_p, anchor_m, tank_j, deflection_m (that before, or 0 where the coupling relaxes).
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    wanted = [builder.input(f"wanted_{name}") for name in GAINS]
    deflection = builder.input("deflection_m")
    started = builder.state("started")
    before = [ca.if_else(started, builder.state(name), goal) for name, goal in zip(GAINS, wanted, strict=True)]
    gains = [_slewed(*pair, settings, sample_time_s) for pair in zip(before, wanted, strict=True)]
    builder.follow("started", 1)
    for name, gain in zip(GAINS, gains, strict=True):
        builder.follow(name, gain)
        builder.output(name, gain)
    if settings.passive:
        anchor, tank, relaxed = _anchored(builder, settings, sample_time_s, deflection, before[1], gains[1])
    else:
        anchor, tank, relaxed = 0.0, 0.0, deflection
    builder.output("anchor_m", anchor)
    builder.output("tank_j", tank)
    builder.output("deflection_m", relaxed)
    return builder.done("adaptation")


def _slewed(before: Expr, wanted: Expr, settings: AdaptationSettings, sample_time_s: float) -> Expr:
    import casadi as ca  # noqa: PLC0415

    if settings.slew_per_s is None:
        return wanted
    step = settings.slew_per_s * sample_time_s * ca.fmax(before, wanted)
    return ca.fmin(ca.fmax(wanted, before - step), before + step)


def _anchored(
    builder: StepBuilder, settings: AdaptationSettings, sample_time_s: float, deflection: Expr, k_before: Expr, k: Expr
) -> tuple[Expr, Expr, Expr]:
    import casadi as ca  # noqa: PLC0415

    environment, force = builder.input("environment_energy_j"), builder.input("held_force_n")
    position, touching = builder.input("position_m"), builder.input("touching")
    anchor, tank = builder.state("anchor_m"), builder.state("tank_j")
    last_position, stored = builder.state("position_m"), builder.state("stored_j")
    work = builder.state("work_j")

    stretch = deflection - anchor
    holds = 0.5 * k_before * stretch * stretch + environment
    # The work of the interval before the last, which ended with this stored energy.
    filled = ca.fmax(ca.fmin(tank + work - (holds - stored), settings.tank_j), -settings.tank_j)
    rises = k > k_before
    held = ca.if_else(rises, stretch * k_before / ca.if_else(rises, k, 1), stretch)
    moved = deflection - held
    step = -(1 - math.exp(-sample_time_s / settings.return_s)) * moved
    cost = 0.5 * k * step * (step - 2 * held)
    # The energy is convex in the step: a share of it costs at most that share.
    paid = ca.if_else(cost > 0, ca.fmin(ca.fmax(filled, 0) / ca.if_else(cost > 0, cost, 1), 1), 1)
    following = ca.if_else(touching, moved + paid * step, 0)
    builder.follow("anchor_m", following)
    builder.follow("tank_j", filled)
    builder.follow("stored_j", holds)
    builder.follow("work_j", force * (position - last_position))
    builder.follow("position_m", position)
    return following, filled, ca.if_else(touching, deflection, 0)
