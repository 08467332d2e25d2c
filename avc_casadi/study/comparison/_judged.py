"""What the gains of each method are worth: certificate, realism, and Re Z_h in both hold models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate import certify, deployable
from avc_casadi.coupling import Coupling
from avc_casadi.loop import judge_realism
from avc_casadi.passivity import SampledLoop, fractions, real_part
from avc_casadi.study.comparison._safety import Safety
from avc_casadi.support import Comparable, FloatArray, plain

if TYPE_CHECKING:
    from avc_casadi.certificate import Certificate, Deployable
    from avc_casadi.coupling import (
        GainSchedule,
    )
    from avc_casadi.loop import RealismResult
    from avc_casadi.problem import Model, Problem


@dataclass(frozen=True, eq=False)
class Judged(Comparable):
    """One gain table judged; arrays have shape (n,).

    Attributes:
        certificate: of the gains that exist.
        realism: of what these gains render.
        real_part: Re Z_h at its own frequency by hold model, N.s/m; rows without gains show what was asked for, and not
            a number where that is not finite.
    """

    certificate: Certificate
    realism: RealismResult
    real_part: dict[Model, FloatArray]
    deployable: Deployable | None

    @property
    def safety(self) -> Safety:
        """What the gains are safe for."""
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
