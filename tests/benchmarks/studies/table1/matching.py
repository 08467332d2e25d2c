"""Which coupling feels more like the reference: a model of a person who compares traces of force and position.

The reference is the same hand with the same intention before the same wall without sampling, quantisation or coupling.
A person notices a coupling by what differs more in contact, force or position, each as the rms of its difference over
the rms of the reference. Differences up to the Weber fraction w pass unnoticed (Weber's law; 0.10 as default, between
the 7 % of force and the 23 % of stiffness that are swept). Of two couplings the nearer one is chosen; a person is
unable to choose where neither differs noticeably from the reference, or the two not from one another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.problem import Impedance
from avc_casadi.simulation.population.trial import Conditions, Traces, traces

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.scene import Motion


WEBER = 0.10
WEBER_SWEEP = (0.07, 0.10, 0.15, 0.23)
# The reference is sampled this much faster, and its damping makes up for what is left of k_e T/2.
REFERENCE_FACTOR = 8


def reference_problem(problem: Problem) -> Problem:
    """Sample the wall so fast that it feels continuous."""
    step_s = problem.device.sample_time_s / REFERENCE_FACTOR
    wall = problem.environment
    made_up = Impedance(
        damping_ns_per_m=wall.damping_ns_per_m + wall.stiffness_n_per_m * step_s / 2,
        stiffness_n_per_m=wall.stiffness_n_per_m,
    )
    return problem.changed(device={"sample_time_s": step_s, "delay_samples": 0}, environment=made_up)


def reference_traces(
    problem: Problem, subjects: Hand | StylusHand, motion: Motion, friction_n: float
) -> Iterator[Traces]:
    """Simulate the reference for everybody, some at a time, and keep the samples of the device's own clock."""
    for found in traces(reference_problem(problem), NO_COUPLING, subjects, motion, Conditions(friction_n)):
        position, velocity, force = (
            values[:, ::REFERENCE_FACTOR] for values in (found.position_m, found.velocity_m_per_s, found.force_n)
        )
        yield Traces(position, velocity, force, problem.device.sample_time_s)


def distance(felt: Traces, reference: Traces) -> FloatArray:
    """How far each person's traces are from the reference, as a share of it, shape (people,).

    Both are compared from the first contact of the reference to the end. A run that diverges is infinitely far.
    """
    touched = np.cumsum(reference.force_n > 0, axis=1) > 0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        shares = [
            np.sqrt((touched * (mine - real) ** 2).sum(axis=1) / (touched * real**2).sum(axis=1))
            for mine, real in ((felt.force_n, reference.force_n), (felt.position_m, reference.position_m))
        ]
        far = np.max(shares, axis=0)
    return np.asarray(np.where(np.isfinite(far), far, np.inf))


@dataclass(frozen=True)
class Choice:
    """What people chose between two couplings.

    Attributes:
        first: chose the first as nearer to the reference, shape (people,).
        second: chose the second.
    """

    first: BoolArray
    second: BoolArray

    @property
    def unable(self) -> BoolArray:
        """Could not choose."""
        return ~(self.first | self.second)


def choose(first: FloatArray, second: FloatArray, weber: float = WEBER) -> Choice:
    """Let people choose between two couplings by their distances from the reference, each of shape (people,)."""
    noticed = np.maximum(first, second) > weber
    with np.errstate(invalid="ignore"):
        able = noticed & (np.abs(first - second) > weber)
    return Choice(first=np.asarray(able & (first < second)), second=np.asarray(able & (second < first)))
