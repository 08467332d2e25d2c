"""The law from position to force in a log: one regression over lags, holds, filters and switches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.diagnose.clock import even_phase
from avc_casadi.diagnose.compensation import filtered_change, find_filtered_sign, switched
from avc_casadi.diagnose.dead_zone import dead_zone, outside
from avc_casadi.diagnose.law_regression import Regression, reading_variance_of, regress
from avc_casadi.diagnose.oscillation import Log, Oscillation

# Residuals of a law are root mean squares, as shares of the standard deviation of the force.

_EXPLAINS = 0.05
"""Residual up to which a law explains the force."""

_COARSE = 0.3
"""Residual up to which a law explains the force with a coarse encoder."""

_GRAIN = 1.3
"""Residual up to which a law explains the force, per residual that the encoder steps make."""

_BETTER = 0.3
"""Residual that a more complex law leaves at most, per residual of the simpler one."""

_EXACT = 5e-3
"""Residual up to which a law is exact and needs no other."""

_EXACT_FEW = 1e-3
"""Residual up to which a law of fewer than 25 samples is exact."""

_MOST_LAG = 8
"""Longest lag that is tried, ticks."""

_MOST_LATE = 64
"""Longest lag that is tried, samples of the log."""

_FEWEST = 25
"""Fewest samples of a law that is not exact."""

_FEWEST_EXACT = 6
"""Fewest samples of an exact law, and fewest pairs of positions in them; two more with a filter."""

_FEWEST_SWITCHED = 50
"""Fewest samples of a law with a switched part."""

_MOST_KEEP = 0.98
"""Share of the velocity from which on a filter is none: the force before tells the next."""

_AT_LIMIT = 0.9999
"""Share of the largest force, or of the limit, from which on a force is at the limit."""

_TOGGLE_STEPS = 1.5
"""Encoder steps up to which a position toggles between two."""

_MEANS_OVER = (8, 64)
"""Rows over which a coarse position is averaged, in turn."""

_SWITCHED_SHARE = 0.05
"""Share of the range of the force from which on a switched part matters."""

_FEWEST_EDGE_ROWS = 20
"""Fewest pairs of neighbouring samples by which edges are searched."""

_SMOOTH_QUANTILE = 0.7
"""Quantile of the residuals up to which changes of the force are of spring and damper."""

_JUMP_SHARE = 0.35
"""Share of the largest residual above which a change of the force is a jump."""

_FEWEST_JUMPS = 3
"""Jumps below which the position does not switch the force."""

_DEAD_BANDS = (0.03, 0.6)
"""Narrowest and widest half of a dead band that is tried, per longest step of the position over an edge."""

_DEAD_BAND_COUNT = 12
"""Dead bands that are tried."""

_SIDE_SHARE = 0.02
"""Share of ticks with a force to one side from which on its law acts to that side."""

_CUT_OFF_SHARE = 0.05
"""Force that is asked for at the end of a log, per largest force, from which on one of none is cut off."""

_DAMPING_OF_DELAY = 3
"""A damping matters no more that a spring loses by a third of a tick of delay."""

_MOST_DROPPED = 0.01
"""Share of missed samples up to which frames are searched."""

_MOST_SIGN_LAG = 3
"""Longest lag that is tried with the sign of a filtered velocity, ticks."""

_MOST_FRAME_LAG = 4
"""Lags below this, ticks, are tried with frames."""

_LONGEST_FRAME = 100
"""Longest frame that is searched, ticks."""

_FEWEST_FRAME_ROWS = 100
"""Ticks in which the fast part moves that a frame takes."""

_FEWEST_FRAMES = 12
"""Frames that a log has at least; a frame is a twelfth of it at most."""

_FAST_TICKS_SHARE = 0.45
"""Share of ticks in which only the fast part changes, at least."""

_FRAME_JUMP = 1e-3
"""Share of the largest change of the force above which a residual is a jump of the slow part."""


@dataclass(frozen=True)
class Switch:
    """c sign(s): s is the position between two edges, where the force is none, the speed, or the rest of the force.

    A speed may be behind a filter, v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T, and the force c tanh(v/v0).
    """

    force_n: float
    by: Literal["position", "speed", "force"]
    edges_m: tuple[float, float] = (0.0, 0.0)
    keep: float = 0.0
    """Share of the speed that its filter keeps in a tick."""
    width_m_per_s: float = 0.0
    """v0; 0 of a sign."""

    def gain_n_per_m(self, amplitude_m: float) -> float:
        """Return the size of the first harmonic of the force, per amplitude A of the position.

        It is the describing function of a relay, 4 |c|/(pi A) sqrt(1 - (h/A)^2), h half of the distance of the edges.
        """
        half_band = (self.edges_m[1] - self.edges_m[0]) / 2
        if amplitude_m <= half_band:
            return 0.0
        return 4 * abs(self.force_n) / (math.pi * amplitude_m) * math.sqrt(1 - (half_band / amplitude_m) ** 2)


@dataclass(frozen=True)
class Frames:
    """A spring or damper that is new once in so many ticks, and some frames late."""

    slow: Literal["spring", "damper"]
    ticks: int
    late: float


@dataclass(frozen=True)
class FittedLaw:
    """F(n) = k x(n-lag) + b v(n-lag) + offset + switch; v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T.

    Errors are half of 95 % intervals; a coefficient below its error is 0.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    """Share of the velocity that its filter keeps in a tick."""
    lag: float
    """Age of the position that the law reads, ticks."""
    offset_n: float
    misfit: float
    """Residual, root mean square, as a share of the standard deviation of the force."""
    samples: int
    stiffness_error_n_per_m: float = 0.0
    damping_error_ns_per_m: float = 0.0
    grain: float = 0.0
    """Residual that an encoder step leaves, where the law reads a finer position."""
    switch: Switch | None = None
    frames: Frames | None = None
    dead_zone_m: tuple[float, float] | None = None
    """Positions between which the spring has no force, m; x counts from the nearer one."""
    notch_hz: float | None = None
    """Frequency of a notch that a remedy puts behind the law, Hz; none is fitted."""

    @property
    def explains(self) -> bool:
        """Whether it is the force of the log."""
        coarse = min(_GRAIN * self.grain, _COARSE) if self.stiffness_n_per_m > 0 else 0.0
        return self.misfit < max(_EXPLAINS, coarse)

    @property
    def linear(self) -> bool:
        """Whether no sign switches its force, and it has no parts of two rates."""
        return self.switch is None and self.frames is None

    def overcompensates(self, friction_n: float) -> bool:
        """Return whether a force with the speed is more than the friction of a device, and so feeds a swing."""
        return self.switch is not None and self.switch.by == "speed" and -self.switch.force_n > friction_n

    def leaves_damping_open(self, period_s: float, switched_n_per_m: float = 0.0) -> bool:
        """Return whether the error of the damper is more than the damper, and matters.

        It does not where a third of a tick of delay does as much: of the spring, and of a switched force of this gain.
        """
        as_delay = (abs(self.stiffness_n_per_m) + switched_n_per_m) * period_s / _DAMPING_OF_DELAY
        return self.damping_error_ns_per_m > max(abs(self.damping_ns_per_m), as_delay)

    def filter_hz(self, sample_time_s: float) -> float | None:
        """Cut-off of the velocity filter, Hz; None without one below the Nyquist frequency."""
        return None if self.keep <= math.exp(-math.pi) else -math.log(self.keep) / (2 * math.pi * sample_time_s)


def find_law(log: Log, swing: Oscillation, limit_n: float | None, friction_n: float) -> FittedLaw | None:
    """Return the law that explains the force best, whether it does or not; None without enough samples in contact.

    Spring and damper come first, then a dead zone, a part that a sign switches, and parts of two rates. Samples at the
    force limit are left out; `friction_n` is the friction that a switched force may compensate.
    """
    size = np.abs(log.force_n)
    largest = float(size.max(initial=0.0))
    if not largest:
        return None
    limit = largest if limit_n is None else min(largest, limit_n)
    top = size >= _AT_LIMIT * limit
    # The largest force may be a limit; where the position toggles between two steps it belongs to one of them.
    moves_at_top = np.ptp(log.position_m[top]) > _TOGGLE_STEPS * log.encoder_m
    at_limit = top & (limit == limit_n or moves_at_top)
    plain = _best(_plain_in_order(log, log.ran & log.touching & ~at_limit))
    if plain is None:
        # A damper of an encoder that moves by a step a tick at most gives its largest force at each step.
        plain = _best(law for law in _plain_in_order(log, log.ran & log.touching) if law.misfit < _EXACT)
    if plain is not None and plain.misfit < _EXACT:
        return plain
    plain = _best(_with_dead_zone(log, log.ran & log.touching & ~at_limit), plain)
    if plain is not None and plain.misfit < _EXACT:
        return plain
    # Of a force of three values at most, all are of the relay.
    in_swing = log.ran.copy() if np.unique(log.force_n).size <= 3 else log.ran & ~at_limit
    in_swing[: swing.first] = False
    in_swing[swing.last :] = False
    relay = _best(_relays(log, in_swing, friction_n), plain)
    # What a sign of the speed explains nearly, one behind a filter may explain.
    by_speed = relay is not None and relay.switch is not None and relay.switch.by == "speed"
    if relay is plain or (by_speed and relay is not None and relay.misfit > _EXACT):
        relay = _best(_with_filtered_sign(log, in_swing, friction_n), relay)
    if relay is not plain:
        return relay
    return _best(sorted(_two_rates(log, at_limit), key=lambda law: law.misfit), plain)


def _best(laws: Iterable[FittedLaw], best: FittedLaw | None = None) -> FittedLaw | None:
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


@dataclass(frozen=True, eq=False)
class _Reading:
    """The positions that a law reads at n ticks."""

    rows: IndexArray
    """The ticks of the force, shape (n,)."""
    position_m: FloatArray
    """Position that the spring reads, shape (n,), m."""
    change_m: FloatArray
    """Change of the position in a tick that the damper reads, shape (n,), m."""
    lag: float
    """Age of both, ticks."""

    @classmethod
    def of_lag(cls, rows: IndexArray, position: FloatArray, lag: int, age: float | None = None) -> _Reading:
        """Return the reading of positions so many ticks before; their age may be a part of a hold less."""
        now, before = position[rows - lag], position[rows - lag - 1]
        return cls(rows, now, now - before, lag if age is None else age)


def _law(log: Log, reading: _Reading, sign: FloatArray | None = None, *, filtered: bool = False) -> FittedLaw | None:
    """Return the law of the force at the ticks of a reading, with a filter of the velocity or a switched part.

    F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep) (x - x_before) + c sign.
    """
    force, position = log.force_n[reading.rows], reading.position_m
    period = log.period_s
    deviation = float(np.std(force))
    further = []
    if filtered:
        further = [log.force_n[reading.rows - 1]]
    elif sign is not None:
        further = [sign]
    reading_variance = reading_variance_of(log)
    fit = regress(force, position, reading.change_m, further, reading_variance)
    keep = float(fit.factors[3]) if fit is not None and filtered else 0.0
    if fit is None or not 0 <= keep < _MOST_KEEP:
        return None
    if not filtered and sign is None and np.std(fit.residual_n) > _EXACT * deviation:
        fit = _by_means(force, reading, fit, reading_variance)
    stiffness = float(fit.factors[0]) / (1 - keep)
    damping = (float(fit.factors[1]) - stiffness * keep) * period / (1 - keep)
    stiffness_error, damping_error_m = (fit.errors / (1 - keep)).tolist()
    # From the force before, the next is told too easily: what counts is the error that the filter sums up.
    rms = float(np.sqrt(np.mean(fit.residual_n**2)))
    step_rms = log.encoder_m / math.sqrt(12)
    return FittedLaw(
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=damping,
        keep=keep,
        lag=reading.lag,
        offset_n=float(fit.factors[2]) / (1 - keep) - stiffness * float(position.mean()),
        misfit=max(rms / deviation / max(1 - keep, 1e-3), 1e-12),
        samples=reading.rows.size,
        stiffness_error_n_per_m=stiffness_error,
        damping_error_ns_per_m=damping_error_m * period,
        grain=step_rms * math.hypot(stiffness, math.sqrt(2) * damping / period) / deviation,
        switch=None if sign is None else Switch(float(fit.factors[3]), "position"),
    )


def _by_means(force: FloatArray, reading: _Reading, fit: Regression, reading_variance: float) -> Regression:
    """Return the regression on means over many rows where that tells the damper more exactly, else the given one.

    A coarse encoder hides the speed from row to row, but not over many. `reading_variance` is that of a reading, m^2.
    """
    rows = reading.rows
    position = reading.position_m
    change = reading.change_m

    def means(values: FloatArray, ends: IndexArray, count: int) -> FloatArray:
        sums = np.cumsum(values)
        return (sums[ends] - sums[ends - count]) / count

    for count in _MEANS_OVER:
        ends = np.flatnonzero(rows[count:] - rows[:-count] == count) + count
        if ends.size <= 4 * count:
            continue
        mean_position = means(position, ends, count)
        mean_change = means(change, ends, count)
        coarse = regress(means(force, ends, count), mean_position, mean_change, [], reading_variance, count)
        if coarse is not None and coarse.errors[1] < fit.errors[1]:
            by_position, by_change, constant = coarse.factors
            offset = constant + by_position * (position.mean() - mean_position.mean())
            residual = force - by_position * (position - position.mean()) - by_change * change - offset
            fit = Regression(np.array([by_position, by_change, offset]), coarse.errors, residual)
    return fit


def _plain(log: Log, use: BoolArray) -> Iterator[FittedLaw]:
    """Yield the spring and damper, k x + b v, fitted to each reading of the position, with v filtered and not."""
    for (lag, age, now, before), filtered in itertools.product(_readings(log), (False, True)):
        rows = _rows_of_lag(log.ran, use, lag)
        rows = rows[use[rows - 1]] if filtered else rows
        reading = _Reading(rows, now[rows - lag], now[rows - lag] - before[rows - lag], age)
        pairs = rows.size
        if _FEWEST_EXACT <= rows.size < _FEWEST:
            pairs = len(np.unique(np.stack([reading.position_m, before[rows - lag]], axis=1), axis=0))
        if pairs < _FEWEST_EXACT + 2 * filtered:
            continue
        law = _law(log, reading, filtered=filtered)
        if law is not None and (rows.size >= _FEWEST or law.misfit <= _EXACT_FEW):
            yield law


def _plain_in_order(log: Log, use: BoolArray) -> list[FittedLaw]:
    """Return spring and damper of each reading, in the order in which they are taken.

    A force of the position a sample before is exactly one of a negative damper now: that is the last.
    """
    return sorted(_plain(log, use), key=lambda law: (law.damping_ns_per_m < 0, law.keep > 0))


def _readings(log: Log) -> Iterator[tuple[int, float, FloatArray, FloatArray]]:
    """Yield what a law may read: the tick back and the age, ticks, the position of each tick then and a tick before, m.

    The age may be a part of a hold less than whole ticks. A clock of its own reads at its ticks or at the samples that
    follow them.
    """
    ages = {(lag, 0) for lag in range(_MOST_LAG + 1)}
    ages |= {(lag, ahead) for lag in range(1, _MOST_LAG + 1) for ahead in range(math.ceil(log.hold))}
    early = (0.0,) if log.even else (0.0, 1.0)
    for lag, ahead in sorted(ages, key=lambda age: age[0] * log.hold - age[1]):
        late = lag * log.hold - ahead
        if late <= _MOST_LATE or not ahead:
            for share in early:
                now = log.between(ahead - share * log.early)
                yield lag, late / log.hold, now, np.append(now[:1], now[:-1])


def _with_dead_zone(log: Log, use: BoolArray) -> Iterator[FittedLaw]:
    """Yield the spring with a dead zone and the damper, fitted to each reading of the position."""
    for lag, age, now, before in _readings(log):
        rows = _rows_of_lag(log.ran, use, lag)
        if rows.size < _FEWEST:
            continue
        position, change = now[rows - lag], now[rows - lag] - before[rows - lag]
        edges = dead_zone(log.force_n[rows], position, change)
        if edges is None:
            continue
        law = _law(log, _Reading(rows, outside(position, edges), change, age))
        if law is not None and law.stiffness_n_per_m > 0 and law.misfit < _EXPLAINS:
            yield replace(law, dead_zone_m=edges)


def _relays(log: Log, use: BoolArray, friction_n: float) -> Iterator[FittedLaw]:
    """Yield laws with spring, damper and a part that the sign of position, speed or force switches.

    The part matters to the range of the force, or compensates friction.
    """
    for lag in range(_MOST_LAG + 1):
        rows = _rows_of_lag(log.ran, use, lag)
        if rows.size < _FEWEST_SWITCHED:
            break
        force_range = float(np.ptp(log.force_n[rows]))
        if not force_range:
            break
        reading = _Reading.of_lag(rows, log.position_m, lag)
        for switch, sign in _switches(log, reading, lag):
            law = _law(log, reading, sign)
            if law is None or law.switch is None:
                continue
            switched_n = law.switch.force_n
            compensates = switch.by == "speed" and 0 < friction_n < -switched_n
            matters = abs(switched_n) > _SWITCHED_SHARE * force_range or compensates
            if law.misfit <= _EXPLAINS and matters:
                yield replace(law, switch=replace(switch, force_n=switched_n))


def _with_filtered_sign(log: Log, use: BoolArray, friction_n: float) -> Iterator[FittedLaw]:
    """Yield the law with a part that the sign, or tanh, of a filtered velocity switches."""
    rows = _rows_of_lag(log.ran, use, _MOST_SIGN_LAG)
    if rows.size < _FEWEST_SWITCHED or log.missed_share > _MOST_DROPPED:
        return
    sign = find_filtered_sign(log.force_n, log.position_m, rows, _MOST_SIGN_LAG)
    if sign is None:
        return
    read = rows - sign.lag
    change = np.diff(log.position_m, prepend=log.position_m[:1])
    filtered = filtered_change(change, sign.keep)
    damper = filtered if sign.damper_filtered else change
    reading = _Reading(rows, log.position_m[read], damper[read], sign.lag)
    law = _law(log, reading, switched(filtered[read], sign.width))
    if law is None or law.switch is None or law.misfit > _EXPLAINS:
        return
    switched_n = law.switch.force_n
    compensates = 0 < friction_n < -switched_n
    if abs(switched_n) > _SWITCHED_SHARE * float(np.ptp(log.force_n[rows])) or compensates:
        switch = Switch(switched_n, "speed", keep=sign.keep, width_m_per_s=sign.width / log.period_s)
        yield replace(law, switch=switch, keep=sign.keep if sign.damper_filtered else 0.0)


def _switches(log: Log, reading: _Reading, lag: int) -> Iterator[tuple[Switch, FloatArray]]:
    """Yield what may switch the force at the ticks of a reading, with its sign."""
    force, position = log.force_n[reading.rows], reading.position_m
    for low, high in _edges(log.force_n, log.position_m, reading.rows, lag):
        yield Switch(0.0, "position", (low, high)), (np.sign(position - low) + np.sign(position - high)) / 2
    yield Switch(0.0, "speed"), np.sign(reading.change_m)
    if np.unique(force).size > 3:
        yield Switch(0.0, "force"), np.sign(force)


def _edges(force: FloatArray, position: FloatArray, rows: IndexArray, lag: int) -> list[tuple[float, float]]:
    """Return pairs of positions, m, between which the force may switch: one edge, or two with a dead band.

    Edges lie where the force jumps and spring and damper do not explain it. `lag` is how many ticks old the position
    is.
    """
    rows = rows[np.isin(rows - 1, rows)]
    if rows.size < _FEWEST_EDGE_ROWS:
        return []
    now, before, older = (position[rows - lag - back] for back in range(3))
    changes = force[rows] - force[rows - 1]
    columns = np.stack([now - before, now - 2 * before + older], axis=1)
    # Most changes are of spring and damper: the third that they explain worst is left out, again and again.
    smooth_rows = np.ones(rows.size, dtype=bool)
    for _ in range(4):
        gains = np.linalg.lstsq(columns[smooth_rows], changes[smooth_rows], rcond=1e-9)[0]
        residual = np.abs(changes - columns @ gains)
        smooth_rows = residual <= np.quantile(residual, _SMOOTH_QUANTILE)
    jumps = (residual > _JUMP_SHARE * residual.max()) & (now != before)
    if np.count_nonzero(jumps) < _FEWEST_JUMPS:
        return []
    low, high = np.minimum(now, before)[jumps], np.maximum(now, before)[jumps]
    centre = _edge(low, high)
    edges = [(centre, centre)]
    twice_middle = low + high
    upper = twice_middle > (twice_middle.min() + twice_middle.max()) / 2
    if upper.any() and twice_middle[upper].min() > twice_middle[~upper].max():
        edges.append((_edge(low[~upper], high[~upper]), _edge(low[upper], high[upper])))
    # Edges that one step may cross together.
    longest_step = float((high - low).max())
    narrowest, widest = _DEAD_BANDS
    widths = np.geomspace(narrowest * longest_step, widest * longest_step, _DEAD_BAND_COUNT).tolist()
    return edges + [(centre - width, centre + width) for width in widths]


def _edge(low: FloatArray, high: FloatArray) -> float:
    """Return the position, m, that all steps from `low` to `high` cross, at 0 where it may be; else their middle.

    It is no position that is read on one side alone, as 0 is of a force that is given at x <= 0.
    """
    inner, outer = float(low.max()), float(high.min())
    if inner > outer:
        return float(np.median(low + high)) / 2
    return 0.0 if inner < 0 < outer else (inner + outer) / 2


def _two_rates(log: Log, at_limit: BoolArray) -> Iterator[FittedLaw]:
    """Yield laws whose spring or damper is computed once a frame of ticks and the other part at every tick."""
    if log.missed_share > _MOST_DROPPED:
        return
    use = log.ran & log.touching & ~at_limit
    parts: tuple[Literal["spring", "damper"], ...] = ("spring", "damper")
    for lag, slow in itertools.product(range(_MOST_FRAME_LAG), parts):
        frame = _frame(log, at_limit, lag, slow)
        if frame is None:
            continue
        ticks, first = frame
        for late in range(3 * ticks + 1):
            rows = np.flatnonzero(use & (np.arange(use.size) > first + ticks + late + lag + 1))
            frame_rows = rows - (rows - first) % ticks - late
            law = _law(log, _frame_reading(log, rows, frame_rows, lag, slow, ticks))
            if law is not None and min(law.stiffness_n_per_m, law.damping_ns_per_m) > 0 and law.misfit < _EXPLAINS:
                yield replace(law, frames=Frames(slow, ticks, late / ticks))


def _frame_reading(log: Log, rows: IndexArray, frame_rows: IndexArray, lag: int, slow: str, ticks: int) -> _Reading:
    """Return the reading whose slow part is of the tick of its frame, and its change, m in a tick, over a frame."""
    position = log.position_m
    if slow == "spring":
        spring, damper, back = frame_rows - lag, rows - lag, 1
    else:
        spring, damper, back = rows - lag, frame_rows - lag, ticks
    return _Reading(rows, position[spring], (position[damper] - position[damper - back]) / back, lag)


def _frame(log: Log, at_limit: BoolArray, lag: int, slow: str) -> tuple[int, int] | None:
    """Return the ticks of a frame and its first tick, where the slow part of the force jumps in one phase only.

    The fast part has the median gain of force over motion from tick to tick; None where there is no such frame.
    """
    force, position = log.force_n, log.position_m
    use = log.ran & log.touching
    fast = position if slow == "damper" else np.diff(position, prepend=position[0])
    rows = np.flatnonzero(use[1:] & use[:-1] & (np.arange(1, use.size) > lag + 2)) + 1
    changes = force[rows] - force[rows - 1]
    moves = fast[rows - lag] - fast[rows - lag - 1]
    limited, limited_before = at_limit[rows], at_limit[rows - 1]
    moving = (np.abs(moves) > 1e-9 * np.abs(moves).max(initial=1e-300)) & ~limited & ~limited_before
    if np.count_nonzero(moving) < _FEWEST_FRAME_ROWS:
        return None
    # Most ticks are of the fast part alone: the median of their ratios is its gain.
    gain = float(np.median(changes[moving] / moves[moving]))
    residual = changes - gain * moves
    # Of a force at the limit only a jump towards it is seen, and after it only one away from it.
    visible = (residual * limited * force[rows] >= 0) & (residual * limited_before * force[rows - 1] <= 0)
    jumps = visible & (np.abs(residual) > _FRAME_JUMP * float(np.abs(changes).max()))
    if gain <= 0 or np.mean(~jumps) < _FAST_TICKS_SHARE or np.count_nonzero(jumps) < _FEWEST_FRAMES:
        return None
    return even_phase(rows[jumps], min(_LONGEST_FRAME, force.size // _FEWEST_FRAMES))


def is_cut_off(log: Log, law: FittedLaw) -> bool:
    """Return whether a log ends without force where its law, by what it does on this side, asks for one."""
    if log.force_n[-1] or law.switch is not None or law.frames is not None:
        return False
    place = log.position_m[-1:] if law.dead_zone_m is None else outside(log.position_m[-1:], law.dead_zone_m)
    asked = law.stiffness_n_per_m * float(place[0]) + law.offset_n
    acts = np.mean(log.force_n * np.sign(asked) > 0) > _SIDE_SHARE
    return bool(acts and abs(asked) > _CUT_OFF_SHARE * np.abs(log.force_n).max())
