"""Level L5: each frozen row linearly stable with the worst hand found in the ranges, without friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certificate import radius_limit
from avc_casadi.claims.levels import Rows, level_result, not_judged
from avc_casadi.loops.loop import Body
from avc_casadi.loops.ranges import hand_boxes, worst_held
from avc_casadi.loops.spectrum import largest_eigenvalue
from avc_casadi.loops.wall import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    fraction_rendering,
    frozen_parts,
    linear_stability,
    wall,
)
from avc_casadi.loops.worst_hand import worst_hands
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.hands import Hand, hand_corners, hand_set, hand_text, no_hand

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult
    from avc_casadi.claims.levels import Rows
    from avc_casadi.loops.ranges import Ranges
    from avc_casadi.loops.sampled_loop import Fractions
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.sampled_plant import SampledPlant

# Rows of gains whose devices are searched inside their ranges.
_ROWS_INSIDE = 4


@dataclass(frozen=True)
class EveryHand:
    """The worst of all evaluated hands and device corners, for each of n rows."""

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
    """Search for the worst hand of each row.

    A row that is unstable with one of the initial hands is not searched further, except the worst of all rows.
    """
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
        value, hand, device = worst_rendering(problem.device, parts, contact, int(row), hand_boxes(problem)[0])
        if abs(value) > radius[row]:
            radius[row], frequency[row] = abs(value), _frequency_hz(value, device)
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
        value, _, device = worst_rendering(problem.device, parts, contact, int(row), hand_boxes(problem)[-1])
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


def worst_rendering(
    device: Device, parts: Fractions, contact: FloatArray, row: int, hand: Ranges
) -> tuple[complex, dict[str, float], Device]:
    """Return the largest eigenvalue of one row over the ranges of a hand and the device, that hand and that device."""
    only = slice(row, row + 1)
    rendering = fraction_rendering(parts.pick(only), contact[only], device.sample_time_s)

    def leading(plant: SampledPlant, _: object) -> ComplexArray:
        return largest_eigenvalue(wall(Body.of(plant).flat(), rendering))

    return worst_held(device, hand, leading)[:3]


def _frequency_hz(value: complex, device: Device) -> float:
    return float(abs(np.angle(value)) / (2 * np.pi * device.sample_time_s))


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


_LARGEST_SHIFT = 1e6


def hands_level(rows: Rows, *, draws: int, seed: int, progress: Progress = SILENT) -> LevelResult:
    """Judge L5 on the loop of the device as declared, whatever model the gains were designed for.

    The margin of a row is the damping that its device can lose, with the worst hand, at the boundary of stability
    (negative: lacking); it is computed for the worst row alone.
    """
    problem = rows.problem
    seen = looked_at(problem, draws, seed)
    claim = f"each frozen row is linearly stable, with no friction, with {seen}; this says nothing of switching"
    slowest = max(device.delay_samples for device in device_corners(problem.device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        return not_judged(rows, "L5", "sampled-data", f"more than {MAX_DELAY_SAMPLES} samples of delay")
    parts = frozen_parts(problem, rows.b, rows.k)
    found = every_hand(problem, parts, rows.contact, draws=draws, seed=seed, progress=progress)
    radius = found.radius
    detail = _beside(rows, parts, radius) | {
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
    margin = damping_reserve(device, parts.pick(only), rows.contact[only], hand)
    held = hand.values(0)
    detail["worst_hand"] = held
    detail["worst_device"] = linear_values(device)
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
        detail=detail,
    )


def _beside(rows: Rows, parts: Fractions, radius: FloatArray) -> dict[str, Any]:
    """Return details of the verdict: the device released."""
    released, _, _ = released_radius(rows.problem, parts, rows.contact)
    limit = radius_limit(rows.problem.device, parts, no_hand())[:, 0]
    return {
        "spectral_radius": float(np.max(radius)) if len(radius) else None,
        "row_spectral_radius": rows.spread(radius),
        "released_spectral_radius": float(np.max(released)) if len(radius) else None,
        "released_pass": bool(len(radius) and (released < limit).all()),
    }


def damping_reserve(device: Device, parts: Fractions, contact: FloatArray, hand: Hand) -> float:
    """Return the device damping to spare before a row with a hand becomes unstable, N.s/m; negative where it lacks.

    Not a number where no damping up to 1e6 N.s/m stabilises the loop.
    """
    bound = radius_limit(device, parts, hand)

    def stable(shift: float) -> bool:
        return bool((linear_stability(device, parts, contact, hand, shift).radius < bound).all())

    starts_stable = stable(0.0)
    available = device.damping_ns_per_m + hand.values(0)["damping_ns_per_m"]
    near, far = 0.0, 1e-3 * (1.0 + available)
    sign = -1.0 if starts_stable else 1.0
    limit = available if starts_stable else _LARGEST_SHIFT
    while far < limit and stable(sign * far) == starts_stable:
        near, far = far, 2 * far
    far = min(far, limit)
    if stable(sign * far) == starts_stable:
        return available if starts_stable else float("nan")
    while far - near > 1e-9 * (1.0 + far):
        middle = (near + far) / 2
        near, far = (middle, far) if stable(sign * middle) == starts_stable else (near, middle)
    return near if starts_stable else -far
