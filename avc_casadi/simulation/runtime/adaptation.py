"""Changing the gains of the coupling without creating energy, and without sagging under a mean force.

The spring of the coupling acts on the deflection e from an anchor a: f = k (e - a) + b de/dt. With e = m + d, m the
mean deflection and d the deviation from it, and with k_0 the stiffness of the row of rest, the anchor wanted is

    g = -m max(k_0/k - 1, 0),    so that    k (e - g) = max(k_0, k) m + k d:

the gains of the frequency act on the deviation, and the mean force keeps at least the stiffness of the row of rest. A
row softer than k_0 would sag under it otherwise. At rest k = k_0 and g = 0: a held press ends at the stiffness of its
row. With a fixed anchor the spring is one of constant gains; only what moves k or a could create energy:

- k rises with the force held: the anchor moves so that k (e - a) stays, and the energy falls by the ratio of the two;
- k falls with the deflection held: force and energy fall with it;
- the anchor goes on from there, by what g changes with a falling k at once and to g in time, only as far as it is paid
  for from a tank;
- where the device leaves the wall the coupling relaxes: no force acts there, and anchor and mean return to 0.

The tank holds what the virtual side has taken in and neither stores nor has spent, at most the given ceiling: the force
asked for times the displacement, less the change of the stored energy. A displacement is paired with the mean of the
forces before and after it. That is exact for a spring and, in sum, positive for a damper: constant gains do not lower
it; what holding and delaying a force creates, with constant gains too, belongs to the loop and is not charged to their
change. The damper stores nothing, so that b and b_p may change at will.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from avc_casadi.simulation.runtime.step import Expr, Step, StepBuilder


@dataclass(frozen=True)
class HoldSettings:
    """How the look-up leaves an estimate that is no longer there.

    Attributes:
        hold_s: how long the last estimate is kept.
        decay_s: time constant with which the frequency then falls to that of rest.
    """

    hold_s: float = 0.0
    decay_s: float = 0.1


def hold_step(sample_time_s: float, settings: HoldSettings) -> Step:
    """Return the step from an estimate to the frequency of the look-up.

    The gains follow the rows of the table, each of which was designed, all the way to rest: the frequency falls, not
    the gains. The age stops at the hold time, so that nothing grows.

    Returns:
        frequency_hz, valid, with the parameter rest_hz -> frequency_hz, held (1 while it is not an estimate of now).
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    estimate, valid, rest = builder.input("frequency_hz"), builder.input("valid"), builder.parameter("rest_hz")
    # The start counts as long at rest.
    frequency, age = builder.state("frequency_hz"), builder.state("age_s", settings.hold_s)
    known = ca.if_else(frequency > 0, frequency, rest)
    older = ca.fmin(age + sample_time_s, settings.hold_s)
    share = min(1.0, sample_time_s / settings.decay_s) if settings.decay_s > 0 else 1.0
    falling = known + share * (rest - known)
    lost = ca.if_else(age < settings.hold_s, known, falling)
    following = ca.if_else(valid, estimate, lost)
    builder.follow("frequency_hz", following)
    builder.follow("age_s", ca.if_else(valid, 0, older))
    builder.output("frequency_hz", following)
    builder.output("held", ca.logic_not(valid))
    return builder.done("hold")


GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
# Added where nothing may be divided by 0. So soft a spring carries no mean force; so small a gain or energy is none.
_SOFTEST_N_PER_M = 1.0
_TINY = 1e-30


@dataclass(frozen=True)
class AdaptationSettings:
    """How fast and how gains change.

    Attributes:
        slew_per_s: largest change a second as a share of the larger of the gains before and after; None for no limit.
        passive: with anchor and tank; otherwise the stiffness changes at constant deflection, as firmware without them
            does, and creates energy.
        return_s: time constant with which the anchor goes where it is wanted.
        tank_j: ceiling of the tank, and most that it remembers to be missing.
        mean_s: time constant of the mean deflection. Long against a bounce, which has no mean force to be kept.
    """

    slew_per_s: float | None = None
    passive: bool = True
    return_s: float = 0.05
    tank_j: float = 0.01
    mean_s: float = 1.5


def adaptation_step(sample_time_s: float, settings: AdaptationSettings) -> Step:
    """Return the step from wanted gains to gains in force and the anchor.

    Args:
        sample_time_s: T.
        settings: slew, anchor and tank.

    Returns:
        Wanted b, k, b_p; of the tick before: the deflection e (m), the environment's stored energy (J) and the force
        asked for (N, positive against +x); the position of now (m; 0 outside of a one-sided environment), whether the
        device touches the environment, and the stiffness k_0 of the row of rest (0: the mean force keeps none)
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

    filled = _filled(builder, settings, deflection, k_before)
    touching, rest = builder.input("touching"), builder.input("rest_stiffness_n_per_m")
    anchor, mean = builder.state("anchor_m"), builder.state("mean_deflection_m")

    mean += (1 - math.exp(-sample_time_s / settings.mean_s)) * (deflection - mean)
    # g = -mean * missing.
    missing = ca.fmax(rest / (k + _SOFTEST_N_PER_M) - 1, 0)
    held = (deflection - anchor) * (k_before / (ca.fmax(k_before, k) + _TINY))
    moved = deflection - held
    carried = -mean * ca.fmax(missing - builder.state("missing"), 0)
    step = carried - (1 - math.exp(-sample_time_s / settings.return_s)) * (moved + carried + mean * missing)
    cost = 0.5 * k * step * (step - 2 * held)
    there = ca.fmax(filled, 0)
    # The energy is convex in the step: a share of it costs at most that share.
    paid = ca.if_else(cost > there, there / (cost + _TINY), 1)
    following = ca.if_else(touching, moved + paid * step, 0)
    builder.follow("anchor_m", following)
    builder.follow("mean_deflection_m", ca.if_else(touching, mean, 0))
    builder.follow("missing", missing)
    return following, filled, ca.if_else(touching, deflection, 0)


def _filled(builder: StepBuilder, settings: AdaptationSettings, deflection: Expr, k_before: Expr) -> Expr:
    """Return what the tank holds after the tick before: its spring's cost is part of what is stored."""
    import casadi as ca  # noqa: PLC0415

    environment, force = builder.input("environment_energy_j"), builder.input("held_force_n")
    position = builder.input("position_m")
    tank, stored = builder.state("tank_j"), builder.state("stored_j")
    stretch = deflection - builder.state("anchor_m")
    holds = 0.5 * k_before * stretch * stretch + environment
    work = 0.5 * (force + builder.state("held_force_n")) * builder.state("moved_m")
    filled = ca.fmax(ca.fmin(tank + work - (holds - stored), settings.tank_j), -settings.tank_j)
    builder.follow("tank_j", filled)
    builder.follow("stored_j", holds)
    builder.follow("held_force_n", force)
    builder.follow("moved_m", position - builder.state("position_m"))
    builder.follow("position_m", position)
    return filled
