"""What `realism.require` asks of a stage, as values that must not be negative."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.problem import Problem
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.numbers import Complex, Real, abs2
from avc_casadi.paper.realism import bound_magnitudes
from avc_casadi.paper.rows import GainArrays

REALISM_ROWS = {"none": 0, "jnd": 1, "bounds": 2}
"""How many values each requirement keeps from being negative."""
REALISM_BACKOFF = 1e-7
"""How far inside its requirement each stage is asked to stay, relative: the NLP's tolerance then never leaves it."""


def realism_values(require: str, z: Complex, target: Complex, jnd: Real, bounds: tuple[Real, Real]) -> list[Real]:
    """Return what must not be negative, of symbols or arrays.

    Args:
        require: none, jnd or bounds.
        z: Z_h.
        target: Z_h_ds.
        jnd: the just-noticeable difference as a share of |Z_h_ds|.
        bounds: least and largest |Z_h|^2 over |Z_h_ds|^2.
    """
    goal2 = abs2(target)
    if require == "jnd":
        return [1 - abs2(z - target) / (goal2 * jnd**2)]
    size2 = abs2(z) / goal2
    return [size2 - bounds[0], bounds[1] - size2] if require == "bounds" else []


def relative_bounds(problem: Problem, loop: Loop) -> tuple[FloatArray, FloatArray]:
    """Least and largest |Z_h|^2 that the problem's bounds allow, over |Z_h_ds|^2, (n,); 0 where nobody asks."""
    if problem.realism.require != "bounds":
        return np.zeros(1), np.zeros(1)
    low, high = bound_magnitudes(problem, loop)
    radius = np.abs(loop.target)
    return (low / radius) ** 2, (high / radius) ** 2


def realism_slack(problem: Problem, loop: Loop, gains: GainArrays) -> FloatArray:
    """How far gains, each (..., n), are inside what is required at the n frequencies, relative; infinite for none."""
    realism = problem.realism
    if realism.require == "none":
        return np.full(gains[0].shape, np.inf)
    bounds = relative_bounds(problem, loop)
    return np.asarray(
        np.minimum.reduce(
            realism_values(realism.require, loop.perceived(*gains), np.asarray(loop.target), realism.jnd, bounds)
        )
    )
