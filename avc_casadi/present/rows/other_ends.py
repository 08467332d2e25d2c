"""Rows of a spring and damper to a simulation, a follower or another end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import singledispatch
from typing import Any

from avc_casadi.coupling import Coupling
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.virtual_tool import WIDEST_MARGIN
from avc_casadi.loops.damped_wall import RINGS_BELOW
from avc_casadi.loops.engine import ToolCase
from avc_casadi.loops.follower import BilateralCase
from avc_casadi.loops.loop_family import LeastDampedMode
from avc_casadi.model.corners import Robustness
from avc_casadi.model.ends import End, Follower, Simulation
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import Mark, Part, Parts, Row, Value, caution, commas, count, grade, row
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.reasons import CHANGES
from avc_casadi.recommendation.pair import GAIN_MARGIN
from avc_casadi.recommendation.recommendation import (
    NoPair,
    Pair,
    PairLimits,
    PairRecommendation,
)
from avc_casadi.recommendation.rendered import RenderedPair
from avc_casadi.simulation.population.trial import FollowerTrial, ToolTrial, Trial


def no_pair_rows(recommended: NoPair) -> list[Row]:
    """Return why no coupling to another end is deployable, and what limits one."""
    none = row("Coupling", f"none is deployable: {recommended.reason}", mark=Mark.FAIL)
    # Where K is linearly stable hands refute it: what else is linearly stable with it is no help.
    wanted = recommended.pair.wanted_n_per_m
    refuted = wanted is not None and wanted <= recommended.pair.stiffest.stiffness_n_per_m
    same = [] if refuted else _same_k(recommended.pair, recommended.problem)
    return [none, *same, *_pair_limit(recommended)]


def pair_rows(recommended: PairRecommendation) -> list[Row]:
    """Return the rows of a coupling to another end: its gains, what it renders, stability, trial and limits."""
    problem = recommended.problem
    pair = recommended.pair
    coupling = recommended.coupling
    local = subject.local_damper(recommended.end)
    soft = pair.wanted_n_per_m is None and coupling.gains.stiffness_n_per_m < problem.hands.stiffness_n_per_m[0]
    doubt = grade(not soft and not thin(pair.gain_margin, pair.motor_margins), Mark.CAUTION)
    softer = ": softer than the softest hand" if soft else ""
    return [
        row("Coupling", subject.pair_of(coupling.gains, local), softer, mark=doubt),
        *_scaled(recommended.end, coupling),
        *_damped_in_the_device(recommended.end, coupling),
        *rendered_rows(recommended.rendered),
        *_pair_stability(pair),
        *_two_port(pair),
        _pair_simulated(recommended.trial),
        subject.peak_force(recommended.trial.largest_tap_force_n, problem.device.max_force_n),
        *([row("K is set by", f"hands: {recommended.set_by}")] if recommended.set_by else []),
        *_same_k(pair, problem, rank=1),
        *_pair_limit(recommended),
    ]


@singledispatch
def _damped_in_the_device(end: End, coupling: Coupling) -> list[Row]:  # noqa: ARG001
    """Return what a damper in the device's loop assumes of it."""
    return []


@_damped_in_the_device.register
def _damped_beside_an_engine(end: Simulation, coupling: Coupling) -> list[Row]:
    sample_time_s = coupling.problem.device.sample_time_s
    if not coupling.gains.local_damping_ns_per_m or min(end.step_s) <= sample_time_s:
        return []
    rate = ("its damper runs every", Value(sample_time_s, "time"), ", faster than the engine;")
    remedy = "if your program commands the device once a step, state device.sample_time_s = step_s"
    return [row("Device's loop", rate, remedy)]


@singledispatch
def _scaled(end: End, coupling: Coupling) -> list[Row]:  # noqa: ARG001
    """Return the gains of a coupling in the units of its end, where they differ."""
    return []


@_scaled.register
def _in_scene(end: Simulation, coupling: Coupling) -> list[Row]:
    if coupling.in_scene == coupling.gains:
        return []
    return [row("Scaled", "in the scene", subject.pair_of(coupling.in_scene, subject.local_damper(end)))]


@_scaled.register
def _at_follower(end: Follower, coupling: Coupling) -> list[Row]:
    if coupling.at_follower == coupling.gains:
        return []
    return [row("Scaled", "at the follower", subject.pair_of(coupling.at_follower, subject.local_damper(end)))]


def _two_port(pair: Pair) -> list[Row]:
    """Return whether a coupling of two devices is passive; nothing where that is not known."""
    margin = pair.passivity_margin_ns_per_m
    if margin is None:
        return []
    if margin >= 0:
        return [row("Passivity", "for any operator and environment", mark=Mark.PASS)]
    needed = Value(pair.passive_damping_ns_per_m, "damping")
    return [row("Passivity", "not for every operator: passivity needs", needed, "on each device", mark=Mark.CAUTION)]


def _pair_limit(recommended: NoPair | PairRecommendation) -> list[Row]:
    """Return the stiffest coupling by linear stability, what would help, and what is declared and not used."""
    stiffest = recommended.pair.stiffest
    dampers = "with a damper in the device's loop" if stiffest.local_damping_ns_per_m else "with K and B alone"
    limit: Parts = "no spring K is stable"
    if stiffest.stiffness_n_per_m:
        limit = ("K", Value(stiffest.stiffness_n_per_m, "stiffness"), dampers)
    changes = [
        (CHANGES[change.change], Value(change.stiffest_n_per_m, "stiffness"))
        for change in recommended.sensitivities[:3]
    ]
    return [row("Linear limit", commas([limit, *changes], ";")), *subject.not_used(recommended.not_used)]


def rendered_rows(rendered: RenderedPair) -> list[Row]:
    """Return what the handle meets: on a rigid object, on the stiffest declared contact, and in free motion."""
    points = rendered.points
    if not points:
        return []
    rows, first = [], points[0]
    if rendered.on_stiffest_contact_n_per_m is not None:
        contact = Value(rendered.on_stiffest_contact_n_per_m, "stiffness"), "pressed"
        rows.append(row("Declared contact", contact))
    at_rest = rendered.stiffness_n_per_m
    pressed = None if at_rest is None else (Value(at_rest, "stiffness"), "pressed")
    stiff = [(Value(point.stiffness_n_per_m, "stiffness"), f"at {point.frequency_hz:g} Hz") for point in points]
    rows.append(row("Rigid object", commas([pressed, *stiff])))
    if first.mass_kg is not None:
        mass: Part = "a restoring spring" if first.mass_kg < 0 else Value(first.mass_kg, "mass")
        drag = ", drag", Value(first.drag_ns_per_m, "damping"), f"at {first.frequency_hz:g} Hz; impedance error"
        errors = commas((Value(point.free_error, "share"), f"at {point.frequency_hz:g} Hz") for point in points)
        differs = max(point.free_error or 0.0 for point in points) > 1
        rows.append(row("Free motion", mass, drag, errors, mark=caution(differs)))
    elif first.drag_ns_per_m:
        drag_everywhere = Value(first.drag_ns_per_m, "damping"), "everywhere, from the damper in the device's own loop"
        rows.append(row("Drag", drag_everywhere))
    return rows


def thin(gain_margin: float, motor_margins: Sequence[float]) -> bool:
    """Return whether the gain margins of a pair are too small for a tick."""
    return gain_margin < GAIN_MARGIN or min(motor_margins) < Robustness().gain_margin


def _pair_stability(pair: Pair) -> list[Row]:
    """Return that all loops to an end are stable, with their margins, and the least damped of them."""
    steady = pair.mismatch_stable is not False
    return [
        _stable_loops(
            pair.loops, "" if steady else "; not on devices whose values are 10 % off", grade(steady, Mark.CAUTION)
        ),
        _gain_margins(pair.gain_margin, pair.motor_margins),
        *_least_damped(pair.mode),
    ]


def stability(end: End, certificate: PairCertificate) -> list[Row]:
    """Return whether all loops to an end are stable, with their margins, and the worst or least damped of them."""
    loops = certificate.loops
    rows = [row("Stability", "not all of", count(loops), "loops are stable", mark=Mark.FAIL)]
    if certificate.stable:
        margins = _gain_margins(certificate.gain_margin, certificate.motor_margins)
        rows = [_stable_loops(loops, "", Mark.PASS), margins]
    place, tick = worst_end(end, certificate.worst)
    radius = "; spectral radius", Value(certificate.spectral_radius, "number", 6), tick
    hand = subject.hand(certificate.worst.hand)
    rows.append(row("Worst loop", hand, ";" if place else None, place, radius))
    return rows + ([] if certificate.least_damped is None else _least_damped(certificate.least_damped))


def _stable_loops(loops: int, but: str, mark: Mark) -> Row:
    return row(
        "Stability", "all", count(loops), "loops are linearly stable: extreme hands, released, clamped", but, mark=mark
    )


def _gain_margins(gain_margin: float, motor_margins: Sequence[float]) -> Row:
    """Return the factors, rounded down, by which all gains or the force of one motor may grow."""
    factors = [
        f"{math.floor(100 * margin) / 100:.3g}" if margin < WIDEST_MARGIN else f"{WIDEST_MARGIN:g} or more"
        for margin in (gain_margin, *motor_margins)
    ]
    loops = ("K and B", "the motor alone", "the follower's")
    margins = ", ".join(f"{factor} of {loop}" for factor, loop in zip(factors, loops, strict=False))
    is_thin = thin(gain_margin, motor_margins)
    return row("Gain margin", margins, ": thin" if is_thin else "", mark=caution(is_thin))


def _least_damped(mode: LeastDampedMode) -> list[Row]:
    """Return the row of the least damping ratio of all loops and its frequency; none where nothing swings."""
    if mode.damping_ratio >= 1:
        return []
    ratio = Value(mode.damping_ratio, "number", 2), "at", Value(mode.frequency_hz, "frequency")
    shown = row(subject.DAMPING_RATIO, ratio, "(least damped loop)")
    if mode.damping_ratio >= RINGS_BELOW:
        return [shown]
    decay = Value(mode.time_constant_s, "time")
    return [row(shown.label, shown.values, ": lightly damped, time constant", decay, mark=Mark.CAUTION)]


@singledispatch
def worst_end(end: End, case: Any) -> tuple[Parts, Parts]:  # noqa: ARG001
    """Return an end in the worst loop, and the tick by which its spectral radius counts."""
    return None, "a sample"


@worst_end.register
def _worst_tool(end: Simulation, case: ToolCase) -> tuple[Parts, Parts]:  # noqa: ARG001
    tool = case.tool
    contact = _in_contact(tool.contact_stiffness_n_per_m)
    place: Parts = "fixed place" if math.isinf(tool.mass_kg) else ("tool of", Value(tool.mass_kg, "mass"), ",", contact)
    return place, ("a step of", Value(case.step_s, "time"))


@worst_end.register
def _worst_follower(end: Follower, case: BilateralCase) -> tuple[Parts, Parts]:  # noqa: ARG001
    mass = Value(case.follower["mass_kg"], "mass")
    place = "follower of", mass, ",", _in_contact(case.environment_n_per_m)
    return place, "a sample, at the worst phase of the clocks"


def _in_contact(stiffness_n_per_m: float) -> Parts:
    """Return what a body touches: nothing, a spring, or where the stiffness is infinite a rigid object."""
    if math.isinf(stiffness_n_per_m):
        return "held rigidly"
    return ("on", Value(stiffness_n_per_m, "stiffness")) if stiffness_n_per_m else "free"


@singledispatch
def _pair_simulated(trial: Trial) -> Row:
    """Return how many simulated hands settle with a coupling to another end."""
    return row("Simulated", _settled(trial), mark=grade(trial.all_settle))


@_pair_simulated.register
def _tool_simulated(trial: ToolTrial) -> Row:
    """Return how many hands settle, also without friction and where the engine misses steps; all of them pass."""
    without_friction = int(trial.stable_without_friction.sum())
    with_missed_steps = int(trial.stable_with_dropped_steps.sum())
    fewest = min(trial.settled, without_friction, with_missed_steps)
    smooth = ",", count(without_friction), "without friction"
    missed = ",", count(with_missed_steps), "with", Value(trial.dropped_share, "share"), "of the steps missed"
    return row("Simulated", _settled(trial), smooth, missed, mark=grade(fewest == trial.hands, Mark.CAUTION))


@_pair_simulated.register
def _follower_simulated(trial: FollowerTrial) -> Row:
    link = ";", Value(trial.jitter, "share"), "of jitter,", Value(trial.lost_share, "share"), "lost"
    return row("Simulated", _settled(trial), link, mark=grade(trial.all_settle))


def _settled(trial: Trial) -> tuple[Part, ...]:
    return count(trial.settled), "of", count(trial.hands), f"hands settle ({', '.join(trial.by_motion)})"


def _same_k(pair: PairLimits, problem: Problem, rank: int = 0) -> list[Row]:
    """Return lightest tool, slowest step and exchanges with which the same K is linearly stable, each with its B."""
    limits: dict[str, Parts] = {
        "least_tool_mass_kg": ("a tool from", Value(pair.least_tool_mass_kg, "mass")),
        "slowest_step_s": ("a step up to", Value(pair.slowest_step_s, "time")),
    }
    conditions: list[Parts] = []
    exchanges = [name for name in pair.same_k if name not in limits]
    for name in (*(limit for limit in limits if limit in pair.same_k), *exchanges):
        gains = pair.same_k[name]
        local = ("and", Value(gains.local_damping_ns_per_m, "damping"), "of the device")
        with_b = "with B", Value(gains.damping_ns_per_m, "damping"), local if gains.local_damping_ns_per_m else None
        conditions.append((limits.get(name, f"exchange {name}"), with_b))
    if pair.exchanges and not any(pair.exchanges.values()):
        conditions.append("no exchange")
    margin = f"; linear stability only, gain margin {problem.robustness.gain_margin:g}"
    return [row("Same K", commas(conditions), margin, rank=rank)] if conditions else []
