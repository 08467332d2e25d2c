"""Level L5: linear stability with the worst hand found in the ranges, without friction, at every corner of the device.

A search, not a proof: corners, draws and ascent; where the device has ranges, inside these too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.levels import Judged, LevelResult, Rows, level_result, not_judged
from avc_casadi.loops.loop import Body
from avc_casadi.loops.ranges import Ranges, hand_boxes, worst_hands, worst_held
from avc_casadi.loops.spectrum import largest_eigenvalue
from avc_casadi.loops.wall import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    fraction_rendering,
    frozen_parts,
    frozen_rendering,
    linear_stability,
    observed_wall,
    rigid,
    wall,
)
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.hands import Hand, hand_corners, hand_set, hand_text, no_hand

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.coupling import Coupling
    from avc_casadi.loops.sampled_loop import Fractions
    from avc_casadi.model.device import Device
    from avc_casadi.model.plant import SampledPlant
    from avc_casadi.model.problem import Problem

# Rows of gains whose devices are searched inside their ranges.
_ROWS_INSIDE = 4
_LARGEST_SHIFT_NS_PER_M = 1e6
# A free, undamped device has the eigenvalue 1 twice: rounding moves a double one by its root, unless the matrix is
# triangular, as that of a rigid device is.
_FREE_TOLERANCE = 1e-7
# Least share of the innovation that passes a dead zone: with less the hand alone decides.
_LEAST_SHARE = 0.01


def radius_limit(device: Device, parts: Fractions, hands: Hand) -> FloatArray:
    """Return the bound of the spectral radius of n renderings with h hands, shape (n, h).

    Below 1, where a spring of wall or hand restores the device; without any its position is an eigenvalue of 1.
    """
    free = 1 + (RADIUS_TOLERANCE if rigid(device) else _FREE_TOLERANCE)
    held = np.broadcast_to(np.asarray(hands.stiffness_n_per_m) > 0, (len(hands),))
    called_back = (np.asarray(parts.integral) > 0)[:, None] | held[None, :]
    return np.where(called_back, 1 - RADIUS_TOLERANCE, free)


@dataclass(frozen=True)
class EveryHand:
    """The worst of all evaluated hands and devices, for each of n rows."""

    stable: BoolArray
    radius: FloatArray
    frequency_hz: FloatArray
    hands: Hand
    corner: IndexArray
    devices: list[Device]
    looked_at: int


def every_hand(
    problem: Problem, parts: Fractions, contact: FloatArray, *, draws: int, seed: int, progress: Progress = SILENT
) -> EveryHand:
    """Search for the worst hand of each row."""
    devices = device_corners(problem.device, LINEAR_KEYS)
    first = hand_set(problem.hands, draws=draws, seed=seed)
    limits = radius_limit(problem.device, parts, first)
    stable = np.ones(len(contact), dtype=bool)
    found = []
    for device in devices:
        one = worst_hands(device, parts, contact, problem.hands, draws=draws, seed=seed, enough=1.0, progress=progress)
        own = _own_limit(problem.device, parts, one.hands)
        stable &= (one.known.radius < limits).all(axis=1) & (one.radius < own)
        found.append(one)
    radii = np.array([one.radius for one in found])
    corner = radii.argmax(axis=0)
    pick = corner, np.arange(radii.shape[1])
    radius, frequency = radii[pick], np.array([one.frequency_hz for one in found])[pick]
    places = np.array([list(vars(one.hands).values()) for one in found])[corner, :, pick[1]].T
    if radius.size and radius.max() >= 1.0:
        row = slice(int(radius.argmax()), int(radius.argmax()) + 1)
        last = worst_hands(
            devices[corner[row][0]], parts.pick(row), contact[row], problem.hands, draws=draws, seed=seed
        )
        radius[row], frequency[row] = last.radius, last.frequency_hz
        places[:, row] = np.array(list(vars(last.hands).values()))
    for row in _hardest(problem.device, radius):
        value, hand, device = _worst_inside(problem.device, parts, contact, int(row), hand_boxes(problem)[0])
        if abs(value) > radius[row]:
            radius[row], frequency[row] = abs(value), abs(np.angle(value)) / (2 * np.pi * device.sample_time_s)
            places[:, row], corner[row] = list(hand.values()), len(devices)
            devices = [*devices, device]
            stable[row] &= radius[row] < _own_limit(device, parts.pick(slice(row, row + 1)), Hand(**hand))[0]
    return EveryHand(stable, radius, frequency, Hand(*places), corner, devices, len(first))


def released_radius(
    problem: Problem, parts: Fractions, contact: FloatArray, progress: Progress = SILENT
) -> tuple[FloatArray, IndexArray, list[Device]]:
    """Return the largest released spectral radius of each row, shape (n,), its device, and all devices."""
    devices = device_corners(problem.device, LINEAR_KEYS)
    radii = [linear_stability(device, parts, contact, no_hand(), progress=progress).radius[:, 0] for device in devices]
    corner, radius = np.argmax(radii, axis=0), np.max(radii, axis=0)
    for row in _hardest(problem.device, radius):
        value, _, device = _worst_inside(problem.device, parts, contact, int(row), hand_boxes(problem)[-1])
        if abs(value) > radius[row]:
            radius[row], corner[row] = abs(value), len(devices)
            devices = [*devices, device]
    return radius, corner, devices


def _hardest(device: Device, radius: FloatArray) -> IndexArray:
    """Return the rows whose devices are searched inside the ranges: of those not refuted at corners the worst."""
    if not device_ranges(device, LINEAR_KEYS):
        return np.zeros(0, dtype=np.intp)
    order = np.argsort(-radius, kind="stable")
    return np.asarray(order[radius[order] < 1.0][:_ROWS_INSIDE])


def _worst_inside(
    device: Device, parts: Fractions, contact: FloatArray, row: int, hand: Ranges
) -> tuple[complex, dict[str, float], Device]:
    """Return the largest eigenvalue of one row over the ranges of a hand and the device, that hand and that device."""
    only = slice(row, row + 1)
    rendering = fraction_rendering(parts.pick(only), contact[only], device.sample_time_s)

    def leading(plant: SampledPlant, _: object) -> ComplexArray:
        return largest_eigenvalue(wall(Body.of(plant).flat(), rendering))

    return worst_held(device, hand, leading)[:3]


def looked_at(problem: Problem, draws: int, seed: int) -> str:
    """Return the hands behind a verdict, in words."""
    corners = len(hand_corners(problem.hands))
    return f"{corners} corners, {draws} draws (seed {seed}) and a search of the ranges"


def _own_limit(device: Device, parts: Fractions, hands: Hand) -> FloatArray:
    """Return the bound on the radius of each row with its own hand, shape (n,)."""
    held = np.asarray(hands.stiffness_n_per_m) > 0
    one_each = Hand(np.zeros(2), np.zeros(2), np.array([0.0, 1.0]))
    free, back = radius_limit(device, parts, one_each).T
    return np.asarray(np.where(held, back, free))


@dataclass(frozen=True)
class Worst:
    """The least damped loop with an observer that a search found; share of the innovation that passes the dead zone."""

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
    law, problem = coupling.runtime.state_feedback, coupling.problem
    if law is None or not coupling.table.constant:
        raise UnsupportedError("state feedback is judged before constant gains only; make the gains constant")
    if max(one.delay_samples for one in device_corners(problem.device, ("delay_samples",))) > MAX_DELAY_SAMPLES:
        raise UnsupportedError(f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay")
    rendering = frozen_rendering(problem, *vars(coupling.table.at_rest).values())

    def leading(plant: SampledPlant, values: Mapping[str, FloatArray]) -> ComplexArray:
        # The loop is affine in the share.
        none, all_ = observed_wall(Body.of(plant).flat(), law, rendering, (0.0, 1.0))
        return largest_eigenvalue(none + values["share"][:, None, None] * (all_ - none))

    def worst(hand: Ranges, least_share: float) -> Worst:
        value, held, device, values = worst_held(problem.device, hand, leading, share=(least_share, 1.0))
        return Worst(abs(value), device, held, float(values["share"][0]))

    boxes = hand_boxes(problem)
    found = {"hands": worst(boxes[0], 1.0), "let-go": worst(boxes[-1], 1.0), "dead-zone": worst(boxes[0], _LEAST_SHARE)}
    # Its search may end in another maximum.
    return found | {"dead-zone": max(found["hands"], found["dead-zone"], key=lambda one: one.radius)}


def hands_level(judged: Judged) -> LevelResult:
    """Judge L5 on the loop of the device as declared, whatever model the gains were designed for."""
    rows, problem, draws, seed = judged.rows, judged.problem, judged.draws, judged.seed
    if judged.behind_feedback and judged.coupling is not None:
        return _feedback_level(rows, feedback_radius(judged.coupling))
    seen = looked_at(problem, draws, seed)
    claim = f"each frozen row is linearly stable, with no friction, with {seen}; this says nothing of switching"
    slowest = max(device.delay_samples for device in device_corners(problem.device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        return not_judged(rows, "L5", "sampled-data", f"more than {MAX_DELAY_SAMPLES} samples of delay")
    parts = frozen_parts(problem, rows.b, rows.k)
    found = every_hand(problem, parts, rows.contact, draws=draws, seed=seed, progress=judged.progress)
    radius = found.radius
    released = released_radius(problem, parts, rows.contact)[0]
    limit = radius_limit(problem.device, parts, no_hand())[:, 0]
    detail: dict[str, Any] = {
        "spectral_radius": float(np.max(radius)) if len(radius) else None,
        "row_spectral_radius": rows.spread(radius),
        "released_spectral_radius": float(np.max(released)) if len(radius) else None,
        "released_pass": bool(len(radius) and (released < limit).all()),
        "hands": found.looked_at,
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
    hand, device = found.hands.pick(only), found.devices[found.corner[worst]]
    margin, held = damping_reserve(device, parts.pick(only), rows.contact[only], hand), hand.values(0)
    if not found.stable[worst]:
        missing = len(rows.present) - len(radius)
        claim = (
            f"Not met by {np.count_nonzero(~found.stable)} of {len(radius)} rows: the row of "
            f"{rows.frequency_hz[result.row]:.5g} Hz has a spectral radius of {radius[worst]:.6g} (at "
            f"{found.frequency_hz[worst]:.4g} Hz) with {hand_text(held)}"
            + (f"; {missing} rows have no gains" if missing else "")
        )
        result = replace(result, claim=claim)
    return replace(
        result,
        margin_ns_per_m=margin,
        row_margin_ns_per_m=np.where(np.arange(len(rows.present)) == result.row, margin, np.nan),
        detail=detail | {"worst_hand": held, "worst_device": linear_values(device)},
    )


def _feedback_level(rows: Rows, found: dict[str, Worst]) -> LevelResult:
    """Judge L5 on the loop of a coupling with state feedback."""
    worst, released, one = found["dead-zone"], found["let-go"], np.ones(len(rows.b))
    claim = (
        "the loop with observer and state feedback is linearly stable, with no friction, with the worst hand that a "
        "search of [hands] found, whatever share of the innovation passes the dead zone"
    )
    if not worst.stable:
        who = hand_text(worst.hand)
        claim = f"Not met: spectral radius {worst.radius:.6g} with {who} and {worst.share:.3g} of the innovation"
    passed = np.full(len(rows.b), worst.stable)
    margin, tolerance = (1 - worst.radius) * one, RADIUS_TOLERANCE * one
    result = level_result(rows, "L5", "sampled-data", claim, passed, margin, 0 * one, tolerance)
    detail = {
        "spectral_radius": worst.radius,
        "released_spectral_radius": released.radius,
        "released_pass": released.stable,
        "hands": len(hand_corners(rows.problem.hands)),
        "worst_hand": worst.hand,
        "worst_share": worst.share,
    }
    return replace(result, claim=claim, margin_ns_per_m=float("nan"), detail=detail)


def damping_reserve(device: Device, parts: Fractions, contact: FloatArray, hand: Hand) -> float:
    """Return the device damping to spare before a row with a hand becomes unstable, N.s/m; negative where it lacks."""
    bound = radius_limit(device, parts, hand)

    def stable(shift: float) -> bool:
        damping = {"damping_ns_per_m": device.damping_ns_per_m + shift}
        return bool((linear_stability(device.model_copy(update=damping), parts, contact, hand).radius < bound).all())

    starts_stable = stable(0.0)
    available = device.damping_ns_per_m + hand.values(0)["damping_ns_per_m"]
    near, far = 0.0, 1e-3 * (1.0 + available)
    sign = -1.0 if starts_stable else 1.0
    limit = available if starts_stable else _LARGEST_SHIFT_NS_PER_M
    while far < limit and stable(sign * far) == starts_stable:
        near, far = far, 2 * far
    far = min(far, limit)
    if stable(sign * far) == starts_stable:
        return available if starts_stable else float("nan")
    while far - near > 1e-9 * (1.0 + far):
        middle = (near + far) / 2
        near, far = (middle, far) if stable(sign * middle) == starts_stable else (near, middle)
    return near if starts_stable else -far
