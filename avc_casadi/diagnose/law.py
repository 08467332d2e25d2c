"""The law from position to force in a log: spring, damper, filter, lag; a switched part; two rates."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.diagnose.oscillation import Log, Oscillation, even_phase
from avc_casadi.identification.regression import feedback, regression

# Residual up to which a law explains the force; a more complex law has to leave so much less; an exact one needs no
# other. Lags that are tried, and the fewest samples of a law that is not exact.
_EXPLAINS, _BETTER, _EXACT, _MOST_LAG, _FEWEST = 0.05, 0.3, 5e-3, 8, 25


@dataclass(frozen=True)
class Switch:
    """c sign(s): s is the position between two edges, where the force is none, the speed, or the rest of the force."""

    force_n: float
    by: Literal["position", "speed", "force"]
    edges_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Frames:
    """A spring or damper that is new once in so many ticks, and some frames late."""

    slow: Literal["spring", "damper"]
    ticks: int
    late: int


@dataclass(frozen=True)
class Law:
    """F(n) = k x(n-lag) + b v(n-lag) + offset + switch; v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T."""

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    lag: int
    offset_n: float
    misfit: float
    samples: int
    switch: Switch | None = None
    frames: Frames | None = None

    @property
    def explains(self) -> bool:
        """Whether it is the force of the log."""
        return self.misfit < _EXPLAINS

    def filter_hz(self, sample_time_s: float) -> float | None:
        """Cut-off of the velocity filter; None without one below the Nyquist frequency."""
        return None if self.keep <= math.exp(-math.pi) else -math.log(self.keep) / (2 * math.pi * sample_time_s)


def find_law(log: Log, swing: Oscillation, limit_n: float | None, friction_n: float) -> Law | None:
    """Return the law that explains the force best, whether it does or not; None without enough samples in contact."""
    size = np.abs(log.force_n)
    most = float(size.max(initial=0.0))
    if not most:
        return None
    limit = most if limit_n is None else min(most, limit_n)
    top = size >= 0.9999 * limit
    # The largest force may be a limit; where the position toggles between two steps it belongs to one of them.
    cut = top & (limit == limit_n or np.ptp(log.position_m[top]) > 1.5 * log.encoder_m)
    use = log.ran & log.touching & ~cut
    best: Law | None = None
    for lag in range(_MOST_LAG + 1):
        for filtered in (False, True):
            law = _plain(log, use, lag, filtered=filtered)
            law = law if law is None or filtered else _with_limit(law, log, cut, limit)
            if law is not None and (best is None or law.misfit < _BETTER * best.misfit):
                best = law
    if best is not None and best.misfit < _EXACT:
        return best
    part = np.zeros_like(use)
    part[swing.first : swing.last] = True
    whole = log.ran & part & (True if np.unique(log.force_n).size <= 3 else ~cut)
    others = [_switched(log, whole, friction_n), _two_rates(log, use & part)]
    better = (law for law in others if law is not None and (best is None or law.misfit < _BETTER * best.misfit))
    return next(better, best)


def _lagged(ran: BoolArray, use: BoolArray, lag: int) -> IndexArray:
    """Return the ticks whose lagged samples are in the log."""
    good = use.copy()
    good[: lag + 2] = False
    for back in {lag, lag + 1} - {0}:
        good[back:] &= ran[:-back]
    return np.flatnonzero(good)


def _share(left_n: float, force: FloatArray) -> float:
    """Return a residual as a share of the changes of the force."""
    changes = float(np.std(force))
    return max(left_n / changes, 1e-12) if changes else math.inf


def _left(columns: FloatArray, force: FloatArray) -> tuple[FloatArray, float]:
    """Return the factors of a regression and its residual as a share, infinite where columns are alike."""
    found = regression(columns, force)
    return (np.zeros(columns.shape[1]), math.inf) if found is None else (found[0], _share(found[1], force))


def _plain(log: Log, use: BoolArray, lag: int, *, filtered: bool) -> Law | None:
    """Fit a spring and a damper, with a filter of the velocity or without."""
    rows = _lagged(log.ran, use, lag)
    rows = rows[use[rows - 1]] if filtered else rows
    if rows.size < 6:
        return None
    x, before = log.position_m[rows - lag], log.position_m[rows - lag - 1]
    if rows.size < _FEWEST and len(np.unique(np.stack([x, before], axis=1), axis=0)) < 6 + 2 * filtered:
        return None
    one = feedback(log.position_m, log.force_n, rows, lag, log.period_s, filtered=filtered)
    if one is None:
        return None
    # From the force before, the next is told too easily: what counts is the error that the filter sums up.
    left = _share(one.left_n, log.force_n[rows]) / max(1 - one.keep, 1e-3)
    if not math.isfinite(left) or (rows.size < _FEWEST and left > 1e-3):
        return None
    return Law(one.stiffness_n_per_m, one.damping_ns_per_m, one.keep, lag, one.offset_n, left, int(rows.size))


def _with_limit(law: Law, log: Log, cut: BoolArray, limit_n: float) -> Law:
    """Count the forces at the limit too, which the law has to reach."""
    rows = _lagged(log.ran, cut, law.lag)
    if not rows.size:
        return law
    x, before = log.position_m[rows - law.lag], log.position_m[rows - law.lag - 1]
    force = law.stiffness_n_per_m * x + law.damping_ns_per_m * (x - before) / log.period_s + law.offset_n
    left = np.clip(force, -limit_n, limit_n) - log.force_n[rows]
    return replace(law, misfit=max(law.misfit, float(np.sqrt(np.mean(left**2))) / limit_n))


def _switched(log: Log, use: BoolArray, friction_n: float) -> Law | None:
    """Return the law with a part that a sign switches, or None."""
    position, force = log.position_m, log.force_n
    best: Law | None = None
    for lag in range(_MOST_LAG + 1):
        rows = _lagged(log.ran, use, lag)
        if rows.size < 50 or not np.ptp(force[rows]):
            break
        x, before = position[rows - lag], position[rows - lag - 1]
        after = position[np.minimum(rows - lag + 1, position.size - 1)]
        signs = [
            (Switch(0.0, "position", (low, high)), (np.sign(x - low) + np.sign(x - high)) / 2)
            for low, high in _edges(force, position, rows, lag)
        ]
        signs += [(Switch(0.0, "speed"), np.sign(one - before)) for one in (x, after)]
        signs += [(Switch(0.0, "force"), np.sign(force[rows]))] if np.unique(force[rows]).size > 3 else []
        plain = np.stack([x - x.mean(), x - before, np.ones(rows.size)], axis=1)
        most = min(_EXPLAINS, _BETTER * _left(plain, force[rows])[1])
        for kind, sign in signs:
            values, left = _left(np.column_stack([sign, plain]), force[rows])
            alone, left_alone = _left(np.column_stack([sign, np.ones(rows.size)]), force[rows])
            if left_alone < _EXPLAINS and left_alone < 2 * left:
                values, left = np.array([alone[0], 0.0, 0.0, alone[1]]), left_alone
            c, k, b, offset = values.tolist()
            matters = abs(c) > 0.05 * float(np.ptp(force[rows])) or (kind.by == "speed" and 0 < friction_n < -c)
            if left <= most and matters and (best is None or left < _BETTER * best.misfit):
                switch = replace(kind, force_n=c)
                best = Law(k, b * log.period_s, 0.0, lag, offset - k * float(x.mean()), left, int(rows.size), switch)
    return best


def _edges(force: FloatArray, position: FloatArray, rows: IndexArray, lag: int) -> list[tuple[float, float]]:
    """Return where the position may switch the force: at one edge, or at two with a dead band between them."""
    rows = rows[np.isin(rows - 1, rows)]
    if rows.size < 20:
        return []
    x, before, older = (position[rows - lag - back] for back in range(3))
    changes = force[rows] - force[rows - 1]
    columns = np.stack([x - before, x - 2 * before + older], axis=1)
    near = np.ones(rows.size, dtype=bool)
    for _ in range(4):
        smooth = np.linalg.lstsq(columns[near], changes[near], rcond=1e-9)[0]
        left = np.abs(changes - columns @ smooth)
        near = left <= np.quantile(left, 0.7)
    jumps = (left > 0.35 * left.max()) & (x != before)
    if np.count_nonzero(jumps) < 3:
        return []
    low, high = np.minimum(x, before)[jumps], np.maximum(x, before)[jumps]

    def edge(some: BoolArray) -> float:
        inner, outer = float(low[some].max()), float(high[some].min())
        if inner > outer:
            return float(np.median(low[some] + high[some])) / 2
        return 0.0 if inner <= 0 <= outer else (inner + outer) / 2

    upper = low + high > ((low + high).min() + (low + high).max()) / 2
    centre, most = edge(np.ones(low.size, dtype=bool)), float((high - low).max())
    edges = [(centre, centre)]
    if upper.any() and (low + high)[upper].min() > (low + high)[~upper].max():
        edges.append((edge(~upper), edge(upper)))
    # Edges that one step may cross together.
    return edges + [(centre - width, centre + width) for width in np.geomspace(0.03 * most, 0.6 * most, 12).tolist()]


def _two_rates(log: Log, use: BoolArray) -> Law | None:
    """Return the law whose spring or damper is new once a frame and the other part at every tick, or None."""
    if log.missed_share > 0.01:
        return None
    force, position, period = log.force_n, log.position_m, log.period_s
    best: Law | None = None
    kinds: tuple[Literal["spring", "damper"], ...] = ("spring", "damper")
    for lag in range(4):
        for slow in kinds:
            frame = _frame(force, position, use, lag, slow)
            for late in range(4) if frame else ():
                ticks, first = frame or (1, 0)
                rows = np.flatnonzero(use)
                rows = rows[rows > first + (late + 1) * ticks + lag + 1]
                framed = rows - (rows - first) % ticks - late * ticks
                spring, damper = (framed - lag, rows - lag) if slow == "spring" else (rows - lag, framed - lag)
                back = 1 if slow == "spring" else ticks
                speed = (position[damper] - position[damper - back]) / (back * period)
                columns = np.stack([position[spring], speed, np.ones(rows.size)], axis=1)
                (k, b, offset), left = _left(columns, force[rows])
                if left < _EXPLAINS and k > 0 and b > 0 and (best is None or left < best.misfit):
                    frames = Frames(slow, ticks, late)
                    best = Law(float(k), float(b), 0.0, lag, float(offset), left, int(rows.size), frames=frames)
    return best


def _frame(force: FloatArray, position: FloatArray, use: BoolArray, lag: int, slow: str) -> tuple[int, int] | None:
    """Return the ticks of a frame and its first tick: beside the fast part the force jumps in one phase only."""
    fast = position if slow == "damper" else np.diff(position, prepend=position[0])
    rows = np.flatnonzero(use[1:] & use[:-1]) + 1
    rows = rows[rows > lag + 2]
    new, moved = force[rows] - force[rows - 1], fast[rows - lag] - fast[rows - lag - 1]
    some = np.abs(moved) > 1e-9 * np.abs(moved).max(initial=1e-300)
    if np.count_nonzero(some) < 100:
        return None
    # Most ticks are of the fast part alone: the median of their ratios is its gain.
    gain = float(np.median(new[some] / moved[some]))
    jumps = np.abs(new - gain * moved) > 1e-3 * float(np.abs(new).max())
    if gain <= 0 or np.mean(~jumps) < 0.45 or np.count_nonzero(jumps) < 12:
        return None
    return even_phase(rows[jumps], min(100, force.size // 12))
