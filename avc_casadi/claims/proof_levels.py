"""The level on demand, L7, of the rows of the deployed table: proofs and their summary."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.levels import LevelResult
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, promising, prove_rest
from avc_casadi.loops.wall import rigid

if TYPE_CHECKING:
    from avc_casadi.claims.certify import Certificate
    from avc_casadi.claims.levels import Judged
    from avc_casadi.claims.prove.rest import Outcome
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem


SCHEMA = "avc-proof-file/1"


def proof_files(problem: Problem, certificate: Certificate) -> dict[str, dict[str, Any]]:
    """Return the proof files of the requested levels, by name: JSON values."""
    tables = {name: getattr(problem, name).model_dump(mode="json") for name in ("device", "environment", "hands")}
    return {
        f"{level}.json": plain(
            {
                "schema": SCHEMA,
                "level": level,
                "outcome": found.outcome,
                "claim": found.claim,
                "problem": tables,
                "proofs": found.detail["proofs"],
            }
        )
        for level, found in certificate.levels.items()
        if "proofs" in found.detail
    }


_WORST_FIRST = ("refuted", "open", "proved")
# Budget of a proof within a second or two.
_FEW_CELLS = 60_000


def rest_level(judged: Judged) -> LevelResult:
    """Prove or refute rest at each row of the deployed table with constant gains; else give the reason it is open."""
    coupling = judged.coupling
    if coupling is None:
        return _level([], "open", "no row has gains", np.zeros(judged.gains.rows, dtype=bool))
    rows = coupling.table.rows
    found = []
    for done, row in enumerate(rows.tolist()):
        with judged.progress.step(f"proof of rest, {done + 1} of {len(rows)} rows"):
            found.append(_of_row(coupling, row, judged.seed, judged.progress))
    outcomes = [one.outcome for one in found]
    worst = min(range(len(found)), key=lambda row: _WORST_FIRST.index(outcomes[row]))
    claim = found[worst].sentence
    if len(found) > 1:
        counts = ", ".join(f"{outcomes.count(one)} {one}" for one in _WORST_FIRST if one in outcomes)
        claim = f"{counts} of {len(found)} rows, each held; the row of {rows[worst, 0]:.5g} Hz: {claim}"
        claim += "; this says nothing of gains that change"
    passed = np.array([outcome == "proved" for outcome in outcomes])
    return _level(found, outcomes[worst], claim, passed, worst)


def quick_rest_level(coupling: Coupling, progress: Progress = SILENT) -> LevelResult | None:
    """Prove L7 where it takes a second or two: constant gains alone, clipped last, on a rigid device known exactly."""
    if not quickly_proved(coupling):
        return None
    law, box = _law(coupling, coupling.table.rows[0].tolist()), _box(coupling)
    with progress.step("proof of rest"):
        found = prove_rest(
            law, coupling.contact, coupling.problem.device, box, most_cells=_FEW_CELLS, progress=progress
        )
    return _level([found], found.outcome, found.sentence, np.array([found.outcome == "proved"]))


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


def _level(found: list[Rest], outcome: Outcome, claim: str, passed: BoolArray, worst: int = 0) -> LevelResult:
    """Return L7 of rows of the deployed table; a proof has no margin."""
    nothing = np.full(len(passed), np.nan)
    return LevelResult(
        level="L7",
        passed=bool(passed.all()),
        margin_ns_per_m=np.nan,
        frequency_hz=np.nan,
        model="sampled-data",
        claim=claim,
        tolerance_ns_per_m=0.0,
        row=worst,
        row_passed=passed,
        row_margin_ns_per_m=nothing,
        row_frequency_hz=nothing,
        detail={"proofs": [one.document() for one in found]},
        outcome=outcome,
    )


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
        f"the guard {runtime.guard} changes the force by what it has seen": runtime.guard is not None,
    }
    lacking = [reason for reason, there in beside.items() if there]
    if not lacking:
        return found
    without = found.sentence if found.outcome != "open" else f"open, {found.sentence}"
    return replace(found, outcome="open", sentence=f"{'; '.join(lacking)}; without it: {without}")
