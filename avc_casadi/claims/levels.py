"""Levels of a certificate: what each claims of the rows of a gain table; L0 to L4, passivity of frozen gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi._util.page import worded
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi._util.units import Units
from avc_casadi.claims.impedance import worst_real_impedance
from avc_casadi.claims.level_claims import (
    BandOfOneRow,
    BandOfRows,
    BehindFeedback,
    LevelClaim,
    LevelFinding,
    LevelName,
    MarginFault,
    NegativeStiffness,
    NonIdeality,
    NoProofWithPaperHold,
    NoRowHasGains,
    NotJudged,
    NotMet,
    PassivityClaim,
    PassivityCondition,
    RowFault,
    RowsMissing,
    UnstablePole,
    Unsupported,
)
from avc_casadi.claims.level_detail import HandsDetail, ProofDetail
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.claims.port import CouplingSlack, RenderingSlack, passive_hand, port_worst
from avc_casadi.claims.worst_frequency import RELATIVE_TOLERANCE, lowest_of, worst_margin
from avc_casadi.coupling import Coupling
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE, PlantFamily
from avc_casadi.loops.wall import SampledLoop, fractions, linear_stability, rigid
from avc_casadi.model.corners import device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Model, Problem
from avc_casadi.model.problem_ranges import least_damped

Where = Literal["own", "band", "all"]
"""Frequencies at which a row is judged: its own, a band about it, or all."""


@dataclass(frozen=True)
class Level:
    """Where and with which hold a level is judged.

    Attributes:
        where: frequencies at which a row is judged.
        hold: the model of the hold; None for the problem's.
        any_environment: whether it holds with any passive environment, not with the problem's alone.
        on_demand: whether it is judged on request alone.
    """

    where: Where = "all"
    hold: Model | None = None
    any_environment: bool = False
    on_demand: bool = False


LEVELS = {
    "L0": Level(where="own"),
    "L1": Level(where="band"),
    "L2": Level(hold="paper"),
    "L3": Level(hold="sampled-data"),
    "L4": Level(any_environment=True),
    "L5": Level(),
    "L7": Level(on_demand=True),
}
"""Levels of a certificate, from the weakest claim to the strongest; `present` says what each claims."""


_ROWS_AT_ONCE = 4000
"""Rows of Llewellyn's condition in memory at a time."""


@dataclass(frozen=True)
class Rows:
    """The gains under judgement.

    Attributes:
        problem: the problem judged against.
        frequency_hz: interaction frequencies of all rows, shape (n,).
        present: which rows have gains, shape (n,).
        b: damping of the p present rows, shape (p,), N.s/m.
        k: their stiffness, shape (p,), N/m.
        contact: their contact damping b_p, shape (p,), N.s/m.
    """

    problem: Problem
    frequency_hz: FloatArray
    present: BoolArray
    b: FloatArray
    k: FloatArray
    contact: FloatArray

    def spread(self, values: FloatArray, missing: float = np.nan) -> FloatArray:
        """Return values (p,) of the present rows in an array of all rows, (n,)."""
        of_all_rows = np.full(len(self.present), missing)
        of_all_rows[self.present] = values
        return of_all_rows


@dataclass(frozen=True)
class Subject:
    """What a certificate is about: the gains under judgement, and where.

    Attributes:
        problem: the problem judged against.
        rows: the gains under judgement.
        gains: the table that they come from.
        given: the table, or the coupling with it and its runtime, as it was given.
        draws: hands drawn for L5 in addition to the corners.
        seed: seed of the draws.
        progress: reported over the rows.
    """

    problem: Problem
    rows: Rows
    gains: GainSchedule
    given: GainSchedule | Coupling
    draws: int
    seed: int
    progress: Progress = SILENT

    @property
    def behind_feedback(self) -> bool:
        """Whether the gains run behind an observer with state feedback."""
        return self.gains.state_feedback is not None and bool(self.gains.usable.any())

    @cached_property
    def coupling(self) -> Coupling | None:
        """The deployed table with its runtime; None where no row has gains."""
        if isinstance(self.given, Coupling):
            return self.given.for_problem(self.problem)
        return Coupling.from_schedule(self.problem, self.gains) if self.gains.usable.any() else None


ProofOutcome = Literal["", "proved", "refuted", "open"]
"""Outcome of a proof; empty of a level that is no proof."""


@dataclass(frozen=True, eq=False)
class LevelResult(Document):
    """One level of a certificate; row arrays have shape (n,) in the order of the gains.

    Attributes:
        level: name of the level.
        passed: whether every row meets it.
        margin_ns_per_m: worst margin of all rows; not a number where there is none.
        frequency_hz: frequency of the worst margin.
        model: the model that the claim is made in.
        finding: the claim, or what does not hold.
        units: units of the device, in which its sentence is written.
        tolerance_ns_per_m: rounding granted to the worst margin.
        row: the worst row; None where no row has gains.
        row_passed: whether each row meets it.
        row_margin_ns_per_m: worst margin of each row; not a number for rows without gains.
        row_frequency_hz: frequency of that margin.
        detail: what L5 or L7 finds beyond its margin; None of the others.
        outcome: proved, refuted or open, of a proof; else empty.
    """

    JSON_KEYS: ClassVar = (
        "title",
        ("pass", "passed"),
        ("row_pass", "row_passed"),
        "margin_ns_per_m",
        "frequency_hz",
        "model",
        "claim",
        "tolerance_ns_per_m",
        "row",
        "row_margin_ns_per_m",
        "row_frequency_hz",
        ("refused", "refused_or_none"),
        ("outcome", "outcome_or_none"),
        "rows_failed",
    )

    level: str
    passed: bool
    margin_ns_per_m: float
    frequency_hz: float
    model: Model
    finding: LevelFinding
    units: Units
    tolerance_ns_per_m: float
    row: int | None
    row_passed: BoolArray
    row_margin_ns_per_m: FloatArray
    row_frequency_hz: FloatArray
    detail: HandsDetail | ProofDetail | None = None
    outcome: ProofOutcome = ""

    def __repr__(self) -> str:
        return f"LevelResult({self.level}, {self.word}: {self.claim})"

    @property
    def title(self) -> str:
        """Name of the level, in words."""
        return worded(LevelName(self.level))

    @property
    def claim(self) -> str:
        """The claim, or what does not hold, in words."""
        return worded(self.finding, self.units)

    @property
    def refused(self) -> str:
        """Why it was not judged, in words; empty where it was."""
        return worded(self.finding.refusal, self.units) if isinstance(self.finding, NotJudged) else ""

    @property
    def refused_or_none(self) -> str | None:
        """Why it was not judged; None where it was."""
        return self.refused or None

    @property
    def outcome_or_none(self) -> str | None:
        """Outcome of a proof; None of another level."""
        return self.outcome or None

    @property
    def word(self) -> Literal["pass", "fail", "refused", "proved", "refuted", "open"]:
        """pass, fail, or refused: not judged; of a proof its outcome."""
        if self.outcome:
            return self.outcome
        if isinstance(self.finding, NotJudged):
            return "refused"
        return "pass" if self.passed else "fail"

    @property
    def rows_failed(self) -> int:
        """Number of rows that do not meet it."""
        return int(np.count_nonzero(~self.row_passed))

    def document(self) -> dict[str, Any]:
        """Return JSON values, with those of its detail."""
        detail = {} if self.detail is None else self.detail.document()
        return super().document() | detail


@dataclass(frozen=True, eq=False)
class RowMargins:
    """What a level finds of each of p present rows.

    Attributes:
        passed: whether each meets it, shape (p,).
        margin: worst margin of each, shape (p,), N.s/m or as the level says.
        frequency_hz: frequency of that margin, shape (p,).
        tolerance: rounding granted to it, shape (p,).
        faults: what fails of each row besides a margin; None where it is the margin.
    """

    passed: BoolArray
    margin: FloatArray
    frequency_hz: FloatArray
    tolerance: FloatArray
    faults: list[RowFault | None] | None = None

    @property
    def worst(self) -> int:
        """The row of the lowest margin among those that fail, or else among all."""
        return int(np.argmin(self.margin if self.passed.all() else np.where(self.passed, np.inf, self.margin)))

    def fault(self, row: int) -> RowFault:
        """Return what fails of a row."""
        beside_margin = self.faults[row] if self.faults else None
        return beside_margin or MarginFault(float(self.margin[row]), float(self.frequency_hz[row]))


def level_result(rows: Rows, level: str, model: Model, claim: LevelClaim, margins: RowMargins) -> LevelResult:
    """Summarise the present rows by the worst of them.

    Args:
        rows: the gains under judgement, p of them present.
        level: name of the level.
        model: the model that the claim is made in.
        claim: the claim, if it passes.
        margins: what each present row has.
    """
    row_passed = rows.spread(margins.passed.astype(np.float64), 0.0) > 0
    missing = int(np.count_nonzero(~rows.present))
    failed = int(np.count_nonzero(~margins.passed))
    count = len(margins.passed)
    if count == 0:
        return unjudged(rows, level, model, NoRowHasGains(missing))
    worst = margins.worst
    row = int(np.flatnonzero(rows.present)[worst])
    finding: LevelFinding = claim
    if failed:
        finding = NotMet(failed, count, missing, float(rows.frequency_hz[row]), margins.fault(worst))
    elif missing:
        finding = RowsMissing(missing, claim)
    finite = np.isfinite(margins.margin[worst])
    return LevelResult(
        level=level,
        passed=failed == 0 and missing == 0,
        margin_ns_per_m=float(margins.margin[worst]) if finite else np.nan,
        frequency_hz=float(margins.frequency_hz[worst]),
        model=model,
        finding=finding,
        units=rows.problem.units,
        tolerance_ns_per_m=float(margins.tolerance[worst]),
        row=row,
        row_passed=row_passed,
        row_margin_ns_per_m=rows.spread(margins.margin),
        row_frequency_hz=rows.spread(margins.frequency_hz),
    )


def unjudged(rows: Rows, level: str, model: Model, finding: LevelFinding) -> LevelResult:
    """Return a level of which no row is judged, for the reason in `finding`; it is not met."""
    nothing = np.full(len(rows.present), np.nan)
    present = np.flatnonzero(rows.present)
    return LevelResult(
        level=level,
        passed=False,
        margin_ns_per_m=np.nan,
        frequency_hz=np.nan,
        model=model,
        finding=finding,
        units=rows.problem.units,
        tolerance_ns_per_m=np.nan if len(present) else 0.0,
        row=int(present[0]) if len(present) else None,
        row_passed=np.zeros(len(rows.present), dtype=bool),
        row_margin_ns_per_m=nothing,
        row_frequency_hz=nothing,
    )


def passivity_level(subject: Subject, level: str) -> LevelResult:
    """Return a level of passivity, L0 to L4, of the rows: Re Z_h >= 0 where the level asks for it, or Llewellyn's.

    It is refused behind state feedback, and where the device has no exact method for it.
    """
    rows = subject.rows
    claim = LEVELS[level]
    model = claim.hold or subject.problem.stability.model
    device = subject.problem.device
    if subject.behind_feedback:
        return unjudged(rows, level, subject.problem.stability.model, NotJudged(BehindFeedback()))
    try:
        if ideal(device):
            return _exact(rows, level, model, subject.progress)
        if claim.where != "all":
            return _in_band(rows, level, model)
        if model == "paper":
            return unjudged(rows, level, model, NotJudged(NoProofWithPaperHold(level, non_idealities(device))))
        return _at_port(rows, level, subject.progress)
    except UnsupportedError as error:
        return unjudged(rows, level, model, NotJudged(Unsupported(str(error))))


def _exact(rows: Rows, level: str, model: Model, progress: Progress) -> LevelResult:
    """Return a level of passivity on an ideal device, at each end of the range of its delay, by exact formulas."""
    # Re Z_h grows with the device's damping, so that the lower end of its range covers the others.
    problem = least_damped(rows.problem)
    band = _band(rows, LEVELS[level].where)
    any_environment = LEVELS[level].any_environment
    whole = LEVELS[level].where == "all"
    sound = np.ones(len(rows.b), dtype=bool)
    faults = None
    worst_of_delays = []
    for delay in sorted({corner.delay_samples for corner in PlantFamily.of(problem).devices}):
        loop = replace(SampledLoop.of(problem, model), delay_samples=delay)
        if any_environment:
            worst_of_delays.append(_llewellyn(rows, loop, progress))
            continue
        band_hz = band.low_hz, band.high_hz
        worst = worst_margin(loop, rows.b, rows.k, rows.contact, band_hz, progress=progress)
        worst_of_delays.append([worst.margin_ns_per_m, worst.frequency_hz, worst.tolerance_ns_per_m])
        if whole:
            # Poles and residue are conditions of a rendering as a whole; other claims are on Re Z_h alone.
            sound = worst.poles_stable & (worst.dc_stiffness_n_per_m >= 0)
            faults = _faults(~worst.poles_stable, worst.dc_stiffness_n_per_m)
    margin, frequency, tolerance = lowest_of(worst_of_delays)
    passed = sound & (margin >= -tolerance)
    claim = PassivityClaim(_condition(level), model, band.stated)
    return level_result(rows, level, model, claim, RowMargins(passed, margin, frequency, tolerance, faults))


def _condition(level: str) -> PassivityCondition:
    """Return what a level claims."""
    if LEVELS[level].any_environment:
        return PassivityCondition.LLEWELLYN
    return PassivityCondition.PASSIVE if LEVELS[level].where == "all" else PassivityCondition.REAL_PART


def _llewellyn(rows: Rows, loop: SampledLoop, progress: Progress) -> list[FloatArray]:
    """Return the least of Llewellyn's margin of each present row, N.s/m, its frequency and tolerance, each (p,)."""
    parts = [
        llewellyn_margin(loop, rows.b[part], rows.k[part], rows.contact[part])
        for part in chunks(len(rows.b), _ROWS_AT_ONCE, progress, "Llewellyn")
    ]
    margin, frequency = (np.concatenate(column) for column in zip(*parts, strict=True))
    size = loop.device_damping_ns_per_m + rows.contact + np.abs(margin)
    return [margin, frequency, np.where(np.isfinite(margin), RELATIVE_TOLERANCE * size, 0.0)]


@dataclass(frozen=True)
class _Band:
    """The band in which each of p present rows is judged, and how a claim states it; None for every frequency."""

    low_hz: FloatArray
    high_hz: FloatArray
    stated: BandOfRows | BandOfOneRow | None


def _band(rows: Rows, where: Where) -> _Band:
    """Return the band, Hz, in which each present row is judged: its own frequency, or over and times the band factor.

    At `all` it is from 0 on. A table of one row has the band of the problem's frequencies.
    """
    factor = rows.problem.stability.band_factor if where == "band" else 1.0
    row_hz = rows.frequency_hz[rows.present]
    if where == "all":
        return _Band(np.zeros(len(row_hz)), np.full(len(row_hz), np.inf), None)
    if len(rows.present) > 1:
        return _Band(row_hz / factor, row_hz * factor, BandOfRows(factor))
    run_hz = rows.problem.frequencies_hz()
    low_hz = float(run_hz.min()) / factor
    high_hz = float(run_hz.max()) * factor
    return _Band(np.full(len(row_hz), low_hz), np.full(len(row_hz), high_hz), BandOfOneRow(low_hz, high_hz))


def _in_band(rows: Rows, level: str, model: Model) -> LevelResult:
    """Return a level of Re Z_h >= 0 in each row's band, at the handle of a device with all that it declares."""
    band = _band(rows, LEVELS[level].where)
    parts = fractions(SampledLoop.of(rows.problem, model), rows.b, rows.k)
    corners = PlantFamily.of(rows.problem).devices
    worst = worst_real_impedance(corners, parts, rows.contact, band.low_hz, band.high_hz, model)
    claim = PassivityClaim(_condition(level), model, band.stated, len(corners))
    margins = RowMargins(worst.passed, worst.margin_ns_per_m, worst.frequency_hz, worst.tolerance_ns_per_m)
    return level_result(rows, level, model, claim, margins)


def _at_port(rows: Rows, level: str, progress: Progress) -> LevelResult:
    """Return a level of passivity at every frequency, at the handle of a device with all that it declares.

    The slack is that of the rendering, or for any passive environment that of the coupling. A row passes where it is
    also stable with one passive hand, and for this environment has no negative stiffness.
    """
    # A constant coupling repeats one row.
    gains = np.stack([rows.b, rows.k, rows.contact])
    (b, k, contact), distinct_row = np.unique(gains, axis=1, return_inverse=True)
    distinct_row = distinct_row.ravel()
    parts = fractions(SampledLoop.of(rows.problem, "sampled-data"), b, k)
    corners = PlantFamily.of(rows.problem).devices
    sample_time_s = rows.problem.device.sample_time_s
    any_environment = LEVELS[level].any_environment
    slack = CouplingSlack(b, k, contact, sample_time_s) if any_environment else RenderingSlack(parts, contact)
    worst = port_worst(corners, slack, len(b), progress)
    # For any passive wall the DC stiffness of this one is no condition.
    stiffness = np.zeros(len(distinct_row)) if any_environment else (parts.integral / sample_time_s)[distinct_row]
    stable = np.array(parts.stable, dtype=bool)
    law = parts.law(contact, sample_time_s)
    for device in corners:  # with one passive hand, and so with any where the port is passive
        stable &= linear_stability(device, law, passive_hand(device)).radius[:, 0] < 1 - RADIUS_TOLERANCE
    passive = worst.passed[distinct_row]
    passed = passive & stable[distinct_row] & (stiffness >= 0)
    claim = PassivityClaim(_condition(level), "sampled-data", corners=len(corners))
    beside_margin = _faults(stiffness >= 0, stiffness)
    faults = [fault if is_passive else None for fault, is_passive in zip(beside_margin, passive, strict=True)]
    margins = RowMargins(
        passed=passed,
        margin=worst.margin_ns_per_m[distinct_row],
        frequency_hz=worst.frequency_hz[distinct_row],
        tolerance=worst.tolerance_ns_per_m[distinct_row],
        faults=faults,
    )
    return level_result(rows, level, "sampled-data", claim, margins)


def _faults(unstable: BoolArray, dc_n_per_m: FloatArray) -> list[RowFault | None]:
    """Return what fails of each row besides its margin: a pole that grows or a negative stiffness; None of nothing."""

    def fault(*, grows: bool, dc: float) -> RowFault | None:
        if grows:
            return UnstablePole()
        return NegativeStiffness(dc) if dc < 0 else None

    return [fault(grows=grows, dc=dc) for grows, dc in zip(unstable, dc_n_per_m.tolist(), strict=True)]


def ideal(device: Device) -> bool:
    """Return whether a device is rigid, with an ideal amplifier and whole samples of delay: levels in closed form."""
    delays = [corner.delay_samples for corner in device_corners(device, ("delay_samples",))]
    return rigid(device) and all(delay == int(delay) for delay in delays)


def non_idealities(device: Device) -> tuple[NonIdeality, ...]:
    """Return what makes a device not ideal: amplifier, resonance, a delay of a part of a sample."""
    late = any(corner.delay_samples % 1 for corner in device_corners(device, ("delay_samples",)))
    declared = {
        NonIdeality.AMPLIFIER: device.amplifier_bandwidth_hz is not None,
        NonIdeality.RESONANCE: device.resonance is not None,
        NonIdeality.PART_OF_SAMPLE: late,
    }
    return tuple(name for name, is_declared in declared.items() if is_declared)
