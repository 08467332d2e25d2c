"""The position between two encoder steps: an observer that knows the force it commands."""

from __future__ import annotations

from dataclasses import dataclass

from avc_casadi.runtime._step import Step, StepBuilder


@dataclass(frozen=True)
class ObserverSettings:
    """What the observer knows.

    Attributes:
        resolution_m: length of an encoder step.
        mass_kg: mass of device and hand together, about.
        velocity_gain: share of a position error per sample that corrects the velocity.
        load_gain: share of a position error per sample squared, times the mass, that corrects the unknown force.
    """

    resolution_m: float
    mass_kg: float
    velocity_gain: float = 0.1
    load_gain: float = 0.0025


def observer_step(sample_time_s: float, settings: ObserverSettings) -> Step:
    """Predict the motion from the held force and an unknown load; correct it only by what the encoder contradicts.

    An encoder says that the position lies within half a step of its count. Inside, the prediction stands, so that the
    force does not jump by stiffness times step; outside, position, velocity and load are corrected by the excess.

    Args:
        sample_time_s: T.
        settings: what is known.

    Returns:
        position_m (in whole steps), held_force_n (positive against +x) -> position_m, velocity_m_per_s.
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    measured, held = builder.input("position_m"), builder.input("held_force_n")
    started, position = builder.state("started"), builder.state("position_m")
    # Velocity and acceleration in metres a sample, so that all states are of one size.
    velocity, load = builder.state("step_m"), builder.state("load_step_m")
    push = sample_time_s * sample_time_s / settings.mass_kg
    gained = load - push * held
    predicted = position + velocity + 0.5 * gained
    half = 0.5 * settings.resolution_m
    error = measured - predicted
    excess = error - ca.fmin(ca.fmax(error, -half), half)
    now = ca.if_else(started, predicted + excess, measured)
    speed = ca.if_else(started, velocity + gained + settings.velocity_gain * excess, 0)
    builder.follow("started", 1)
    builder.follow("position_m", now)
    builder.follow("step_m", speed)
    builder.follow("load_step_m", ca.if_else(started, load + settings.load_gain * excess, 0))
    builder.output("position_m", now)
    builder.output("velocity_m_per_s", speed / sample_time_s)
    return builder.done("observer")
