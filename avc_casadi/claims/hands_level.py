"""Level L5: each frozen row linearly stable with the worst hand found in the ranges, without friction."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import KG, N_PER_M, NS_PER_M
from avc_casadi.claims.certificate import radius_limit
from avc_casadi.claims.levels import Rows, level_result, not_judged
from avc_casadi.claims.stability.declared_device import rigid, whole_stability
from avc_casadi.claims.stability.frozen_loop import MAX_DELAY_SAMPLES, RADIUS_TOLERANCE, frozen_parts
from avc_casadi.claims.stability.switching import switching_proof
from avc_casadi.claims.stability.worst_hand import worst_hands
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, linear_values
from avc_casadi.model.hands import Hand, hand_corners, hand_set, no_hand

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult
    from avc_casadi.claims.levels import Rows
    from avc_casadi.claims.passivity.sampled_loop import Fractions
    from avc_casadi.claims.prove.hands import HandsProof, Outcome
    from avc_casadi.claims.prove.rest import Rest
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem


def proved_level(rows: Rows, checked: LevelResult, known: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Prove L5 or refute it, row by row, over every hand and every device of the ranges.

    Args:
        rows: the gains.
        checked: the level by the search.
        known: existing proofs of rest.
        progress: reported over the rows.

    Returns:
        The level: not met where a row is refuted. Open rows keep the verdict of the search, and are named.
    """
    from avc_casadi.claims.prove.hands import prove_hands  # noqa: PLC0415 - proofs are loaded on demand

    if checked.refused or not len(rows.b):
        return replace(checked, outcome="open")
    gains, inverse = np.unique(np.array([rows.b, rows.k, rows.contact]), axis=1, return_inverse=True)
    unique = prove_hands(rows.problem, *gains, progress=progress)
    at_rest = _at_rest(rows, unique, known, progress)
    index = inverse.ravel()
    proofs = [unique[row] for row in index]
    outcomes: list[Outcome] = ["proved" if row in at_rest else unique[row].outcome for row in index]
    still_open = {row for row, proof in enumerate(unique) if _open(proof)} - set(at_rest)
    counts = Counter(outcomes)
    refuted = np.array([outcome == "refuted" for outcome in outcomes])
    passed = checked.row_passed & ~(rows.spread(refuted.astype(np.float64), 0.0) > 0)
    missing = len(rows.present) - len(proofs)
    detail: dict[str, Any] = checked.detail | {
        "proof": {
            "proved": counts["proved"],
            "refuted": counts["refuted"],
            "open": counts["open"],
            "row_outcome": outcomes,
            "cells": sum(len(piece.cells) for proof in unique for piece in proof.pieces),
            "looked_at": sum(proof.looked_at for proof in unique) + sum(proof.cells for proof in at_rest.values()),
            "seconds": sum(proof.seconds for proof in unique) + sum(proof.seconds for proof in at_rest.values()),
            "first_open": next((unique[row].reason for row in index if row in still_open), None),
        },
        # One for each distinct row of gains.
        "proofs": [at_rest.get(row, proof).document() for row, proof in enumerate(unique)],
    }
    whole = counts["proved"] == len(proofs) and not missing
    if whole:
        how = "by the multipliers of L7" if at_rest else "interval arithmetic over the whole box"
        claim = (
            "Proved: each frozen row is linearly stable, with no friction, with every hand and every device of the"
            f" ranges ({how}); this says nothing of switching"
        )
    elif counts["refuted"] or missing:
        claim = checked.claim if not checked.passed else _told(proofs)
    else:
        claim = f"{checked.claim}; proof: {counts['proved']} of {len(proofs)} rows proved, {counts['open']} open"
    worst = max((proof for proof in proofs if proof.outcome == "refuted"), key=lambda one: one.radius, default=None)
    if checked.passed and worst is not None and worst.device is not None:
        detail |= {"worst_hand": worst.hand, "worst_device": linear_values(worst.device)}
    passed_whole = bool(passed.all()) and checked.passed
    outcome: Outcome = "refuted" if counts["refuted"] else "proved" if whole else "open"
    return replace(checked, passed=passed_whole, row_passed=passed, claim=claim, detail=detail, outcome=outcome)


def not_proved(checked: LevelResult, why: str) -> LevelResult:
    """Return a level with the reason why it cannot be proved, beside the verdict without a proof."""
    return replace(checked, claim=f"{checked.claim}; not proved: {why}", outcome="open")


def _at_rest(rows: Rows, unique: list[HandsProof], known: list[Rest], progress: Progress) -> dict[int, Rest]:
    """Prove open rows by a multiplier that proves rest, clipped last; by index among the distinct rows."""
    from avc_casadi.claims.prove.held_device import HAND  # noqa: PLC0415 - proofs are loaded on demand
    from avc_casadi.claims.prove.law import ContactLaw  # noqa: PLC0415
    from avc_casadi.claims.prove.rest import prove_rest  # noqa: PLC0415

    problem, found = rows.problem, {}
    box = {name: getattr(problem.hands, name) for name in HAND}
    for row, proof in enumerate(unique):
        if not _open(proof):
            continue
        gains = proof.gains
        b, k, contact = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
        law = ContactLaw.of(problem, float(b[0]), float(k[0]), float(contact[0]))
        made = next((one for one in known if one.outcome == "proved" and one.law == law), None)
        rest = made or prove_rest(law, "clip-last", problem.device, box, orbits=False, progress=progress)
        if rest.outcome == "proved":
            found[row] = rest
    return found


def _open(proof: HandsProof) -> bool:
    return proof.outcome == "open"


def _told(proofs: list[HandsProof]) -> str:
    refuted = [proof for proof in proofs if proof.outcome == "refuted"]
    return f"Not met by {len(refuted)} of {len(proofs)} rows: {refuted[0].sentence()}"


@dataclass(frozen=True)
class EveryHand:
    """The worst of all evaluated hands and device corners, for each of n rows.

    Attributes:
        stable: whether the row is stable with all of them, shape (n,).
        radius: largest spectral radius, shape (n,).
        frequency_hz: frequency of that eigenvalue, shape (n,).
        hands: the worst hand of each row, n hands.
        corner: its corner of the device, shape (n,).
        devices: the corners.
        looked_at: initial hands, common to all rows.
    """

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

    Args:
        problem: device with its ranges, and hands.
        parts: partial fractions of n renderings.
        contact: b_p, shape (n,).
        draws: hands drawn in addition to the corners.
        seed: seed of the draws.
        progress: reported over the rows.

    Raises:
        UnsupportedError: more than `MAX_DELAY_SAMPLES` samples of delay.
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
    return EveryHand(stable, radius, frequency, Hand(*places), corner, devices, len(first))


def looked_at(problem: Problem, draws: int, seed: int) -> str:
    """Return the hands behind a verdict, in words."""
    corners = len(hand_corners(problem.hands))
    return f"{corners} corners, {draws} draws (seed {seed}) and a search of the ranges of the hands"


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
            f"{found.frequency_hz[worst]:.4g} Hz) with a hand of {held['mass_kg']:.4g} {KG}, "
            f"{held['damping_ns_per_m']:.4g} {NS_PER_M}, {held['stiffness_n_per_m']:.4g} {N_PER_M}"
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
    """Return details of the verdict: the device released, and whether gains may switch between neighbouring rows."""
    released = [whole_stability(device, parts, rows.contact, no_hand()).radius for device in devices]
    limit = radius_limit(rows.problem.device, parts, no_hand())
    switching = None
    if rigid(rows.problem.device):  # the proof covers no other device
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
    """Return the device damping to spare before a row with a hand becomes unstable, N.s/m; negative where it lacks.

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
