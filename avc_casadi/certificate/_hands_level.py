"""Level L5: each frozen row linearly stable with every hand of a set, without friction."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate._levels import Rows, level_result
from avc_casadi.stability import (
    MAX_DELAY_SAMPLES,
    RADIUS_TOLERANCE,
    HandSet,
    frozen_parts,
    hand_set,
    linear_stability,
    no_hand,
    switching_proof,
)

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import FloatArray, LevelResult
    from avc_casadi.passivity import Fractions

_LARGEST_SHIFT = 1e6


def hands_level(rows: Rows, *, draws: int, seed: int) -> LevelResult:
    """Judge L5 on the loop that runs on a device, whatever model the gains were designed for.

    The margin of a row is the damping that its device can lose, with the worst hand, before the loop stands on the edge
    of stability (negative: that it lacks); it is found for the worst row alone.
    """
    hands = hand_set(rows.problem.hands, draws=draws, seed=seed)
    name = f"{hands.corners} corners and {draws} draws (seed {seed}) of the hands"
    claim = f"each frozen row is linearly stable, with no friction, with {name}; this says nothing of switching"
    if rows.problem.device.delay_samples > MAX_DELAY_SAMPLES:
        nothing = np.full(len(rows.b), np.nan)
        result = level_result(rows, "L5", "sampled-data", claim, np.zeros(len(rows.b), bool), nothing, nothing, nothing)
        return replace(result, claim=f"Not judged: more than {MAX_DELAY_SAMPLES} samples of delay")
    parts = frozen_parts(rows.problem, rows.b, rows.k)
    stability = linear_stability(rows.problem.device, parts, rows.contact, hands)
    worst_hand = np.argmax(stability.radius, axis=1)
    radius = np.max(stability.radius, axis=1, initial=0.0)
    frequency = np.take_along_axis(stability.frequency_hz, worst_hand[:, None], axis=1)[:, 0]
    released = linear_stability(rows.problem.device, parts, rows.contact, no_hand())
    detail: dict[str, Any] = {
        "spectral_radius": float(np.max(radius)) if len(radius) else None,
        "row_spectral_radius": rows.spread(radius),
        "hands": len(hands),
        "hands_seed": seed,
        "released_spectral_radius": float(np.max(released.radius)) if len(radius) else None,
        "released_pass": bool(len(radius) and released.stable.all()),
    }
    corners = hand_set(rows.problem.hands, draws=0)
    switching = switching_proof(rows.problem, rows.b, rows.k, rows.contact, corners)
    detail["common_lyapunov"] = (
        None if switching is None else asdict(switching) | {"pass": switching.proved == switching.pairs}
    )
    # Rows rank by spectral radius; the margin in N.s/m is that of the worst one.
    result = level_result(
        rows,
        "L5",
        "sampled-data",
        claim,
        stability.stable,
        1.0 - radius,
        frequency,
        np.full(len(radius), RADIUS_TOLERANCE),
    )
    if result.row is None:
        return replace(result, detail=detail)
    worst = int(np.count_nonzero(rows.present[: result.row]))
    one = parts.pick(slice(worst, worst + 1))
    pick = slice(int(worst_hand[worst]), int(worst_hand[worst]) + 1)
    hand = HandSet(hands.mass_kg[pick], hands.damping_ns_per_m[pick], hands.stiffness_n_per_m[pick], 1, seed)
    margin = damping_reserve(rows, one, rows.contact[worst : worst + 1], hand)
    detail["worst_hand"] = {
        "mass_kg": float(hand.mass_kg[0]),
        "damping_ns_per_m": float(hand.damping_ns_per_m[0]),
        "stiffness_n_per_m": float(hand.stiffness_n_per_m[0]),
    }
    if not result.row_passed[result.row]:
        failed = int(np.count_nonzero(~stability.stable))
        claim = (
            f"Not met by {failed} of {len(radius)} rows: the row of {rows.frequency_hz[result.row]:.5g} Hz has a "
            f"spectral radius of {radius[worst]:.6g} (at {frequency[worst]:.4g} Hz) with a hand of "
            f"{hand.mass_kg[0]:.4g} kg, {hand.damping_ns_per_m[0]:.4g} N.s/m, {hand.stiffness_n_per_m[0]:.4g} N/m"
        )
        missing = len(rows.present) - len(radius)
        result = replace(result, claim=f"{claim}; {missing} rows have no gains" if missing else claim)
    return replace(
        result,
        margin_ns_per_m=margin,
        row_margin_ns_per_m=np.where(np.arange(len(rows.present)) == result.row, margin, np.nan),
        detail=detail,
    )


def damping_reserve(rows: Rows, parts: Fractions, contact: FloatArray, hand: HandSet) -> float:
    """Device damping to spare before one row with one hand becomes unstable, N.s/m; negative where it lacks.

    Not a number where no damping up to 1e6 N.s/m stabilises the loop.
    """

    def stable(shift: float) -> bool:
        return bool(linear_stability(rows.problem.device, parts, contact, hand, shift).stable[0])

    starts_stable = stable(0.0)
    available = rows.problem.device.damping_ns_per_m + float(hand.damping_ns_per_m[0])
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
