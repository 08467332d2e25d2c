"""The law from position to force in a log: one regression over lags, holds, filters and switches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.diagnose.oscillation import Log, Oscillation, even_phase, samples_alike
from avc_casadi.identification.regression import regression

# Residual up to which a law explains the force, and up to which with a coarse encoder; a more complex law has to leave
# so much less; an exact one needs no other. Lags that are tried, and the fewest samples of a law that is not exact.
_EXPLAINS, _COARSE, _BETTER, _EXACT, _MOST_LAG, _FEWEST = 0.05, 0.3, 0.3, 5e-3, 8, 25


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
    late: float


@dataclass(frozen=True)
class Law:
    """F(n) = k x(n-lag) + b v(n-lag) + offset + switch; v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T.

    Errors are half of 95 % intervals; a coefficient below its error is 0.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    lag: float
    offset_n: float
    misfit: float
    samples: int
    stiffness_error_n_per_m: float = 0.0
    damping_error_ns_per_m: float = 0.0
    grain: float = 0.0  # what an encoder step leaves, where the law reads a finer position
    switch: Switch | None = None
    frames: Frames | None = None

    @property
    def explains(self) -> bool:
        """Whether it is the force of the log."""
        return self.misfit < max(_EXPLAINS, min(1.3 * self.grain, _COARSE) if self.stiffness_n_per_m > 0 else 0.0)

    def filter_hz(self, sample_time_s: float) -> float | None:
        """Cut-off of the velocity filter; None without one below the Nyquist frequency."""
        return None if self.keep <= math.exp(-math.pi) else -math.log(self.keep) / (2 * math.pi * sample_time_s)


def find_law(log: Log, swing: Oscillation, limit_n: float | None, friction_n: float) -> Law | None:
    """Return the law that explains the force best, whether it does or not; None without enough samples in contact."""
    size, most = np.abs(log.force_n), float(np.abs(log.force_n).max(initial=0.0))
    if not most:
        return None
    limit = most if limit_n is None else min(most, limit_n)
    top = size >= 0.9999 * limit
    # The largest force may be a limit; where the position toggles between two steps it belongs to one of them.
    cut = top & (limit == limit_n or np.ptp(log.position_m[top]) > 1.5 * log.encoder_m)
    use = log.ran & log.touching & ~cut
    # A force of the position a sample before is exactly one of a negative damper now: that is the last to be taken.
    best = _best(sorted(_plain(log, use), key=lambda law: (law.damping_ns_per_m < 0, law.keep > 0)))
    if best is not None and best.misfit < _EXACT:
        return best
    whole = log.ran & (True if np.unique(log.force_n).size <= 3 else ~cut)
    whole[: swing.first] = whole[swing.last :] = False
    relay = _best(_relays(log, whole, friction_n), best)
    return relay if relay is not best else _best(sorted(_two_rates(log, cut), key=lambda law: law.misfit), best)


def _best(laws: Iterable[Law], best: Law | None = None) -> Law | None:
    """Return the law with the smallest residual; what comes later has to leave far less."""
    for law in laws:
        best = law if best is None or law.misfit < _BETTER * best.misfit else best
    return best


def _rows_of_lag(ran: BoolArray, use: BoolArray, lag: int) -> IndexArray:
    """Return the ticks whose lagged samples are in the log."""
    good = use.copy()
    good[: lag + 2] = False
    for back in {lag, lag + 1} - {0}:
        good[back:] &= ran[:-back]
    return np.flatnonzero(good)


def _regress(
    force: FloatArray, x: FloatArray, step: FloatArray, beside: Sequence[FloatArray], average: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return factors of position, its change in a sample, 1 and what stands beside; errors of two; the residual.

    A factor within its error is left out. Where the rest is an error of the positions, the change has it too, which
    pulls its factor towards 0 and half of the other's: so far the errors reach.
    """
    parts, other, changes = (x - x.mean(), step), [np.ones(x.size), *beside], float(np.std(force))
    use, errors = [0, 1], np.zeros(2)
    for _ in range(3):
        columns = np.stack([*(parts[one] for one in use), *other], axis=1)
        fit = regression(columns, force) if changes else None
        if fit is None:
            return None
        factors, residual = np.zeros(2 + len(other)), force - columns @ fit[0]
        factors[[*use, *range(2, factors.size)]] = fit[0]
        if fit[1] > 1e-9 * changes:
            scale = np.sqrt(np.mean(columns**2, axis=0))
            inverse = np.diag(np.linalg.inv((columns / scale).T @ (columns / scale) / x.size))
            white = 2 * fit[1] * math.sqrt(samples_alike(residual) / x.size)
            read = fit[1] ** 2 / max(factors[0] ** 2, 2 * factors[1] ** 2 / average, 1e-300)
            for one, own in zip(use, (scale / np.sqrt(inverse)).tolist(), strict=False):
                pull = read / own**2 / (average if one else 1)
                share = min((1 + one) * pull, 1.0)
                whole = white / own + abs(factors[1 - one]) * pull + abs(factors[one]) * share
                errors[one] = whole / (1 - share) if share < 1 else math.inf
        clear = [one for one in use if abs(factors[one]) > errors[one] + 1e-9 * changes / float(np.std(parts[one]))]
        if clear == use:
            break
        use = clear
    return factors, errors, residual


def _law(
    log: Log, rows: IndexArray, x: FloatArray, step: FloatArray, lag: float, sign: FloatArray | None = None,
    *, filtered: bool = False,
) -> Law | None:  # fmt: skip
    """Return the law of the force of some rows; a coarse position tells more by its means over many rows."""
    force, period, changes = log.force_n[rows], log.period_s, float(np.std(log.force_n[rows]))
    fit = _regress(force, x, step, [log.force_n[rows - 1]] if filtered else [] if sign is None else [sign])
    keep = float(fit[0][3]) if fit is not None and filtered else 0.0
    if fit is None or not 0 <= keep < 0.98:
        return None
    factors, errors, residual = fit
    for many in (8, 64) if not filtered and sign is None and np.std(residual) > _EXACT * changes else ():
        ends = np.flatnonzero(rows[many:] - rows[:-many] == many) + many
        means = [(np.cumsum(one)[ends] - np.cumsum(one)[ends - many]) / many for one in (force, x, step)]
        coarse = _regress(means[0], means[1], means[2], [], many) if ends.size > 4 * many else None
        if coarse is not None and coarse[1][1] < errors[1]:
            (k, c, offset), errors, _ = coarse
            factors = np.array([k, c, offset + k * (x.mean() - means[1].mean())])
            residual = force - k * (x - x.mean()) - c * step - factors[2]
    # F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before). From the force before, the next is
    # told too easily: what counts is the error that the filter sums up.
    k, error = float(factors[0]) / (1 - keep), (errors / (1 - keep)).tolist()
    b = (float(factors[1]) - k * keep) * period / (1 - keep)
    misfit = max(float(np.sqrt(np.mean(residual**2))) / changes / max(1 - keep, 1e-3), 1e-12)
    grain = log.encoder_m / math.sqrt(12) * math.hypot(k, math.sqrt(2) * b / period) / changes
    offset = float(factors[2]) / (1 - keep) - k * float(x.mean())
    switch = None if sign is None else Switch(float(factors[3]), "position")
    return Law(k, b, keep, lag, offset, misfit, rows.size, error[0], error[1] * period, grain, switch)


def _plain(log: Log, use: BoolArray) -> Iterator[Law]:
    """Yield spring and damper of each lag, which may be a part of a hold, with a filter of the velocity and without."""
    for late, filtered in itertools.product(range(min(_MOST_LAG * log.hold, 64) + 1), (False, True)):
        lag, position = -(-late // log.hold), log.between(-late % log.hold)
        rows = _rows_of_lag(log.ran, use, lag)
        rows = rows[use[rows - 1]] if filtered else rows
        x, before = position[rows - lag], position[rows - lag - 1]
        pairs = len(np.unique(np.stack([x, before], axis=1), axis=0)) if 6 <= rows.size < _FEWEST else rows.size
        law = _law(log, rows, x, x - before, late / log.hold, filtered=filtered) if pairs >= 6 + 2 * filtered else None
        if law is not None and (rows.size >= _FEWEST or law.misfit <= 1e-3):
            yield law


def _relays(log: Log, use: BoolArray, friction_n: float) -> Iterator[Law]:
    """Yield laws with a part that a sign switches."""
    position, force = log.position_m, log.force_n
    for lag in range(_MOST_LAG + 1):
        rows = _rows_of_lag(log.ran, use, lag)
        if rows.size < 50 or not np.ptp(force[rows]):
            break
        x, before = position[rows - lag], position[rows - lag - 1]
        signs = [
            (Switch(0.0, "position", (low, high)), (np.sign(x - low) + np.sign(x - high)) / 2)
            for low, high in _edges(force, position, rows, lag)
        ]
        signs += [(Switch(0.0, "speed"), np.sign(x - before))]
        signs += [(Switch(0.0, "force"), np.sign(force[rows]))] if np.unique(force[rows]).size > 3 else []
        for switch, sign in signs:
            law = _law(log, rows, x, x - before, lag, sign)
            c = 0.0 if law is None or law.switch is None else law.switch.force_n
            matters = abs(c) > 0.05 * float(np.ptp(force[rows])) or (switch.by == "speed" and 0 < friction_n < -c)
            if law is not None and law.misfit <= _EXPLAINS and matters:
                yield replace(law, switch=replace(switch, force_n=c))


def _edges(force: FloatArray, position: FloatArray, rows: IndexArray, lag: int) -> list[tuple[float, float]]:
    """Return where the position may switch the force: at one edge, or at two with a dead band between them."""
    if (rows := rows[np.isin(rows - 1, rows)]).size < 20:
        return []
    x, before, older = (position[rows - lag - back] for back in range(3))
    changes = force[rows] - force[rows - 1]
    columns = np.stack([x - before, x - 2 * before + older], axis=1)
    near = np.ones(rows.size, dtype=bool)
    for _ in range(4):
        smooth = np.linalg.lstsq(columns[near], changes[near], rcond=1e-9)[0]
        residual = np.abs(changes - columns @ smooth)
        near = residual <= np.quantile(residual, 0.7)
    jumps = (residual > 0.35 * residual.max()) & (x != before)
    if np.count_nonzero(jumps) < 3:
        return []
    low, high = np.minimum(x, before)[jumps], np.maximum(x, before)[jumps]

    def edge(some: BoolArray) -> float:
        inner, outer = float(low[some].max()), float(high[some].min())
        if inner > outer:
            return float(np.median(low[some] + high[some])) / 2
        return 0.0 if inner <= 0 <= outer else (inner + outer) / 2

    both = low + high
    upper, most = both > (both.min() + both.max()) / 2, float((high - low).max())
    centre, apart = edge(both > -math.inf), upper.any() and both[upper].min() > both[~upper].max()
    # Edges that one step may cross together.
    widths = np.geomspace(0.03 * most, 0.6 * most, 12).tolist()
    edges = [(centre, centre), *([(edge(~upper), edge(upper))] if apart else [])]
    return edges + [(centre - width, centre + width) for width in widths]


def _two_rates(log: Log, cut: BoolArray) -> Iterator[Law]:
    """Yield laws whose spring or damper is new once a frame and the other part at every tick."""
    use, position = log.ran & log.touching & ~cut, log.position_m
    kinds: tuple[Literal["spring", "damper"], ...] = ("spring", "damper")
    for lag, slow in itertools.product(range(4), kinds) if log.missed_share <= 0.01 else ():
        ticks, first = _frame(log, cut, lag, slow) or (0, 0)
        for late in range(3 * ticks + 1) if ticks else ():
            rows = np.flatnonzero(use & (np.arange(use.size) > first + ticks + late + lag + 1))
            frame_rows = rows - (rows - first) % ticks - late
            spring, damper = (frame_rows - lag, rows - lag) if slow == "spring" else (rows - lag, frame_rows - lag)
            back = 1 if slow == "spring" else ticks
            law = _law(log, rows, position[spring], (position[damper] - position[damper - back]) / back, lag)
            if law is not None and min(law.stiffness_n_per_m, law.damping_ns_per_m) > 0 and law.misfit < _EXPLAINS:
                yield replace(law, frames=Frames(slow, ticks, late / ticks))


def _frame(log: Log, cut: BoolArray, lag: int, slow: str) -> tuple[int, int] | None:
    """Return the ticks of a frame and its first tick: beside the fast part the force jumps in one phase only."""
    force, x, use = log.force_n, log.position_m, log.ran & log.touching
    fast = x if slow == "damper" else np.diff(x, prepend=x[0])
    rows = np.flatnonzero(use[1:] & use[:-1] & (np.arange(1, use.size) > lag + 2)) + 1
    new, moves = force[rows] - force[rows - 1], fast[rows - lag] - fast[rows - lag - 1]
    some = (np.abs(moves) > 1e-9 * np.abs(moves).max(initial=1e-300)) & ~cut[rows] & ~cut[rows - 1]
    if np.count_nonzero(some) < 100:
        return None
    # Most ticks are of the fast part alone: the median of their ratios is its gain.
    gain = float(np.median(new[some] / moves[some]))
    residual = new - gain * moves
    # Of a force at the limit only a jump towards it is seen, and after it only one away from it.
    visible = (residual * cut[rows] * force[rows] >= 0) & (residual * cut[rows - 1] * force[rows - 1] <= 0)
    jumps = visible & (np.abs(residual) > 1e-3 * float(np.abs(new).max()))
    if gain <= 0 or np.mean(~jumps) < 0.45 or np.count_nonzero(jumps) < 12:
        return None
    return even_phase(rows[jumps], min(100, force.size // 12))
