"""The scope of a problem as a condition on one row of gains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.loops.ranges import worst_hands
from avc_casadi.loops.sampled_loop import SampledLoop
from avc_casadi.loops.wall import RADIUS_TOLERANCE, frozen_parts

if TYPE_CHECKING:
    from avc_casadi.loops.sampled_loop import Values
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class ScopeSlack:
    """Slack of each row within its scope, shape (n,)."""

    slack: FloatArray
    frequency_hz: FloatArray

    @property
    def met(self) -> BoolArray:
        """Whether each row meets its scope strictly, without any tolerance."""
        return np.asarray(self.slack >= 0)


def scope_band_hz(problem: Problem, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the band in which the row of each frequency must be passive; the frequency itself for scope hands."""
    nyquist = 0.5 / problem.device.sample_time_s
    scope, factor = problem.stability.scope, problem.stability.band_factor
    if scope == "all":
        return np.zeros_like(frequency_hz), np.full_like(frequency_hz, nyquist)
    if scope == "band":
        return np.asarray(frequency_hz / factor), np.minimum(frequency_hz * factor, nyquist)
    return frequency_hz, frequency_hz


def deciding_frequencies_hz(problem: Problem, frequency_hz: FloatArray) -> FloatArray | None:
    """Return frequencies at which Re Z_h >= margin implies the whole scope, shape (n, m); None if none are known."""
    scope = problem.stability.scope
    if scope == "pointwise":
        return frequency_hz[:, None]
    if scope == "hands" or problem.stability.model == "paper" or problem.device.delay_samples:
        return None
    low, high = scope_band_hz(problem, frequency_hz)
    return high[:, None] if scope == "all" else np.stack([low, high], axis=1)


def scope_slack(
    problem: Problem,
    frequency_hz: Values,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
) -> ScopeSlack:
    """Return the slack of rows of gains in the scope, model and margin of a problem."""
    given = (frequency_hz, damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m)
    own, b, k, contact = (
        np.ravel(value) for value in np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in given))
    )
    margin = problem.stability.margin_ns_per_m
    if problem.stability.scope == "hands":
        parts, most = frozen_parts(problem, b, k), 1 - RADIUS_TOLERANCE
        lean = problem.device.model_copy(update={"damping_ns_per_m": problem.device.damping_ns_per_m - margin})
        worst = worst_hands(lean, parts, contact, problem.hands, enough=most)
        return ScopeSlack(most - worst.radius, worst.frequency_hz)
    worst_case = worst_margin(SampledLoop.of(problem), b, k, contact, *scope_band_hz(problem, own))
    sound = worst_case.poles_stable & (worst_case.dc_stiffness_n_per_m >= 0)
    slack = np.where(sound, worst_case.margin_ns_per_m - margin, -np.inf)
    return ScopeSlack(slack, worst_case.frequency_hz)
