"""Evaluation of the gains of each method, of a pair by hand and of a causal coupling: certificate, realism, Re Z_h."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.json_values import plain, plain_table
from avc_casadi.claims.certify import Certificate, certify
from avc_casadi.claims.deployable import Deployable, deployable
from avc_casadi.claims.worst_frequency import real_part
from avc_casadi.coupling import Coupling
from avc_casadi.loops.wall import SampledLoop, force_over_position, fractions, frozen_rendering
from avc_casadi.model.corners import margin_over_range
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Model, Problem
from avc_casadi.paper import equations as eq
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import RealismResult, judge_realism
from avc_casadi.paper.rows import gain_schedule


@dataclass(frozen=True)
class Safety:
    """Safety of a gain table by its certificate."""

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

    @property
    def words(self) -> str:
        """The first claim that does not hold, or that all do."""
        if not self.hands:
            return f"not stable with every hand: L5 fails at {self.rows_failed['L5']} of {self.rows} rows"
        if not self.let_go:
            return "not stable when released"
        passive = "" if self.passive else f", not passive: L3 fails at {self.rows_failed['L3']} of {self.rows} rows"
        return f"stable with every hand and released{passive or ', and passive'}"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"levels": self.levels, "let_go": self.let_go, "deployable": self.deployable}


def safer(mine: Safety, other: Safety, name: str) -> str:
    """Return which of two is safer: "mine", the name of the other, or "equal"."""
    if mine.rank == other.rank:
        return "equal"
    return "mine" if mine.rank > other.rank else name


def safety_reason(mine: Safety, other: Safety, name: str) -> str:
    """Return one sentence on the safety of a hand-tuned pair and of a method, and which not to deploy."""
    both = {"mine": mine, name: other}
    unsafe = " and ".join(who for who, one in both.items() if not one.deployable)
    advice = f"; do not deploy {unsafe}" if unsafe else ""
    return "; ".join(f"{who} is {one.words}" for who, one in both.items()) + advice


@dataclass(frozen=True, eq=False)
class HandTuned:
    """One constant series coupling at every frequency; arrays of shape (n,)."""

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

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        values = {name: value for name, value in vars(self).items() if name != "impedance"}
        return plain_table({**values, "better": self.better, **parts("impedance", self.impedance)})


def parts(name: str, impedance: ComplexArray) -> dict[str, FloatArray]:
    """Return an impedance as JSON holds it."""
    return {f"{name}_re": impedance.real, f"{name}_im": impedance.imag}


def constant_pair(problem: Problem, pair: tuple[float, float]) -> GainSchedule:
    """Return the pair (k in N/m, b in N.s/m) as a table of constant series gains."""
    n = len(problem.frequencies_hz())
    gains = (np.full(n, pair[1]), np.full(n, pair[0]), np.zeros(n))
    return gain_schedule(problem, "mine", gains, (Status.SOLVED,) * n)


def judge_hand_tuned(
    problem: Problem, own: GainSchedule, schedule: GainSchedule, tolerance: FloatArray, safety: tuple[Safety, Safety]
) -> HandTuned:
    """Judge a constant pair, of `constant_pair`, beside designed gains."""
    k, b, box = float(own.stiffness_n_per_m[0]), float(own.damping_ns_per_m[0]), problem.coupling
    error, meets = own.magnitude_error, own.real_part >= margin_over_range(problem)
    usable = schedule.usable
    theirs = np.where(usable, schedule.magnitude_error, np.inf)
    return HandTuned(
        stiffness_n_per_m=k,
        damping_ns_per_m=b,
        impedance=own.impedance,
        magnitude_error=error,
        complex_error=own.complex_error,
        real_part=own.real_part,
        meets_margin=meets,
        inside_box=box.damping_ns_per_m[0] <= b <= box.damping_ns_per_m[1]
        and box.stiffness_n_per_m[0] <= k <= box.stiffness_n_per_m[1],
        compared=schedule.method,
        share_schedule_better=float(np.mean(usable & (~meets | (theirs + tolerance < error)))),
        share_pair_better=float(np.mean(meets & (error + tolerance < theirs))),
        safer=safer(*safety, schedule.method),
        safety_reason=safety_reason(*safety, schedule.method),
    )


@dataclass(frozen=True, eq=False)
class Judged:
    """One gain table judged; arrays have shape (n,)."""

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


@dataclass(frozen=True, eq=False)
class CausalGains:
    """The series coupling that renders, at each frequency, what a causal coupling does; arrays of shape (n,)."""

    damping_ns_per_m: FloatArray  # b of Z_avc = Z_r Z_e/(Z_e - Z_r), Z_r rendered, by (17), of either sign
    stiffness_n_per_m: FloatArray
    impedance: ComplexArray  # Z_h = Z_d + H Z_r of the problem's model
    magnitude_error: FloatArray  # the goal (11)
    complex_error: FloatArray

    @property
    def usable(self) -> BoolArray:
        """Where a spring and damper could do the same."""
        pairs = np.isfinite(self.stiffness_n_per_m) & (self.stiffness_n_per_m >= 0) & (self.damping_ns_per_m >= 0)
        return np.asarray(pairs)

    def document(self) -> dict[str, Any]:
        """Return JSON values: the pair and both errors at each frequency."""
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "magnitude_error", "complex_error")
        return plain_table({key: getattr(self, key) for key in keys})


def causal_gains(coupling: Coupling) -> CausalGains:
    """Return what a coupling renders at its problem's frequencies, of small motions in contact, as series gains."""
    problem = coupling.problem
    loop = loop_at(problem, problem.frequencies_hz())
    z = np.exp(2j * np.pi * loop.angle.turns)
    force = force_over_position(
        frozen_rendering(problem, *vars(coupling.table.at_rest).values()), z, coupling.runtime.state_feedback
    )
    rendered = force * np.asarray(eq.environment_impedance(loop.angle, problem.stability.model, 0.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping, stiffness = eq.coupling_gains(loop.angle, rendered * loop.environment / (loop.environment - rendered))
    felt, target = np.asarray(eq.perceived_impedance(loop.device, loop.hold, rendered)), np.asarray(loop.target)
    return CausalGains(
        damping_ns_per_m=np.where(np.isfinite(stiffness), damping, np.nan),
        stiffness_n_per_m=np.where(np.isfinite(stiffness), stiffness, np.nan),
        impedance=felt,
        magnitude_error=np.abs(np.abs(felt) - np.abs(target)),
        complex_error=np.abs(felt - target) / np.abs(target),
    )
