"""Feasibility and optimality of solved rows, recomputed from the CasADi NLP whatever the solver said."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi.design._rows import GainArrays, admissible
from avc_casadi.design.pointwise._nlp import coupling_nlp, nlp_parameters
from avc_casadi.loop import Loop
from avc_casadi.support import BoolArray, FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

KKT_TOLERANCE = 1e-6
"""Largest accepted KKT residual: by how much error^2 would fall along one gain at the slope of the point, over the
gain's natural scale or up to its bound, relative to the square of the terms that make up |Z_h_avc|."""
_ACTIVE = 1e-6
"""(12) counts as active where Re Z_h is within this share of the same terms of the margin."""


@dataclass(frozen=True)
class Optimality:
    """Recomputed quality of each row, arrays of shape (n,); not a number for rows without gains.

    Attributes:
        violation_ns_per_m: by how much (12) is missed, 0 where it is met but for rounding; infinite outside the gain
            box.
        kkt_residual: first-order optimality of (11)-(12), dimensionless.
    """

    violation_ns_per_m: FloatArray
    kkt_residual: FloatArray

    def acceptable(self) -> BoolArray:
        """Whether each row may be called solved."""
        with np.errstate(invalid="ignore"):
            good: BoolArray = (self.violation_ns_per_m == 0) & (self.kkt_residual <= KKT_TOLERANCE)
        return good


@lru_cache(maxsize=8)
def _derivatives(rows: int) -> Any:
    nlp = coupling_nlp()
    outputs = [
        nlp.objective,
        nlp.constraint,
        ca.gradient(nlp.objective, nlp.gains),
        ca.gradient(nlp.constraint, nlp.gains),
        ca.gradient(nlp.impedance.imag, nlp.gains),
    ]
    return ca.Function("optimality", [nlp.gains, nlp.parameters], outputs).map(rows)


def optimality(problem: Problem, loop: Loop, gains: GainArrays) -> Optimality:
    """Recompute violation and KKT residual of (b, k, b_p), each (n,)."""
    parameters = nlp_parameters(problem, loop)
    x = np.array(gains)
    f, g, df, dg, turning = (np.array(value) for value in _derivatives(x.shape[1])(x, parameters))
    terms = np.abs(loop.target) + np.abs(loop.device) + np.abs(loop.hold * (loop.rendered(*gains[:2]) + gains[2]))
    with np.errstate(invalid="ignore", divide="ignore"):
        missing = np.where(-g[0] > np.finfo(np.float64).eps * terms, -g[0], 0.0)
        # |Z| has no gradient where Z = 0, but it rises from there on every way; an error of 0 is optimal anyway.
        df = np.where(np.isnan(df), -2 * np.sqrt(f) * np.hypot(dg, turning), df)
        df, dg = np.where(f[0] == 0, 0.0, df / terms**2), dg / terms
        active = g[0] <= _ACTIVE * terms
    violation = np.where(admissible(problem, *gains), missing, np.inf)
    box = problem.coupling
    low, high = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]).T[:, :, None]
    scale = parameters[-3:] + x
    down, up = np.clip(x - low, 0.0, scale), np.clip(high - x, 0.0, scale)
    residual = _residual(df, np.where(active, dg, 0.0), down, up)
    empty = np.isnan(x).any(axis=0)
    return Optimality(np.where(empty, np.nan, violation), np.where(empty, np.nan, residual))


def _residual(df: FloatArray, dg: FloatArray, down: FloatArray, up: FloatArray) -> FloatArray:
    """Smallest residual over multipliers lambda >= 0 of (12); arrays (3, n).

    The residual of a gain is the slope times the way that the gain can go, down where the goal rises and up where it
    falls. It is piecewise linear in lambda, so that the smallest maximum lies where two gains balance or one vanishes.

    Args:
        df: gradient of the goal.
        dg: gradient of the constraint, 0 where it is not active.
        down: how far each gain may fall.
        up: how far each gain may rise.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        choices = [np.zeros(df.shape[1]), *(df / dg)]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            for one in (down[i], -up[i]):
                choices += [
                    (one * df[i] - other * df[j]) / (one * dg[i] - other * dg[j]) for other in (down[j], -up[j])
                ]
    multiplier = np.array(choices)
    multiplier = np.where(np.isfinite(multiplier) & (multiplier > 0), multiplier, 0.0)
    slope = df - multiplier[:, None] * dg
    smallest: FloatArray = np.where(slope > 0, slope * down, -slope * up).max(axis=1).min(axis=0)
    return smallest
