"""What each stage must meet: Re Z_h over its scope, or every hand, and what `realism.require` asks of Z_h."""

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
"""Slots beside the ends of a scope whose deciding frequencies are not known."""
_SPREAD = {"pointwise": 0, "band": 5, "all": 23, "hands": 0}
"""How many there are for the lattice, which has a first look at the scope."""
_LOWEST_SHARE = 1e-4
"""Lowest frequency, as a share of Nyquist, at which scope all is looked at first."""
LOOP_ROWS = 9
"""Parameters of a loop at a frequency."""
_INSIDE = 1 - 1e-9
"""Share of Nyquist at which a slot stands for Nyquist itself, where Im Z_d is infinite."""
REALISM_ROWS = {"none": 0, "jnd": 1, "bounds": 2}
"""How many values each requirement keeps from being negative."""
REALISM_BACKOFF = 1e-7
"""How far inside its requirement each stage is asked to stay, relative: the NLP's tolerance then never leaves it."""


def deciding_corners(problem: Problem) -> tuple[Problem, ...]:
    """The problem at the corners of its device that decide: all for hands, the least damped one for Re Z_h."""
    if problem.stability.scope == "hands":
        return corner_problems(problem)
    # Re Z_h does not depend on the mass and grows with the damping; the hand's is credited.
    return (least_damped(problem, problem.schedule.hand_damping_ns_per_m),)


def worst_slack(problem: Problem, frequency_hz: FloatArray, gains: GainArrays) -> ScopeSlack:
    """The exact slack of each row over its whole scope, at the worst corner of the device."""
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
    """Take the hand of each row at its own corner of the device."""
    known = [vars(hands).values() for hands in found if hands is not None]
    if not known:
        return None
    return Hand(*np.take_along_axis(np.array([list(one) for one in known]), corner[None, None, :], axis=0)[0])


@dataclass
class Slots:
    """Frequencies at which Re Z_h is kept above the margin; violating ones are added until none is left.

    Attributes:
        frequency_hz: the frequencies, (m, n), m for each stage.
        fixed: how many of each stage stay, the first ones; the others give way to violating frequencies.
    """

    frequency_hz: FloatArray
    fixed: int

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray, *, spread: bool = False) -> Slots:
        """Take the frequencies that decide, where they are known, or else the ends of each scope and some between.

        Args:
            problem: the problem.
            frequency_hz: stages, (n,).
            spread: take many between, for a first look.
        """
        deciding = deciding_frequencies_hz(problem, frequency_hz)
        if deciding is not None:
            return cls(_evaluable(problem, deciding.T), deciding.shape[1])
        low, high = scope_band_hz(problem, frequency_hz)
        lowest = np.minimum(np.maximum(low, _LOWEST_SHARE * 0.5 / problem.device.sample_time_s), high)
        between = np.geomspace(lowest, high, (_SPREAD if spread else _FREE)[problem.stability.scope] + 2)[1:-1]
        return cls(_evaluable(problem, np.concatenate((low[None], high[None], between))), 2)

    def copy(self) -> Slots:
        """Return slots that change on their own."""
        return Slots(self.frequency_hz.copy(), self.fixed)

    def moved(self, problem: Problem, frequency_hz: FloatArray) -> Slots:
        """Return slots for a changed problem of the same size: its own ends, and what was found before."""
        fresh = Slots.of(problem, frequency_hz)
        fresh.frequency_hz[self.fixed :] = _evaluable(problem, self.frequency_hz[self.fixed :])
        return fresh

    def add(self, problem: Problem, gains: GainArrays, worst: ScopeSlack, missed: BoolArray) -> None:
        """Put the worst frequency of each stage ``missed`` (n,) in place of the one that binds these gains least."""
        if len(self.frequency_hz) == self.fixed:
            return
        free = loop_at(deciding_corners(problem)[0], self.frequency_hz[self.fixed :]).perceived(*gains).real
        slot, stages = self.fixed + free.argmax(axis=0), np.flatnonzero(missed)
        self.frequency_hz[slot[stages], stages] = _evaluable(problem, worst.frequency_hz[stages])

    def loops(self, problem: Problem) -> list[Loop]:
        """The loop at each slot, with the device that decides."""
        corner = deciding_corners(problem)[0]
        return [loop_at(corner, row) for row in self.frequency_hz]

    def parameters(self, problem: Problem) -> FloatArray:
        """Parameters of the slots, (9 m, n)."""
        return np.concatenate([loop_parameters(loop) for loop in self.loops(problem)])


def loop_parameters(loop: Loop, damping_credit_ns_per_m: float = 0.0) -> FloatArray:
    """Parameters of a numeric loop, shape (9, ...); the credit is added to the damping of the device."""
    device = loop.device + damping_credit_ns_per_m
    columns = (loop.angle.sample_time_s, loop.angle.sin, loop.angle.cos, device.real, device.imag)
    rest = (loop.hold.real, loop.hold.imag, loop.environment.real, loop.environment.imag)
    return np.array(np.broadcast_arrays(*columns, *rest), dtype=np.float64)


def _evaluable(problem: Problem, frequency_hz: FloatArray) -> FloatArray:
    """Frequencies just inside 0 and Nyquist, where an impedance is infinite though its real part is not."""
    nyquist = 0.5 / problem.device.sample_time_s
    return np.asarray(np.clip(frequency_hz, 1e-7 * nyquist, _INSIDE * nyquist))


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
