"""The levels on demand, L7 to L9, of the rows of the deployed table: proofs and their summaries."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import MissingExtraError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import rows_text
from avc_casadi._util.units import FORCE, N_PER_M, NEWTON, UM
from avc_casadi.claims.levels import proof_level
from avc_casadi.claims.prove.changing import MOST_CELLS, Changing, Order, prove_changes
from avc_casadi.claims.prove.hands import Outcome
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, promising, prove_rest
from avc_casadi.claims.prove.ripple import bound_ripple
from avc_casadi.claims.prove.walls import WallGap, same_gains, wall_gap
from avc_casadi.claims.stability.declared_device import rigid
from avc_casadi.model.gains import spring_before

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import Certificate, LevelResult
    from avc_casadi.claims.prove.hands import Outcome
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem


SCHEMA = "avc-proof-file/1"


def proof_files(problem: Problem, certificate: Certificate) -> dict[str, dict[str, Any]]:
    """Return the proof files of the requested levels, by name: JSON values.

    Args:
        problem: the problem judged against; its device, wall and hands are in each file.
        certificate: with proofs, as `certify` with ``prove`` gives it.
    """
    spoken_of = {name: getattr(problem, name).model_dump(mode="json") for name in ("device", "environment", "hands")}
    return {
        f"{level}.json": plain(
            {
                "schema": SCHEMA,
                "level": level,
                "outcome": found.outcome,
                "claim": found.claim,
                "problem": spoken_of,
                "proofs": found.detail["proofs"],
            }
        )
        for level, found in certificate.levels.items()
        if "proofs" in found.detail
    }


def ripple_level(coupling: Coupling, found: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Bound the ripple of constant gains: half an encoder step, noise of four times its rms, dry friction.

    Args:
        coupling: the coupling.
        found: its rows with their proofs of rest.
        progress: reported over the boxes.
    """

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        return proof_level("L9", outcome, claim, np.full(len(found), outcome == "proved"), detail)

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
        f"in kept contact errors of {1e6 * bound.error_m:.3g} {UM} and friction of {bound.friction_n:.3g} {NEWTON} "
        f"move every hand by at most {1e6 * bound.position_m:.3g} {UM} and the {FORCE} by at most {bound.force_n:.3g} "
        f"{NEWTON} (worst corner: {1e6 * bound.corners_position_m:.3g} {UM}, {bound.corners_force_n:.3g} {NEWTON})"
    )
    detail = {"ripple": plain(vars(bound))}
    if high is not None and high <= low:
        return told("open", f"{claim}; at no press are contact and {FORCE} limit both kept by this bound", detail)
    upper = "" if high is None else f" and below {high:.3g} {NEWTON}"
    return told("proved", f"{claim}; for presses above {low:.3g} {NEWTON}{upper}", detail)


# Changes of rows times cells of hands: about a minute.
_MOST_CHANGES = 2000


def changes_level(coupling: Coupling, frozen: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Judge gains that change: anywhere in the box of the table, or row by row.

    Args:
        coupling: the coupling.
        frozen: its rows with their proofs of rest.
        progress: reported over the patterns and cells.
    """
    table, runtime = coupling.table, coupling.runtime

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        return proof_level("L8", outcome, claim, np.full(len(table), outcome == "proved"), detail)

    if table.constant:
        unstable = frozen[0].unstable is not None
        return told("refuted", frozen[0].sentence, {}) if unstable else told("proved", "no gains change", {})
    if runtime.state_feedback is not None or runtime.observer_mass_kg is not None or runtime.guard is not None:
        return told("open", "gains that change beside an observer or a guard are not judged", {})
    gains = coupling.table.gains
    whole = _order(coupling, gain_corners(gains), "any", progress)
    if whole.outcome == "proved":
        found = [whole]
        claim = (
            "proved: the gains may change at any speed, each for itself, anywhere within the box that the table spans, "
            f"with every hand of the box, in kept contact ({len(whole.cells)} cells)"
        )
    else:
        found, claim = _rows(coupling, gains, progress)
    if coupling.contact == "gated":
        claim += "; behind the gate the same in kept contact"
    claim += "; the anchor that pays for a change of stiffness and what happens at the surface are not covered"
    return told(found[0].outcome, claim, {"proofs": [one.document() for one in found]})


def _rows(coupling: Coupling, gains: FloatArray, progress: Progress) -> tuple[list[Changing], str]:
    """Judge the rows in any order, with all between neighbours; failing that, one row a sample."""
    pattern = prove_changes(coupling.problem, gains, most_cells=0, progress=progress)
    if pattern.outcome == "open":
        between = _order(coupling, rows_and_between(gains), "any", progress)
        if between.outcome == "proved":
            return [between], f"proved: {between.sentence}; the way from each row to the next is covered"
    stepwise = _order(coupling, gains, "neighbours", progress)
    found = [pattern, stepwise]
    claim = "; ".join(f"{one.outcome}: {one.sentence}" for one in found)
    return found, f"{claim}; gains between rows are not covered"


def _order(coupling: Coupling, gains: FloatArray, order: Order, progress: Progress) -> Changing:
    """Search for a proof; a pattern refutes it only where the gains are rows of the table."""
    problem, rows = coupling.problem, gains.shape[1]
    changes = rows**2 if order == "any" else 3 * rows - 2
    try:
        cells = min(MOST_CELLS, _MOST_CHANGES // changes)
        return prove_changes(problem, gains, order, most_cells=cells, progress=progress)
    except MissingExtraError as missing:
        found = prove_changes(problem, gains, order, most_cells=0, progress=progress)
        return replace(found, sentence=f"{found.sentence}; {missing}")


_WORST_FIRST = ("refuted", "open", "proved")
# Budget of a proof within a second or two.
_FEW_CELLS, _FEW_STEPS = 60_000, 5


def rests(coupling: Coupling, seed: int = 0, progress: Progress = SILENT) -> list[Rest]:
    """Prove or refute rest at each row of the deployed table with constant gains; else give the reason it is open.

    Args:
        coupling: the coupling.
        seed: of drawn hands and of the search for orbits.
        progress: reported over the rows.
    """
    rows = coupling.table.rows
    found = []
    for done, row in enumerate(rows.tolist()):
        with progress.step(f"proof of rest, {done + 1} of {rows_text(len(rows))}"):
            found.append(_of_row(coupling, row, seed, progress))
    return found


def rest_level(coupling: Coupling, found: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Summarise the proofs of all rows; an open one of constant gains with the stiffness that a proof would cost.

    Args:
        coupling: the coupling.
        found: `rests` of it.
        progress: reported over the search for the stiffest wall.
    """
    outcomes = [one.outcome for one in found]
    worst = min(range(len(found)), key=lambda row: _WORST_FIRST.index(outcomes[row]))
    rows = coupling.table.rows
    passed = np.array([outcome == "proved" for outcome in outcomes])
    claim = found[worst].sentence
    if len(found) > 1:
        counts = ", ".join(f"{outcomes.count(one)} {one}" for one in _WORST_FIRST if one in outcomes)
        claim = f"{counts} of {rows_text(len(found))}, each held; the row of {rows[worst, 0]:.5g} Hz: {claim}"
        claim += "; this says nothing of gains that change"
    detail = _detail(found)
    if len(found) == 1 and outcomes[0] == "open" and found[0].multiplier is None:
        gap = _gap(coupling, found[0], progress)
        if gap is not None:
            detail["gap"] = plain(vars(gap))
            claim += (
                f"; with these gains the stiffest wall that is proved has {gap.proved_n_per_m:.4g} {N_PER_M}, the "
                f"stiffest that is linearly stable {gap.linear_n_per_m:.4g} {N_PER_M}"
            )
    return proof_level("L7", outcomes[worst], claim, passed, detail, worst)


def quick_rest_level(coupling: Coupling, progress: Progress = SILENT) -> LevelResult | None:
    """Prove L7 where it takes a second or two: constant gains alone, clipped last, on a rigid device known exactly.

    A device with play is not known exactly. No orbit is searched for: the result is proved, refuted by an unstable
    hand, or open.

    Returns:
        The level; None for any other coupling.
    """
    if not quickly_proved(coupling):
        return None
    law, box = _law(coupling, coupling.table.rows[0].tolist()), _box(coupling)
    with progress.step("proof of rest"):
        found = prove_rest(
            law, coupling.contact, coupling.problem.device, box, most_cells=_FEW_CELLS, orbits=False, progress=progress
        )
    return proof_level("L7", found.outcome, found.sentence, np.array([found.outcome == "proved"]), _detail([found]))


def quickly_proved(coupling: Coupling) -> bool:
    """Return whether `quick_rest_level` judges a coupling."""
    runtime, device, spread = coupling.runtime, coupling.problem.device, coupling.problem.device.range
    alone = runtime.state_feedback is None and runtime.observer_mass_kg is None and runtime.guard is None
    known = (
        rigid(device)
        and not (device.backlash_m or spread.backlash_m)
        and all(ends is None for ends in (spread.mass_kg, spread.damping_ns_per_m, spread.delay_samples))
    )
    return alone and known and coupling.table.constant and coupling.contact == "clip-last"


def promises_rest(coupling: Coupling) -> bool:
    """Return whether a proof of rest is likely, in a fraction of a second; False for what is not quickly proved."""
    if not quickly_proved(coupling):
        return False
    try:
        held = SampledPlantBox(coupling.problem.device, _box(coupling))
        return promising(_law(coupling, coupling.table.rows[0].tolist()), held) > 0
    except UnsupportedError:
        return False


def proved_wall_n_per_m(coupling: Coupling, progress: Progress = SILENT) -> float:
    """Return the largest rendered stiffness at rest for which L7 is proved: 0 where none was.

    Springs are tried in series with the same wall, with the contact damper as given or in proportion.

    Args:
        coupling: one that `quick_rest_level` judges.
        progress: reported over the search.
    """
    law = _law(coupling, coupling.table.rows[0].tolist())
    felt = law.stiffness_at_rest_n_per_m

    def softer(stiffness: float) -> list[ContactLaw]:
        spring = spring_before(coupling.problem, stiffness)
        return [
            replace(law, stiffness_n_per_m=spring, contact_damping_ns_per_m=share * law.contact_damping_ns_per_m)
            for share in dict.fromkeys((1.0, stiffness / felt))
        ]

    with progress.step("stiffest wall that is proved"):
        try:
            gap = wall_gap(
                softer, coupling.problem.device, _box(coupling), felt, steps=_FEW_STEPS, most_cells=_FEW_CELLS
            )
        except UnsupportedError:
            return 0.0
    return gap.proved_n_per_m


def _detail(found: list[Rest]) -> dict[str, Any]:
    return {"proofs": [one.document() for one in found]}


def _law(coupling: Coupling, row: list[float]) -> ContactLaw:
    _, b, k, contact_damping = row
    return ContactLaw.of(coupling.problem, b, k, contact_damping, coupling.runtime.state_feedback)


def _box(coupling: Coupling) -> dict[str, tuple[float, float]]:
    return {name: getattr(coupling.problem.hands, name) for name in HAND}


def _of_row(coupling: Coupling, row: list[float], seed: int, progress: Progress) -> Rest:
    problem, runtime = coupling.problem, coupling.runtime
    law = _law(coupling, row)
    found = prove_rest(law, coupling.contact, problem.device, _box(coupling), seed=seed, progress=progress)
    beside = {
        "the observer between encoder steps is not linear": runtime.observer_mass_kg is not None,
        f"the guard {runtime.guard} changes the {FORCE} by what it has seen": runtime.guard is not None,
    }
    lacking = [reason for reason, there in beside.items() if there]
    if not lacking:
        return found
    without = found.sentence if found.outcome != "open" else f"open, {found.sentence}"
    return replace(found, outcome="open", sentence=f"{'; '.join(lacking)}; without it: {without}")


def _gap(coupling: Coupling, found: Rest, progress: Progress) -> WallGap | None:
    """Return the loss of stiffness for a proof, in words; None where no proof covers the loop."""
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


def gain_corners(gains: FloatArray) -> FloatArray:
    """Return the corners of the box of some rows.

    Args:
        gains: b, k and b_p of the rows, shape (3, rows); infinite is rigid.

    Returns:
        Shape (3, n), n of 1 to 8.
    """
    ends = [np.unique([row.min(), row.max()]) for row in gains]
    return np.stack(np.meshgrid(*ends, indexing="ij")).reshape(3, -1)


def rows_and_between(gains: FloatArray) -> FloatArray:
    """Return rows whose mixtures contain every row and every straight line from one to the next.

    Along the line b and k change by another share than b_p in the three numbers of the loop: between two rows that
    differ in both, coupling and contact damper are mixed crosswise too.

    Args:
        gains: b, k and b_p of the rows in the order of the table, shape (3, rows).

    Returns:
        Shape (3, n), the rows themselves first.
    """
    before, after = gains[:, :-1], gains[:, 1:]
    both = (before[:2] != after[:2]).any(axis=0) & (before[2] != after[2])
    crossed = [np.vstack([one[:2, both], other[2:, both]]) for one, other in ((before, after), (after, before))]
    return np.hstack([gains, *crossed])
