"""Level L5: linear stability with the worst hand found in the ranges, without friction, at every corner of the device.

A search, not a proof: corners, draws and ascent; where the device has ranges, inside these too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.levels import LevelResult, Rows, Subject, level_result, refusal
from avc_casadi.claims.worst_frequency import worst_margin
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.system import Ranges, ascend, hand_boxes, worst_case
from avc_casadi.loops.wall import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    SampledLoop,
    closed,
    frozen_law,
    law_at_rest,
    linear_stability,
    plants_of,
)
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_corners, hand_ranges, hand_set, hand_text, no_hand
from avc_casadi.model.law import Law, Values
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.problem import Hands, Problem


@dataclass(frozen=True)
class WorstHands:
    """The worst hand of a search for each of n rows, and the radius with all hands that it began with, (n, h)."""

    radius: FloatArray
    frequency_hz: FloatArray
    hands: Hand
    initial_radius: FloatArray


def worst_hands(
    device: Device,
    law: Law,
    hands: Hands,
    *,
    draws: int = 24,
    seed: int = 0,
    enough: float = np.inf,
    progress: Progress = SILENT,
) -> WorstHands:
    """Search the ranges for the hand with which each frozen row has the largest spectral radius."""
    # A constant coupling repeats one row.
    (count,) = law.shape
    numbers = (law.a, law.b, law.c, law.d)
    rows = np.concatenate([part.reshape(count, part.shape[1] * part.shape[2]) for part in numbers], axis=1)
    _, distinct, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    same, law = same.ravel(), law.pick(distinct)
    first = hand_set(hands, draws=draws, seed=seed)
    initial = linear_stability(device, law, first, progress)
    low, width = hand_ranges(hands)[:, :1], np.ptp(hand_ranges(hands), axis=1)[:, None]
    at = np.array([np.broadcast_to(value, (len(first),)) for value in vars(first).values()])
    # The released device lies outside the ranges and is no initial guess.
    inside = ((at >= low) & (at <= hand_ranges(hands)[:, 1:])).all(axis=0)
    shares = (at - low) / np.where(width > 0, width, 1.0)
    order = _worst_apart(np.where(inside, initial.radius, -np.inf), shares)
    best = np.arange(len(distinct)), initial.radius.argmax(axis=1)
    radius, frequency, place = initial.radius[best], initial.frequency_hz[best], at[:, best[1]]

    def leading(rows: IndexArray, shares: FloatArray) -> ComplexArray:
        body = Body.of(plants_of([device], Hand(*(low + width * shares)))).flat()
        return closed(body, law.pick(rows)).leading

    going = np.flatnonzero(np.isfinite(radius) & (radius < enough) & width.any())
    starts = order.shape[1]
    at_once = max(1, 2_000_000 // (9 * starts * (4 + math.ceil(device.delay_samples)) ** 2))
    for begin in range(0, len(going), at_once):
        rows = going[begin : begin + at_once]
        begins = np.clip(shares[:, order[rows].ravel()], 0.0, 1.0)
        ends, values = ascend(leading, np.repeat(rows, starts), begins)
        winner = np.abs(values).reshape(-1, starts).argmax(axis=1) + np.arange(len(rows)) * starts
        better = np.abs(values[winner]) > radius[rows]
        rows, winner = rows[better], winner[better]
        radius[rows], place[:, rows] = np.abs(values[winner]), low + width * ends[:, winner]
        frequency[rows] = np.abs(np.angle(values[winner])) / (2 * math.pi * device.sample_time_s)
    return WorstHands(radius[same], frequency[same], Hand(*place[:, same]), initial.radius[same])


def _worst_apart(radius: FloatArray, places: FloatArray) -> IndexArray:
    """Return the four worst hands of each row that lie apart, worst first; places (3, h) as shares of the box."""
    distance = np.abs(places[:, :, None] - places[:, None, :]).max(axis=0)
    left = radius.copy()
    chosen = []
    for _ in range(min(4, radius.shape[1])):
        worst = left.argmax(axis=1)
        chosen.append(worst)
        left = np.where(distance[worst] < 0.6, -np.inf, left)
    return np.stack(chosen, axis=1)


@dataclass(frozen=True)
class WorstLoops:
    """The worst loop of all evaluated hands and devices, for each of n rows."""

    stable: BoolArray
    radius: FloatArray
    frequency_hz: FloatArray
    hands: Hand
    devices: list[Device]


def every_hand(
    problem: Problem,
    law: Law,
    *,
    draws: int = 24,
    seed: int = 0,
    progress: Progress = SILENT,
) -> WorstLoops:
    """Search for the worst hand of each row at each corner of the device, and inside its ranges."""
    device, people = problem.device, problem.hands
    corners = device_corners(device, LINEAR_KEYS)
    (count,) = law.shape
    stable = np.ones(count, dtype=bool)
    found = []
    for corner in corners:
        one = worst_hands(corner, law, people, draws=draws, seed=seed, enough=1.0, progress=progress)
        stable &= np.maximum(one.initial_radius.max(axis=1), one.radius) < 1 - RADIUS_TOLERANCE
        found.append(one)
    each, rows = np.array([one.radius for one in found]), np.arange(count)
    where = each.argmax(axis=0)
    radius, frequency = each[where, rows], np.array([one.frequency_hz for one in found])[where, rows]
    places = np.array([list(vars(one.hands).values()) for one in found])[where, :, rows].T
    devices = [corners[place] for place in where]
    if radius.size and radius.max() >= 1.0:
        row = slice(int(radius.argmax()), int(radius.argmax()) + 1)
        last = worst_hands(devices[row][0], law.pick(row), people, draws=draws, seed=seed)
        radius[row], frequency[row] = last.radius, last.frequency_hz
        places[:, row] = np.array(list(vars(last.hands).values()))
    inside = bool(device_ranges(device, LINEAR_KEYS)) and device.mass_kg + people.mass_kg[1] > 0
    order = np.argsort(-radius, kind="stable")
    # Of the rows that corners do not refute the worst are searched inside the ranges of the device.
    for row in order[radius[order] < 1.0][:4].tolist() if inside else ():
        single = law.pick(row)

        def leading(plant: SampledPlant, _: object, single: Law = single) -> ComplexArray:
            return closed(Body.of(plant).flat(), single).leading

        value, hand, worst, _ = worst_case(device, hand_boxes(problem)[0], leading)
        if abs(value) > radius[row]:
            radius[row], frequency[row] = abs(value), abs(np.angle(value)) / (2 * np.pi * worst.sample_time_s)
            places[:, row], devices[row] = list(hand.values()), worst
            stable[row] &= abs(value) < 1 - RADIUS_TOLERANCE
    return WorstLoops(stable, radius, frequency, Hand(*places), devices)


def released(problem: Problem, law: Law, progress: Progress = SILENT) -> WorstLoops:
    """Search for the worst released device of each row."""
    nobody = dict.fromkeys(vars(no_hand()), (0.0, 0.0)) | {"let_go": False}
    alone = problem.model_copy(update={"hands": problem.hands.model_copy(update=nobody)})
    return every_hand(alone, law, draws=0, progress=progress)


def search_text(problem: Problem, draws: int, seed: int) -> str:
    """Return the hands that a search covers, in words."""
    corners = len(hand_corners(problem.hands))
    return f"{corners} corners, {draws} draws (seed {seed}) and a search of the ranges"


@dataclass(frozen=True)
class Worst:
    """The least damped loop with an observer that a search found; share of the innovation or force that passes."""

    radius: float
    device: Device
    hand: dict[str, float]
    share: float

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.radius < 1 - RADIUS_TOLERANCE


def feedback_radius(coupling: Coupling) -> dict[str, Worst]:
    """Return the worst loops of a coupling with state feedback, over the ranges of hands and device."""
    problem = coupling.problem
    if coupling.runtime.state_feedback is None or not coupling.table.constant:
        raise UnsupportedError("state feedback is judged before constant gains only; make the gains constant")
    if max(one.delay_samples for one in device_corners(problem.device, ("delay_samples",))) > MAX_DELAY_SAMPLES:
        raise UnsupportedError(f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay")
    law = law_at_rest(coupling)

    def worst(hand: Ranges, least_share: float, sector: str = "dead_zone") -> Worst:
        def leading(plant: SampledPlant, values: Mapping[str, FloatArray]) -> ComplexArray:
            return closed(Body.of(plant).flat(), law.at_slopes(**{sector: values["share"]})).leading

        value, held, device, values = worst_case(problem.device, hand, leading, share=(least_share, 1.0))
        return Worst(abs(value), device, held, float(values["share"][0]))

    boxes = hand_boxes(problem)
    found = {"hands": worst(boxes[0], 1.0), "let-go": worst(boxes[-1], 1.0)}
    # With less than a hundredth the hand alone decides. A search may end in another maximum.
    some = {
        "dead-zone": [worst(boxes[0], 0.01)],
        "clip": [worst(hand, 0.01, "force_limit") for hand in (boxes[0], boxes[-1])],
    }
    return found | {name: max(found["hands"], *ones, key=lambda one: one.radius) for name, ones in some.items()}


def hands_level(subject: Subject) -> LevelResult:
    """Judge L5 on the loop of the device as declared, whatever model the gains were designed for."""
    rows, problem, draws, seed = subject.rows, subject.problem, subject.draws, subject.seed
    if subject.behind_feedback and subject.coupling is not None:
        return _feedback_level(rows, feedback_radius(subject.coupling), problem)
    effort = search_text(problem, draws, seed)
    claim = f"each frozen row is linearly stable, with no friction, with {effort}; this says nothing of switching"
    slowest = max(device.delay_samples for device in device_corners(problem.device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        return refusal(rows, "L5", "sampled-data", f"more than {MAX_DELAY_SAMPLES} samples of delay")
    law = frozen_law(problem, rows.b, rows.k, rows.contact)
    found = every_hand(problem, law, draws=draws, seed=seed, progress=subject.progress)
    radius = found.radius
    free = released(problem, law)
    detail: dict[str, Any] = {
        "spectral_radius": float(np.max(radius)) if len(radius) else None,
        "row_spectral_radius": rows.spread(radius),
        "released_spectral_radius": float(np.max(free.radius)) if len(radius) else None,
        "released_pass": bool(len(radius) and free.stable.all()),
        "hands": len(hand_corners(problem.hands)) + draws,
        "hands_seed": seed,
        "row_worst_hand": {name: rows.spread(np.asarray(value)) for name, value in vars(found.hands).items()},
    }
    # Rows rank by spectral radius; the margin in N.s/m is that of the worst one.
    tolerance = np.full(len(radius), RADIUS_TOLERANCE)
    result = level_result(rows, "L5", "sampled-data", claim, found.stable, 1.0 - radius, found.frequency_hz, tolerance)
    if result.row is None:
        return replace(result, detail=detail)
    worst = int(np.count_nonzero(rows.present[: result.row]))
    only = slice(worst, worst + 1)
    hand, device = found.hands.pick(only), found.devices[worst]
    margin, held = damping_reserve(device, law.pick(only), hand), hand.values(0)
    if not found.stable[worst]:
        missing = len(rows.present) - len(radius)
        claim = (
            f"Not met by {np.count_nonzero(~found.stable)} of {len(radius)} rows: the row of "
            f"{rows.frequency_hz[result.row]:.5g} Hz has a spectral radius of {radius[worst]:.6g} (at "
            f"{found.frequency_hz[worst]:.4g} Hz) with {hand_text(held, problem.units.unit)}"
            + (f"; {missing} rows have no gains" if missing else "")
        )
        result = replace(result, claim=claim)
    return replace(
        result,
        margin_ns_per_m=margin,
        row_margin_ns_per_m=np.where(np.arange(len(rows.present)) == result.row, margin, np.nan),
        detail=detail | {"worst_hand": held, "worst_device": linear_values(device)},
    )


def _feedback_level(rows: Rows, loops: dict[str, Worst], problem: Problem) -> LevelResult:
    """Judge L5 on the loop of a coupling with state feedback."""
    of, worst = max((one for one in loops.items() if one[0] != "let-go"), key=lambda one: one[1].radius)
    free, one = loops["let-go"], np.ones(len(rows.b))
    claim = (
        "the loop with observer and state feedback is linearly stable, with no friction, with the worst hand that a "
        "search of [hands] found, whatever share of the innovation passes the dead zone, or of the force its clip"
    )
    if not worst.stable:
        who = hand_text(worst.hand, problem.units.unit) if any(worst.hand.values()) else "the device released"
        share = f"{worst.share:.3g} of the {'force' if of == 'clip' else 'innovation'}"
        claim = f"Not met: spectral radius {worst.radius:.6g} with {who} and {share}"
    passed = np.full(len(rows.b), worst.stable)
    margin, tolerance = (1 - worst.radius) * one, RADIUS_TOLERANCE * one
    result = level_result(rows, "L5", "sampled-data", claim, passed, margin, 0 * one, tolerance)
    detail = {
        "spectral_radius": worst.radius,
        "released_spectral_radius": free.radius,
        "released_pass": free.stable,
        "hands": len(hand_corners(rows.problem.hands)),
        "worst_hand": worst.hand,
        "worst_share": worst.share,
    }
    return replace(result, claim=claim, margin_ns_per_m=float("nan"), detail=detail)


def damping_reserve(device: Device, law: Law, hand: Hand) -> float:
    """Return the device damping to spare before a row with a hand becomes unstable, N.s/m; negative where it lacks."""

    def stable(shift: float) -> bool:
        damping = {"damping_ns_per_m": device.damping_ns_per_m + shift}
        radius = linear_stability(device.model_copy(update=damping), law, hand).radius
        return bool((radius < 1 - RADIUS_TOLERANCE).all())

    starts_stable = stable(0.0)
    available = device.damping_ns_per_m + hand.values(0)["damping_ns_per_m"]
    near, far = 0.0, 1e-3 * (1.0 + available)
    sign = -1.0 if starts_stable else 1.0
    limit = available if starts_stable else 1e6
    while far < limit and stable(sign * far) == starts_stable:
        near, far = far, 2 * far
    far = min(far, limit)
    if stable(sign * far) == starts_stable:
        return available if starts_stable else float("nan")
    while far - near > 1e-9 * (1.0 + far):
        middle = (near + far) / 2
        near, far = (middle, far) if stable(sign * middle) == starts_stable else (near, middle)
    return near if starts_stable else -far


@dataclass(frozen=True)
class ScopeSlack:
    """Slack of each row within its scope, shape (n,)."""

    slack: FloatArray
    frequency_hz: FloatArray

    @property
    def met(self) -> BoolArray:
        """Whether each row meets its scope strictly, without any tolerance."""
        return np.asarray(self.slack >= 0)


def scope_band_hz(problem: Problem, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the band in which the row of each frequency must be passive; the frequency itself for scope hands."""
    nyquist = 0.5 / problem.device.sample_time_s
    scope, factor = problem.stability.scope, problem.stability.band_factor
    if scope == "all":
        return np.zeros_like(frequency_hz), np.full_like(frequency_hz, nyquist)
    if scope == "band":
        return np.asarray(frequency_hz / factor), np.minimum(frequency_hz * factor, nyquist)
    return frequency_hz, frequency_hz


def deciding_frequencies_hz(problem: Problem, frequency_hz: FloatArray) -> FloatArray | None:
    """Return frequencies at which Re Z_h >= margin implies the whole scope, shape (n, m); None if none are known."""
    scope = problem.stability.scope
    if scope == "pointwise":
        return frequency_hz[:, None]
    if scope == "hands" or problem.stability.model == "paper" or problem.device.delay_samples:
        return None
    low, high = scope_band_hz(problem, frequency_hz)
    return high[:, None] if scope == "all" else np.stack([low, high], axis=1)


def scope_slack(
    problem: Problem,
    frequency_hz: Values,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
) -> ScopeSlack:
    """Return the slack of rows of gains in the scope, model and margin of a problem."""
    values = (frequency_hz, damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m)
    own, b, k, contact = (
        np.ravel(value) for value in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in values))
    )
    margin = problem.stability.margin_ns_per_m
    if problem.stability.scope == "hands":
        law, most = frozen_law(problem, b, k, contact), 1 - RADIUS_TOLERANCE
        lean = problem.device.model_copy(update={"damping_ns_per_m": problem.device.damping_ns_per_m - margin})
        worst = worst_hands(lean, law, problem.hands, enough=most)
        return ScopeSlack(most - worst.radius, worst.frequency_hz)
    least = worst_margin(SampledLoop.of(problem), b, k, contact, *scope_band_hz(problem, own))
    sound = least.poles_stable & (least.dc_stiffness_n_per_m >= 0)
    slack = np.where(sound, least.margin_ns_per_m - margin, -np.inf)
    return ScopeSlack(slack, least.frequency_hz)
