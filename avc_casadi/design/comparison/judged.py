"""Evaluation of the gains of each method: certificate, realism, and Re Z_h in both hold models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, real_part
from avc_casadi.model.corners import margin_over_range
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.realism import judge_realism
from avc_casadi.paper.rendered import gain_schedule

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avc_casadi.claims.certificate import Certificate
    from avc_casadi.claims.deployable import Deployable
    from avc_casadi.model.problem import Model, Problem
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.paper.loop import Loop
    from avc_casadi.paper.realism import RealismResult


@dataclass(frozen=True)
class Safety:
    """Safety of a gain table by its certificate.

    Attributes:
        levels: whether every row meets each level; None where the level is refused on this device.
        hands: L5, linearly stable with every hand, at the rows and where the device interpolates between them.
        let_go: the same with the device released.
        passive: L3, passive in the model of the loop that runs.
        rows_failed: by level, how many rows do not meet it.
        rows: how many rows there are.
    """

    levels: dict[str, bool | None]
    hands: bool
    let_go: bool
    passive: bool
    rows_failed: dict[str, int]
    rows: int

    @classmethod
    def of(cls, certificate: Certificate, verdict: Deployable | None = None) -> Safety:
        """Return the safety by a certificate and the verdict on the coupling; claims not judged count as unsafe."""
        levels = certificate.levels
        claims = {} if verdict is None else {claim.name: claim.passed for claim in verdict.claims}
        return cls(
            levels={level: None if found.refused else found.passed for level, found in levels.items()},
            hands=levels["L5"].passed and claims.get("hands", False),
            let_go=bool(levels["L5"].detail.get("released_pass", False)) and claims.get("let-go", False),
            passive=levels["L3"].passed,
            rows_failed={level: found.rows_failed for level, found in levels.items()},
            rows=len(certificate.frequency_hz),
        )

    @property
    def rank(self) -> tuple[bool, bool, bool]:
        """Order of safety: every hand, then released, then passive; larger is safer."""
        return self.hands, self.let_go, self.passive

    @property
    def deployable(self) -> bool:
        """Whether the frozen gains may be deployed: stable with every hand and released."""
        return self.hands and self.let_go

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"levels": self.levels, "let_go": self.let_go, "deployable": self.deployable}


def safer(mine: Safety, other: Safety, name: str) -> str:
    """Return which of two is safer: "mine", the name of the other, or "equal"."""
    if mine.rank == other.rank:
        return "equal"
    return "mine" if mine.rank > other.rank else name


def safety_reason(mine: Safety, other: Safety, name: str) -> str:
    """Return one sentence on the safety of two tables and which not to deploy.

    Args:
        mine: of the hand-tuned pair.
        other: of the method that it is compared with.
        name: that method's name.
    """
    if mine.rank == other.rank:
        return _equal(mine, other, name)
    ahead = mine.rank > other.rank
    better, worse = (mine, other) if ahead else (other, mine)
    names = ("mine", name) if ahead else (name, "mine")
    what, why = _first_difference(better, worse)
    advice = "" if worse.deployable else f": do not deploy {names[1]}"
    also = "" if worse.deployable or better.deployable else f", nor {names[0]} ({_lacks(better)})"
    return f"{names[0]} is {what}, {names[1]} is not ({why}){advice}{also}"


def _equal(mine: Safety, other: Safety, name: str) -> str:
    if not mine.deployable:
        return f"deploy neither mine ({_lacks(mine)}) nor {name} ({_lacks(other)})"
    passive = "and passive in the sampled-data model" if mine.passive else "neither is passive (L3)"
    return f"mine and {name} are both stable with every hand and released, {passive}"


def _first_difference(better: Safety, worse: Safety) -> tuple[str, str]:
    """Return the first claim that one meets and the other does not, and why."""
    if better.hands != worse.hands:
        return "stable with every hand", _failing(worse, "L5")
    if better.let_go != worse.let_go:
        return "stable when released", "the released device is not stable"
    return "passive in the sampled-data model", _failing(worse, "L3")


def _lacks(safety: Safety) -> str:
    return "the released device is not stable" if safety.hands else _failing(safety, "L5")


def _failing(safety: Safety, level: str) -> str:
    return f"{level} fails at {safety.rows_failed[level]} of {safety.rows} rows"


@dataclass(frozen=True, eq=False)
class HandTuned:
    """One constant series coupling at every frequency; arrays of shape (n,).

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
        impedance: perceived impedance, N.s/m.
        magnitude_error: ||Z_h_ds| - |Z_h||, N.s/m.
        complex_error: |Z_h - Z_h_ds|/|Z_h_ds|.
        real_part: Re Z_h, N.s/m.
        meets_margin: Re Z_h >= margin, (12).
        inside_box: whether both gains lie in the problem's gain box.
        compared: the method that it is compared with.
        share_schedule_better: share of frequencies where the schedule has the smaller magnitude error, or meets (12)
            where the pair does not.
        share_pair_better: share where the pair meets (12) and has the smaller magnitude error, or the schedule has no
            gains; possible only with gains outside the box.
        safer: which is safe for more, "mine", the method's name or "equal"; errors count only where it is "equal".
        safety_reason: why, in one sentence.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    impedance: ComplexArray
    magnitude_error: FloatArray
    complex_error: FloatArray
    real_part: FloatArray
    meets_margin: NDArray[np.bool_]
    inside_box: bool
    compared: str
    share_schedule_better: float
    share_pair_better: float
    safer: str
    safety_reason: str

    @property
    def better(self) -> str:
        """Which is better, "mine", the method's name or "equal": by safety, then by smaller error."""
        if self.safer != "equal" or self.share_pair_better == self.share_schedule_better:
            return self.safer
        return "mine" if self.share_pair_better > self.share_schedule_better else self.compared


def constant_pair(problem: Problem, pair: tuple[float, float]) -> GainSchedule:
    """Return the pair (k in N/m, b in N.s/m) as a table of constant series gains."""
    k, b = pair
    n = len(problem.frequencies_hz())
    gains = (np.full(n, b), np.full(n, k), np.zeros(n))
    return gain_schedule(problem, "mine", gains, (Status.SOLVED,) * n)


def judge_hand_tuned(
    problem: Problem,
    loop: Loop,
    pair: tuple[float, float],
    schedule: GainSchedule,
    tolerance: FloatArray,
    safety: tuple[Safety, Safety],
) -> HandTuned:
    """Judge a constant pair.

    Args:
        problem: the problem.
        loop: its loop at its frequencies.
        pair: (k in N/m, b in N.s/m).
        schedule: the designed gains.
        tolerance: differences in magnitude error below this count as equal, N.s/m, shape (n,).
        safety: what the pair and the designed gains are safe for.
    """
    k, b = pair
    box = problem.coupling
    impedance = np.asarray(loop.perceived(np.full(schedule.rows, b), np.full(schedule.rows, k)))
    target = np.asarray(loop.target)
    error = np.abs(np.abs(target) - np.abs(impedance))
    meets = impedance.real >= margin_over_range(problem)
    usable = schedule.usable
    ours = np.where(usable, schedule.magnitude_error, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.abs(impedance - target) / np.abs(target)
    return HandTuned(
        stiffness_n_per_m=k,
        damping_ns_per_m=b,
        impedance=impedance,
        magnitude_error=error,
        complex_error=relative,
        real_part=impedance.real,
        meets_margin=meets,
        inside_box=box.damping_ns_per_m[0] <= b <= box.damping_ns_per_m[1]
        and box.stiffness_n_per_m[0] <= k <= box.stiffness_n_per_m[1],
        compared=schedule.method,
        share_schedule_better=float(np.mean(usable & (~meets | (ours + tolerance < error)))),
        share_pair_better=float(np.mean(meets & (error + tolerance < ours))),
        safer=safer(*safety, schedule.method),
        safety_reason=safety_reason(*safety, schedule.method),
    )


@dataclass(frozen=True, eq=False)
class Judged:
    """One gain table judged; arrays have shape (n,).

    Attributes:
        certificate: of the gains that exist.
        realism: of the rendered impedance.
        real_part: Re Z_h at its own frequency by hold model, N.s/m; rows without gains show the requested
            value, or not a number where that is not finite.
    """

    certificate: Certificate
    realism: RealismResult
    real_part: dict[Model, FloatArray]
    deployable: Deployable | None

    @property
    def safety(self) -> Safety:
        """Safety of the gains."""
        return Safety.of(self.certificate, self.deployable)

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "certificate": self.certificate.document(),
            "realism": self.realism.document(),
            "real_part_by_model": {model: plain(values) for model, values in self.real_part.items()},
        }


def judge_gains(problem: Problem, gains: GainSchedule) -> Judged:
    """Judge a gain table at the problem's frequencies."""
    models: tuple[Model, ...] = ("paper", "sampled-data")
    return Judged(
        certificate=certify(problem, gains),
        realism=judge_realism(problem, gains.impedance, gains.usable),
        real_part={model: _real_part(problem, gains, model) for model in models},
        deployable=deployable(Coupling.of(problem, gains)) if gains.usable.any() else None,
    )


def _real_part(problem: Problem, gains: GainSchedule, model: Model) -> FloatArray:
    b, k = gains.requested_damping_ns_per_m, gains.requested_stiffness_n_per_m
    contact = gains.requested_contact_damping_ns_per_m
    known = np.isfinite(b) & np.isfinite(k) & np.isfinite(contact)
    loop = SampledLoop.of(problem, model)
    parts = fractions(loop, np.where(known, b, 0.0), np.where(known, k, 0.0))
    contact = np.where(known, contact, 0.0)
    return np.where(known, real_part(loop, parts, contact, gains.frequency_hz), np.nan)
