"""Two rates in one loop: a spring of every frame of a picture or an engine and a damper of every tick, or the reverse.

From tick to tick only what is new at every tick changes the force; what is new at every frame jumps there. The slow
part is late by half its own period and by what its frame waits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi.identification.closed_loop import regression
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log

_FEWEST = 100
_FEWEST_FRAMES = 12
_MOST_TICKS, _MOST_LATE, _MOST_LAG = 100, 3, 3
# Share of the changes that the fast part explains exactly, and of the others that come in one phase of a frame.
_MOSTLY, _IN_PHASE = 0.6, 0.95
# A change is exact to this share of the usual one.
_EXACT = 1e-3
# A force nearer to its largest is cut.
_WHOLE = 0.999


@dataclass(frozen=True)
class TwoRates:
    """F(n) = k x(m - late) + b v(m) + a constant, of which one part has the position of its last frame.

    Attributes:
        law: both gains, as a loop of one rate would have them.
        slow: "spring" or "damper".
        ticks: of a frame.
        late: frames from a position to its force, beside those of the frame itself.
    """

    law: Law
    slow: str
    ticks: int
    late: int

    def sentence(self, period_s: float) -> str:
        """Say which part runs how often."""
        fast = "damper" if self.slow == "spring" else "spring"
        late = f" and {self.late} frame{'' if self.late == 1 else 's'} late" if self.late else ""
        return (
            f"two rates in one loop: the {self.slow} is new every {number(1e3 * self.ticks * period_s, 3)} ms{late}, "
            f"the {fast} every {number(1e3 * period_s, 3)} ms (k = {number(self.law.stiffness_n_per_m, 3)} N/m, "
            f"b = {number(self.law.damping_ns_per_m, 3)} N.s/m)"
        )


def find_two_rates(log: Log) -> TwoRates | None:
    """Return the two rates at which the parts of a force are computed, or None of a loop of one rate.

    Args:
        log: on its grid, without a tick missed.
    """
    force, position = log.force_n, log.position_m
    size = np.abs(force)
    if not log.ran.all() or size.max() == 0:
        return None
    whole = (size > 1e-9 * size.max()) & (size < _WHOLE * size.max())
    for lag in range(_MOST_LAG + 1):
        for slow in ("spring", "damper"):
            found = _frames(force, position, whole, lag, slow)
            if found is not None:
                fitted = _fitted(log, whole, lag, slow, *found)
                if fitted is not None:
                    return fitted
    return None


def _frames(force: FloatArray, position: FloatArray, whole: BoolArray, lag: int, slow: str) -> tuple[int, int] | None:
    """Return the ticks of a frame, and the first tick of one, where the fast part leaves jumps that come evenly."""
    fast = position if slow == "damper" else np.diff(position, prepend=position[0])
    rows = np.flatnonzero(whole[1:] & whole[:-1]) + 1
    rows = rows[rows > lag + 2]
    new, moved = force[rows] - force[rows - 1], fast[rows - lag] - fast[rows - lag - 1]
    some = np.abs(moved) > 1e-9 * np.abs(moved).max(initial=1e-300)
    if np.count_nonzero(some) < _FEWEST:
        return None
    # Most ticks are of the fast part alone: the middle of their ratios is its gain.
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
