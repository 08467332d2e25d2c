"""Observers: the position between two encoder steps and ahead of a delay; with a dead zone and state feedback."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from avc_casadi.model.runtime import StateFeedback
from avc_casadi.simulation.tick import Expr, Step, StepBuilder, ca, delay_line


@dataclass(frozen=True)
class ObserverSettings:
    """Assumed model and gains of the observer."""

    resolution_m: float
    mass_kg: float
    ahead: float = 0.0
    velocity_gain: float = 0.1
    load_gain: float = 0.0025


def observer_step(sample_time_s: float, settings: ObserverSettings) -> Step:
    """Return the observer's step: predict from commands and an unknown load, correct beyond the resolution."""
    builder = StepBuilder()
    measured, asked = builder.input("position_m"), builder.input("force_n")
    started, position = builder.state("started"), builder.state("position_m")
    # Velocity and acceleration in metres per sample (squared), so that all states are of one magnitude.
    velocity, load = builder.state("step_m"), builder.state("load_step_m")
    push = sample_time_s * sample_time_s / settings.mass_kg
    whole = int(settings.ahead)
    late = settings.ahead - whole
    line = delay_line(builder, "in_flight", asked, whole + (late > 0))

    def moved(place: Expr, speed: Expr, gain: Expr, acting: list[tuple[float, Expr]]) -> tuple[Expr, Expr]:
        """Return the motion under an unknown load and forces, each for a share of a sample."""
        for share, force in acting:
            gained = gain - push * force
            place += share * speed + 0.5 * share * share * gained
            speed += share * gained
        return place, speed

    # A fractional delay lets the previous force act for that share of the sample.
    acted = [(1.0, line[whole])] if late == 0 else [(late, line[whole + 1]), (1 - late, line[whole])]
    coming = [(1.0, force) for force in line[:whole][::-1]]
    if late > 0:
        coming.insert(0, (late, line[whole]))
    predicted, faster = moved(position, velocity, load, acted)
    half = 0.5 * settings.resolution_m
    error = measured - predicted
    excess = error - ca.fmin(ca.fmax(error, -half), half)
    now = ca.if_else(started, predicted + excess, measured)
    speed = ca.if_else(started, faster + settings.velocity_gain * excess, 0)
    unknown = ca.if_else(started, load + settings.load_gain * excess, 0)
    builder.follow("started", 1)
    builder.follow("position_m", now)
    builder.follow("step_m", speed)
    builder.follow("load_step_m", unknown)
    return builder.build("observer", position_m=moved(now, speed, unknown, coming)[0])


def state_feedback_step(settings: StateFeedback) -> Step:
    """Return the step of observer and state feedback, its matrices as parameters: one serves all of one size."""
    return _step_of(settings.states, tuple(settings.positions), settings.measures)


@lru_cache(maxsize=64)
def _step_of(n: int, positions: tuple[int, ...], measures: int) -> Step:
    """Return one step of an observer of n states with a dead zone: s = A s + B F + L innovation, and its position.

    What the dead zone leaves of the innovation corrects the state.
    """
    builder = StepBuilder()
    measured, asked = builder.input("position_m"), builder.input("force_n")
    started = builder.state("started")
    before = [builder.state(f"s{place + 1}_m") for place in range(n)]
    a = [[builder.parameter(f"a{row + 1}_{column + 1}") for column in range(n)] for row in range(n)]
    b, gain, weight = ([builder.parameter(f"{name}{row + 1}") for row in range(n)] for name in "blr")
    half, face = builder.parameter("dead_zone_m"), builder.parameter("face_m")
    closed = _closed_share(builder, measured, started)
    seen = measured + closed * face
    predicted = [
        ca.if_else(
            started,
            b[row] * asked + sum((a[row][column] * before[column] for column in range(n)), ca.SX(0)),
            seen if row in positions else 0,
        )
        for row in range(n)
    ]
    error = seen - predicted[measures]
    error = error - closed * ca.fmin(ca.fmax(error, -half), half)
    corrected = [value + gain[row] * error for row, value in enumerate(predicted)]
    builder.follow("started", 1)
    for row, value in enumerate(corrected):
        builder.follow(f"s{row + 1}_m", value)
    return builder.build(
        "state_feedback", position_m=sum((weight[row] * value for row, value in enumerate(corrected)), ca.SX(0))
    )


def _closed_share(builder: StepBuilder, measured: Expr, started: Expr) -> Expr:
    """Return how far the dead zone is closed, 1 at rest and 0 in motion (`StateFeedback`).

    A lag keeps out what encoder steps alone sustain, which is faster than a hand. Only distances are remembered: they
    fade to 0, where a position of single precision would stop some hundred of its last digits short.
    """
    names = ("opens_m", "open_m", "opening_per_m", "kept", "smoothing")
    opens, most, opening, kept, smoothing = (builder.parameter(name) for name in names)
    before, lag, above, below = (builder.state(name) for name in ("measured_m", "lag_m", "above_m", "below_m"))
    moved = ca.if_else(started, measured - before, 0)
    lagging = smoothing * (lag + moved)
    smoothly = lag + moved - lagging
    higher = ca.fmin(ca.fmax(kept * (above - smoothly), 0), most)
    lower = ca.fmin(ca.fmax(kept * (below + smoothly), 0), most)
    for name, value in {"measured_m": measured, "lag_m": lagging, "above_m": higher, "below_m": lower}.items():
        builder.follow(name, value)
    return 1 - ca.fmin(ca.fmax((higher + lower - opens) * opening, 0), 1)
