"""Constraints of each stage: Re Z_h over its scope or stability with every hand, and `realism.require`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.claims.stability.scope import ScopeSlack, deciding_frequencies_hz, scope_band_hz, scope_slack
from avc_casadi.model.corners import corner_problems, least_damped
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.numbers import Complex, Real, abs2
from avc_casadi.paper.realism import bound_magnitudes
from avc_casadi.paper.rows import GainArrays

_FREE = {"pointwise": 0, "band": 3, "all": 3, "hands": 0}
"""Slots beside the ends of a scope whose critical frequencies are unknown."""
_SPREAD = {"pointwise": 0, "band": 5, "all": 23, "hands": 0}
"""Number of slots for the lattice, which evaluates the scope coarsely."""
_LOWEST_SHARE = 1e-4
"""Lowest initial frequency of scope all, as a share of Nyquist."""
LOOP_ROWS = 9
"""Parameters of a loop at a frequency."""
_INSIDE = 1 - 1e-9
"""Share of Nyquist at which a slot represents Nyquist itself, where Im Z_d is infinite."""
REALISM_ROWS = {"none": 0, "jnd": 1, "bounds": 2}
"""Number of non-negative values of each requirement."""
REALISM_BACKOFF = 1e-7
"""Relative backoff from each stage's requirement, so that the NLP's tolerance never violates it."""


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
    at = np.array([item.frequency_hz for item in all_slacks])[worst]
    return ScopeSlack(slack[worst], at, _of_each([item.hands for item in all_slacks], worst[0]))


def _of_each(found: list[Hand | None], corner: IndexArray) -> Hand | None:
    """Return the hand of each row at its own corner of the device."""
    known = [vars(hands).values() for hands in found if hands is not None]
    if not known:
        return None
    return Hand(*np.take_along_axis(np.array([list(one) for one in known]), corner[None, None, :], axis=0)[0])


@dataclass
class Slots:
    """Frequencies at which Re Z_h is kept above the margin; violating ones are added until none is left.

    Attributes:
        frequency_hz: the frequencies, (m, n), m for each stage.
        fixed: number of each stage that stay, the first ones; the others are replaced by violating frequencies.
    """

    frequency_hz: FloatArray
    fixed: int

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray, *, spread: bool = False) -> Slots:
        """Return the critical frequencies, where known, or else the ends of each scope and some between.

        Args:
            problem: the problem.
            frequency_hz: stages, (n,).
            spread: take many between, for a coarse evaluation.
        """
        deciding = deciding_frequencies_hz(problem, frequency_hz)
        if deciding is not None:
            return cls(_evaluable(problem, deciding.T), deciding.shape[1])
        low, high = scope_band_hz(problem, frequency_hz)
        lowest = np.minimum(np.maximum(low, _LOWEST_SHARE * 0.5 / problem.device.sample_time_s), high)
        between = np.geomspace(lowest, high, (_SPREAD if spread else _FREE)[problem.stability.scope] + 2)[1:-1]
        return cls(_evaluable(problem, np.concatenate((low[None], high[None], between))), 2)

    def copy(self) -> Slots:
        """Return an independent copy."""
        return Slots(self.frequency_hz.copy(), self.fixed)

    def moved(self, problem: Problem, frequency_hz: FloatArray) -> Slots:
        """Return slots for a changed problem of the same size: its own ends, and the frequencies found before."""
        fresh = Slots.of(problem, frequency_hz)
        fresh.frequency_hz[self.fixed :] = _evaluable(problem, self.frequency_hz[self.fixed :])
        return fresh

    def add(self, problem: Problem, gains: GainArrays, worst: ScopeSlack, missed: BoolArray) -> None:
        """Replace the least active frequency of each stage by its worst one, ``missed`` (n,)."""
        if len(self.frequency_hz) == self.fixed:
            return
        free = loop_at(deciding_corners(problem)[0], self.frequency_hz[self.fixed :]).perceived(*gains).real
        slot, stages = self.fixed + free.argmax(axis=0), np.flatnonzero(missed)
        self.frequency_hz[slot[stages], stages] = _evaluable(problem, worst.frequency_hz[stages])

    def loops(self, problem: Problem) -> list[Loop]:
        """Return the loop at each slot, with the critical device."""
        corner = deciding_corners(problem)[0]
        return [loop_at(corner, row) for row in self.frequency_hz]

    def parameters(self, problem: Problem) -> FloatArray:
        """Return the parameters of the slots, (9 m, n)."""
        return np.concatenate([loop_parameters(loop) for loop in self.loops(problem)])


def loop_parameters(loop: Loop) -> FloatArray:
    """Return the parameters of a numeric loop, shape (9, ...)."""
    columns = (loop.angle.sample_time_s, loop.angle.sin, loop.angle.cos, loop.device.real, loop.device.imag)
    rest = (loop.hold.real, loop.hold.imag, loop.environment.real, loop.environment.imag)
    return np.array(np.broadcast_arrays(*columns, *rest), dtype=np.float64)


def _evaluable(problem: Problem, frequency_hz: FloatArray) -> FloatArray:
    """Return frequencies just inside 0 and Nyquist, where an impedance is infinite though its real part is not."""
    nyquist = 0.5 / problem.device.sample_time_s
    return np.asarray(np.clip(frequency_hz, 1e-7 * nyquist, _INSIDE * nyquist))


def realism_values(require: str, z: Complex, target: Complex, jnd: Real, bounds: tuple[Real, Real]) -> list[Real]:
    """Return the values that must be non-negative, of symbols or arrays.

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
    """Return least and largest |Z_h|^2 of the problem's bounds, over |Z_h_ds|^2, (n,); 0 where not required."""
    if problem.realism.require != "bounds":
        return np.zeros(1), np.zeros(1)
    low, high = bound_magnitudes(problem, loop)
    radius = np.abs(loop.target)
    return (low / radius) ** 2, (high / radius) ** 2


def realism_slack(problem: Problem, loop: Loop, gains: GainArrays) -> FloatArray:
    """Return the relative slack of gains, each (..., n), in the required realism at n frequencies; infinite if none."""
    realism = problem.realism
    if realism.require == "none":
        return np.full(gains[0].shape, np.inf)
    bounds = relative_bounds(problem, loop)
    return np.asarray(
        np.minimum.reduce(
            realism_values(realism.require, loop.perceived(*gains), np.asarray(loop.target), realism.jnd, bounds)
        )
    )
