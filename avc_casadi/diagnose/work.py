"""What drives a swing from outside: a shaking, a force that takes energy, or a steady swing that nothing limits."""

from __future__ import annotations

import cmath
import math

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.diagnose.change import FEW_STEPS
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.plant import Hypothesis, stable
from avc_casadi.model.hands import released_hand
from avc_casadi.model.plant import DEVICE, sampled_plant

_AT_TOP = 0.999
"""Share of the largest force, or of the limit, from which on a force is at it."""

_FLAT_TOP_SHARE = 0.1
"""Share of ticks at the largest force from which on it is a limit; of a sine 3 % are."""

_ALWAYS_TOUCHING = 0.999
"""Share of ticks in contact from which on a swing never leaves the wall."""


def drives_from_outside(log: Log, swing: Oscillation, law: FittedLaw, hypothesis: Hypothesis) -> str:
    """Return why a hand, the table or a machine drives a swing; empty where not.

    Of a swing of a few encoder steps only a shaking that was fitted tells: the steps themselves may drive and bound it.
    """
    if hypothesis.shake_hz is not None and stable(hypothesis, law):
        push = f"a steady push from outside at {number(hypothesis.shake_hz, 3)} Hz"
        return f"{push} explains the motion: a hand, the table or a machine shakes the device"
    if swing.steps <= FEW_STEPS:
        return ""
    if work_w(log, swing, hypothesis) < 0:
        return "the force as it acts takes energy from the swing: a hand, the table or a machine drives it"
    if swing.kind == "limit cycle" and not limited(log, swing, law, hypothesis):
        return "nothing limits the steady swing, as the loop would have to: a hand, the table or a machine may drive it"
    return ""


def limited(log: Log, swing: Oscillation, law: FittedLaw, hypothesis: Hypothesis) -> bool:
    """Return whether anything bounds a swing: a force limit, a wall that it leaves, travel stops, or a switched force.

    A linear loop that is unstable grows, and one that is stable decays: it swings steadily at its very limit alone.
    Friction does not bound a swing either, as its share falls with the size.
    """
    if law.switch is not None or hypothesis.stops is not None or swing.contact_share < _ALWAYS_TOUCHING:
        return True
    force = np.abs(log.force_n[swing.first : swing.last])
    largest = float(force.max())
    limit_n = hypothesis.device.max_force_n
    at_limit = limit_n is not None and largest >= _AT_TOP * limit_n
    return at_limit or float(np.mean(force >= _AT_TOP * largest)) > _FLAT_TOP_SHARE


def work_w(log: Log, swing: Oscillation, hypothesis: Hypothesis) -> float:
    """Return the mean power of the force, W, over whole cycles, by the size of the motion that the encoder reads.

    -1/(N T) sum over n of F(n - delay - lead) (x(n+1) - x(n)), as the force counts against the position. The force acts
    late and held, and on the motor, whose motion leads that of an encoder behind a resonance.
    """
    inside = log.position_m[swing.first : swing.last]
    middle = inside.mean()
    lead_ticks = _lead_ticks(hypothesis, swing.frequency_hz)
    behind = hypothesis.delay + lead_ticks
    rises = swing.first + np.flatnonzero((inside[1:] > middle) & (inside[:-1] <= middle)) + 1
    # Of the first cycles of a log, the force that acts on the motor may be of before it.
    rises = rises[rises >= lead_ticks]
    if rises.size < 2:
        return 0.0
    ticks = np.arange(int(rises[0]), int(rises[-1]))
    # The force of a tick acts from its delay on.
    acting = np.interp(ticks - behind, np.arange(log.force_n.size), log.force_n)
    moves = log.position_m[ticks + 1] - log.position_m[ticks]
    return -float(np.sum(acting * moves)) / (ticks.size * log.period_s)


def _lead_ticks(hypothesis: Hypothesis, frequency_hz: float) -> float:
    """Return the ticks, within a cycle, by which the motion of the motor is ahead of what the encoder reads.

    The angle of G_motor / G_encoder at z = e^(j omega T), with G = c (z I - A)^-1 b of the sampled plant.
    """
    plant = sampled_plant(hypothesis.device, hypothesis.hand or released_hand())
    motor_row = np.array([float(name == f"{DEVICE}_position_m") for name in plant.names])
    if np.array_equal(motor_row, plant.output_row):
        return 0.0
    angle = 2 * math.pi * frequency_hz * plant.sample_time_s
    z = cmath.exp(1j * angle)
    force = plant.new[0, 0] + plant.old[0, 0] / z
    state = np.linalg.solve(z * np.eye(len(plant.names)) - plant.matrix[0, 0], force)
    return (cmath.phase(complex(motor_row @ state) / complex(plant.output_row @ state)) % (2 * math.pi)) / angle
