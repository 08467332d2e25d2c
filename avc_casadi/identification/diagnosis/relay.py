"""Discontinuous forces: switched by a sign (relay, minimum force, rendered friction), or at the edge of contact.

At its edge the gain of a sign is infinite (its describing function is 4 c/(pi A) at an amplitude A), so that no loop
with a delay is stable with it, however soft spring and damper are.

A damper jumps at the edge of contact too, by b times the speed, and pulls the force to 0 before the device leaves the
wall: extrapolated to the sample before contact, its sum with the spring is at most 0. That of a force switched on by
the position is as large there as it is a sample later.

Two rates in one loop: a spring updated every frame of graphics or an engine and a damper every tick, or the reverse.

From tick to tick only the fast part changes the force; the slow part jumps at each frame. It is late by half its own
period and by the latency of its frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi.identification.closed_loop import regression
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation

_MOST_LAG = 8
_FEWEST = 100
# A switched force is accepted with so small a residual, as an ordinary law; and one so much smaller than of spring and
# damper.
_LEFT, _BETTER = 0.05, 0.3
# Switched share of the force amplitude, below which it is friction compensation.
_SHARE = 0.1
# With a force of two or three levels, share of the samples with that of their sign.
_FOLLOWS = 0.97
_SIZES = 3
# A force nearer to the device's limit is saturated.
_WHOLE = 0.9999


@dataclass(frozen=True)
class SwitchedForce:
    """F = c sign(s) + k x + b dx/dt + a constant.

    Attributes:
        force_n: c, below 0 where it acts along the motion: friction compensation.
        by: switching variable: the position, the speed, or the sign of the force itself (a minimum force).
        at_m: switching position.
        law: the spring and the damper beside it; zero where there are none.
        band_m: to either side of that position the force is none.
    """

    force_n: float
    by: str
    at_m: float
    law: Law
    band_m: float = 0.0

    @property
    def alone(self) -> bool:
        """Whether it is the whole force."""
        return not self.law.stiffness_n_per_m and not self.law.damping_ns_per_m

    def sentence(self) -> str:
        """Describe the force in one sentence."""
        band = f" by {number(self.band_m, 3)}" if self.band_m else ""
        where = {
            "position": f"where the position {'leaves' if band else 'crosses'} {number(self.at_m, 3)}{band}",
            "speed": "against the motion" if self.force_n > 0 else "along the motion (friction that is compensated)",
            "force": "with its own sign: no force is smaller (a minimum force)",
        }[self.by]
        return f"a force of +-{number(abs(self.force_n), 3)} is switched {where}"


def find_switched_force(
    log: Log, swing: TracedOscillation, limit_n: float | None, friction_n: float
) -> SwitchedForce | None:
    """Return the force switched by a sign during an oscillation, or None.

    Args:
        log: on its grid.
        swing: its oscillation.
        limit_n: force limit of the device, at which forces saturate.
        friction_n: of the device; compensation beyond it feeds an oscillation, however small.
    """
    part = slice(swing.first, swing.last)
    force, position, ran = log.force_n[part], log.position_m[part], log.ran[part]
    if np.count_nonzero(ran) < _FEWEST or not np.ptp(force):
        return None
    speed = np.gradient(position)
    sizes = np.unique(force).size
    whole = ran & (True if limit_n is None or sizes <= _SIZES else np.abs(force) < _WHOLE * limit_n)
    best: SwitchedForce | None = None
    least = np.inf
    for lag in range(_MOST_LAG + 1):
        rows = np.flatnonzero(whole[lag + 1 :]) + lag + 1
        if rows.size < _FEWEST:
            break
        edge = _edge(force, position, rows, lag)
        signs = {
            "position": np.sign(position[rows - lag] - edge),
            "speed": np.sign(speed[rows - lag]),
            "speed of the last tick": np.sign(position[rows - lag] - position[rows - lag - 1]),
            "force": np.sign(force[rows]),
        }
        if sizes == _SIZES:
            banded = _with_a_band(force, position, rows, lag)
            if banded is not None:
                return banded
        for name, sign in signs.items():
            by = name.partition(" ")[0]
            if by != "force" and sizes <= _SIZES and _follows(force[rows], sign):
                along = float(np.mean(force[rows] * sign))
                size = math.copysign(float(np.ptp(force)) / 2, along)
                return SwitchedForce(size, by, edge, Law(0.0, 0.0, 0.0, lag, edge, 1e-12, int(rows.size)))
            found = None if sizes <= _SIZES else _fit(force, position, rows, lag, sign, log.ticks.period_s)
            if found is None or not found[1].misfit < _BETTER * least:
                continue
            feeds = by == "speed" and found[0] < 0 and 0 < friction_n < -found[0]
            if feeds or 2 * abs(found[0]) > _SHARE * float(np.ptp(force[rows])):
                best, least = SwitchedForce(found[0], by, edge, found[1]), found[1].misfit
    return best


def _edge(force: FloatArray, position: FloatArray, rows: IndexArray, lag: int) -> float:
    """Return the position at which the force jumps."""
    jumps = np.abs(force[rows] - force[rows - 1])
    at = rows[jumps > 0.5 * jumps.max()]
    sides = np.sort([position[at - lag], position[at - lag - 1]], axis=0)
    low, high = float(sides[0].max()), float(sides[1].min())
    if low > high:
        # No position lies between those of every jump.
        return float(np.median(sides))
    return 0.0 if low <= 0 <= high else (low + high) / 2


def _with_a_band(force: FloatArray, position: FloatArray, rows: IndexArray, lag: int) -> SwitchedForce | None:
    """Return a force of two opposite levels that is none within a band of positions, or None."""
    levels = np.unique(force)
    size = float(np.ptp(levels)) / 2
    low, middle, high = (np.sort(position[rows - lag][force[rows] == level]) for level in levels)
    if not min(low.size, middle.size, high.size) or abs(levels.sum()) > _NOTHING * size:
        return None
    # Of all pairs of neighbours, the shares in which the larger force is at the larger position.
    ordered = [float(np.mean(np.searchsorted(one, other))) / one.size for one, other in ((low, middle), (middle, high))]
    if min(ordered) < _FOLLOWS:
        return None
    law = Law(0.0, 0.0, 0.0, lag, 0.0, 1e-12, int(rows.size))
    return SwitchedForce(size, "position", float(low[-1] + high[0]) / 2, law, float(high[0] - low[-1]) / 2)


def _follows(force: FloatArray, sign: FloatArray) -> bool:
    middle = (float(force.min()) + float(force.max())) / 2
    moves = sign != 0
    same = float(np.mean(np.sign(force - middle)[moves] == sign[moves])) if moves.any() else 0.5
    return bool(moves.mean() > 0.5 and max(same, 1 - same) > _FOLLOWS)


def _fit(
    force: FloatArray, position: FloatArray, rows: IndexArray, lag: int, sign: FloatArray, period_s: float
) -> tuple[float, Law] | None:
    """Return the switched level and the law beside it, where a sign explains the force; None elsewhere."""
    x, before = position[rows - lag], position[rows - lag - 1]
    plain = np.stack([x - x.mean(), x - before, np.ones(rows.size)], axis=1)
    swings = float(np.std(force[rows]))
    without = regression(plain, force[rows])[1] / swings
    told, left_n, _ = regression(np.column_stack([plain, sign]), force[rows])
    size, left = float(told[3]), left_n / swings
    if left > min(_LEFT, _BETTER * without):
        return None
    k, b = float(told[0]), float(told[1]) * period_s
    slack = float(x.mean()) - float(told[2]) / k if k else float(x.mean())
    return size, Law(k, b, 0.0, lag, slack, max(left, 1e-12), int(rows.size))


_FEWEST_JUMP = 25
_MOST_LAG_JUMP = 3
# Residual of spring, damper and jump in contact, as a share of the force.
_LEFT_JUMP = 0.05
# The force of a spring changes by its stiffness times the encoder step: over so few steps of position, or up to so many
# steps of force, a force at contact is no jump but quantisation.
_FEW_STEPS, _OWN_STEPS = 3.5, 2.5
# Share of the jump in the force amplitude, and contacts per cycle.
_SHARE_JUMP = 0.4
_PER_CYCLE = 0.5
_NOTHING = 1e-3
# A force nearer to the device's limit is saturated.
_WHOLE_JUMP = 0.9999


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
    """Describe how the force follows the position.

    Args:
        jump: of the log.
        reach_m: travel of the hand per unit of position.
    """
    nothing = _NOTHING * reach_m**2
    parts = [f"{number(jump.force_n, 3)}"]
    parts += [f"{number(jump.stiffness_n_per_m, 3)} of depth"] if abs(jump.stiffness_n_per_m) > nothing else []
    parts += [f"{number(jump.damping_ns_per_m, 3)}"] if abs(jump.damping_ns_per_m) > nothing else []
    return f"in contact the force is {' + '.join(parts)}, and 0 outside: every cycle switches it"


def find_jump(log: Log, swing: TracedOscillation, law: Law | None, limit_n: float | None) -> Jump | None:
    """Return the jump that occurs in every cycle of an oscillation, or None.

    Args:
        log: on its grid.
        swing: its oscillation.
        law: from position to force; where identified, its spring gives the rest of the force at the edge.
        limit_n: force limit of the device; saturated forces carry no information.
    """
    found, period = swing.found, log.ticks.period_s
    # Switching on may have started it: its later half counts.
    part = slice((swing.first + swing.last) // 2, swing.last)
    force, position = log.force_n[part], log.position_m[part]
    touching = force > 1e-9 * float(np.abs(force).max(initial=0.0))
    before = np.flatnonzero(touching[1:] & ~touching[:-1])
    cycles = found.frequency_hz * force.size * period
    swings = float(np.ptp(force))
    whole = touching if limit_n is None else touching & (force < _WHOLE_JUMP * limit_n)
    if whole.sum() < _FEWEST_JUMP or before.size < _PER_CYCLE * cycles or (force < 0).any():
        return None
    for lag in range(_MOST_LAG_JUMP + 1):
        rows = np.flatnonzero(whole)
        rows = rows[rows > lag]
        if np.ptp(position[rows - lag]) < _FEW_STEPS * log.encoder_m:
            continue
        edge = float(position[rows - lag].min())
        columns = _columns(position, rows, lag, edge, period)
        told = np.linalg.lstsq(columns, force[rows], rcond=1e-10)[0]
        left = float(np.sqrt(np.mean((columns @ told - force[rows]) ** 2)))
        if left < _LEFT_JUMP * float(np.sqrt(np.mean(force[rows] ** 2))):
            jump = Jump(float(told[0]), float(told[1]), float(told[2]), lag)
            if jump.force_n < _OWN_STEPS * jump.stiffness_n_per_m * log.encoder_m:
                return None
            carried = _columns(position, before[before > lag], lag, edge, period) @ told
            switched = carried.size > 0 and float(np.median(carried)) > _LEFT_JUMP * swings
            least = _SHARE_JUMP * swings
            # Contact begins where the force does, saturated or not.
            contact = np.flatnonzero(touching)
            begins = float(position[contact[contact > lag] - lag].min())
            return jump if switched and min(jump.force_n, _of_spring(law, begins, log.reach_m)) > least else None
    return None


def _of_spring(law: Law | None, edge: float, reach_m: float) -> float:
    """Return the force of the spring alone at a position; infinite where none is identified."""
    if law is None or not law.told or not law.stiffness_n_per_m > _NOTHING * reach_m**2:
        return np.inf
    return law.stiffness_n_per_m * (edge - law.wall_m)


def _columns(position: FloatArray, rows: IndexArray, lag: int, edge: float, period: float) -> FloatArray:
    """Return 1, depth and speed of the samples behind some forces, shape (rows, 3)."""
    x = position[rows - lag]
    return np.stack([np.ones(rows.size), x - edge, (x - position[rows - lag - 1]) / period], axis=1)


_FEWEST_OF_TWO = 100
_FEWEST_FRAMES = 12
_MOST_TICKS, _MOST_LATE, _MOST_LAG_OF_TWO = 100, 3, 3
# Share of the changes that the fast part explains exactly, and of the others that occur in one phase of a frame.
_MOSTLY, _IN_PHASE = 0.6, 0.95
# A change is exact to this share of the usual one.
_EXACT = 1e-3
# A force nearer to its largest is saturated.
_WHOLE_OF_TWO = 0.999


@dataclass(frozen=True)
class TwoRates:
    """F(n) = k x(m - late) + b v(m) + a constant, one part of which takes the position of its last frame.

    Attributes:
        law: both gains, as of a loop with one rate.
        slow: "spring" or "damper".
        ticks: of a frame.
        late: frames from a position to its force, beyond those of the frame itself.
    """

    law: Law
    slow: str
    ticks: int
    late: int

    def sentence(self, period_s: float) -> str:
        """Describe the rates of the two parts."""
        fast = "damper" if self.slow == "spring" else "spring"
        late = f" and {self.late} frame{'' if self.late == 1 else 's'} late" if self.late else ""
        return (
            f"two rates in one loop: the {self.slow} is new every {number(1e3 * self.ticks * period_s, 3)} ms{late}, "
            f"the {fast} every {number(1e3 * period_s, 3)} ms (k = {number(self.law.stiffness_n_per_m, 3)}, "
            f"b = {number(self.law.damping_ns_per_m, 3)})"
        )


def find_two_rates(log: Log) -> TwoRates | None:
    """Return the two rates of the parts of a force, or None for a loop of one rate.

    Args:
        log: on its tick grid, without a tick missed.
    """
    force, position = log.force_n, log.position_m
    size = np.abs(force)
    if log.ticks.missed_share or size.max() == 0:
        return None
    whole = log.ran & (size > 1e-9 * size.max()) & (size < _WHOLE_OF_TWO * size.max())
    for lag in range(_MOST_LAG_OF_TWO + 1):
        for slow in ("spring", "damper"):
            found = _frames(force, position, whole, lag, slow)
            if found is not None:
                fitted = _fitted(log, whole, lag, slow, *found)
                if fitted is not None:
                    return fitted
    return None


def _frames(force: FloatArray, position: FloatArray, whole: BoolArray, lag: int, slow: str) -> tuple[int, int] | None:
    """Return the ticks of a frame, and its first tick, where the residual jumps of the fast part are periodic."""
    fast = position if slow == "damper" else np.diff(position, prepend=position[0])
    rows = np.flatnonzero(whole[1:] & whole[:-1]) + 1
    rows = rows[rows > lag + 2]
    new, moved = force[rows] - force[rows - 1], fast[rows - lag] - fast[rows - lag - 1]
    some = np.abs(moved) > 1e-9 * np.abs(moved).max(initial=1e-300)
    if np.count_nonzero(some) < _FEWEST_OF_TWO:
        return None
    # Most ticks are of the fast part alone: the median of their ratios is its gain.
    gain = float(np.median(new[some] / moved[some]))
    left = np.abs(new - gain * moved)
    jumps = left > _EXACT * float(np.abs(new).max())
    if gain <= 0 or np.mean(~jumps) < _MOSTLY or np.count_nonzero(jumps) < _FEWEST_FRAMES:
        return None
    at = rows[jumps]
    for ticks in range(min(_MOST_TICKS, force.size // _FEWEST_FRAMES), 1, -1):
        phases = np.bincount(at % ticks, minlength=ticks)
        if phases.max() >= _IN_PHASE * at.size:
            return ticks, int(np.argmax(phases))
    return None


def _fitted(log: Log, whole: BoolArray, lag: int, slow: str, ticks: int, first: int) -> TwoRates | None:
    force, position, period = log.force_n, log.position_m, log.ticks.period_s
    best: TwoRates | None = None
    for late in range(_MOST_LATE + 1):
        rows = np.flatnonzero(whole)
        rows = rows[rows > first + (late + 1) * ticks + lag + 1]
        frame = rows - (rows - first) % ticks - late * ticks
        at: dict[str, IndexArray] = {"spring": rows - lag, "damper": rows - lag, slow: frame - lag}
        behind = ticks if slow == "damper" else 1
        speed = (position[at["damper"]] - position[at["damper"] - behind]) / (behind * period)
        columns = np.stack([position[at["spring"]], speed, np.ones(rows.size)], axis=1)
        (k, b, constant), left_n, _ = regression(columns, force[rows])
        left = left_n / float(np.std(force[rows]))
        law = Law(float(k), float(b), 0.0, lag, -float(constant / k), max(left, 1e-12), int(rows.size))
        if law.told and k > 0 and b > 0 and (best is None or left < best.law.misfit):
            best = TwoRates(law, slow, ticks, late)
    return best
