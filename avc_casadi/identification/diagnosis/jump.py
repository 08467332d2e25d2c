"""A force that jumps where contact begins: a spring without length, which no loop with a delay holds.

A damper jumps there too, by b times the speed, and pulls the force to 0 before the device leaves the wall. Its force is
a spring and a damper cut at 0: carried on to the sample before contact, the same sum is at most 0. That of a force that
a position switches on is as large there as it is a sample later.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Swing

_FEWEST = 25
_MOST_LAG = 3
# What spring, damper and jump leave of the force in contact, as a share.
_LEFT = 0.05
# A spring's force goes by its stiffness times the encoder's steps: over so few of them, or of no more than so many of
# its own, a force that begins is no jump but a step.
_FEW_STEPS, _OWN_STEPS = 3.5, 2.5
# Share of the force's swing that is the jump, and how often a cycle begins contact.
_SHARE = 0.4
_PER_CYCLE = 0.5
_NOTHING = 1e-3
# A force nearer to the device's limit is cut.
_WHOLE = 0.9999


@dataclass(frozen=True)
class Jump:
    """F = jump + k (x - x0) + b dx/dt in contact, 0 outside of it.

    Attributes:
        force_n: the jump at x0, out of the wall.
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
        lag: samples from a position to its force.
    """

    force_n: float
    stiffness_n_per_m: float
    damping_ns_per_m: float
    lag: int


def jump_sentence(jump: Jump, reach_m: float) -> str:
    """Say how the force follows the position.

    Args:
        jump: of the log.
        reach_m: how far the hand moves for a unit of the position.
    """
    nothing = _NOTHING * reach_m**2
    parts = [f"{number(jump.force_n, 3)} N"]
    parts += [f"{number(jump.stiffness_n_per_m, 3)} N/m of depth"] if abs(jump.stiffness_n_per_m) > nothing else []
    parts += [f"{number(jump.damping_ns_per_m, 3)} N.s/m"] if abs(jump.damping_ns_per_m) > nothing else []
    return f"in contact the force is {' + '.join(parts)}, and 0 outside: every cycle switches it"


def find_jump(log: Log, swing: Swing, law: Law | None, limit_n: float | None) -> Jump | None:
    """Return the jump that an oscillation switches in every cycle, or None.

    Args:
        log: on its grid.
        swing: its oscillation.
        law: what the computer makes of the position; where it is told, its spring says what is left at the edge.
        limit_n: force limit of the device, at which forces are cut and tell nothing of what made them.
    """
    found, period = swing.found, log.ticks.period_s
    # What was switched on may have begun it: its later half counts.
    part = slice((swing.first + swing.last) // 2, swing.last)
    force, position = log.force_n[part], log.position_m[part]
    touching = force > 1e-9 * float(np.abs(force).max(initial=0.0))
    before = np.flatnonzero(touching[1:] & ~touching[:-1])
    cycles = found.frequency_hz * force.size * period
    swings = float(np.ptp(force))
    whole = touching if limit_n is None else touching & (force < _WHOLE * limit_n)
    if whole.sum() < _FEWEST or before.size < _PER_CYCLE * cycles or (force < 0).any():
        return None
    for lag in range(_MOST_LAG + 1):
        rows = np.flatnonzero(whole)
        rows = rows[rows > lag]
        if np.ptp(position[rows - lag]) < _FEW_STEPS * log.encoder_m:
            continue
        edge = float(position[rows - lag].min())
        columns = _columns(position, rows, lag, edge, period)
        told = np.linalg.lstsq(columns, force[rows], rcond=1e-10)[0]
        left = float(np.sqrt(np.mean((columns @ told - force[rows]) ** 2)))
        if left < _LEFT * float(np.sqrt(np.mean(force[rows] ** 2))):
            jump = Jump(float(told[0]), float(told[1]), float(told[2]), lag)
            if jump.force_n < _OWN_STEPS * jump.stiffness_n_per_m * log.encoder_m:
                return None
            carried = _columns(position, before[before > lag], lag, edge, period) @ told
            switched = carried.size > 0 and float(np.median(carried)) > _LEFT * swings
            least = _SHARE * swings
            # Contact begins where the force does, cut at the device's limit or not.
            contact = np.flatnonzero(touching)
            begins = float(position[contact[contact > lag] - lag].min())
            return jump if switched and min(jump.force_n, _of_spring(law, begins, log.reach_m)) > least else None
    return None


def _of_spring(law: Law | None, edge: float, reach_m: float) -> float:
    """Return the force of the spring alone at a position; infinite where none is told."""
    if law is None or not law.told or not law.stiffness_n_per_m > _NOTHING * reach_m**2:
        return np.inf
    return law.stiffness_n_per_m * (edge - law.wall_m)


def _columns(position: FloatArray, rows: IndexArray, lag: int, edge: float, period: float) -> FloatArray:
    """Return 1, depth and speed of the samples that some forces were computed from, shape (rows, 3)."""
    x = position[rows - lag]
    return np.stack([np.ones(rows.size), x - edge, (x - position[rows - lag - 1]) / period], axis=1)
