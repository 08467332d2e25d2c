"""Certification of a gain table: one claim a level, each with its worst margin, whatever the design method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.counts import IN_MEMORY, Count, refuse_counts, seed_count
from avc_casadi._util.json_values import Document, plain
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.hands import hands_level
from avc_casadi.claims.level_claims import RestFinding
from avc_casadi.claims.level_detail import ProofDetail
from avc_casadi.claims.levels import LEVELS, LevelResult, Rows, Subject, passivity_level
from avc_casadi.claims.prove.grounds import BeyondProof
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, promising, prove_rest
from avc_casadi.coupling import Coupling, check_sample_time, require_coupling
from avc_casadi.files.problem_file import AnyProblem, accepts_problem, require_wall
from avc_casadi.loops.wall import PartialFractions, SampledLoop, fractions, frozen_parts, passive_limit_n_per_m, rigid
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Tabular, Document):
    """Passivity and stability of a gain table: one claim a level, with its worst margin. The levels are never merged.

    L0 to L3 ask for Re Z_h >= 0 at the handle, Z_h = Z_d + H (Z_eavc + b_p): at a row's own frequency, the paper's
    (12), in a band about it, and at all frequencies with the paper's hold and with the sampled-data one (Colgate and
    Schenkel 1997). L4 is Llewellyn's (6), for any passive wall, and L5 the spectral radius with every hand below 1.

    Attributes:
        problem: name of the problem.
        requested: whether the infeasible gains of unrealisable rows were judged in place of missing ones.
        frequency_hz: interaction frequencies of the rows, shape (n,).
        rows_without_gains: number of rows without gains; each fails every level.
        levels: results by level.
        passive_limit_n_per_m: 2 b_d/((1 + d) T) at the worst of the ranges: the largest DC stiffness of any passive
            linear rendering; not a number where none is known.
        dc_stiffness_n_per_m: DC stiffness k k_e/(k + k_e) of each row, shape (n,).
        definition: the problem judged against, for ``print``.
        gains: the judged gains.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> f"{certificate.levels['L0'].margin_ns_per_m:.2f} N.s/m"
        '2.04 N.s/m'
    """

    JSON_KEYS: ClassVar = (
        "problem",
        "frequency_hz",
        "rows_without_gains",
        "passive_limit_n_per_m",
        "dc_stiffness_n_per_m",
        "judged",
        "levels",
    )

    problem: str
    requested: bool
    frequency_hz: FloatArray
    rows_without_gains: int
    levels: dict[str, LevelResult]
    passive_limit_n_per_m: float
    dc_stiffness_n_per_m: FloatArray
    definition: Problem
    gains: GainSchedule | Coupling

    def to_dict(self) -> Columns:
        """Return the levels as columns, each of shape (levels,)."""
        levels = self.levels.values()
        columns = ("level", "passed", "margin_ns_per_m", "frequency_hz", "model", "rows_failed", "claim")
        values = {name: np.array([getattr(result, name) for result in levels]) for name in columns}
        return values | {"title": np.array([result.title for result in levels])}

    @property
    def judged(self) -> str:
        """Which gains were judged."""
        return "requested gains" if self.requested else "gains"

    def _summary(self) -> str:
        marks = ", ".join(f"{level} {result.word}" for level, result in self.levels.items())
        return f"{self.problem!r}, {self.judged} of {len(self.frequency_hz)} rows: {marks}"


def _rows(problem: Problem, gains: GainSchedule, *, requested: bool = False) -> Rows:
    """Return the gains b, k and b_p under judgement: those that run, or where ``requested`` those asked for.

    Rows without gains are marked as absent; infinite b or k count as a rigid coupling, but not behind state feedback.
    """
    b = gains.requested_damping_ns_per_m if requested else gains.damping_ns_per_m
    k = gains.requested_stiffness_n_per_m if requested else gains.stiffness_n_per_m
    contact = gains.requested_contact_damping_ns_per_m if requested else gains.contact_damping_ns_per_m
    # A rigid spring or damper is a meaningful limit, but not behind state feedback; an infinite contact damper is not.
    present = ~(np.isnan(b) | np.isnan(k)) & np.isfinite(contact)
    if gains.state_feedback is not None:
        present &= np.isfinite(b) & np.isfinite(k)
    return Rows(problem, gains.frequency_hz, present, b[present], k[present], contact[present])


@accepts_problem
def certify(
    problem: AnyProblem,
    gains: GainSchedule | Coupling,
    *,
    requested: bool = False,
    draws: int = 24,
    seed: int = 0,
    prove: bool = False,
    progress: Progress = SILENT,
) -> Certificate:
    """Return the certificate of a gain table: passivity and stability claims, with the worst margin of each.

    Args:
        problem: device, environment, models and hands to judge against; or a problem file, or a name of the catalogue.
        gains: the table, or the coupling with it; rows without gains fail every level.
        requested: judge the infeasible gains of unrealisable rows as well. Rows with an infinite gain are judged as a
            rigid coupling.
        draws: hands drawn for L5 in addition to the corners of the range.
        seed: seed of the draws.
        prove: request the proof of rest (L7) of the deployed table with its runtime, seconds a row: proved, refuted or
            open, with the reason. Proofs and witnesses are in the detail of the level as ``proofs`` and can be read
            again (`avc_casadi.claims.prove.rest.Rest`). ``avc certify --help`` says for which devices and laws.
        progress: reported over the rows that are judged.

    Returns:
        The certificate; ``levels[name]`` has ``passed``, ``margin_ns_per_m``, the frequency of that margin, and the
        same by row, shape (n,).

    Raises:
        InputError: gains of another sample time, a count out of its range, or neither a table nor a coupling.
        UnsupportedError: a delay that a level takes in whole samples only.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> [name for name, level in certificate.levels.items() if not level.passed]
        ['L4']
    """
    refuse_counts(Count("draws", draws, 0, IN_MEMORY), seed_count(seed))
    stated = require_wall(problem)
    table = _schedule_of(gains)
    check_sample_time(table.sample_time_s, stated, f"gains by {table.method} for {table.problem}")
    behind_feedback = table.state_feedback is not None and bool(table.usable.any())
    requested = requested and not behind_feedback
    rows = _rows(stated, table, requested=requested)
    return _judge(Subject(stated, rows, table, gains, draws, seed, progress), requested=requested, prove=prove)


def _judge(subject: Subject, *, requested: bool, prove: bool) -> Certificate:
    """Return the certificate of gains at every level; at those on demand only where a proof is requested."""
    judge = {name: partial(passivity_level, level=name) for name in LEVELS} | {"L5": hands_level, "L7": rest_level}
    return Certificate(
        problem=subject.problem.name,
        requested=requested,
        frequency_hz=subject.gains.frequency_hz,
        rows_without_gains=int(np.count_nonzero(~subject.rows.present)),
        levels={name: judge[name](subject) for name, level in LEVELS.items() if prove or not level.on_demand},
        passive_limit_n_per_m=passive_limit_n_per_m(subject.problem.device),
        dc_stiffness_n_per_m=_dc_stiffness_n_per_m(subject),
        definition=subject.problem,
        gains=subject.given,
    )


def _dc_stiffness_n_per_m(subject: Subject) -> FloatArray:
    """Return what each row renders at rest, k k_e/(k + k_e), N/m, shape (n,); not a number for rows without gains.

    The rendered impedance has the term r/(z - 1), r in N.s/m, which at rest is the spring r/T, T the sample time.
    """
    problem = subject.problem
    rows = subject.rows
    parts_of = frozen_parts if subject.behind_feedback else _sampled_parts
    return rows.spread(parts_of(problem, rows.b, rows.k).integral / problem.device.sample_time_s)


def _schedule_of(gains: GainSchedule | Coupling) -> GainSchedule:
    """Return the table itself, or that of a coupling; InputError for neither."""
    if isinstance(gains, GainSchedule):
        return gains
    require_coupling(gains)
    return gains.schedule


def _sampled_parts(problem: Problem, b: FloatArray, k: FloatArray) -> PartialFractions:
    """Return the rendering of rows of gains without an observer."""
    return fractions(SampledLoop.of(problem), b, k)


def proof_files(problem: Problem, certificate: Certificate) -> dict[str, dict[str, Any]]:
    """Return the proof files by name: of each level with proofs of its rows (L7) these and its claim, as JSON."""
    tables = {name: getattr(problem, name).model_dump(mode="json") for name in ("device", "environment", "hands")}
    return {
        f"{level}.json": plain(
            {
                "schema": "avc-proof-file/1",
                "level": level,
                "outcome": result.outcome,
                "claim": result.claim,
                "problem": tables,
                "proofs": result.detail.proofs,
            }
        )
        for level, result in certificate.levels.items()
        if isinstance(result.detail, ProofDetail)
    }


@dataclass(frozen=True)
class _RowProgress(Progress):
    """Progress of the proof of one of several rows: rows count, and its own share is a word."""

    whole: Progress
    done: int
    rows: int

    def advance(self, done: int, total: int, part: str = "") -> None:
        """Report the rows that are done, and the share of the present one."""
        share = f", {100 * done // total} % of the next {part}" if part else ""
        self.whole.advance(self.done, self.rows, f"rows{share}")


def rest_level(subject: Subject) -> LevelResult:
    """Return L7: rest proved, refuted or open at each row of the deployed table with constant gains.

    Each row has the reason where it is open. The level is as good as its worst row.
    """
    coupling = subject.coupling
    if coupling is None:
        return _rest_result([], RestFinding(), subject.problem, subject.gains.rows)
    rows = coupling.table.rows
    rests = []
    with subject.progress.step("proof of rest"):
        for done, row in enumerate(rows.tolist()):
            progress = subject.progress
            if len(rows) > 1:
                progress = _RowProgress(subject.progress, done, len(rows))
                # A row of which nothing is verified counts too.
                progress.advance(0, 1)
            rests.append(_of_row(coupling, row, subject.seed, progress))
    outcomes = [rest.outcome for rest in rests]
    worst_first = ("refuted", "open", "proved")
    worst = min(range(len(rests)), key=lambda row: worst_first.index(outcomes[row]))
    finding = RestFinding(tuple(outcomes), rests[worst], float(rows[worst, 0]))
    return _rest_result(rests, finding, subject.problem, len(rests), worst)


_QUICK_CELLS = 60_000
"""Cells of a proof that takes a second or two."""


def quick_rest_level(coupling: Coupling, progress: Progress = SILENT) -> LevelResult | None:
    """Prove L7 where it takes a second or two: constant gains alone, clipped last, on a rigid device known exactly."""
    if not admits_quick_proof(coupling):
        return None
    law = _law(coupling, coupling.table.rows[0].tolist())
    device = coupling.problem.device
    with progress.step("proof of rest"):
        rest = prove_rest(law, coupling.contact, device, _box(coupling), most_cells=_QUICK_CELLS, progress=progress)
    return _rest_result([rest], RestFinding((rest.outcome,), rest), coupling.problem, 1)


def admits_quick_proof(coupling: Coupling) -> bool:
    """Return whether a proof of rest takes a second or two: constant gains alone, on a rigid device known exactly.

    The force is to be clipped last, and there is no play, observer, law or guard.
    """
    runtime = coupling.runtime
    device = coupling.problem.device
    ranges = device.range
    gains_alone = runtime.state_feedback is None and runtime.observer_mass_kg is None and runtime.guard is None
    without_play = not (device.backlash_m or ranges.backlash_m)
    known_exactly = all(ends is None for ends in (ranges.mass_kg, ranges.damping_ns_per_m, ranges.delay_samples))
    known = rigid(device) and without_play and known_exactly
    return gains_alone and known and coupling.table.constant and coupling.contact == "clip-last"


def promises_rest(coupling: Coupling) -> bool:
    """Return whether a proof of rest is likely, in a fraction of a second; False for what is not quickly proved."""
    if not admits_quick_proof(coupling):
        return False
    try:
        held = SampledPlantBox(coupling.problem.device, _box(coupling))
        return promising(_law(coupling, coupling.table.rows[0].tolist()), held) > 0
    except UnsupportedError:
        return False


def _rest_result(rests: list[Rest], finding: RestFinding, problem: Problem, rows: int, worst: int = 0) -> LevelResult:
    """Return the level L7 of proofs of rest of rows, `worst` the place of the worst; a proof has no margin."""
    nothing = np.full(rows, np.nan)
    passed = np.zeros(rows, dtype=bool)
    passed[: len(rests)] = [rest.outcome == "proved" for rest in rests]
    return LevelResult(
        level="L7",
        passed=bool(passed.all()),
        margin_ns_per_m=np.nan,
        frequency_hz=np.nan,
        model="sampled-data",
        finding=finding,
        units=problem.units,
        tolerance_ns_per_m=0.0,
        row=worst,
        row_passed=passed,
        row_margin_ns_per_m=nothing,
        row_frequency_hz=nothing,
        detail=ProofDetail(tuple(rest.document() for rest in rests)),
        outcome="open" if finding.worst is None else finding.worst.outcome,
    )


def _law(coupling: Coupling, row: list[float]) -> ContactLaw:
    """Return the law of one row (f, b, k, b_p) of a coupling's table."""
    _, b, k, contact_damping = row
    return ContactLaw.of(coupling.problem, b, k, contact_damping, coupling.runtime.state_feedback)


def _box(coupling: Coupling) -> dict[str, tuple[float, float]]:
    """Return the ranges of the hand, by name."""
    return {name: getattr(coupling.problem.hands, name) for name in HAND}


def _of_row(coupling: Coupling, row: list[float], seed: int, progress: Progress) -> Rest:
    """Return the proof of rest of one row; open where the runtime does what the proof does not know."""
    problem = coupling.problem
    runtime = coupling.runtime
    law = _law(coupling, row)
    rest = prove_rest(law, coupling.contact, problem.device, _box(coupling), seed=seed, progress=progress)
    observer = runtime.observer_mass_kg is not None
    if not observer and runtime.guard is None:
        return rest
    return replace(rest, outcome="open", ground=BeyondProof(observer, runtime.guard, rest.outcome, rest.ground))
