"""Levels that are asked for on demand: rest with every hand (L7), gains that change (L8), ripple in contact (L9)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import MissingExtraError, UnsupportedError
from avc_casadi.certificate._certificate import LevelResult
from avc_casadi.proof import (
    HAND,
    MOST_CELLS,
    Changing,
    ContactLaw,
    Order,
    Outcome,
    Rest,
    WallGap,
    bound_ripple,
    prove_changes,
    prove_rest,
    same_gains,
    wall_gap,
)
from avc_casadi.support import SILENT, BoolArray, Progress, plain, rows_text

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Certificate, Level
    from avc_casadi.coupling import Coupling

_WORST_FIRST = ("refuted", "open", "proved")


def prove(coupling: Coupling, *, seed: int = 0, progress: Progress = SILENT) -> dict[Level, LevelResult]:
    """Prove what a certificate otherwise only samples; each level says proved, refuted or open.

    L7: the loop comes to rest with every hand of [hands], wherever the hand rests and from any state, making and
    breaking contact, without friction, at each row of the table that runs. Proofs and witnesses stand in its detail
    and can be read again (`avc_casadi.proof.Rest.from_document`).

    A device let go has no place of rest, and is no part of it.

    L8: rows of the table may follow one another, in any order or by one row a sample, in kept contact with every hand
    of the box; or a pattern of rows and a hand that refute it (`avc_casadi.proof.Changing.from_document`).

    L9: how far half an encoder step, noise of four times its rms and dry friction can move device and force with every
    hand of the box, while the hand presses enough to keep in contact.

    Args:
        coupling: what runs, with the problem that it runs for.
        seed: of hands that are drawn and of the search for orbits.
        progress: told of the rows.

    Example:
        >>> problem = avc.load_problem("soft")
        >>> prove(avc.Coupling.of(problem, avc.solve(problem, "static-tuned")))["L7"].outcome
        'proved'
    """
    rows = coupling.table.rows
    found: list[Rest] = []
    for done, row in enumerate(rows):
        with progress.step(f"proof of rest, {done + 1} of {rows_text(len(rows))}"):
            found.append(_of_row(coupling, row.tolist(), seed, progress))
    with progress.step("patterns of changing gains"):
        changing = _changing(coupling, progress)
    with progress.step("bound of the ripple"):
        ripple = _ripple(coupling, found, progress)
    return {"L7": _rest(coupling, found, progress), "L8": changing, "L9": ripple}


def with_proofs(certificate: Certificate, proofs: dict[Level, LevelResult]) -> Certificate:
    """Return a certificate with further levels."""
    return replace(certificate, levels=certificate.levels | proofs)


def _of_row(coupling: Coupling, row: list[float], seed: int, progress: Progress) -> Rest:
    problem, runtime = coupling.problem, coupling.runtime
    _, b, k, contact_damping = row
    law = ContactLaw.of(problem, b, k, contact_damping, runtime.state_feedback)
    box = {name: getattr(problem.hands, name) for name in HAND}
    found = prove_rest(law, coupling.contact, problem.device, box, seed=seed, progress=progress)
    beside = {
        "the observer between encoder steps is not linear": runtime.observer_mass_kg is not None,
        f"the guard {runtime.guard} changes the force by what it has seen": runtime.guard is not None,
    }
    lacking = [reason for reason, there in beside.items() if there]
    if not lacking:
        return found
    without = found.sentence if found.outcome != "open" else f"open, {found.sentence}"
    return replace(found, outcome="open", sentence=f"{'; '.join(lacking)}; without it: {without}")


def _rest(coupling: Coupling, found: list[Rest], progress: Progress) -> LevelResult:
    outcomes = [one.outcome for one in found]
    worst = min(range(len(found)), key=lambda row: _WORST_FIRST.index(outcomes[row]))
    rows = coupling.table.rows
    passed = np.array([outcome == "proved" for outcome in outcomes])
    counts = ", ".join(f"{outcomes.count(one)} {one}" for one in _WORST_FIRST if one in outcomes)
    claim = found[worst].sentence
    if len(found) > 1:
        claim = f"{counts} of {rows_text(len(found))}, each held; the row of {rows[worst, 0]:.5g} Hz: {claim}"
        claim += "; this says nothing of gains that change"
    detail: dict[str, Any] = {"proofs": [one.document() for one in found]}
    if len(found) == 1 and outcomes[0] == "open" and found[0].multiplier is None:
        gap = _gap(coupling, found[0], progress)
        if gap is not None:
            detail["gap"] = plain(vars(gap))
            claim += (
                f"; with these gains the stiffest wall that is proved has {gap.proved_n_per_m:.4g} N/m, the stiffest "
                f"that is linearly stable {gap.linear_n_per_m:.4g} N/m"
            )
    return _level("L7", outcomes[worst], claim, passed, detail, worst)


def _level(
    level: Level, outcome: Outcome, claim: str, passed: BoolArray, detail: dict[str, Any], worst: int = 0
) -> LevelResult:
    nothing = np.full(len(passed), np.nan)
    return LevelResult(
        level=level,
        passed=bool(passed.all()),
        margin_ns_per_m=math.nan,
        frequency_hz=math.nan,
        model="sampled-data",
        claim=claim,
        tolerance_ns_per_m=0.0,
        row=worst,
        row_passed=passed,
        row_margin_ns_per_m=nothing,
        row_frequency_hz=nothing,
        detail=detail,
        outcome=outcome,
    )


def _changing(coupling: Coupling, progress: Progress) -> LevelResult:
    """Judge rows that follow one another; what runs beside the gains, and gains between rows, are told, not judged."""
    table, runtime = coupling.table, coupling.runtime

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        return _level("L8", outcome, claim, np.full(len(table), outcome == "proved"), detail)

    if table.constant:
        return told("proved", "no gains change", {})
    if runtime.state_feedback is not None or runtime.observer_mass_kg is not None or runtime.guard is not None:
        return told("open", "gains that change beside an observer or a guard are not judged", {})
    any_order = _order(coupling, "any", progress)
    found = [any_order]
    if any_order.outcome != "proved":
        found.append(_order(coupling, "neighbours", progress))
    claim = "; ".join(f"{one.outcome}: {one.sentence}" for one in found)
    if coupling.contact == "gated":
        claim += "; behind the gate the same in kept contact"
    claim += "; gains between rows and what happens at the surface are not covered"
    return told(any_order.outcome, claim, {"changes": [one.document() for one in found]})


def _order(coupling: Coupling, order: Order, progress: Progress) -> Changing:
    problem, gains = coupling.problem, coupling.table.gains
    try:
        return prove_changes(problem, gains, order, most_cells=MOST_CELLS, progress=progress)
    except MissingExtraError as missing:
        found = prove_changes(problem, gains, order, most_cells=0, progress=progress)
        return replace(found, sentence=f"{found.sentence}; {missing}")


def _ripple(coupling: Coupling, found: list[Rest], progress: Progress) -> LevelResult:
    """Bound the ripple of gains that do not vary."""

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        passed = np.full(len(found), outcome == "proved")
        return _level("L9", outcome, claim, passed, detail)

    if len(found) > 1:
        return told("open", "gains that vary are not bounded: a change of gains is a disturbance of its own", {})
    if coupling.runtime.observer_mass_kg is not None:
        return told("open", "the observer between encoder steps is not linear", {})
    try:
        bound = bound_ripple(found[0].law, coupling.problem.device, found[0].hand, progress)
    except UnsupportedError as refusal:
        return told("open", str(refusal), {})
    low, high = bound.press_n
    claim = (
        f"in kept contact errors of {1e6 * bound.error_m:.3g} um and friction of {bound.friction_n:.3g} N move every "
        f"hand by at most {1e6 * bound.position_m:.3g} um and the force by at most {bound.force_n:.3g} N (worst "
        f"corner: {1e6 * bound.corners_position_m:.3g} um, {bound.corners_force_n:.3g} N)"
    )
    detail = {"ripple": plain(vars(bound))}
    if high is not None and high <= low:
        return told("open", f"{claim}; at no press are contact and force limit both kept by this bound", detail)
    upper = "" if high is None else f" and below {high:.3g} N"
    return told("proved", f"{claim}; for presses above {low:.3g} N{upper}", detail)


def _gap(coupling: Coupling, found: Rest, progress: Progress) -> WallGap | None:
    """Say what a proof would cost in stiffness; None where the loop is of no kind that is proved."""
    problem, observer = coupling.problem, found.law.state_feedback
    if coupling.contact == "gated" or (observer is not None and observer.dead_zone_m > 0):
        return None
    with progress.step("stiffest wall that is proved"):
        try:
            return wall_gap(
                same_gains(found.law), problem.device, found.hand, 2 * problem.environment.stiffness_n_per_m
            )
        except UnsupportedError:
            return None
