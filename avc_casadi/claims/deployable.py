"""Deployable: whether a coupling may be deployed on a device, and which claim fails otherwise; one definition.

Linearly stable with every hand of [hands] and released, over all of [device.range], on the loop of the device as
declared, at the table's rows and between them; with state feedback for any gain of its dead zone and of its clip,
without a nonlinear observer. The disk margin is 0.15 or what [robustness] asks for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, ClassVar, Literal
from weakref import WeakKeyDictionary

import numpy as np

from avc_casadi._errors import NotDeployableError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi._util.page import Worded, worded
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import Units
from avc_casadi.claims.certify import Certificate, certify
from avc_casadi.claims.hands import worst_case_behind_observer, worst_case_over_hands
from avc_casadi.claims.level_claims import DetentsBehindFeedback, Unsupported, WhyNotJudged
from avc_casadi.claims.levels import LevelResult
from avc_casadi.coupling import Coupling, require_coupling
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, OpenLoop
from avc_casadi.loops.plant_family import PlantFamily, WorstCase
from avc_casadi.loops.stable_walls import damping_range, in_contact, stiffest_wall
from avc_casadi.loops.wall import frozen_law
from avc_casadi.model.gains import GainTable
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime

# Verbs judge before they push, export or report; the numbers are part of the key, as arrays are mutable. Tables are
# compared by value: equal gains with different runtimes need separate entries.
_VERDICTS: WeakKeyDictionary[GainTable, list[tuple[Problem, Runtime, bytes, Deployable]]] = WeakKeyDictionary()


ClaimName = Literal[
    "hands", "let-go", "dead-zone", "clip", "detent", "detent-hands", "detent-let-go", "disk-margin", "renders"
]
"""Claims of a verdict, by the names of its document."""

# So many verdicts are kept of a table.
_KEPT_VERDICTS = 32
# A disk margin that is this share of a required one is taken for it.
_TAKEN_FOR_REQUIRED = 0.97
# Imaginary part of a pole below which it does not swing but for rounding.
_NO_SWING = 1e-6


class ClaimRemedy(Worded, Enum):
    """What to do where a claim fails."""

    RECOMMEND_OR_SOFTEN = auto()
    """Take the recommended coupling, or soften the wall."""
    RECOMMEND_OR_LESS_MARGIN = auto()
    """Take the recommended coupling, soften the wall, or require a smaller disk margin."""
    WITHOUT_FEEDBACK = auto()
    """Take a coupling without state feedback."""
    WITHOUT_REALISM = auto()
    """Take a softer wall, a shorter sample time, or a method without the realism condition."""
    LESS_DELAY = auto()
    """Shorten the delay, or analyse the loop by other means."""


@dataclass(frozen=True)
class DetentRemedy(Worded):
    """What to do about unstable detents: give them a damping, or a smaller slope.

    Attributes:
        lowest_ns_per_m: smallest damping with which their slope is stable; not a number where none is.
        highest_ns_per_m: largest one.
        steepest_n_per_m: steepest slope that some damping stabilises.
    """

    lowest_ns_per_m: float
    highest_ns_per_m: float
    steepest_n_per_m: float


@dataclass(frozen=True, kw_only=True)
class DeployClaim(Worded, Document):
    """One claim that a deployable coupling meets; a subclass has what was judged.

    Attributes:
        name: name of the claim.
        passed: whether it holds.
        units: units of the device, in which its sentence is written.
        remedy: what to do where it fails.
        radius: largest spectral radius; not a number where the claim is on something else.
        without_observer: whether it was judged without the observer, which is not linear.
    """

    JSON_KEYS: ClassVar = ("name", ("pass", "passed"), "sentence", "advice", ("spectral_radius", "radius"))

    name: ClaimName
    passed: bool
    units: Units
    remedy: ClaimRemedy | DetentRemedy | None = ClaimRemedy.RECOMMEND_OR_SOFTEN
    radius: float = math.nan
    without_observer: bool = False

    @property
    def sentence(self) -> str:
        """The claim in words, or what does not hold."""
        return worded(self, self.units)

    @property
    def advice(self) -> str:
        """What to do, in words; empty where the claim holds."""
        return "" if self.passed or self.remedy is None else worded(self.remedy, self.units)


@dataclass(frozen=True, kw_only=True)
class StabilityClaim(DeployClaim):
    """Linear stability of the loop, of all judged gains.

    Attributes:
        worst: the worst loop.
        corners: corner hands that were tried before the search; None where the worst was found by search alone.
        frequency_hz: frequency of the gains of the worst loop.
        judged: number of gains that were judged.
        failed: number of gains that are unstable.
        ranges: keys of the device that have a range.
        in_detents: whether the loops are those in the wall with its detents.
    """

    worst: WorstCase
    corners: int | None = None
    frequency_hz: float = math.nan
    judged: int = 1
    failed: int = 0
    ranges: tuple[str, ...] = ()
    in_detents: bool = False


@dataclass(frozen=True, kw_only=True)
class DiskMarginClaim(DeployClaim):
    """A disk margin that is too small."""

    margin: float
    least: float


@dataclass(frozen=True, kw_only=True)
class NotJudgedClaim(DeployClaim):
    """A claim that is not judged.

    Attributes:
        refusal: why.
    """

    refusal: WhyNotJudged


@dataclass(frozen=True, kw_only=True)
class NothingRenderedClaim(DeployClaim):
    """Gains of 0, which render nothing of the wall."""


@dataclass(frozen=True, kw_only=True)
class DetentClaim(DeployClaim):
    """Linear stability in the valleys of detents, and of what leaves their tops.

    Attributes:
        slope_n_per_m: steepest slope of the detents, of both signs.
        damping_ns_per_m: their damping.
        in_valley: whether the loops in a valley are stable.
        held: hands of the corners, one of them none, that hold a top.
        hands: number of these hands.
        leaves_s: time in which the quickest of the others leaves a top by a factor e; not a number where all hold it.
    """

    slope_n_per_m: float
    damping_ns_per_m: float
    in_valley: bool
    held: int
    hands: int
    leaves_s: float


@dataclass(frozen=True)
class Deployable(Worded, Document):
    """Whether a coupling may be deployed, with the deciding claims.

    Attributes:
        claims: each claim with its result.
        disk_margin: the smallest of corner hands and released, of the gains at rest; not a number where a claim fails.

    Example:
        >>> problem = avc.load_problem("soft")
        >>> coupling = avc.Coupling.from_schedule(problem, avc.solve(problem, "static-tuned"))
        >>> [claim.name for claim in avc.deployable(coupling).claims]
        ['hands', 'let-go']
    """

    JSON_KEYS: ClassVar = (("pass", "passed"), "sentence", "disk_margin", "claims")

    claims: tuple[DeployClaim, ...]
    disk_margin: float = math.nan

    @property
    def passed(self) -> bool:
        """Whether the coupling may be deployed."""
        return all(claim.passed for claim in self.claims)

    @property
    def sound(self) -> bool:
        """Whether its disk margin is not thin; a margin that is not known is not doubted."""
        return math.isnan(self.disk_margin) or self.disk_margin >= SOUND_DISK

    @property
    def failed(self) -> list[DeployClaim]:
        """The claims that fail."""
        return [claim for claim in self.claims if not claim.passed]

    @property
    def sentence(self) -> str:
        """The verdict in one line: which claims fail."""
        return worded(self)

    @property
    def advice(self) -> str:
        """What to do, in one line; empty where all claims hold."""
        return "; ".join(dict.fromkeys(claim.advice for claim in self.claims if claim.advice))


def deployable(coupling: Coupling, progress: Progress = SILENT) -> Deployable:
    """Return the verdict on a coupling, on the loop of its own problem; its certificate is not used.

    Args:
        coupling: the coupling.
        progress: reported over the gains that are judged.

    Raises:
        InputError: it is not a coupling.

    Example:
        >>> problem = avc.load_problem("figure5")
        >>> avc.deployable(avc.Coupling.from_schedule(problem, avc.solve(problem, "direct"))).passed
        False
    """
    require_coupling(coupling)
    numbers = coupling.table.frequency_hz.tobytes() + coupling.table.gains.tobytes()
    verdicts = _VERDICTS.setdefault(coupling.table, [])
    law = coupling.runtime.state_feedback
    # No claim depends on the width of a dead zone.
    runs = coupling.runtime if law is None else coupling.runtime.model_copy(update={"state_feedback": law.linear})
    for problem, runtime, key, verdict in verdicts:
        if problem is coupling.problem and runtime == runs and key == numbers:
            return verdict
    verdict = _verdict(coupling, progress)
    if verdict.passed and coupling.problem.device.mass_kg > 0:  # released, a massless device has no loop
        verdict = _with_disk_margin(verdict, coupling)
    verdicts.append((coupling.problem, runs, numbers, verdict))
    del verdicts[:-_KEPT_VERDICTS]
    return verdict


def _with_disk_margin(verdict: Deployable, coupling: Coupling) -> Deployable:
    """Return the verdict with the disk margin of the gains at rest, and a claim that fails where it is too small.

    The least is that of [robustness], or `LEAST_DISK`.
    """
    margin = min(margins.disk for margins in OpenLoop.of(coupling).margins())
    requirement = coupling.problem.robustness.disk_margin
    least = LEAST_DISK if requirement is None else _TAKEN_FOR_REQUIRED * requirement
    claims = verdict.claims
    if margin < least:
        claims += (
            DiskMarginClaim(
                name="disk-margin",
                passed=False,
                units=coupling.problem.units,
                remedy=ClaimRemedy.RECOMMEND_OR_LESS_MARGIN,
                margin=margin,
                least=least,
            ),
        )
    return Deployable(claims, margin)


def _verdict(coupling: Coupling, progress: Progress) -> Deployable:
    """Return the claims on the linear loops of a coupling, without its disk margin.

    Its frozen gains, or the law behind an observer, are judged with every hand and released; then in detents, and
    whether anything is rendered.
    """
    problem = coupling.problem
    frequency, gains = _interpolation(coupling.table)
    try:
        if coupling.runtime.state_feedback is not None:
            return Deployable((*_feedback_claims(coupling), *_detents_behind_feedback(problem)))
        claims: tuple[DeployClaim, ...] = _frozen_claims(problem, frequency, gains, progress)
        if problem.detent is not None:
            claims += _claims_in_detents(problem, frequency, gains, progress)
    except UnsupportedError as refusal:
        names: tuple[ClaimName, ClaimName] = ("hands", "let-go")
        why = Unsupported(str(refusal))
        return Deployable(tuple(_not_judged(name, problem, why, ClaimRemedy.LESS_DELAY) for name in names))
    wall = problem.environment
    if not np.any(gains != 0) and (wall.stiffness_n_per_m or wall.damping_ns_per_m):
        remedy = ClaimRemedy.WITHOUT_REALISM
        claims += (NothingRenderedClaim(name="renders", passed=False, units=problem.units, remedy=remedy),)
    if coupling.runtime.observer_mass_kg is not None:
        claims = tuple(replace(claim, without_observer=True) for claim in claims)
    return Deployable(claims)


def _not_judged(name: ClaimName, problem: Problem, refusal: WhyNotJudged, remedy: ClaimRemedy) -> DeployClaim:
    return NotJudgedClaim(name=name, passed=False, units=problem.units, remedy=remedy, refusal=refusal)


def _detents_behind_feedback(problem: Problem) -> tuple[DeployClaim, ...]:
    """Return that the detents of a problem are not judged behind state feedback; nothing without detents."""
    if problem.detent is None:
        return ()
    return (_not_judged("detent", problem, DetentsBehindFeedback(), ClaimRemedy.WITHOUT_FEEDBACK),)


def _claims_in_detents(
    problem: Problem, frequency: FloatArray, gains: FloatArray, progress: Progress
) -> tuple[DeployClaim, ...]:
    """Return the claim on the detents alone, and those on frozen gains where a detent's slope adds to the wall's."""
    assert problem.detent is not None  # noqa: S101 - asked by the caller
    # In the wall the slope of a detent adds to that of the wall.
    steepest = problem.environment.stiffness_n_per_m + problem.detent.slope_n_per_m
    inside = problem.changed(environment={"stiffness_n_per_m": steepest})
    held, released = _frozen_claims(inside, frequency, gains, progress)
    return (
        detent_claim(problem),
        replace(held, name="detent-hands", in_detents=True),
        replace(released, name="detent-let-go", in_detents=True),
    )


def _interpolation(table: GainTable) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies, Hz, at which a table is judged, and its gains (b, k, b_p) there, shape (3, n).

    They are the rows and three points between neighbours, where the device interpolates.
    """
    rows = table.frequency_hz
    if len(rows) == 1:
        return rows, table.gains
    # Three points between two neighbouring rows, where the device interpolates.
    shares = np.linspace(0.0, 1.0, 4, endpoint=False)
    log = np.log(rows)
    between = np.exp((log[:-1, None] + shares * np.diff(log)[:, None]).ravel())
    frequency = np.unique(np.concatenate([rows, between]))
    return frequency, table(frequency)


def _frozen_claims(
    problem: Problem, frequency: FloatArray, gains: FloatArray, progress: Progress
) -> tuple[StabilityClaim, StabilityClaim]:
    """Return the claims that every row of gains (b, k, b_p), kept constant, is stable with every hand, and released.

    Each names the row of the largest spectral radius, its hand and its device.
    """
    law = frozen_law(problem, *gains)
    family = PlantFamily.of(problem)
    held = worst_case_over_hands(family, law, progress=progress)
    released = worst_case_over_hands(family.released, law, draws=0, progress=progress)

    def claim(name: ClaimName, cases: list[WorstCase]) -> StabilityClaim:
        row = max(range(len(cases)), key=lambda row: cases[row].radius)
        failed = sum(not case.stable for case in cases)
        return StabilityClaim(
            name=name,
            passed=not failed,
            units=problem.units,
            radius=cases[row].radius,
            worst=cases[row],
            corners=len(hand_corners(problem.hands)),
            frequency_hz=float(frequency[row]),
            judged=len(frequency),
            failed=failed,
            ranges=tuple(family.device_ranges),
        )

    return claim("hands", held), claim("let-go", released)


def _feedback_claims(coupling: Coupling) -> tuple[DeployClaim, ...]:
    """Return the claims on the law behind an observer: stable with every hand, and released.

    They include any share of the innovation that passes its dead zone, and any share of the force that a clip leaves.
    """
    problem = coupling.problem
    worst_of = worst_case_behind_observer(coupling)
    names: tuple[ClaimName, ...] = ("hands", "let-go", "dead-zone", "clip")
    return tuple(
        StabilityClaim(
            name=name,
            passed=worst_of[name].stable,
            units=problem.units,
            radius=worst_of[name].radius,
            worst=worst_of[name],
            ranges=tuple(PlantFamily.of(problem).device_ranges),
        )
        for name in names
    )


@dataclass(frozen=True)
class DeployedCertificate(Document):
    """The certificate that a coupling to a wall carries: the levels of its rows, and the verdict on its table.

    Attributes:
        certificate: the levels of its rows.
        verdict: whether it may be deployed.
    """

    certificate: Certificate
    verdict: Deployable

    def with_level(self, level: LevelResult) -> DeployedCertificate:
        """Return the certificate with another level."""
        levels = self.certificate.levels | {level.level: level}
        return replace(self, certificate=replace(self.certificate, levels=levels))

    def document(self) -> dict[str, Any]:
        """Return the JSON document."""
        return self.certificate.document() | {"deployable": self.verdict.document()}


@dataclass(frozen=True)
class CertifiedCoupling:
    """What `avc certify` finds of a coupling to a wall: its certificate, and the verdict on the table that runs.

    Attributes:
        certificate: the levels of its gains.
        verdict: whether it may be deployed; None where no row has gains.
        file: the file of the gains; None where they stand in none.
        notes: what runs otherwise than the file says.
        proof_files: names of the written proofs.
    """

    certificate: Certificate
    verdict: Deployable | None
    file: str | None = None
    notes: tuple[str, ...] = ()
    proof_files: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether it may be deployed."""
        return self.verdict is not None and self.verdict.passed

    def document(self) -> dict[str, Any]:
        """Return the `certify` document: JSON values only."""
        verdict = {"pass": False} if self.verdict is None else self.verdict.document()
        return self.certificate.document() | {
            "gains": self.file,
            "notes": list(self.notes),
            "proof_files": list(self.proof_files),
            "deployable": verdict,
        }


def certify_deployed(coupling: Coupling, progress: Progress = SILENT, *, prove: bool = False) -> DeployedCertificate:
    """Return the certificate of a coupling: the levels of its rows, and the verdict on the deployed table."""
    certificate = certify(coupling.problem, coupling, prove=prove, progress=progress)
    return DeployedCertificate(certificate, deployable(coupling, progress))


def require_deployable(coupling: Coupling, *, unsafe: bool = False) -> Deployable:
    """Raise unless a coupling may be deployed on a device or exported to C; its own certificate is not used."""
    verdict = deployable(coupling)
    if not verdict.passed and not unsafe:
        raise NotDeployableError(
            f"{coupling.problem.name} by {coupling.method}: {verdict.sentence}. {verdict.advice[0].upper()}"
            f"{verdict.advice[1:]}; --unsafe (in Python unsafe=True) overrides."
        )
    return verdict


def detent_claim(problem: Problem) -> DetentClaim:
    """Return the claim on detents: linear loops at their steepest slopes, of both signs, with every hand and released.

    It passes where no loop in a valley is unstable, and what leaves a peak does so without oscillation.
    """
    detent = problem.detent
    if detent is None:
        raise ValueError("the problem has no detents")
    slope, damping = detent.slope_n_per_m, detent.damping_ns_per_m
    family = PlantFamily.of(problem).drawn()
    valley, top = (in_contact(family.devices, family.hands, sign * slope, damping).poles for sign in (1.0, -1.0))
    radius = float(np.abs(valley).max())
    leaving = top[np.abs(top) >= 1]
    hands = len(family.hands)
    held = int((np.abs(top).max(axis=-1).reshape(len(family.devices), hands).max(axis=0) < 1).sum())
    quickest_per_s = float(np.log(np.abs(leaving)).max()) / problem.device.sample_time_s if len(leaving) else 0.0
    swings = bool((np.abs(leaving.imag) > _NO_SWING).any())
    passed = radius < 1 and not swings
    return DetentClaim(
        name="detent",
        passed=passed,
        units=problem.units,
        remedy=None if passed else _detent_remedy(family, slope),
        radius=radius,
        slope_n_per_m=slope,
        damping_ns_per_m=damping,
        in_valley=radius < 1,
        held=held,
        hands=hands,
        leaves_s=1 / quickest_per_s if quickest_per_s > 0 else math.nan,
    )


def _detent_remedy(family: PlantFamily, slope_n_per_m: float) -> DetentRemedy:
    holds = damping_range(family, slope_n_per_m)
    steepest_n_per_m = math.nan
    if not math.isfinite(holds.lowest_ns_per_m):
        steepest_n_per_m = stiffest_wall(family).stiffness_n_per_m
    return DetentRemedy(holds.lowest_ns_per_m, holds.highest_ns_per_m, steepest_n_per_m)
