"""What each stage must meet, named: frequencies of its scope, credit for hand and device, and the hands' table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi.design._gains import FloatArray
from avc_casadi.design._rows import Gains
from avc_casadi.design.schedule._stage import loop_parameters
from avc_casadi.impedance import Loop, loop_at
from avc_casadi.problem import Problem
from avc_casadi.stability import ScopeSlack, scope_band_hz, scope_slack

_SLOTS = {"pointwise": 1, "band": 5, "all": 6, "hands": 1}
_INSIDE = 1 - 1e-9
"""Share of Nyquist at which a slot stands for Nyquist itself, where Im Z_d is infinite."""


def device_corners(problem: Problem) -> list[Problem]:
    """The problem at every corner of the ranges of device mass and damping, with the credit for the hand's damping."""
    device, credit = problem.device, problem.schedule.hand_damping_ns_per_m
    masses = sorted(set(device.range.mass_kg or (device.mass_kg,)))
    dampings = sorted(set(device.range.damping_ns_per_m or (device.damping_ns_per_m,)))
    if problem.stability.scope != "hands":
        # Re Z_h does not depend on the mass and grows with the damping: one corner decides.
        masses, dampings = masses[:1], [dampings[0] + credit]
    return [
        problem.model_copy(update={"device": device.model_copy(update={"mass_kg": mass, "damping_ns_per_m": damping})})
        for mass in masses
        for damping in dampings
    ]


def worst_slack(problem: Problem, frequency_hz: FloatArray, gains: Gains) -> ScopeSlack:
    """The exact slack of each row over its whole scope, at the worst corner of the device."""
    all_slacks = [scope_slack(corner, frequency_hz, *gains) for corner in device_corners(problem)]
    slack = np.array([item.slack for item in all_slacks])
    worst = slack.argmin(axis=0), np.arange(slack.shape[1])
    return ScopeSlack(slack[worst], np.array([item.frequency_hz for item in all_slacks])[worst])


@dataclass
class Slots:
    """Frequencies (m, n) at which Re Z_h is kept above the margin; violating ones are added until none is left.

    Attributes:
        frequency_hz: the frequencies; unused slots repeat the stage's own.
        used: how many slots of each stage hold a frequency of their own, (n,).
    """

    frequency_hz: FloatArray
    used: FloatArray

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray) -> Slots:
        """Start with the ends of each scope."""
        nyquist = 0.5 / problem.device.sample_time_s
        low, high = scope_band_hz(problem, frequency_hz)
        low = np.maximum(low, 1e-7 * nyquist)
        slots = np.repeat(frequency_hz[None], _SLOTS[problem.stability.scope], axis=0)
        if len(slots) > 1:
            slots[0], slots[1], slots[2] = low, np.minimum(high, _INSIDE * nyquist), np.sqrt(low * high)
        return cls(slots, np.full(len(frequency_hz), min(3, len(slots))))

    def add(self, problem: Problem, worst: ScopeSlack, missed: FloatArray) -> None:
        """Give the worst frequencies of the stages ``missed`` slots of their own, the oldest going first."""
        nyquist = 0.5 / problem.device.sample_time_s
        free = len(self.frequency_hz) - 2
        for stage in np.flatnonzero(missed):
            slot = 2 + (self.used[stage] - 2) % free
            self.frequency_hz[int(slot), stage] = np.clip(worst.frequency_hz[stage], 1e-7 * nyquist, _INSIDE * nyquist)
            self.used[stage] += 1

    def loops(self, problem: Problem) -> list[Loop]:
        """The loop at each slot, with the device that decides."""
        corner = device_corners(problem)[0]
        return [loop_at(corner, row) for row in self.frequency_hz]

    def parameters(self, problem: Problem) -> FloatArray:
        """Parameters of the slots, (9 m, n)."""
        return np.concatenate([loop_parameters(loop) for loop in self.loops(problem)])
