"""The NLP (11)-(12) as CasADi expressions of the gains b, k and b_p: the definition of the method `direct`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi.loop import ComplexExpr, Loop, SampleAngle, abs2, casadi_numbers, coupling_impedance, margin_over_range
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

_NAMES = (
    "sample_time", "sin", "cos", "device_re", "device_im", "hold_re", "hold_im", "environment_re", "environment_im",
    "target_re", "target_im", "margin", "scale_b", "scale_k", "scale_p",
)  # fmt: skip


@dataclass(frozen=True)
class CouplingNlp:
    """One frequency's NLP; all members are CasADi SX expressions.

    Attributes:
        gains: (b, k, b_p), the decision variables, N.s/m and N/m.
        parameters: everything that depends on device, environment, bounds, margin and frequency, shape (15,), so that
            one NLP serves all problems.
        impedance: Z_h_avc.
        target: Z_h_ds.
        objective: (|Z_h_ds| - |Z_h_avc|)^2   (11).
        distance: |Z_h_avc - Z_h_ds|^2, which breaks ties of (11).
        constraint: Re Z_h_avc - margin   (12).
        constraint_polynomial: (12) times |Z_e + Z_avc|^2: the same sign, quadratic in the gains, free of division.
    """

    gains: Any
    parameters: Any
    impedance: ComplexExpr
    target: ComplexExpr
    objective: Any
    distance: Any
    constraint: Any
    constraint_polynomial: Any


@cache
def coupling_nlp() -> CouplingNlp:
    """Build the NLP of one frequency; built once a process."""
    b, k, b_p = ca.SX.sym("b"), ca.SX.sym("k"), ca.SX.sym("b_p")
    parameters = ca.SX.sym("parameters", len(_NAMES))
    value = dict(zip(_NAMES, ca.vertsplit(parameters), strict=True))
    angle = SampleAngle(casadi_numbers(), 0.0, value["sample_time"], value["sin"], value["cos"])
    device = ComplexExpr(value["device_re"], value["device_im"])
    hold = ComplexExpr(value["hold_re"], value["hold_im"])
    environment = ComplexExpr(value["environment_re"], value["environment_im"])
    z_h_ds = ComplexExpr(value["target_re"], value["target_im"])

    z_avc = coupling_impedance(angle, b, k)
    z_h_avc = Loop(angle, device, hold, environment, environment, environment).perceived(b, k, b_p)
    objective = (ca.sqrt(abs2(z_h_ds)) - ca.sqrt(abs2(z_h_avc))) ** 2
    constraint = z_h_avc.real - value["margin"]

    # With d for what stands beside the series part: d|Z_e + Z_avc|^2 + Re{H (Z_avc|Z_e|^2 + Z_e|Z_avc|^2)} >= 0.
    beside = device.real - value["margin"] + hold.real * b_p
    polynomial = (
        (beside + (hold * environment).real) * abs2(z_avc)
        + ((hold * abs2(environment) + 2 * beside * environment.conjugate()) * z_avc).real
        + beside * abs2(environment)
    )
    return CouplingNlp(
        gains=ca.vertcat(b, k, b_p),
        parameters=parameters,
        impedance=z_h_avc,
        target=z_h_ds,
        objective=objective,
        distance=abs2(z_h_avc - z_h_ds),
        constraint=constraint,
        constraint_polynomial=polynomial,
    )


def nlp_parameters(problem: Problem, loop: Loop, size: float = 1.0) -> FloatArray:
    """Return the parameters of `coupling_nlp` for each frequency, shape (15, n), impedances over a size.

    The last three are natural scales of b, k and b_p: the gains at which coupling and environment weigh the same.
    """
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
        "margin": np.full(weight.shape, margin_over_range(problem) / size),
        "scale_b": weight,
        "scale_k": weight / np.abs(coupling_impedance(loop.angle, 0.0, 1.0)),
        "scale_p": weight,
    }
    return np.array([values[name] for name in _NAMES], dtype=np.float64)
