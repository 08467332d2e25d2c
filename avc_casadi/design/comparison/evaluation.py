"""Evaluation of the gains of each method and of a causal coupling: certificate, realism, Re Z_h."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi.claims.certify import Certificate, certify
from avc_casadi.claims.deployable import ClaimName, Deployable, deployable
from avc_casadi.claims.level_detail import HandsDetail
from avc_casadi.claims.worst_frequency import real_part
from avc_casadi.coupling import Coupling
from avc_casadi.loops.wall import SampledLoop, fractions, law_at_rest
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Model, Problem
from avc_casadi.paper import equations as eq
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import RealismResult, judge_realism


@dataclass(frozen=True, eq=False)
class Evaluation(Document):
    """One gain table judged.

    Attributes:
        certificate: its certificate.
        realism: whether its impedance is realistic at each frequency.
        real_part: Re Z_h by the model of the loop, shape (n,), N.s/m; not a number without gains.
        deployable: whether it may run on the device; None where no row has gains.
    """

    JSON_KEYS: ClassVar = ("certificate", "realism", ("real_part_by_model", "real_part"))

    certificate: Certificate
    realism: RealismResult
    real_part: dict[Model, FloatArray]
    deployable: Deployable | None

    @property
    def safe(self) -> bool:
        """Whether the frozen gains are stable with every hand and released."""
        return self._stable_with_hands and self._stable_released

    @property
    def _stable_with_hands(self) -> bool:
        return self.certificate.levels["L5"].passed and self._claims.get("hands", False)

    @property
    def _stable_released(self) -> bool:
        detail = self.certificate.levels["L5"].detail
        stable = isinstance(detail, HandsDetail) and detail.released_passed
        return stable and self._claims.get("let-go", False)

    @property
    def _claims(self) -> dict[ClaimName, bool]:
        return {} if self.deployable is None else {claim.name: claim.passed for claim in self.deployable.claims}

    def safety(self) -> dict[str, Any]:
        """Return whether the frozen gains are stable with every hand and released, and each level, as JSON values."""
        levels = self.certificate.levels
        return {
            "levels": {level: None if result.refused else result.passed for level, result in levels.items()},
            "let_go": self._stable_released,
            "deployable": self.safe,
        }


def judge_gains(problem: Problem, gains: GainSchedule) -> Evaluation:
    """Judge a gain table at the problem's frequencies."""
    models: tuple[Model, ...] = ("paper", "sampled-data")
    return Evaluation(
        certificate=certify(problem, gains),
        realism=judge_realism(problem, gains.impedance, gains.usable),
        real_part={model: _real_part(problem, gains, model) for model in models},
        deployable=deployable(Coupling.from_schedule(problem, gains)) if gains.usable.any() else None,
    )


def _real_part(problem: Problem, gains: GainSchedule, model: Model) -> FloatArray:
    """Return Re Z_h of the requested gains, shape (n,), N.s/m; not a number where they are not finite."""
    b = gains.requested_damping_ns_per_m
    k = gains.requested_stiffness_n_per_m
    contact = gains.requested_contact_damping_ns_per_m
    known = np.isfinite(b) & np.isfinite(k) & np.isfinite(contact)
    loop = SampledLoop.of(problem, model)
    parts = fractions(loop, np.where(known, b, 0.0), np.where(known, k, 0.0))
    contact = np.where(known, contact, 0.0)
    return np.where(known, real_part(loop, parts, contact, gains.frequency_hz), np.nan)


@dataclass(frozen=True, eq=False)
class CausalGains(Document):
    """The series coupling that renders, at each frequency, what a causal coupling does; arrays of shape (n,).

    Attributes:
        damping_ns_per_m: b of Z_avc = Z_r Z_e/(Z_e - Z_r), Z_r rendered, by (17), of either sign.
        stiffness_n_per_m: its k, of either sign.
        impedance: Z_h = Z_d + H Z_r of the problem's model, N.s/m.
        magnitude_error: the goal (11), ||Z_h| - |Z_h_ds||, N.s/m.
        complex_error: |Z_h - Z_h_ds|/|Z_h_ds|.
    """

    JSON_KEYS: ClassVar = ("damping_ns_per_m", "stiffness_n_per_m", "magnitude_error", "complex_error")

    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    impedance: ComplexArray
    magnitude_error: FloatArray
    complex_error: FloatArray

    @property
    def usable(self) -> BoolArray:
        """Where a spring and damper could do the same."""
        pairs = np.isfinite(self.stiffness_n_per_m) & (self.stiffness_n_per_m >= 0) & (self.damping_ns_per_m >= 0)
        return np.asarray(pairs)


def causal_gains(coupling: Coupling) -> CausalGains:
    """Return what a coupling renders at its problem's frequencies, of small motions in contact, as series gains.

    Z_r is the force of its law at rest over the velocity. Z_avc = Z_r Z_e/(Z_e - Z_r) is the coupling in series with
    the wall Z_e that renders the same, of which b and k are the gains.
    """
    problem = coupling.problem
    loop = loop_at(problem, problem.frequencies_hz())
    z = np.exp(2j * np.pi * loop.angle.turns)
    force = law_at_rest(coupling).transfer(z)
    rendered = force * np.asarray(eq.environment_impedance(loop.angle, problem.stability.model, 0.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping, stiffness = eq.coupling_gains(loop.angle, rendered * loop.environment / (loop.environment - rendered))
    impedance = np.asarray(eq.perceived_impedance(loop.device, loop.hold, rendered))
    target = np.asarray(loop.target)
    return CausalGains(
        damping_ns_per_m=np.where(np.isfinite(stiffness), damping, np.nan),
        stiffness_n_per_m=np.where(np.isfinite(stiffness), stiffness, np.nan),
        impedance=impedance,
        magnitude_error=np.abs(np.abs(impedance) - np.abs(target)),
        complex_error=np.abs(impedance - target) / np.abs(target),
    )
