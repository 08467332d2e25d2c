"""Rows of a coupling to a wall: whether it is deployable, what it renders, its margins, who settles with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from avc_casadi.loops.damped_wall import RINGS_BELOW
from avc_casadi.model.perturbed import PERTURBED_SHARE
from avc_casadi.model.problem import Impedance, Problem
from avc_casadi.present import words
from avc_casadi.present.row import Mark, Part, Parts, Row, Value, caution, commas, count, grade, row, span
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.reasons import CHANGES
from avc_casadi.recommendation.assumptions import Slip
from avc_casadi.recommendation.damped_wall import DampedWall
from avc_casadi.recommendation.evaluator import UnmodelledTrial
from avc_casadi.recommendation.rank import UNNOTICED
from avc_casadi.recommendation.recommendation import (
    Decision,
    NoWallCoupling,
    Recommendation,
    WallRecommendation,
)
from avc_casadi.recommendation.rendered import NOTICED_LATE_S, NOTICED_N, REACHED_M
from avc_casadi.recommendation.rendered_wall import RenderedWall
from avc_casadi.recommendation.sensitivity import Trade
from avc_casadi.simulation.population.trial import CouplingTrial, HandCounts

# Stiffness at rest over that of the wall that is worth a mark.
_STIFFER = 1.1
_CYCLES = {
    "proved": "proved to settle from any state, making and breaking contact",
    "refuted": "a limit cycle without friction exists",
    "open": "freedom from limit cycles is open",
    "simulated": "freedom from limit cycles is simulated, not proved",
}
_NEAR_RESONANCE = 1.3
"""Ratio of frequencies within which a mode of a loop counts as the resonance of the device, which a hand shifts."""
_HARDLY = 0.1
"""Share of a wall below which hardly anything of it is rendered."""
_SLOW_HZ = 1.0
"""Slow motion of a hand."""
_MOVING_HZ = (_SLOW_HZ, 10.0)
"""Motion of a hand: slow, and as fast as it goes."""
_NEAR_FACE_M = 5e-4
"""Distance of the onset of force from the wall's face, at the handle, that a hand does not notice."""
_THROWS = 1.02
"""Exit speed over approach speed from which a wall throws the released device."""
_NOTICED_REST_ERROR_M = 1e-3
"""Distance at the handle from where it would rest that is worth a mark."""


def no_wall_rows(recommended: NoWallCoupling) -> list[Row]:
    """Return why no coupling to the wall is deployable, and what limits one."""
    none = row("Coupling", f"none is deployable: {recommended.reason}", mark=Mark.FAIL)
    return [*slips(recommended), none, *_wall_limit(recommended)]


def wall_rows(recommended: WallRecommendation) -> list[Row]:
    """Return the rows of a coupling to a wall; of one that is not deployable what it renders and who settles."""
    stiffest = _stiffest_wall(recommended)
    first = [
        *slips(recommended),
        *stiffest,
        _coupling(recommended),
        *_rendered(recommended),
        _stability(recommended),
    ]
    if not recommended.deployable:
        return [*first, *_simulated(recommended)]
    problem = recommended.problem
    trial = recommended.trial
    rendered = recommended.rendered
    return [
        *first,
        *_margins(recommended),
        *_trade_off(recommended.trade_off),
        *_simulated(recommended),
        *_unmodelled(recommended.unmodelled_effects),
        subject.peak_force(
            trial.largest_tap_force_n, problem.device.max_force_n, trial.saturated_presses, trial.deepest_tap_m
        ),
        *contact_rows(rendered, problem),
        *subject.notes(words.used_by_solve(recommended.not_used), "Not used", Mark.NONE),
        *([] if stiffest else _wall_limit(recommended)),
    ]


def _stability(recommended: WallRecommendation) -> Row:
    """Return whether the coupling is linearly stable, and whether it settles; or the first claim that fails."""
    failed = recommended.claims.failed
    if failed:
        return row("Stability", failed[0].sentence, mark=Mark.FAIL)
    rest = recommended.rest.word
    text = f"linearly stable with every hand of the range (by search) and released; {_CYCLES[rest]}"
    return row("Stability", text, mark=grade(rest != "refuted", Mark.CAUTION))


def _stiffest_wall(recommended: WallRecommendation) -> list[Row]:
    """Return the stiffest wall that a moving hand gets, with its limit; none where it was not looked for."""
    stiffest_n_per_m = recommended.stiffest_wall_n_per_m
    if not stiffest_n_per_m:
        return []
    within = f", impedance error of a moving hand at most {100 * UNNOTICED:.0f} %; {recommended.no_stiffer}"
    return [row("Stiffest wall", Value(stiffest_n_per_m, "stiffness"), within), *_wall_limit(recommended)]


def _margins(recommended: WallRecommendation) -> list[Row]:
    """Return stability margins, settling time, and damping ratio, each of the worst loop."""
    margins, transients = recommended.margins, recommended.transients
    settling: list[tuple[float, words.Who]] = [
        (transients.released.settling_s, "released"),
        (transients.worst_hand.settling_s, "worst_hand"),
    ]
    slowest_s, slowest = max(settling)
    return [
        subject.margins({"released": margins.released, "worst_hand": margins.worst_hand}),
        subject.settling(None if math.isinf(slowest_s) else slowest_s, slowest),
        _damping_ratio(recommended),
    ]


def _damping_ratio(recommended: WallRecommendation) -> Row:
    """Return the damping ratio of the least damped loop; where it rings, with what a damper of the wall changes."""
    problem, transients = recommended.problem, recommended.transients
    which_loop: words.Who = "worst_hand"
    worst = transients.worst_hand
    if transients.released.damping_ratio < worst.damping_ratio:
        which_loop = "released"
        worst = transients.released
    shown = subject.damping_ratio(worst.damping_ratio, worst.frequency_hz, which_loop, problem.device.sample_time_s)
    if worst.damping_ratio >= RINGS_BELOW:
        return shown
    remedy: Parts = "none of the tried wall dampers helps"
    if recommended.damped_wall is not None:
        remedy = _with_damper(recommended.damped_wall, problem.environment)
    elif _of_structure(problem, worst.frequency_hz):
        remedy = "this swing is the device's own resonance, which no wall damps"
    return row(shown.label, shown.values, ": lightly damped;", remedy, mark=Mark.CAUTION)


def _with_damper(damped: DampedWall, declared: Impedance) -> tuple[Parts, ...]:
    """Return what a damper of the wall, or a softer wall with one, leads to."""
    damper = Value(damped.damping_ns_per_m, "damping")
    wall: Parts = ("with a wall damper of", damper)
    if damped.stiffness_n_per_m != declared.stiffness_n_per_m:
        wall = ("with a wall of", Value(damped.stiffness_n_per_m, "stiffness"), ",", damper)
    reached = (":", Value(damped.damping_ratio, "number", 2), ", settles in", Value(damped.settling_s, "time"))
    slow, brisk = Value(damped.error_at_1_hz_share, "share"), Value(damped.error_at_10_hz_share, "share")
    return wall, reached, (", error", slow, "at 1 Hz,", brisk, "at 10 Hz")


def _of_structure(problem: Problem, frequency_hz: float) -> bool:
    """Whether a frequency is that of a declared resonance that is itself damped less than a wall may be."""
    resonance = problem.device.resonance
    if resonance is None or resonance.damping_ratio >= RINGS_BELOW:
        return False
    return resonance.frequency_hz / _NEAR_RESONANCE < frequency_hz < resonance.frequency_hz * _NEAR_RESONANCE


def _trade_off(trades: Sequence[Trade]) -> list[Row]:
    """Return what a disk margin costs in accuracy and ripple."""
    points = []
    for trade in trades:
        margin = "disk margin", Value(trade.disk_margin, "number", 2), ": error"
        errors = commas(Value(share, "share") for share in trade.error)
        ripple = ", ripple", Value(trade.ripple_n, "force")
        points.append((margin, errors, ripple, "" if trade.met else "(contact or decay not met)"))
    return [row("At 1, 10, 30 Hz", commas(points, ";"))] if points else []


def is_noticed(rendered: RenderedWall) -> bool:
    """Whether a hand that moves notices that it is not the wall."""
    return any(rendered.impedance_error.get(hz, 0.0) > UNNOTICED for hz in _MOVING_HZ)


def slips(recommended: Recommendation) -> list[Row]:
    """Return the values of the device that may be slips."""
    doubts = [assumption.text for assumption in recommended.assumed if isinstance(assumption, Slip)]
    return [row("Values", "; ".join(doubts), mark=Mark.CAUTION)] if doubts else []


def _coupling(recommended: WallRecommendation) -> Row:
    """Return the row of the recommended coupling: observer, gains with their spans, rows of its table."""
    problem, coupling = recommended.problem, recommended.coupling
    law, observer_mass_kg = coupling.runtime.state_feedback, coupling.runtime.observer_mass_kg
    damping, stiffness, contact_damping = coupling.table.gains.tolist()
    parts = commas(
        [
            None if law is None else f"observer ({len(law.innovation)} states) with state feedback",
            subject.gain_spans(damping, stiffness, contact_damping, problem),
            None if observer_mass_kg is None else ("observer of assumed", Value(observer_mass_kg, "mass")),
            None if len(coupling.table) == 1 else f"{len(coupling.table)} rows",
        ]
    )
    if not recommended.deployable:
        in_another_row = recommended.decision is Decision.NOTHING_RENDERED or recommended.claims.failed
        reason = "" if in_another_row else f": {recommended.reason}"
        return row("Coupling", parts, ": NOT deployable", reason, mark=Mark.FAIL)
    names = ", ".join(unused.key for unused in recommended.not_used if not unused.asked_of_solve)
    without = f", ignoring {names}, which the file declares" if names else ""
    doubt = _doubt(recommended)
    margins = recommended.margins
    low = subject.thin(min(margins.released.disk, margins.worst_hand.disk))
    mark = Mark.CAUTION if doubt or without or low else Mark.PASS
    return row("Coupling", parts, ": deployable", without, doubt, low, mark=mark)


def _doubt(recommended: WallRecommendation) -> tuple[Part, ...]:
    """Return why a deployable coupling hardly renders its wall: pushed through, or too soft in motion."""
    trial, rendered = recommended.trial, recommended.rendered
    limit_n = recommended.problem.device.max_force_n
    if trial.saturated_presses > trial.hands / 2:
        pushed = ", but", count(trial.saturated_presses), "of", count(trial.hands), "hands push through the wall (limit"
        return *pushed, Value(limit_n, "force"), ")"
    wall = recommended.problem.environment.stiffness_n_per_m
    if wall > 0:
        moving = rendered.stiffness_in_motion_n_per_m.get(_SLOW_HZ, wall)
        if min(rendered.share_of_wall or 1.0, moving / wall) < _HARDLY:
            return (", but a moving hand feels hardly anything of the wall",)
    return ()


def _rendered(recommended: WallRecommendation) -> list[Row]:
    """Return the rows of what a coupling renders of the wall: stiffness or damper, share, error by frequency."""
    rendered, wall = recommended.rendered, recommended.problem.environment
    errors = commas((Value(error, "share"), f"at {hz:g} Hz") for hz, error in rendered.impedance_error.items())
    if wall.stiffness_n_per_m == 0:
        damping = _in_motion(rendered.damping_in_motion_ns_per_m)
        differs = any(abs(value / wall.damping_ns_per_m - 1) > UNNOTICED for value in damping.values())
        dampers = commas((Value(value, "damping"), f"at {hz:g} Hz") for hz, value in damping.items())
        error = row("Impedance error", errors, "over the whole cycle, because a wall never pulls")
        return [row("Rendered", "damper of", dampers, mark=caution(differs)), error]
    if recommended.decision is Decision.NOTHING_RENDERED:
        return [row("Rendered", recommended.reason, mark=Mark.FAIL)]
    share = rendered.share_of_wall
    if share is None:
        return [row("Rendered", "nothing: every press reaches the force limit", mark=Mark.FAIL)]
    largest_error = max(_in_motion(rendered.impedance_error).values(), default=0.0)
    sine = ", for a sine of", Value(rendered.sine.amplitude_m, "length")
    return [
        _stiffness_row(rendered, wall, share, recommended.trial),
        row("Impedance error", errors, sine, mark=caution(largest_error > max(UNNOTICED, 1 - share))),
    ]


def _stiffness_row(rendered: RenderedWall, wall: Impedance, share: float, trial: CouplingTrial) -> Row:
    """Return the stiffness at rest and in motion: a caution where it is above that of the wall."""
    sensed, handle = rendered.stiffness_n_per_m or 0.0, rendered.stiffness_at_handle_n_per_m or 0.0
    motion = _in_motion(rendered.stiffness_in_motion_n_per_m)
    physical = {hz: abs(wall.stiffness_n_per_m + 2j * math.pi * hz * wall.damping_ns_per_m) for hz in motion}
    stiffer = any(value > (1 + UNNOTICED) * physical[hz] for hz, value in motion.items())
    low, high = trial.nine_in_ten_n_per_m
    spread = low < 0.9 * sensed or high > 1.1 * sensed
    stiffnesses = [
        (Value(handle, "stiffness"), "static (", Value(share * handle / sensed, "share"), "of the wall)"),
        *((Value(value, "stiffness"), f"at {hz:g} Hz") for hz, value in motion.items()),
        None if handle == sensed else (Value(sensed, "stiffness"), "at the sensor"),
        (span((low, high), "stiffness"), "over 90 % of hands") if spread else None,
        "in motion stiffer than the wall and its damper" if stiffer else None,
    ]
    return row("Rendered", commas(stiffnesses), mark=caution(stiffer or share > _STIFFER))


def _in_motion(by_frequency: Mapping[float, float]) -> dict[float, float]:
    """Return the values at frequencies up to those of a hand's motion."""
    return {hz: value for hz, value in by_frequency.items() if hz <= max(_MOVING_HZ)}


def _settle(counts: HandCounts) -> tuple[Part, ...]:
    """Return how many hands settle, and how many of them without friction."""
    settle = count(counts.at_rest), "of", count(counts.hands), "hands settle,"
    return *settle, count(counts.at_rest_without_friction), "without friction"


def _simulated(recommended: WallRecommendation) -> list[Row]:
    """Return how many simulated hands settle: on the device, and on perturbed ones."""
    counts, perturbed = recommended.simulated, recommended.perturbed_devices
    quiet = ";", count(counts.quiet), "below the vibrotactile threshold"
    rows = [row("Simulated", _settle(counts), quiet, mark=subject.settled(counts, doubt=counts.many_vibrate))]
    if perturbed is not None:
        counts, unstable = perturbed.trial.counts(), perturbed.unstable
        devices = (
            "on",
            count(perturbed.trial.devices),
            "devices with values changed by",
            Value(PERTURBED_SHARE, "share"),
        )
        mark = subject.settled(counts, doubt=bool(unstable))
        doubt = ("; linearly unstable on", count(unstable)) if unstable else None
        rows.append(row("Perturbed devices", _settle(counts), devices, doubt, mark=mark))
    return rows


def _unmodelled(trials: Sequence[UnmodelledTrial]) -> list[Row]:
    """Return how many hands settle with each unmodelled effect, and how many of those that hold the device."""
    rows = []
    for label, held in (("Unmodelled", False), ("Other grip", True)):
        shown = [trial for trial in trials if (trial.key == "held") is held]
        if shown:
            of_hands: list[Parts] = [("of", count(shown[0].hands), "hands settle"), *[None] * len(shown[1:])]
            settles = [
                (count(trial.at_rest_as_required), of_all, "with", _effect(trial))
                for trial, of_all in zip(shown, of_hands, strict=True)
            ]
            # A requirement is met, if not without dry friction, then with it where that may be counted on.
            all_settle = all(
                trial.at_rest_as_required == trial.at_rest_without_friction == trial.hands for trial in shown
            )
            rows.append(row(label, commas(settles), mark=grade(all_settle, Mark.CAUTION)))
    return rows


def _effect(trial: UnmodelledTrial) -> Parts:
    """Return an unmodelled effect, or the grip of hands outside the design set."""
    if isinstance(trial.value, str):
        return "one fingertip" if trial.value == "fingertip" else f"hands on a {trial.value}"
    return Value(trial.value, "share"), "less mass" if trial.key == "mass_share" else "of samples lost"


def contact_rows(rendered: RenderedWall, problem: Problem) -> list[Row]:
    """Return encoder steps, contact onset and leaving, rebound and dry friction where a hand may notice them."""
    size = problem.device.metres_per_unit
    rows = [*_quantisation(rendered, size), *_contact_onset(rendered, size)]
    leaving, creep = rendered.leaving, rendered.creep
    if leaving is not None:
        late = leaving.lasting_s > NOTICED_LATE_S
        pushes: Parts = "no noticeable force outside the wall"
        if leaving.lasting_s > 0:
            force, lasting = Value(leaving.force_n, "force"), Value(leaving.lasting_s, "time")
            pushes = "up to", force, "for", lasting, "outside the wall, until", Value(leaving.outside_m, "length")
        withdraws = "when a hand withdraws in", Value(leaving.withdrawn_s, "time")
        rows.append(row("Leaving contact", pushes, withdraws, mark=caution(late), rank=0 if late else 1))
    if creep is not None and creep.play_n > rendered.noticed_n:
        known = math.isfinite(creep.speed_m_per_s)
        hand = ("a hand slower than", Value(creep.speed_m_per_s, "speed")) if known else "a hand"
        play = Value(creep.play_m, "length"), "(", Value(creep.play_n, "force"), ")"
        rows.append(row("Slow press", hand, "feels a change of force only after", play))
    fast = {speed: share for speed, share in rendered.rebound.items() if share > _THROWS}
    if fast:
        exits = commas((Value(share, "number"), "times", Value(speed, "speed")) for speed, share in fast.items())
        rows.append(row("Rebound", "the released device leaves the wall at", exits, mark=Mark.CAUTION))
    rest_error_m = rendered.rest_error_m
    if rest_error_m is not None and rest_error_m > _NOTICED_REST_ERROR_M / size:
        far = "may stop the handle up to", Value(rest_error_m, "length"), "from its place of rest"
        rows.append(row("Dry friction", far, mark=Mark.CAUTION))
    return rows


def _quantisation(rendered: RenderedWall, metres_per_unit: float) -> list[Row]:
    """Return the force by which the coupling answers an encoder step, where hands may notice it."""
    ripple, step = rendered.ripple, rendered.encoder_step
    if not (ripple.many_vibrate or step.total_n > NOTICED_N * metres_per_unit):
        return []
    damper = ("and", Value(step.damper_n, "force"), "by the damper") if step.damper_n else None
    steps = Value(step.spring_n, "force"), "by the spring", damper, "per encoder step;"
    slow = "ripple", Value(ripple.in_slow_motion_n, "force"), "in slow motion,"
    quiet = count(ripple.quiet), "of", count(ripple.hands), "hands do not feel this ripple"
    return [row("Quantisation", steps, slow, quiet, mark=caution(ripple.many_vibrate))]


def _contact_onset(rendered: RenderedWall, metres_per_unit: float) -> list[Row]:
    """Return where the force begins, at the speed at which that is the farthest from the wall's face, if it is far."""
    near_m = _NEAR_FACE_M / metres_per_unit
    stiffness = rendered.stiffness_n_per_m
    give_m = rendered.noticed_n / stiffness if stiffness else 0.0
    onset_m = rendered.onset_m
    if all(depth is not None and -near_m < depth < near_m + give_m for depth in onset_m.values()):
        return []

    def distance(speed: float) -> float:
        depth = onset_m[speed]
        return math.inf if depth is None else abs(depth)

    speed = max(onset_m, key=distance)
    depth_m = onset_m[speed]
    if depth_m is None:
        begins: Parts = "no force up to", Value(REACHED_M / metres_per_unit, "length"), "inside the wall"
    else:
        side = "before the wall's face" if depth_m < 0 else "inside the wall"
        begins = "force from", Value(abs(depth_m), "length"), side
    return [row("Contact onset", begins, "at", Value(speed, "speed"), mark=Mark.CAUTION)]


def _wall_limit(recommended: NoWallCoupling | WallRecommendation) -> list[Row]:
    """Return the stiffest wall of a plain coupling by linear stability, and what would help most."""
    changes = [
        (CHANGES[change.change], Value(change.stiffest_n_per_m, "stiffness"))
        for change in recommended.sensitivities[:3]
    ]
    limit = Value(recommended.limits.plain_wall_n_per_m, "stiffness"), "with a spring and damper alone"
    return [row("Linear limit", commas([limit, *changes], ";"))] if changes else []
