"""Feasibility and optimality of solved rows, recomputed from the CasADi NLP whatever the solver said."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi.design._gains import BoolArray, FloatArray
from avc_casadi.design._nlp import coupling_nlp, nlp_parameters
from avc_casadi.design._rows import Gains, admissible
from avc_casadi.impedance import Loop

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

KKT_TOLERANCE = 1e-6
"""Largest accepted KKT residual: d(error^2)/d(ln gain), relative to the square of the terms that make up |Z_h_avc|."""
_ACTIVE = 1e-6
"""(12) counts as active where Re Z_h is within this share of the same terms of the margin."""


@dataclass(frozen=True)
class Optimality:
    """Recomputed quality of each row, arrays of shape (n,); not a number for rows without gains.

    Attributes:
        violation_ns_per_m: by how much (12) is missed; 0 where it is met. Infinite outside the gain box.
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
    ]
    return ca.Function("optimality", [nlp.gains, nlp.parameters], outputs).map(rows)


def optimality(problem: Problem, loop: Loop, gains: Gains) -> Optimality:
    """Recompute violation and KKT residual of (b, k, b_p), each (n,)."""
    parameters = nlp_parameters(problem, loop)
    x = np.array(gains)
    f, g, df, dg = (np.array(value) for value in _derivatives(x.shape[1])(x, parameters))
    violation = np.where(admissible(problem, *gains), np.maximum(0.0, -g[0]), np.inf)
    terms = np.abs(loop.target) + np.abs(loop.device) + np.abs(loop.hold * (loop.rendered(*gains[:2]) + gains[2]))
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = parameters[-3:] + x
        # The root in |Z| has no gradient at 0, but there the error, if it is 0, is optimal anyway.
        df = np.where(f[0] == 0, 0.0, df * scale / terms**2)
        dg = dg * scale / terms
        active = g[0] <= _ACTIVE * terms
    box = problem.coupling
    bounds = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m])
    at_low, at_high = x <= bounds[:, :1], x >= bounds[:, 1:]
    residual = _residual(df, np.where(active, dg, 0.0), at_low, at_high)
    empty = np.isnan(x).any(axis=0)
    return Optimality(np.where(empty, np.nan, violation), np.where(empty, np.nan, residual))


def _residual(df: FloatArray, dg: FloatArray, at_low: BoolArray, at_high: BoolArray) -> FloatArray:
    """Smallest residual over multipliers lambda >= 0 of (12); arrays (3, n).

    The residual is piecewise linear in lambda, so that its minimum lies where two components balance or one vanishes.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        zeros = df / dg
        crossings = [
            (df[i] + sign * df[j]) / (dg[i] + sign * dg[j]) for i, j in ((0, 1), (0, 2), (1, 2)) for sign in (1, -1)
        ]
    choices = np.concatenate((np.zeros((1, df.shape[1])), zeros, crossings))
    choices = np.where(np.isfinite(choices) & (choices > 0), choices, 0.0)
    slope = df - choices[:, None] * dg
    # At its lower bound a gain may have a rising goal, at its upper bound a falling one.
    slope = np.where(at_low, np.minimum(slope, 0.0), slope)
    slope = np.where(at_high, np.where(at_low, 0.0, np.maximum(slope, 0.0)), slope)
    smallest: FloatArray = np.abs(slope).max(axis=1).min(axis=0)
    return smallest
