"""Deployable: whether a coupling may be deployed on a device, and which claim fails otherwise; one definition.

Linearly stable with every hand of [hands] and released, over all of [device.range], on the loop of the device as
declared, at the table's rows and between them; with state feedback for any gain of its dead zone and of its clip,
without a nonlinear observer. The disk margin is 0.15 or what [robustness] asks for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Literal
from weakref import WeakKeyDictionary

import numpy as np

from avc_casadi._errors import NotDeployableError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.claims.certify import Certificate, certify
from avc_casadi.claims.hands import search_text, worst_case_behind_observer, worst_case_over_hands
from avc_casadi.coupling import Coupling, require_coupling
from avc_casadi.loops.margins import LEAST_DISK, OpenLoop
from avc_casadi.loops.plant_family import DRAWS, PlantFamily, WorstCase
from avc_casadi.loops.wall import frozen_law
from avc_casadi.loops.walls import damping_range, in_contact, stiffest_wall
from avc_casadi.model.corners import linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.gains import GainTable
from avc_casadi.model.hands import hand_text
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


@dataclass(frozen=True)
class DeployClaim(Document):
    """One claim that a deployable coupling meets."""

    JSON_KEYS: ClassVar = ("name", ("pass", "passed"), "sentence", "advice", ("spectral_radius", "radius"))

    name: ClaimName
    passed: bool
    sentence: str
    advice: str
    radius: float = math.nan


@dataclass(frozen=True)
class Deployable(Document):
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
    def failed(self) -> list[DeployClaim]:
        """The claims that fail."""
        return [claim for claim in self.claims if not claim.passed]

    @property
    def sentence(self) -> str:
        """The verdict in one line: which claim fails and what to do."""
        failed = self.failed
        if not failed:
            return "deployable: linearly stable with every hand of [hands] and released"
        return "not deployable: " + "; ".join(claim.sentence for claim in failed)

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
    """Return the verdict with the disk margin of the gains at rest, a claim where that is too small."""
    margin = min(margins.disk for margins in OpenLoop.of(coupling).margins())
    requirement = coupling.problem.robustness.disk_margin
    least = LEAST_DISK if requirement is None else _TAKEN_FOR_REQUIRED * requirement
    claims = verdict.claims
    if margin < least:
        why = f"a disk margin of {margin:.2g}, below {least:.2g}: may vibrate if the motor constant differs"
        advice = "take `avc recommend P`, soften the wall, or lower [robustness] disk_margin"
        claims += (DeployClaim("disk-margin", False, why, advice),)
    return Deployable(claims, margin)


def _verdict(coupling: Coupling, progress: Progress) -> Deployable:
    problem = coupling.problem
    frequency, gains = _interpolation(coupling.table)
    try:
        if coupling.runtime.state_feedback is not None:
            claims = _feedback_claims(coupling)
            if problem.detent is not None:
                advice = "take a coupling without state feedback: avc solve P --method static-tuned"
                claims += (DeployClaim("detent", False, "not judged: state feedback together with [detent]", advice),)
            return Deployable(claims)
        claims = _frozen_claims(problem, frequency, gains, progress)
        if problem.detent is not None:
            # In the wall the slope of a detent adds to that of the wall.
            steepest = problem.environment.stiffness_n_per_m + problem.detent.slope_n_per_m
            inside = problem.changed(environment={"stiffness_n_per_m": steepest})
            claims += (detent_claim(problem),)
            names: tuple[ClaimName, ClaimName] = ("detent-hands", "detent-let-go")
            for name, claim in zip(names, _frozen_claims(inside, frequency, gains, progress), strict=True):
                sentence = f"in the wall with its detents: {claim.sentence}"
                claims += (replace(claim, name=name, sentence=sentence),)
        wall = problem.environment
        if not np.any(gains != 0) and (wall.stiffness_n_per_m or wall.damping_ns_per_m):
            why = "the wall is not rendered: b, k and b_p are 0"
            advice = (
                "take a softer wall, a shorter sample time, or a method without the realism condition (avc recommend)"
            )
            claims += (DeployClaim("renders", False, why, advice),)
    except UnsupportedError as refusal:
        advice = "shorten the delay, or analyse the loop by other means"
        why = f"not judged: {refusal}"
        return Deployable(
            (DeployClaim("hands", False, why, advice), DeployClaim("let-go", False, why, advice)),
        )
    if coupling.runtime.observer_mass_kg is not None:
        beside_it = " (judged without the observer, which is not linear)"
        claims = tuple(replace(claim, sentence=claim.sentence + beside_it) for claim in claims)
    return Deployable(claims)


def _interpolation(table: GainTable) -> tuple[FloatArray, FloatArray]:
    """Return the frequencies at which a table is judged and its gains there, (3, n): the rows and points between."""
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
) -> tuple[DeployClaim, ...]:
    """Return the claims of frozen gains: stable with every hand, and released."""
    law = frozen_law(problem, *gains)
    family = PlantFamily.of(problem)
    held = worst_case_over_hands(family, law, progress=progress)
    released = worst_case_over_hands(family.released, law, draws=0, progress=progress)

    def claim(name: ClaimName, cases: list[WorstCase], passing: str) -> DeployClaim:
        row = max(range(len(cases)), key=lambda row: cases[row].radius)
        failed = sum(not case.stable for case in cases)
        where = (
            "" if len(frequency) == 1 else f" at {frequency[row]:.4g} Hz ({failed} of {len(frequency)} gains judged)"
        )
        failing = _who(problem, cases[row]) + where + _on(problem, cases[row].device)
        return _claim(name, not failed, cases[row].radius, passing, failing)

    with_all = f"with every hand of [hands] (worst by {search_text(problem, DRAWS, 0)})"
    return claim("hands", held, with_all), claim("let-go", released, "when released")


def _feedback_claims(coupling: Coupling) -> tuple[DeployClaim, ...]:
    with_all = "with every hand of [hands] (worst by search)"
    passing: dict[ClaimName, str] = {
        "hands": with_all,
        "let-go": "when released",
        "dead-zone": f"{with_all}, for any output of the dead zone",
        "clip": f"{with_all} and released, for any clipped share of the force",
    }
    shares = {"dead-zone": "innovation passes the dead zone", "clip": "force is left by its clip"}
    claims = []
    worst_of = worst_case_behind_observer(coupling)
    for name, passes in passing.items():
        worst = worst_of[name]
        failing = _who(coupling.problem, worst) + _on(coupling.problem, worst.device)
        if name in shares:
            failing += f" where {worst.values['share']:.3g} of the {shares[name]}"
        claims.append(_claim(name, worst.stable, worst.radius, passes, failing))
    return tuple(claims)


def _who(problem: Problem, worst: WorstCase) -> str:
    """Return with which hand, in words."""
    return f"with {hand_text(worst.hand, problem.units.unit)}" if any(worst.hand.values()) else "when released"


def _claim(name: ClaimName, stable: bool, radius: float, passing: str, failing: str) -> DeployClaim:
    if stable:
        return DeployClaim(name, True, f"linearly stable {passing}, spectral radius {radius:.6g} at most", "", radius)
    advice = "take `avc recommend P`, which finds the deployable coupling nearest to the wall, or soften the wall"
    return DeployClaim(name, False, f"linearly unstable {failing}: spectral radius {radius:.6g}", advice, radius)


def _on(problem: Problem, device: Device) -> str:
    """Return the name of a device within its ranges; none where it has none."""
    values = linear_values(device)
    ends = [f"{key} {values[key]:.4g}" for key in PlantFamily.of(problem).device_ranges]
    return f" (device {', '.join(ends)})" if ends else ""


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


def with_certificate(coupling: Coupling, progress: Progress = SILENT, *, prove: bool = False) -> Coupling:
    """Return the coupling with its certificate: the levels of its rows, and the verdict on the deployed table."""
    found = certify(coupling.problem, coupling, prove=prove, progress=progress)
    return coupling.with_certificate(found.document() | {"deployable": deployable(coupling, progress).document()})


def require_deployable(coupling: Coupling, *, unsafe: bool = False) -> Deployable:
    """Raise unless a coupling may be deployed on a device or exported to C; its own certificate is not used."""
    verdict = deployable(coupling)
    if not verdict.passed and not unsafe:
        raise NotDeployableError(
            f"{coupling.problem.name} by {coupling.method}: {verdict.sentence}. {verdict.advice[0].upper()}"
            f"{verdict.advice[1:]}; --unsafe (in Python unsafe=True) overrides."
        )
    return verdict


def detent_claim(problem: Problem) -> DeployClaim:
    """Judge the linear loops at the steepest slopes of the detents, of both signs, with every hand and released."""
    detent = problem.detent
    if detent is None:
        raise ValueError("the problem has no detents")
    slope = detent.slope_n_per_m
    damping = detent.damping_ns_per_m
    spring = partial(quantity, unit=problem.units.unit("N/m"))
    damper = partial(quantity, unit=problem.units.unit("N.s/m"))
    family = PlantFamily.of(problem).drawn()
    valley, top = (in_contact(family.devices, family.hands, sign * slope, damping).poles for sign in (1.0, -1.0))
    radius = float(np.abs(valley).max())
    leaving = top[np.abs(top) >= 1]
    if radius < 1 and not (np.abs(leaving.imag) > _NO_SWING).any():
        hands = len(family.hands)
        held = int((np.abs(top).max(axis=-1).reshape(len(family.devices), hands).max(axis=0) < 1).sum())
        quickest = float(np.log(np.abs(leaving)).max()) / problem.device.sample_time_s if len(leaving) else math.nan
        rest = "" if held == hands else f", the others leave it without swinging, by e in {1 / quickest:.3g} s"
        sentence = (
            f"detents: in a valley, a spring of {spring(slope)}, linearly stable with every hand of [hands] and "
            f"released, spectral radius {radius:.6g} at most; at a peak, a spring of {spring(-slope)}, {held} of "
            f"{hands} hands, including none, stay there{rest}"
        )
        return DeployClaim("detent", True, sentence, "", radius)
    where = (
        f"in a valley, a spring of {spring(slope)} with {damper(damping)}: spectral radius {radius:.6g}"
        if radius >= 1
        else f"at a peak, a spring of {spring(-slope)}: a device that leaves it oscillates"
    )
    holds = damping_range(family, slope)
    if math.isfinite(holds.lowest_ns_per_m):
        advice = (
            f"set the damping of the detents to {damper(holds.lowest_ns_per_m)} to {damper(holds.highest_ns_per_m)}, "
        )
        advice += "or make the detents weaker or wider"
    else:
        most = stiffest_wall(family).stiffness_n_per_m
        advice = f"make the detents weaker or wider: no damping stabilises a slope above {spring(most)}"
    return DeployClaim("detent", False, f"detents: linearly unstable {where}", advice, radius)
