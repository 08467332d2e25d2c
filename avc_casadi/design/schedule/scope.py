"""Constraints of each stage: Re Z_h over its scope or stability with every hand, and `realism.require`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.claims.hands import ScopeSlack, deciding_frequencies_hz, scope_band_hz, scope_slack
from avc_casadi.model.corners import corner_problems, least_damped
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import Loop, loop_at
from avc_casadi.paper.numbers import Complex, Real, abs2
from avc_casadi.paper.realism import bound_magnitudes
from avc_casadi.paper.rows import GainArrays

_BETWEEN = {"band": (3, 5), "all": (3, 23)}
"""Slots between the ends of a scope whose critical frequencies are unknown: in the NLP, and in the lattice."""
_LOWEST_SHARE = 1e-4
"""Lowest initial frequency of scope all, as a share of Nyquist."""
_INSIDE = 1 - 1e-9
"""Share of Nyquist at which a slot represents Nyquist itself, where Im Z_d is infinite."""
REALISM_ROWS = {"none": 0, "jnd": 1, "bounds": 2}
"""Number of non-negative values of each requirement."""


def deciding_corners(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem at the critical corners of its device: all for hands, the least damped one for Re Z_h."""
    if problem.stability.scope == "hands":
        return corner_problems(problem)
    # Re Z_h does not depend on the mass and grows with the damping; the hand's is credited.
    return (least_damped(problem, problem.schedule.hand_damping_ns_per_m),)


def worst_slack(problem: Problem, frequency_hz: FloatArray, gains: GainArrays) -> ScopeSlack:
    """Return the exact slack of each row over its whole scope, at the worst corner of the device."""
    corners = deciding_corners(problem)
    deciding = deciding_frequencies_hz(problem, frequency_hz)
    if deciding is not None:
        at = _evaluable(problem, deciding.T)
        real = loop_at(corners[0], at).perceived(*gains).real
        lowest = real.argmin(axis=0), np.arange(real.shape[1])
        return ScopeSlack(real[lowest] - problem.stability.margin_ns_per_m, at[lowest])
    all_slacks = [scope_slack(corner, frequency_hz, *gains) for corner in corners]
    slack = np.array([item.slack for item in all_slacks])
    worst = slack.argmin(axis=0), np.arange(slack.shape[1])
    return ScopeSlack(slack[worst], np.array([item.frequency_hz for item in all_slacks])[worst])


@dataclass
class Slots:
    """Frequencies at which Re Z_h is kept above the margin; violating ones are added until none is left."""

    frequency_hz: FloatArray
    fixed: int

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray, *, spread: bool = False) -> Slots:
        """Return the critical frequencies, where known, or else the ends of each scope and some between."""
        if problem.stability.scope == "hands":
            return cls(np.empty((0, len(frequency_hz))), 0)
        deciding = deciding_frequencies_hz(problem, frequency_hz)
        if deciding is not None:
            return cls(_evaluable(problem, deciding.T), deciding.shape[1])
        low, high = scope_band_hz(problem, frequency_hz)
        lowest = np.minimum(np.maximum(low, _LOWEST_SHARE * 0.5 / problem.device.sample_time_s), high)
        between = np.geomspace(lowest, high, _BETWEEN[problem.stability.scope][spread] + 2)[1:-1]
        return cls(_evaluable(problem, np.concatenate((low[None], high[None], between))), 2)

    def add(self, problem: Problem, gains: GainArrays, worst: ScopeSlack, missed: BoolArray) -> None:
        """Replace the least active frequency of each stage by its worst one, ``missed`` (n,)."""
        if len(self.frequency_hz) == self.fixed:
            return
        free = loop_at(deciding_corners(problem)[0], self.frequency_hz[self.fixed :]).perceived(*gains).real
        slot, stages = self.fixed + free.argmax(axis=0), np.flatnonzero(missed)
        self.frequency_hz[slot[stages], stages] = _evaluable(problem, worst.frequency_hz[stages])


def _evaluable(problem: Problem, frequency_hz: FloatArray) -> FloatArray:
    """Return frequencies just inside 0 and Nyquist, where an impedance is infinite though its real part is not."""
    nyquist = 0.5 / problem.device.sample_time_s
    return np.asarray(np.clip(frequency_hz, 1e-7 * nyquist, _INSIDE * nyquist))


def realism_values(problem: Problem, z: Complex, target: Complex, bounds: FloatArray | list[Real]) -> list[Real]:
    """Return what must not be negative, of symbols or arrays; bounds of |Z_h|^2 over |Z_h_ds|^2."""
    if problem.realism.require == "jnd":
        return [1 - abs2(z - target) / (abs2(target) * problem.realism.jnd**2)]
    size2 = abs2(z) / abs2(target)
    return [size2 - bounds[0], bounds[1] - size2] if problem.realism.require == "bounds" else []


def relative_bounds(problem: Problem, loop: Loop) -> FloatArray:
    """Return least and largest |Z_h|^2 of the problem's bounds, over |Z_h_ds|^2, (2, n)."""
    return np.asarray((np.array(bound_magnitudes(problem, loop)) / np.abs(loop.target)) ** 2)


def realism_slack(problem: Problem, loop: Loop, gains: GainArrays) -> FloatArray:
    """Return the relative slack of gains, each (..., n), in the required realism at n frequencies; infinite if none."""
    if problem.realism.require == "none":
        return np.full(gains[0].shape, np.inf)
    target, bounds = np.asarray(loop.target), relative_bounds(problem, loop)
    return np.asarray(np.min(realism_values(problem, loop.perceived(*gains), target, bounds), axis=0))
