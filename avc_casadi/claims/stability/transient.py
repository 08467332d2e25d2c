"""How a loop settles: the least damped oscillation and the time to settle, released and with the hands of the set."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.stability.declared_device import closed_loop, plants_with_forces
from avc_casadi.claims.stability.frozen_loop import frozen_rendering
from avc_casadi.claims.stability.state_feedback import state_feedback_loop
from avc_casadi.loops.spectrum import eigenvalues
from avc_casadi.model.hands import Hand, hand_corners, no_hand
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling

SETTLED = 0.02
"""Share of its initial amplitude below which an oscillation counts as settled."""
# A pole that turns less per sample does not oscillate; a smaller one is deadbeat.
_TURN, _GONE = 1e-6, 1e-9


@dataclass(frozen=True)
class Transient:
    """How the loop in contact settles, on the nominal device.

    Attributes:
        settling_s: time to settle of the slowest oscillation, to 2 %; 0 without oscillation, infinite where it does not
            decay.
        damping_ratio: of the least damped oscillation; 1 without oscillation.
        frequency_hz: of the same; 0 without oscillation.
    """

    settling_s: float
    damping_ratio: float
    frequency_hz: float

    @classmethod
    def of(cls, loops: FloatArray, sample_time_s: float) -> Transient:
        """Return the worst of some loops, shape (..., s, s)."""
        poles = eigenvalues(loops).ravel()
        swinging = poles[_swings(poles)]
        if len(swinging) == 0:
            return cls(0.0, 1.0, 0.0)
        rate = np.log(swinging) / sample_time_s
        ratio = -rate.real / np.abs(rate)
        worst = int(np.argmin(ratio))
        hz = float(np.abs(rate[worst].imag) / (2 * math.pi))
        return cls(float(settling_s(poles, sample_time_s)), float(ratio[worst]), hz)


def settling_s(poles: ComplexArray, sample_time_s: float) -> FloatArray:
    """Return the settling time of the slowest oscillation of each loop, shape (...).

    Args:
        poles: of the loops, shape (..., s).
        sample_time_s: T.
    """
    radius = np.where(_swings(poles), np.abs(poles), 0.0).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = sample_time_s * math.log(SETTLED) / np.log(radius)
    return np.asarray(np.where(radius >= 1, np.inf, np.where(radius > 0, found, 0.0)))


def _swings(poles: ComplexArray) -> BoolArray:
    return np.asarray((np.abs(np.angle(poles)) > _TURN) & (np.abs(poles) > _GONE))


def transients(coupling: Coupling) -> tuple[Transient, Transient]:
    """Return the transients of the device in contact: released, and with the worst corner of the hands.

    Linear: gains at rest, the innovation of a law unattenuated; an observer between encoder steps is left out.

    Args:
        coupling: gains with their runtime.
    """
    problem = coupling.problem
    ranges = problem.hands.model_copy(update={"let_go": False})
    return _transient(coupling, no_hand()), _transient(coupling, hand_corners(ranges))


def _transient(coupling: Coupling, hands: Hand) -> Transient:
    problem, gains, law = coupling.problem, coupling.table.at_rest, coupling.runtime.state_feedback
    plants = plants_with_forces(sampled_plant(problem.device, hands))
    rendering = frozen_rendering(
        problem, gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    )
    loops = closed_loop(*plants, rendering) if law is None else state_feedback_loop(plants, law, rendering)
    return Transient.of(loops, problem.device.sample_time_s)
