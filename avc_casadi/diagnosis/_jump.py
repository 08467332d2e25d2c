"""A force that jumps where contact begins: a spring without length, which no loop with a delay holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi.diagnosis._log import Log
from avc_casadi.diagnosis._oscillation import Swing
from avc_casadi.support import number

_FEWEST = 25
_MOST_LAG = 3
# What spring, damper and jump leave of the force in contact, as a share.
_LEFT = 0.05
# Share of the force's swing that is the jump, and how often a cycle begins contact.
_SHARE = 0.4
_PER_CYCLE = 0.5
_NOTHING = 1e-3


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


def jump_sentence(jump: Jump) -> str:
    """Say how the force follows the position.

    Args:
        jump: of the log.
    """
    parts = [f"{number(jump.force_n, 3)} N"]
    parts += [f"{number(jump.stiffness_n_per_m, 3)} N/m of depth"] if abs(jump.stiffness_n_per_m) > _NOTHING else []
    parts += [f"{number(jump.damping_ns_per_m, 3)} N.s/m"] if abs(jump.damping_ns_per_m) > _NOTHING else []
    return f"in contact the force is {' + '.join(parts)}, and 0 outside: every cycle switches it"


def find_jump(log: Log, swing: Swing) -> Jump | None:
    """Return the jump that an oscillation switches in every cycle, or None.

    Args:
        log: on its grid.
        swing: its oscillation.
    """
    found, period = swing.found, log.ticks.period_s
    # What was switched on may have begun it: its later half counts.
    part = slice((swing.first + swing.last) // 2, swing.last)
    force, position = log.force_n[part], log.position_m[part]
    touching = force > 1e-9 * float(np.abs(force).max(initial=0.0))
    begins = np.count_nonzero(touching[1:] & ~touching[:-1])
    cycles = found.frequency_hz * force.size * period
    swings = float(np.ptp(force))
    if touching.sum() < _FEWEST or begins < _PER_CYCLE * cycles or (force < 0).any():
        return None
    for lag in range(_MOST_LAG + 1):
        rows = np.flatnonzero(touching)
        rows = rows[rows > lag]
        x = position[rows - lag]
        edge = float(x.min())
        speed = (x - position[rows - lag - 1]) / period
        columns = np.stack([np.ones(rows.size), x - edge, speed], axis=1)
        told = np.linalg.lstsq(columns, force[rows], rcond=1e-10)[0]
        left = float(np.sqrt(np.mean((columns @ told - force[rows]) ** 2)))
        if left < _LEFT * float(np.sqrt(np.mean(force[rows] ** 2))):
            jump = Jump(float(told[0]), float(told[1]), float(told[2]), lag)
            return jump if jump.force_n > _SHARE * swings else None
    return None
