"""A log on the grid of its ticks, and the oscillation in it: frequency, size and growth by its turning points."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage, signal

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.record import Columns

Kind = Literal["none", "decaying", "growing", "limit cycle", "irregular"]


@dataclass(frozen=True)
class Ticks:
    """Timing of the loop by its time stamps.

    Attributes:
        sample_time_s: usual time from tick to tick.
        missed_share, longest_gap: share of the ticks without a row, and most of them in a row.
        held: samples for which each force is held.
        uneven_share: scatter of the steps as a share of the period, where stamps keep to no even grid.
    """

    sample_time_s: float
    missed_share: float
    longest_gap: int
    held: int
    uneven_share: float

    @property
    def period_s(self) -> float:
        """Time from one new force to the next."""
        return self.sample_time_s * self.held


@dataclass(frozen=True, eq=False)
class Log:
    """One record on an even grid; the force counts against +position and is held over missed ticks."""

    name: str
    ticks: Ticks
    position_m: FloatArray
    force_n: FloatArray
    ran: BoolArray
    encoder_m: float
    start_s: float
    outside_n: float = 0.0

    @property
    def touching(self) -> BoolArray:
        """Whether each tick is in contact, by its force."""
        return np.asarray(np.abs(self.force_n - self.outside_n) > 1e-9 * float(np.abs(self.force_n).max(initial=0.0)))

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.ticks.period_s)


def log_of(columns: Columns, *, flip_force: bool = False) -> tuple[Log, list[str]]:
    """Return the longest stretch of a log without a pause on its grid, and notes."""
    notes = list(columns.told)
    steps = np.diff(columns.time_s)
    short = float(np.quantile(steps, 0.1))
    usual = float(np.mean(steps[np.abs(steps - short) < 0.3 * short]))
    pauses = np.flatnonzero(steps > 40 * usual)
    edges = np.concatenate([[0], pauses + 1, [columns.time_s.size]])
    longest = int(np.argmax(np.diff(edges)))
    part = slice(int(edges[longest]), int(edges[longest + 1]))
    if pauses.size:
        notes.append(f"{pauses.size} pauses in the log; the longest stretch is used, {np.diff(edges)[longest]} samples")
    time, position = columns.time_s[part], columns.position_m[part]
    force = columns.force_n[part] * (1.0 if flip_force else -1.0)
    counts = _ticks_between(np.diff(time), usual)
    at = np.concatenate([[0], np.cumsum(counts)])
    period = float((time[-1] - time[0]) / at[-1])
    ran = np.zeros(at[-1] + 1, dtype=bool)
    ran[at] = True
    whole = np.zeros(ran.size)
    whole[at] = force
    if columns.filled is not None:
        ran[at] = ~columns.filled[part]
    # Stamps scatter about a grid, or each about the one before.
    about, apart = float(np.std(time - time[0] - at * period)), float(np.std(np.diff(time) - counts * period))
    ticks = Ticks(
        sample_time_s=period,
        missed_share=float(1 - time.size / ran.size),
        longest_gap=int(counts.max(initial=1)) - 1,
        held=_held(position, force),
        uneven_share=apart / period if apart < about else 0.0,
    )
    log = Log(
        name=columns.file,
        ticks=ticks,
        position_m=np.interp(np.arange(ran.size), at, position),
        force_n=whole[at[np.searchsorted(at, np.arange(ran.size), side="right") - 1]],
        ran=ran,
        encoder_m=_encoder_step(position),
        start_s=float(time[0]),
    )
    return _thinned(log), notes


def _ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the ticks from row to row: missing ones stand apart, a scattering clock has steps of 1.5 periods too."""
    for period in (usual, float(np.median(steps))):
        between, twice = (np.mean((steps > a * period) & (steps < b * period)) for a, b in ((1.3, 1.7), (1.7, 2.5)))
        if between <= 0.1 * twice:
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    return np.where(steps < 2.5 * period, 1, np.round(steps / period)).astype(np.intp)


def _encoder_step(position: FloatArray) -> float:
    """Return the step of the lattice of the positions, 0 without one."""
    values = np.unique(position)
    apart = np.diff(values)
    apart = apart[apart > 1e-6 * np.ptp(values)] if values.size > 1 else apart
    if not apart.size:
        return 0.0
    if values.size < 12:
        return float(apart.min())
    usual = float(np.median(apart[apart < 1.5 * np.quantile(apart, 0.1)]))
    for parts in range(1, 7):
        step = usual / parts
        counts = np.round(apart / step)
        near = (counts > 0) & (counts < 40)
        step = float(apart[near] @ counts[near] / (counts[near] @ counts[near]))
        if float(np.sqrt(np.mean((apart[near] / step - counts[near]) ** 2))) < 0.08:
            return step
    return 0.0


def _held(position: FloatArray, force: FloatArray) -> int:
    """Return the samples for which each force is held while the position changes."""
    moved, new = np.diff(position) != 0, np.diff(force) != 0
    change = np.flatnonzero(new) + 1
    if np.count_nonzero(new & moved) < 20 or np.count_nonzero(moved) <= 1.3 * change.size:
        return 1
    for held in range(max(8, round(float(np.median(np.diff(change))))), 1, -1):
        if np.bincount(change % held, minlength=held).max() >= 0.95 * change.size:
            return held
    return 1


def _thinned(log: Log) -> Log:
    """Keep the ticks at which new forces are computed."""
    held = log.ticks.held
    if held == 1:
        return log
    first = int(np.argmax(np.bincount((np.flatnonzero(np.diff(log.force_n) != 0) + 1) % held, minlength=held)))
    kept = slice(first, None, held)
    return replace(
        log,
        position_m=log.position_m[kept],
        force_n=log.force_n[kept],
        ran=log.ran[kept],
        start_s=log.start_s + first * log.ticks.sample_time_s,
    )


@dataclass(frozen=True, eq=False)
class Oscillation:
    """An oscillation of the measured position between two samples.

    Attributes:
        kind: none, decaying, growing, limit cycle, or irregular: persistent without an even cycle.
        first, last: its samples.
        frequency_hz: mean over its cycles.
        peak_to_peak_m, force_peak_to_peak_n: of position and commanded force at the end.
        steps: peak to peak in encoder steps; infinite without an encoder.
        growth_per_s, growth_error_per_s: of the amplitude while it grows or decays; NaN elsewhere.
        contact_share, limit_share: shares of its time with a force, and with the force at its limit.
        fast_m, envelope_m: the position without slow motion, and its amplitude.
    """

    kind: Kind
    first: int
    last: int
    fast_m: FloatArray
    envelope_m: FloatArray
    frequency_hz: float = math.nan
    peak_to_peak_m: float = 0.0
    force_peak_to_peak_n: float = 0.0
    steps: float = math.inf
    growth_per_s: float = math.nan
    growth_error_per_s: float = math.nan
    contact_share: float = 0.0
    limit_share: float = 0.0

    @property
    def sustained(self) -> bool:
        """Whether it goes on."""
        return self.kind in {"growing", "limit cycle", "irregular"}


# Slow motion below each frequency is left out, in turn; an even cycle of fewer turns is none, growth takes fewer.
_ABOVE_HZ, _EVEN_TURNS, _GROWING_TURNS = (4.0, 1.0, 0.25), 8, 5


def find_oscillation(log: Log, limit_n: float | None) -> Oscillation:
    """Return the oscillation of a log: the fastest that persists, else the largest that decays."""
    found = []
    for hertz in _ABOVE_HZ:
        one = _above(log, hertz, limit_n)
        if one.sustained and one.frequency_hz > 2 * hertz and one.last > 0.8 * log.position_m.size:
            return one
        found.append(one)
    dies = any(one.kind == "decaying" and one.last > 0.8 * log.position_m.size for one in found)
    fast = None if dies else _of_force(log, found[0], limit_n)
    found = [*found, fast] if fast is not None else found
    return max(found, key=lambda one: (one.sustained, one.peak_to_peak_m * np.nan_to_num(one.frequency_hz)))


def _above(log: Log, hertz: float, limit_n: float | None) -> Oscillation:
    """Return the oscillation of the position above a frequency."""
    period, n = log.ticks.period_s, log.position_m.size
    if hertz * period > 0.2 or hertz * n * period < 1:
        fast = log.position_m - log.position_m.mean()
    else:
        pad = min(n - 1, round(2 / hertz / period))
        filtered = signal.butter(3, hertz, "highpass", fs=1 / period, output="sos")
        fast = signal.sosfiltfilt(filtered, log.position_m - log.position_m.mean(), padtype="even", padlen=pad)
    window = min(n, max(5, round(1 / hertz / period)))
    envelope = (ndimage.maximum_filter1d(fast, window) - ndimage.minimum_filter1d(fast, window)) / 2
    least = max(1.2 * log.encoder_m, 2e-4 * float(np.ptp(fast)))
    none = Oscillation("none", 0, n, fast, envelope)
    turns = _turns(fast, np.maximum(least, 0.6 * envelope))
    run = _even_run(turns, np.abs(np.diff(fast[turns])))
    if run is None:
        recent = turns[turns > n - max(n // 3, 1)]
        goes_on = recent.size > 10 and n - recent[-1] < 4 * float(np.mean(np.diff(recent)))
        return _measured(log, none, recent, "irregular", limit_n) if goes_on else none
    return _measured(log, none, turns[run], None, limit_n)


def _turns(fast: FloatArray, size: FloatArray) -> IndexArray:
    """Return the samples of alternating extremes, each so far from the one before."""
    turns: list[int] = []
    high = low = 0
    rising: bool | None = None
    for i, (value, far) in enumerate(zip(fast.tolist(), size.tolist(), strict=True)):
        if value > fast[high]:
            high = i
        if value < fast[low]:
            low = i
        if rising is not False and fast[high] - value > far:
            turns.append(high)
            rising, low = False, i
        elif rising is not True and value - fast[low] > far:
            turns.append(low)
            rising, high = True, i
    return np.array(turns, dtype=np.intp)


def _even_run(turns: IndexArray, swings: FloatArray) -> slice | None:
    """Return the turns of the strongest run of even cycles, or None."""
    if turns.size < _GROWING_TURNS:
        return None
    cycles = turns[2:] - turns[:-2]
    uneven = np.abs(np.log(cycles[1:] / cycles[:-1])) > 0.6
    edges = [-1, *np.flatnonzero(uneven).tolist(), cycles.size - 1]
    best, most = None, 0.0
    for begin, end in itertools.pairwise(edges):
        run = slice(begin + 1, end + 3)
        size = run.stop - run.start
        inside = swings[run.start : run.stop - 1]
        grows = size >= _GROWING_TURNS and inside[-1] > 1.5 * inside[0] and run.stop == turns.size
        rate = float(np.sum((inside / np.diff(turns[run])) ** 2) * (1.0 + (run.stop == turns.size)))
        if (size >= _EVEN_TURNS or grows) and rate > most:
            best, most = run, rate
    return best


def _measured(log: Log, none: Oscillation, turns: IndexArray, kind: Kind | None, limit_n: float | None) -> Oscillation:
    """Measure the oscillation of some turns."""
    period, n = log.ticks.period_s, log.position_m.size
    sizes = np.abs(np.diff(none.fast_m[turns]))
    time = np.asarray(turns[1:] * period, dtype=np.float64)
    hertz = (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    quarter = max(3, sizes.size // 4)
    top, late = float(np.quantile(sizes, 0.9)), float(np.median(sizes[-quarter:]))
    growth, error = math.nan, math.nan
    first = int(turns[0])
    back = np.diff(log.position_m[turns[0] : turns[-1] + 1])
    returns = min(float(back[back > 0].sum()), -float(back[back < 0].sum()))
    if returns < 0.5 * log.encoder_m * sizes.size / 2 or returns < 0.05 * float(sizes.sum()) / 2:
        return none
    if kind is None:
        kind = "limit cycle"
        slope, error_late = _slope(time[-min(20, sizes.size) :], sizes[-min(20, sizes.size) :])
        level = abs(slope) < max(2 * error_late, 0.02 * hertz) and sizes.size > 20 and late > 1.6 * log.encoder_m
        peak = int(np.argmax(sizes))
        if late < 0.6 * top and not level:
            kind = "decaying"
            growth, error = _slope(time[peak:], sizes[peak:])
        elif late < 0.6 * top:
            first = int(turns[-20])
        elif late > 1.3 * float(np.median(sizes[: max(2, sizes.size // 4)])) and late > 0.8 * top:
            rise = slice(0, max(peak + 1, 4))
            growth, error = _slope(time[rise], sizes[rise])
            kind = "growing" if late > 1.1 * float(np.median(sizes[sizes.size // 3 : 2 * sizes.size // 3])) else kind
    last = n if n - turns[-1] < 2.5 / hertz / period else int(turns[-1]) + 1
    touching = np.count_nonzero(log.touching[last:]) * period
    if kind in {"limit cycle", "irregular"} and sizes.size < 16 and touching > 1.0 and touching * hertz > 8:
        kind = "decaying"
    inside = slice(max(first, last - max(round(3 / hertz / period), (last - first) // 2)), last)
    size = np.abs(log.force_n[first:last])
    limit = force_limit(log, limit_n)
    return replace(
        none,
        kind=kind,
        first=first,
        last=last,
        frequency_hz=hertz,
        peak_to_peak_m=late,
        force_peak_to_peak_n=float(np.ptp(np.quantile(log.force_n[inside], (0.01, 0.99)))),
        steps=late / log.encoder_m if log.encoder_m else math.inf,
        growth_per_s=growth,
        growth_error_per_s=error,
        contact_share=float(np.mean(log.touching[first:last])),
        limit_share=0.0 if limit is None else float(np.mean(size > 0.999 * limit)),
    )


def _slope(time: FloatArray, sizes: FloatArray) -> tuple[float, float]:
    """Return the slope of the logarithm of sizes, 1/s, and its standard error."""
    values = np.log(np.maximum(sizes, 1e-15))
    if values.size < 4:
        rate = (values[-1] - values[0]) / max(time[-1] - time[0], 1e-9) if values.size > 1 else 0.0
        return float(rate), math.inf
    (slope, _), covariance = np.polyfit(time - time[0], values, 1, cov=True)
    return float(slope), float(math.sqrt(covariance[0, 0]))


def _of_force(log: Log, none: Oscillation, limit_n: float | None) -> Oscillation | None:
    """Return what the force alone shows to the end of a log: a ripple that a few encoder steps make."""
    n, period = log.position_m.size, log.ticks.period_s
    begin = 2 * n // 3
    force = log.force_n[begin:]
    if force.size < 20 or 20 * period > 0.5 or not np.ptp(log.position_m[begin:]):
        return None
    quick = signal.sosfiltfilt(signal.butter(2, 8.0, "highpass", fs=1 / period, output="sos"), force - force.mean())
    ripple = float(np.std(quick))
    turns = _turns(quick, np.full(quick.size, max(1.5 * ripple, 1e-12)))
    most = float(np.abs(log.force_n).max())
    if ripple < max(0.07 * abs(float(force.mean())), 4e-3 * (limit_n or most)) or turns.size < 16:
        return None
    if force.size - turns[-1] > 4 * float(np.mean(np.diff(turns))):
        return None
    cycles = np.diff(turns[::2])
    even = float(np.std(cycles) / np.mean(cycles)) < 0.35
    moved = float(np.ptp(np.quantile(log.position_m[begin:], (0.02, 0.98))))
    hertz = (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    return replace(
        none,
        kind="limit cycle" if even else "irregular",
        first=begin,
        last=n,
        frequency_hz=hertz,
        peak_to_peak_m=moved,
        force_peak_to_peak_n=float(np.ptp(np.quantile(force, (0.01, 0.99)))),
        steps=moved / log.encoder_m if log.encoder_m else math.inf,
        contact_share=float(np.mean(log.touching[begin:])),
    )


def force_limit(log: Log, limit_n: float | None) -> float | None:
    """Return the force limit that a log reaches: the declared one, or a force that stays as positions change."""
    size = np.abs(log.force_n)
    most = float(size.max(initial=0.0))
    if limit_n is not None and most > 0.999 * limit_n:
        return limit_n
    top = size > 0.999 * most
    others, counts = np.unique(size[~top & log.touching], return_counts=True)
    if top.sum() < 8 or others.size < 20 or np.ptp(log.position_m[top]) <= 1.5 * log.encoder_m:
        return None
    return most if top.sum() > 5 * np.median(counts) else None
