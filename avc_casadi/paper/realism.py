"""Realism of an impedance: between the paper's bounds U and L, or within the just-noticeable difference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi.model.problem import Impedance, Objective, Problem
from avc_casadi.paper.equations import ImpedanceLoop, environment_impedance, loop_at, perceived_impedance

IMPERCEPTIBLE = 1e-6
"""Share of a bound by which |Z_h| may miss it and counts as inside: a solver ends this close to it."""


@dataclass(frozen=True, eq=False)
class RealismResult(Document):
    """Realism at each frequency; arrays of shape (n,). Frequencies without gains are not inside.

    Attributes:
        inside_bounds: whether |Z_h| lies between those of the bounds L and U.
        inside_jnd: whether |Z_h - Z_h_ds| is at most the just-noticeable difference rho of |Z_h_ds|.
        jnd: rho.
    """

    JSON_KEYS: ClassVar = ("inside_bounds", "inside_jnd", "share_inside_bounds", "share_inside_jnd", "jnd")

    inside_bounds: BoolArray
    inside_jnd: BoolArray
    jnd: float

    @property
    def share_inside_bounds(self) -> float:
        """Share of the frequencies that are inside the bounds."""
        return float(np.mean(self.inside_bounds))

    @property
    def share_inside_jnd(self) -> float:
        """Share of the frequencies that are inside the just-noticeable difference."""
        return float(np.mean(self.inside_jnd))


def judge_realism(problem: Problem, impedance: ComplexArray, usable: BoolArray) -> RealismResult:
    """Judge perceived impedances at the problem's frequencies."""
    impedance = np.where(usable, impedance, np.nan)
    loop = loop_at(problem, problem.frequencies_hz())
    low, high = bound_magnitudes(problem, loop)
    size = np.abs(impedance)
    jnd = problem.realism.jnd
    above_low = size >= low * (1 - IMPERCEPTIBLE)
    below_high = size <= high * (1 + IMPERCEPTIBLE)
    return RealismResult(
        inside_bounds=np.asarray(above_low & below_high),
        inside_jnd=np.asarray(np.abs(impedance - loop.target) <= jnd * (1 + IMPERCEPTIBLE) * np.abs(loop.target)),
        jnd=jnd,
    )


def bound_magnitudes(problem: Problem, loop: ImpedanceLoop) -> tuple[FloatArray, FloatArray]:
    """Return |Z_h| with the bounds L and U themselves rendered: the smaller and the larger, (n,) each, N.s/m."""
    ends = np.array([np.abs(bound) for bound in perceived_bounds(problem, loop)])
    return ends.min(axis=0), ends.max(axis=0)


def perceived_bounds(problem: Problem, loop: ImpedanceLoop) -> tuple[ComplexArray, ComplexArray]:
    """Return Z_h with the bounds U and L themselves rendered, each (n,), N.s/m."""
    model = problem.stability.model

    def perceived(bound: Impedance) -> ComplexArray:
        rendered = environment_impedance(loop.angle, model, bound.damping_ns_per_m, bound.stiffness_n_per_m)
        return np.asarray(perceived_impedance(loop.device, loop.hold, rendered))

    return perceived(problem.boundaries.upper), perceived(problem.boundaries.lower)


def relative_errors(
    impedance: ComplexArray, target: ComplexArray, objective: Objective = "magnitude", jnd: float = 0.0
) -> FloatArray:
    """Return the relative errors of perceived impedances, of the broadcast shape of the arguments.

    magnitude: ||Z_h| - |Z_h_ds||/|Z_h_ds|; complex: e = |Z_h - Z_h_ds|/|Z_h_ds|; perceptual: max(e/rho - 1, 0).
    """
    size = np.abs(target)
    if objective == "magnitude":
        return np.asarray(np.abs(np.abs(impedance) - size) / size)
    error = np.abs(impedance - target) / size
    if objective == "complex":
        return np.asarray(error)
    return np.asarray(np.maximum(error / jnd - 1, 0.0))
