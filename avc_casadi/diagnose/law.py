"""The law from position to force in a log: spring, damper, filter, lag; a switched part; two rates."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.diagnose.oscillation import Log, Oscillation

# Residual up to which a law explains the force; a more complex law has to leave so much less; an exact one needs no
# other. Lags that are tried, and the fewest samples of a law that is not exact.
_EXPLAINS, _BETTER, _EXACT, _MOST_LAG, _FEWEST = 0.05, 0.3, 5e-3, 8, 25


@dataclass(frozen=True)
class Switch:
    """c sign(s): s is the position between two edges, the speed, the rest of the force, or contact itself.

    Attributes:
        force_n: c; below 0 of the speed where it acts along the motion, as compensated friction does.
        by: switching variable.
        edges_m: lower and upper edge of the position; the force is none between them.
    """

    force_n: float
    by: Literal["position", "speed", "force", "contact"]
    edges_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Frames:
    """A spring or damper that is new once in so many ticks, and some frames late."""

    slow: Literal["spring", "damper"]
    ticks: int
    late: int


@dataclass(frozen=True)
class Law:
    """F(n) = k x(n-lag) + b v(n-lag) + offset + switch; v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T.

    Attributes:
        stiffness_n_per_m, damping_ns_per_m, keep, offset_n: k, b, share of the old velocity, constant.
        lag: samples from a position to its force in the log.
        misfit: residual of the force, root mean square, as a share.
        samples: that identify it.
    """

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

    @property
    def wall_m(self) -> float:
        """Rest position of the spring."""
        return -self.offset_n / self.stiffness_n_per_m if self.stiffness_n_per_m else 0.0

    def with_gain(self, key: str, value: float) -> Law:
        """Return the law with another stiffness or damping."""
        if key == "stiffness_n_per_m":
            return replace(self, stiffness_n_per_m=value)
        return replace(self, damping_ns_per_m=value)

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
        return replace(best, switch=_contact_switch(log, swing, best))
    part = np.zeros_like(use)
    part[swing.first : swing.last] = True
    whole = log.ran & part & (True if np.unique(log.force_n).size <= 3 else ~cut)
    others = [_switched(log, whole, friction_n), _two_rates(log, use & part)]
    for law in others:
        if law is not None and (best is None or law.misfit < _BETTER * best.misfit):
            return law
    return best if best is None or not best.explains else replace(best, switch=_contact_switch(log, swing, best))


def outside_force_n(log: Log) -> float:
    """Return the constant force outside contact, as of a weight that is compensated: the commonest, on one side."""
    forces, counts = np.unique(log.force_n, return_counts=True)
    value = float(forces[np.argmax(counts)])
    out = log.force_n == value
    if not value or abs(value) > 0.99 * np.abs(log.force_n).max() or counts.max() < max(25, 0.02 * out.size):
        return 0.0
    above = float(np.mean(np.searchsorted(np.sort(log.position_m[out]), log.position_m[~out]))) / np.count_nonzero(out)
    return value if max(above, 1 - above) > 0.95 else 0.0


def _residual(columns: FloatArray, force: FloatArray) -> tuple[FloatArray, float]:
    """Return the coefficients of a regression, and its residual as a share of the changes of the force."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    if columns.shape[0] <= columns.shape[1] or not scale.all():
        return np.zeros(columns.shape[1]), math.inf
    values, _, rank, _ = np.linalg.lstsq(columns / scale, force, rcond=1e-9)
    changes = float(np.std(force))
    if rank < columns.shape[1] or not changes:
        return values, math.inf
    left = force - columns @ (values / scale)
    return np.asarray(values / scale), max(float(np.sqrt(np.mean(left**2))) / changes, 1e-12)


def _lagged(ran: BoolArray, use: BoolArray, lag: int) -> IndexArray:
    """Return the ticks whose lagged samples are in the log."""
    good = use.copy()
    good[: lag + 2] = False
    for back in {lag, lag + 1} - {0}:
        good[back:] &= ran[:-back]
    return np.flatnonzero(good)


def _plain(log: Log, use: BoolArray, lag: int, *, filtered: bool) -> Law | None:
    """Fit a spring and a damper, with a filter of the velocity or without."""
    position, force, period = log.position_m, log.force_n, log.ticks.period_s
    rows = _lagged(log.ran, use, lag)
    rows = rows[use[rows - 1]] if filtered else rows
    if rows.size < 6:
        return None
    middle = float(position[rows].mean())
    columns = [position[rows - lag] - middle, position[rows - lag] - position[rows - lag - 1], np.ones(rows.size)]
    columns += [force[rows - 1]] if filtered else []
    matrix = np.stack(columns, axis=1)
    if rows.size < _FEWEST and len(np.unique(matrix, axis=0)) < 2 * len(columns):
        return None
    values, left = _residual(matrix, force[rows])
    keep = float(values[3]) if filtered else 0.0
    # From the force before, the next is told too easily: what counts is the error that the filter sums up.
    left /= max(1 - keep, 1e-3)
    if not math.isfinite(left) or not 0 <= keep < 0.98 or (rows.size < _FEWEST and left > 1e-3):
        return None
    k = float(values[0]) / (1 - keep)
    # F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before)
    b = (float(values[1]) - k * keep) * period / (1 - keep)
    return Law(k, b, keep, lag, float(values[2]) / (1 - keep) - k * middle, left, int(rows.size))


def _with_limit(law: Law, log: Log, cut: BoolArray, limit_n: float) -> Law:
    """Count the forces at the limit too, which the law has to reach."""
    rows = _lagged(log.ran, cut, law.lag)
    if not rows.size:
        return law
    x, before = log.position_m[rows - law.lag], log.position_m[rows - law.lag - 1]
    force = law.stiffness_n_per_m * x + law.damping_ns_per_m * (x - before) / log.ticks.period_s + law.offset_n
    left = np.clip(force, -limit_n, limit_n) - log.force_n[rows]
    return replace(law, misfit=max(law.misfit, float(np.sqrt(np.mean(left**2))) / limit_n))


def _contact_switch(log: Log, swing: Oscillation, law: Law) -> Switch | None:
    """Return the force that contact switches on in every cycle: a spring without length."""
    later = slice((swing.first + swing.last) // 2, swing.last)
    force, position = log.force_n[later], log.position_m[later]
    touching = force > 1e-9 * float(np.abs(force).max(initial=0.0))
    enters = np.flatnonzero(touching[1:] & ~touching[:-1]) + 1
    enters = enters[enters > law.lag + 2]
    cycles = swing.frequency_hz * force.size * log.ticks.period_s
    if (force < 0).any() or not enters.size or enters.size < 0.5 * cycles:
        return None
    # A damper's force vanishes before contact ends; a switched one is as large a sample before contact.
    x, before = position[enters - law.lag - 1], position[enters - law.lag - 2]
    carried = law.stiffness_n_per_m * x + law.damping_ns_per_m * (x - before) / log.ticks.period_s + law.offset_n
    edge = float(position[np.flatnonzero(touching)].min())
    size = min(float(np.median(carried)), law.stiffness_n_per_m * edge + law.offset_n)
    step = 2.5 * abs(law.stiffness_n_per_m) * log.encoder_m
    return Switch(size, "contact", (edge, edge)) if size > max(0.3 * float(np.ptp(force)), step) else None


def _switched(log: Log, use: BoolArray, friction_n: float) -> Law | None:
    """Return the law with a part that a sign switches, or None."""
    position, force, period = log.position_m, log.force_n, log.ticks.period_s
    best: Law | None = None
    for lag in range(_MOST_LAG + 1):
        rows = _lagged(log.ran, use, lag)
        if rows.size < 50 or not np.ptp(force[rows]):
            break
        x, before = position[rows - lag], position[rows - lag - 1]
        after = position[np.minimum(rows - lag + 1, position.size - 1)]
        signs: list[tuple[Switch, FloatArray]] = [
            (Switch(0.0, "position", (low, high)), (np.sign(x - low) + np.sign(x - high)) / 2)
            for low, high in _edges(force, position, rows, lag)
        ]
        signs += [
            (Switch(0.0, "speed"), np.sign(x - before)),
            (Switch(0.0, "speed"), np.sign(after - before)),
            (Switch(0.0, "force"), np.sign(force[rows])),
        ]
        swings = float(np.ptp(force[rows]))
        plain = np.stack([x - x.mean(), x - before, np.ones(rows.size)], axis=1)
        _, without = _residual(plain, force[rows])
        for kind, sign in signs:
            if kind.by == "force" and np.unique(force[rows]).size <= 3:
                continue
            values, left = _residual(np.column_stack([sign, plain]), force[rows])
            alone, left_alone = _residual(np.column_stack([sign, np.ones(rows.size)]), force[rows])
            if left_alone < _EXPLAINS and left_alone < 2 * left:
                values, left = np.array([alone[0], 0.0, 0.0, alone[1]]), left_alone
            feeds = kind.by == "speed" and 0 < friction_n < -values[0]
            if left > min(_EXPLAINS, _BETTER * without) or not (feeds or 2 * abs(values[0]) > 0.1 * swings):
                continue
            if best is None or left < _BETTER * best.misfit:
                c, k, b, offset = values.tolist()
                switch = replace(kind, force_n=c)
                best = Law(k, b * period, 0.0, lag, offset - k * float(x.mean()), left, int(rows.size), switch)
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
    middle = (low + high) / 2

    def edge(some: BoolArray) -> float:
        inner, outer = float(low[some].max()), float(high[some].min())
        if inner > outer:
            return float(np.median(middle[some]))
        return 0.0 if inner <= 0 <= outer else (inner + outer) / 2

    both = np.ones(middle.size, dtype=bool)
    found = [(edge(both), edge(both))]
    upper = middle > (middle.min() + middle.max()) / 2
    if upper.any() and not upper.all() and middle[upper].min() > middle[~upper].max():
        found.append((edge(~upper), edge(upper)))
    # Edges that one step may cross together.
    centre, most = found[0][0], float((high - low).max())
    return found + [(centre - width, centre + width) for width in np.geomspace(0.03 * most, 0.6 * most, 12).tolist()]


def _two_rates(log: Log, use: BoolArray) -> Law | None:
    """Return the law whose spring or damper is new once a frame and the other part at every tick, or None."""
    if log.ticks.missed_share:
        return None
    force, position, period = log.force_n, log.position_m, log.ticks.period_s
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
                (k, b, offset), left = _residual(columns, force[rows])
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
    for ticks in range(min(100, force.size // 12), 1, -1):
        phases = np.bincount(rows[jumps] % ticks, minlength=ticks)
        if phases.max() >= 0.95 * np.count_nonzero(jumps):
            return ticks, int(np.argmax(phases))
    return None
