"""Level L5: each frozen row linearly stable with the worst hand of the ranges that is found, without friction."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate._at_rest import radius_limit
from avc_casadi.certificate._every_hand import every_hand, looked_at
from avc_casadi.certificate._levels import Rows, level_result, not_judged
from avc_casadi.loop import device_corners, hand_corners, linear_values, no_hand
from avc_casadi.stability import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    frozen_parts,
    rigid,
    switching_proof,
    whole_stability,
)
from avc_casadi.support import SILENT, FloatArray, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import (
        LevelResult,
    )
    from avc_casadi.loop import Hand
    from avc_casadi.passivity import Fractions
    from avc_casadi.problem import Device

_LARGEST_SHIFT = 1e6


def hands_level(rows: Rows, *, draws: int, seed: int, progress: Progress = SILENT) -> LevelResult:
    """Judge L5 on the loop of the device as declared, whatever model the gains were designed for.

    The margin of a row is the damping that its device can lose, with the worst hand, before the loop stands on the edge
    of stability (negative: that it lacks); it is found for the worst row alone.
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
    detail = _beside(rows, parts, found.devices, radius, progress) | {
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
            f"{found.frequency_hz[worst]:.4g} Hz) with a hand of {held['mass_kg']:.4g} kg, "
            f"{held['damping_ns_per_m']:.4g} N.s/m, {held['stiffness_n_per_m']:.4g} N/m"
            + (f"; {missing} rows have no gains" if missing else "")
        )
        result = replace(result, claim=claim)
    return replace(
        result,
        margin_ns_per_m=margin,
        row_margin_ns_per_m=np.where(np.arange(len(rows.present)) == result.row, margin, np.nan),
        detail=detail,
    )


def _beside(
    rows: Rows, parts: Fractions, devices: list[Device], radius: FloatArray, progress: Progress
) -> dict[str, Any]:
    """What stands beside the verdict: the device let go, and whether gains may switch between neighbouring rows."""
    released = [whole_stability(device, parts, rows.contact, no_hand()).radius for device in devices]
    limit = radius_limit(rows.problem.device, parts, no_hand())
    switching = None
    if rigid(rows.problem.device):  # the proof knows no other device
        switching = switching_proof(
            rows.problem, rows.b, rows.k, rows.contact, hand_corners(rows.problem.hands), progress
        )
    return {
        "spectral_radius": float(np.max(radius)) if len(radius) else None,
        "row_spectral_radius": rows.spread(radius),
        "released_spectral_radius": max(float(np.max(one)) for one in released) if len(radius) else None,
        "released_pass": bool(len(radius) and all((one < limit).all() for one in released)),
        "common_lyapunov": None
        if switching is None
        else asdict(switching) | {"pass": switching.proved == switching.pairs},
    }


def damping_reserve(device: Device, parts: Fractions, contact: FloatArray, hand: Hand) -> float:
    """Device damping to spare before one row with one hand becomes unstable, N.s/m; negative where it lacks.

    Not a number where no damping up to 1e6 N.s/m stabilises the loop.
    """
    bound = radius_limit(device, parts, hand)

    def stable(shift: float) -> bool:
        return bool((whole_stability(device, parts, contact, hand, shift).radius < bound).all())

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
