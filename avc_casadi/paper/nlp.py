"""The NLP (11)-(12) as CasADi expressions of the gains b, k and b_p: the definition of the method `direct`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.equations import ImpedanceLoop, SampleAngle, coupling_impedance
from avc_casadi.paper.numbers import ComplexExpr, abs2, casadi_numbers
from avc_casadi.paper.rows import GainArrays, admissible

_NAMES = (
    "sample_time", "sin", "cos", "device_re", "device_im", "hold_re", "hold_im", "environment_re", "environment_im",
    "target_re", "target_im", "margin", "scale_b", "scale_k", "scale_p",
)  # fmt: skip


@dataclass(frozen=True)
class CouplingNlp:
    """One frequency's NLP; all members are CasADi SX expressions.

    Attributes:
        gains: (b, k, b_p).
        parameters: the parameters, in the order of `nlp_parameters`.
        impedance: Z_h_avc.
        target: Z_h_ds.
        objective: (11), (|Z_h_ds| - |Z_h_avc|)^2.
        constraint: (12), Re Z_h_avc - margin, not negative where it is met.
    """

    gains: Any
    parameters: Any
    impedance: ComplexExpr
    target: ComplexExpr
    objective: Any
    constraint: Any


@cache
def coupling_nlp() -> CouplingNlp:
    """Return the NLP of one frequency, built once per process: the goal (11) under the constraint (12).

    It minimises (|Z_h_ds| - |Z_h_avc|)^2 over b, k and b_p, with Re Z_h_avc no less than the margin.
    """
    b = ca.SX.sym("b")
    k = ca.SX.sym("k")
    b_p = ca.SX.sym("b_p")
    parameters = ca.SX.sym("parameters", len(_NAMES))
    value = dict(zip(_NAMES, ca.vertsplit(parameters), strict=True))
    angle = SampleAngle(casadi_numbers(), 0.0, value["sample_time"], value["sin"], value["cos"])
    device, hold, environment, z_h_ds = (
        ComplexExpr(value[f"{name}_re"], value[f"{name}_im"]) for name in ("device", "hold", "environment", "target")
    )
    z_h_avc = ImpedanceLoop(angle, device, hold, environment, environment, environment).perceived(b, k, b_p)
    objective = (ca.sqrt(abs2(z_h_ds)) - ca.sqrt(abs2(z_h_avc))) ** 2
    constraint = z_h_avc.real - value["margin"]
    return CouplingNlp(
        gains=ca.vertcat(b, k, b_p),
        parameters=parameters,
        impedance=z_h_avc,
        target=z_h_ds,
        objective=objective,
        constraint=constraint,
    )


def nlp_parameters(problem: Problem, loop: ImpedanceLoop, size: float = 1.0) -> FloatArray:
    """Return the parameters of `coupling_nlp`, shape (15, n), impedances over a size; the last three natural scales."""
    margin = margin_over_range(problem)
    weight = np.abs(loop.environment) / size
    weight = np.where(weight > 0, weight, 1.0)
    values = dict.fromkeys(_NAMES, np.zeros(weight.shape)) | {
        "sample_time": np.full(weight.shape, problem.device.sample_time_s),
        "sin": loop.angle.sin,
        "cos": loop.angle.cos,
        "device_re": loop.device.real / size,
        "device_im": loop.device.imag / size,
        "hold_re": loop.hold.real,
        "hold_im": loop.hold.imag,
        "environment_re": loop.environment.real / size,
        "environment_im": loop.environment.imag / size,
        "target_re": loop.target.real / size,
        "target_im": loop.target.imag / size,
        "margin": np.full(weight.shape, margin / size),
        "scale_b": weight,
        "scale_k": weight / np.abs(coupling_impedance(loop.angle, 0.0, 1.0)),
        "scale_p": weight,
    }
    return np.array([values[name] for name in _NAMES], dtype=np.float64)


KKT_TOLERANCE = 1e-6
"""Largest accepted KKT residual: the decrease of error^2 along one gain at the slope of the point, over the
gain's natural scale or up to its bound, relative to the square of the terms that make up |Z_h_avc|."""


@dataclass(frozen=True)
class Optimality:
    """Recomputed quality of each row, arrays of shape (n,); not a number for rows without gains.

    Attributes:
        violation_ns_per_m: how far Re Z_h lies below the margin, infinite outside the gain box.
        kkt_residual: see `KKT_TOLERANCE`.
    """

    violation_ns_per_m: FloatArray
    kkt_residual: FloatArray

    def acceptable(self) -> BoolArray:
        """Return whether each row counts as solved."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.violation_ns_per_m == 0) & (self.kkt_residual <= KKT_TOLERANCE))


_ACTIVE = 1e-6
"""(12) counts as active where Re Z_h is within this share of its terms of the margin."""


@lru_cache(maxsize=8)
def _derivatives(rows: int) -> Any:
    """Return (gains, parameters) -> objective, constraint, both gradients and that of Im Z_h, mapped over rows."""
    nlp = coupling_nlp()
    outputs = [
        nlp.objective,
        nlp.constraint,
        ca.gradient(nlp.objective, nlp.gains),
        ca.gradient(nlp.constraint, nlp.gains),
        ca.gradient(nlp.impedance.imag, nlp.gains),
    ]
    return ca.Function("optimality", [nlp.gains, nlp.parameters], outputs).map(rows)


def optimality(problem: Problem, loop: ImpedanceLoop, gains: GainArrays) -> Optimality:
    """Return violation of (12), N.s/m, and KKT residual, no unit, of (b, k, b_p), each (n,), recomputed."""
    parameters = nlp_parameters(problem, loop)
    x = np.array(gains)
    f, g, df, dg, turning = (np.array(value) for value in _derivatives(x.shape[1])(x, parameters))
    terms = np.abs(loop.target) + np.abs(loop.device) + np.abs(loop.hold * (loop.rendered(*gains[:2]) + gains[2]))
    with np.errstate(invalid="ignore", divide="ignore"):
        missing = np.where(-g[0] > np.finfo(np.float64).eps * terms, -g[0], 0.0)
        # |Z| has no gradient where Z = 0, but rises from there in every direction; an error of 0 is optimal anyway.
        df = np.where(np.isnan(df), -2 * np.sqrt(f) * np.hypot(dg, turning), df)
        df, dg = np.where(f[0] == 0, 0.0, df / terms**2), dg / terms
        active = g[0] <= _ACTIVE * terms
    violation = np.where(admissible(problem, *gains), missing, np.inf)
    box = problem.coupling
    low, high = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]).T[:, :, None]
    scale = parameters[-3:] + x
    down = np.clip(x - low, 0.0, scale)
    up = np.clip(high - x, 0.0, scale)
    residual = _residual(df, np.where(active, dg, 0.0), down, up)
    empty = np.isnan(x).any(axis=0)
    return Optimality(np.where(empty, np.nan, violation), np.where(empty, np.nan, residual))


def _residual(df: FloatArray, dg: FloatArray, down: FloatArray, up: FloatArray) -> FloatArray:
    """Return the smallest KKT residual over multipliers lambda >= 0 of (12), shape (n,).

    With slopes s_i = df_i - lambda dg_i of the gains i, that can fall by down_i and rise by up_i, it is the largest of
    s_i down_i where s_i > 0, else -s_i up_i. As a function of lambda it is least at 0, where a slope vanishes or where
    two gains balance; ``df``, ``dg``, ``down`` and ``up`` have shape (3, n).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        choices = [np.zeros(df.shape[1]), *(df / dg)]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            reaches = product((down[i], -up[i]), (down[j], -up[j]))
            choices += [
                (reach_i * df[i] - reach_j * df[j]) / (reach_i * dg[i] - reach_j * dg[j])
                for reach_i, reach_j in reaches
            ]
    multiplier = np.array(choices)
    multiplier = np.where(np.isfinite(multiplier) & (multiplier > 0), multiplier, 0.0)
    slope = df - multiplier[:, None] * dg
    return np.asarray(np.where(slope > 0, slope * down, -slope * up).max(axis=1).min(axis=0))
