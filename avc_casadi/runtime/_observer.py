"""The position between two encoder steps, and ahead of a delay: an observer that knows the force it commands."""

from __future__ import annotations

from dataclasses import dataclass

from avc_casadi.runtime._step import Expr, Step, StepBuilder


@dataclass(frozen=True)
class ObserverSettings:
    """What the observer knows.

    Attributes:
        resolution_m: length of an encoder step.
        mass_kg: mass of device and hand together, about.
        ahead: whole samples between a command and the force; the position is predicted over them.
        velocity_gain: share of a position error per sample that corrects the velocity.
        load_gain: share of a position error per sample squared, times the mass, that corrects the unknown force.
    """

    resolution_m: float
    mass_kg: float
    ahead: int = 0
    velocity_gain: float = 0.1
    load_gain: float = 0.0025


def observer_step(sample_time_s: float, settings: ObserverSettings) -> Step:
    """Predict the motion from the commands and an unknown load; correct it only by what the encoder contradicts.

    An encoder says that the position lies within half a step of its count. Inside, the prediction stands, so that the
    force does not jump by stiffness times step; outside, position, velocity and load are corrected by the excess. Over
    a delay the forces that are still to act are known, so that the position is predicted to when the next one acts.

    Args:
        sample_time_s: T.
        settings: what is known.

    Returns:
        position_m (in whole steps), force_n (asked for in the tick before, positive against +x)
        -> position_m, `ahead` samples from now.
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    measured, asked = builder.input("position_m"), builder.input("force_n")
    started, position = builder.state("started"), builder.state("position_m")
    # Velocity and acceleration in metres a sample, so that all states are of one size.
    velocity, load = builder.state("step_m"), builder.state("load_step_m")
    push = sample_time_s * sample_time_s / settings.mass_kg
    held, coming = _in_flight(builder, asked, settings.ahead)
    gained = load - push * held
    predicted = position + velocity + 0.5 * gained
    half = 0.5 * settings.resolution_m
    error = measured - predicted
    excess = error - ca.fmin(ca.fmax(error, -half), half)
    now = ca.if_else(started, predicted + excess, measured)
    speed = ca.if_else(started, velocity + gained + settings.velocity_gain * excess, 0)
    unknown = ca.if_else(started, load + settings.load_gain * excess, 0)
    builder.follow("started", 1)
    builder.follow("position_m", now)
    builder.follow("step_m", speed)
    builder.follow("load_step_m", unknown)
    for force in coming:
        gained = unknown - push * force
        now += speed + 0.5 * gained
        speed += gained
    builder.output("position_m", now)
    return builder.done("observer")


def _in_flight(builder: StepBuilder, asked: Expr, ahead: int) -> tuple[Expr, list[Expr]]:
    """Return the force that acted until now, and those that will act in the samples to come."""
    newest_first = [asked]
    for place in range(ahead):
        name = f"in_flight_{place + 1}_n"
        older = builder.state(name)
        builder.follow(name, newest_first[-1])
        newest_first.append(older)
    return newest_first[-1], newest_first[-2::-1]
