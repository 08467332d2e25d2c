"""A log on the grid of its ticks, and the oscillation in it: frequency and size by its turning points."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage, signal

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.log import Columns, lattice_step
from avc_casadi.identification.regression import regression
from avc_casadi.model.device import Device

Kind = Literal["none", "decaying", "growing", "limit cycle", "irregular"]


@dataclass(frozen=True, eq=False)
class Log:
    """One record on an even grid; the force counts against +position and is held over missed ticks."""

    name: str
    period_s: float
    sample_time_s: float
    hold: int  # samples of the log for which a force is held
    missed_share: float
    uneven_share: float
    position_m: FloatArray
    force_n: FloatArray
    ran: BoolArray
    encoder_m: float
    start_s: float
    samples_m: FloatArray  # positions of all samples, from the first tick on

    @property
    def touching(self) -> BoolArray:
        """Whether each tick is in contact, by its force."""
        return np.asarray(np.abs(self.force_n) > 1e-9 * float(np.abs(self.force_n).max(initial=0.0)))

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.period_s)

    def between(self, samples: int) -> FloatArray:
        """Return the position so many samples after each tick."""
        after = self.samples_m[samples :: self.hold]
        return np.pad(after, (0, self.position_m.size - after.size), mode="edge")


def log_of(columns: Columns, *, flip_force: bool = False) -> tuple[Log, list[str]]:
    """Return the longest stretch of a log without a pause on its grid, and notes."""
    notes, steps = list(columns.notes), np.diff(columns.time_s)
    short = float(np.quantile(steps, 0.1))
    usual = float(np.mean(steps[np.abs(steps - short) < 0.3 * short]))
    pauses = np.flatnonzero(steps > 40 * usual)
    edges = np.concatenate([[0], pauses + 1, [columns.time_s.size]])
    part = slice(*max(itertools.pairwise(edges.tolist()), key=lambda ends: ends[1] - ends[0]))
    time, position = columns.time_s[part], columns.position_m[part]
    if pauses.size:
        notes.append(f"{pauses.size} pauses in the log; the longest stretch is used, {time.size} samples")
    force = columns.force_n[part] * (1.0 if flip_force else -1.0)
    counts = _ticks_between(np.diff(time), usual)
    at = np.concatenate([[0], np.cumsum(counts)])
    period = float((time[-1] - time[0]) / at[-1])
    row_of = np.searchsorted(at, np.arange(at[-1] + 1), side="right") - 1
    # Stamps scatter about a grid, or each about the one before.
    about, apart = float(np.std(time - time[0] - at * period)), float(np.std(np.diff(time) - counts * period))
    values = np.unique(position)
    gaps = np.diff(values)[np.diff(values) > 1e-6 * np.ptp(values)]
    # Of a swing over a few steps only the smallest difference is known.
    step = float(gaps.min(initial=math.inf)) if 1 < values.size < 12 else lattice_step(position) or 0.0
    # Ticks at which no new force is computed are left out.
    hold, first = _hold(position, force)
    ticks, even = slice(first, None, hold), np.interp(np.arange(row_of.size), at, position)
    gaps_share, uneven = float(1 - time.size / row_of.size), apart / period if apart < about else 0.0
    ran, start = (at[row_of] == np.arange(row_of.size))[ticks], float(time[0]) + first * period
    times = (columns.file, period * hold, period, hold, gaps_share, uneven)
    return Log(*times, even[ticks], force[row_of][ticks], ran, step, start, even[first:]), notes


def _ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the ticks from row to row: missing ones stand apart, a scattering clock has steps of 1.5 periods too."""
    for period in (usual, float(np.median(steps))):
        between, twice = (np.mean((steps > a * period) & (steps < b * period)) for a, b in ((1.3, 1.7), (1.7, 2.5)))
        if between <= 0.1 * twice:
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    return np.where(steps < 2.5 * period, 1, np.round(steps / period)).astype(np.intp)


def _hold(position: FloatArray, force: FloatArray) -> tuple[int, int]:
    """Return the samples for which each force is held while the position changes (no relay), and the first new."""
    moves, new = np.diff(position) != 0, np.diff(force) != 0
    change = np.flatnonzero(new) + 1
    if np.unique(force).size < 4 or change.size < 12 or moves.sum() <= 1.3 * change.size:
        return 1, 0
    return even_phase(change, max(8, round(float(np.median(np.diff(change)))))) or (1, 0)


def even_phase(at: IndexArray, most: int) -> tuple[int, int] | None:
    """Return the ticks from one event to the next, where nearly all have one phase, and the first."""
    for ticks in range(most, 1, -1):
        phases = np.bincount(at % ticks, minlength=ticks)
        if phases.max() >= 0.95 * at.size:
            return ticks, int(np.argmax(phases))
    return None


@dataclass(frozen=True, eq=False)
class Oscillation:
    """An oscillation of the measured position between two samples."""

    kind: Kind
    first: int
    last: int
    fast_m: FloatArray
    envelope_m: FloatArray
    frequency_hz: float = math.nan
    peak_to_peak_m: float = 0.0
    force_peak_to_peak_n: float = 0.0
    steps: float = math.inf
    contact_share: float = 0.0

    @property
    def sustained(self) -> bool:
        """Whether it goes on."""
        return self.kind in {"growing", "limit cycle", "irregular"}


# Slow motion below each frequency is left out, in turn; an even cycle of fewer turns is none, growth takes fewer.
_ABOVE_HZ, _EVEN_TURNS, _GROWING_TURNS = (4.0, 1.0, 0.25), 8, 5
LEAST_ALIKE = 3.0  # correlated samples per independent one of a white residual, with rounding


def find_oscillation(log: Log, limit_n: float | None) -> Oscillation:
    """Return the oscillation of a log: the fastest that persists, else the largest that decays."""
    found = [_above(log, hertz) for hertz in _ABOVE_HZ]
    going = [one for one in found if one.sustained and one.last > 0.8 * log.position_m.size]
    for one, hertz in zip(found, _ABOVE_HZ, strict=True):
        if one in going and one.frequency_hz > 2 * hertz:
            return one
    # What decays over few steps may be noise of the position, which shakes the force.
    if not any(one.kind == "decaying" and one.last > 0.8 * log.position_m.size and one.steps > 14 for one in found):
        found += _of_force(log, found[0], limit_n)
    best = max(found, key=lambda one: (one.sustained, one.peak_to_peak_m * np.nan_to_num(one.frequency_hz)))
    # Where nothing swings, the fastest motion that the encoder resolves.
    resolved = (one for one in found if one.envelope_m.max() > 4 * log.encoder_m)
    return best if best.kind != "none" else next(resolved, found[-1])


def samples_alike(left: FloatArray) -> float:
    """Return the correlated samples per independent one, 1 + 2 sum rho^2 (Bartlett), at least 3 for rounding."""
    n = left.size
    correlation = np.fft.irfft(np.abs(np.fft.rfft(left - left.mean(), 2 * n)) ** 2)[: n // 2]
    return max(LEAST_ALIKE, 1 + 2 * float(np.sum((correlation[1:] / max(correlation[0], 1e-300)) ** 2 - 1 / n)))


def _above(log: Log, hertz: float) -> Oscillation:
    """Return the oscillation of the position above a frequency."""
    period, n = log.period_s, log.position_m.size
    fast = log.position_m - log.position_m.mean()
    if hertz * period <= 0.2 and hertz * n * period >= 1:
        pad = min(n - 1, round(2 / hertz / period))
        high_pass = signal.butter(3, hertz, "highpass", fs=1 / period, output="sos")
        fast = signal.sosfiltfilt(high_pass, fast, padtype="even", padlen=pad)
    window = min(n, max(5, round(1 / hertz / period)))
    envelope = (ndimage.maximum_filter1d(fast, window) - ndimage.minimum_filter1d(fast, window)) / 2
    least = max(1.2 * log.encoder_m, 2e-4 * float(np.ptp(fast)))
    none = Oscillation("none", 0, n, fast, envelope)
    turns = _turns(fast, np.maximum(least, 0.6 * envelope))
    run = _even_run(turns, np.abs(np.diff(fast[turns])))
    if run is not None:
        return _measure(log, none, turns[run], even=True)
    recent = turns[turns > n - max(n // 3, 1)]
    goes_on = recent.size > 10 and n - recent[-1] < 4 * float(np.mean(np.diff(recent)))
    return _measure(log, none, recent, even=False) if goes_on else none


def _turns(fast: FloatArray, size: FloatArray) -> IndexArray:
    """Return the samples of alternating extremes, each so far from the one before."""
    turns: list[int] = []
    high = low = 0
    rising: bool | None = None
    for i, (value, far) in enumerate(zip(fast.tolist(), size.tolist(), strict=True)):
        high = i if value > fast[high] else high
        low = i if value < fast[low] else low
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
    best, most = None, 0.0
    for begin, end in itertools.pairwise([-1, *np.flatnonzero(uneven).tolist(), cycles.size - 1]):
        run = slice(begin + 1, end + 3)
        inside, to_end = swings[run.start : run.stop - 1], run.stop == turns.size
        grows = run.stop - run.start >= _GROWING_TURNS and inside[-1] > 1.5 * inside[0] and to_end
        rate = float(np.sum((inside / np.diff(turns[run])) ** 2) * (1.0 + to_end))
        if (run.stop - run.start >= _EVEN_TURNS or grows) and rate > most:
            best, most = run, rate
    return best


def _measure(log: Log, none: Oscillation, turns: IndexArray, *, even: bool) -> Oscillation:
    """Measure the oscillation of some turns."""
    period, n, first = log.period_s, log.position_m.size, int(turns[0])
    sizes, hertz = np.abs(np.diff(none.fast_m[turns])), (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    few = 3 if sizes.size >= _EVEN_TURNS else 1  # so few turns grow: the last is the size
    top, late = float(np.quantile(sizes, 0.9)), float(np.median(sizes[-max(few, sizes.size // 4) :]))
    back = np.diff(log.position_m[turns[0] : turns[-1] + 1])
    returns = min(float(back[back > 0].sum()), -float(back[back < 0].sum()))
    if returns < 0.5 * log.encoder_m * sizes.size / 2 or returns < 0.05 * float(sizes.sum()) / 2:
        return none
    kind: Kind = "limit cycle" if even else "irregular"
    if even and late < 0.6 * top:
        kind = "decaying"
        # Eight turns that shrink by less than 2 % a cycle are even where the encoder resolves that.
        for count, resolved in ((20, 1.6), (8, 12.0)):
            if kind == "decaying" and sizes.size > count and late > resolved * log.encoder_m:
                logs = np.log(np.maximum(sizes[-count:], 1e-15))
                (slope, _), covariance = np.polyfit(turns[-count:] * period, logs, 1, cov=True)
                most = 0.02 * hertz if count == 8 else max(2 * math.sqrt(covariance[0, 0]), 0.02 * hertz)
                kind, first = ("limit cycle", int(turns[-count])) if abs(slope) < most else (kind, first)
    elif even and late > 0.8 * top:
        early, middle = sizes[: max(2, sizes.size // 4)], sizes[sizes.size // 3 : 2 * sizes.size // 3]
        grows = late > max(1.3 * float(np.median(early)), 1.1 * float(np.median(middle)))
        kind = "growing" if grows else kind
    last = n if n - turns[-1] < 2.5 / hertz / period else int(turns[-1]) + 1
    touching = np.count_nonzero(log.touching[last:]) * period
    if kind != "growing" and sizes.size < 16 and touching > 1.0 and touching * hertz > 8:
        kind = "decaying"
    inside = slice(max(first, last - max(round(3 / hertz / period), (last - first) // 2)), last)
    return _swing(log, none, kind, (first, last), inside, hertz, late)


def _swing(
    log: Log, none: Oscillation, kind: Kind, ends: tuple[int, int], inside: slice, hertz: float, size: float
) -> Oscillation:
    """Return an oscillation with its force and its size in encoder steps."""
    force = float(np.ptp(np.quantile(log.force_n[inside], (0.01, 0.99))))
    steps, share = size / log.encoder_m if log.encoder_m else math.inf, float(np.mean(log.touching[slice(*ends)]))
    return Oscillation(kind, *ends, none.fast_m, none.envelope_m, hertz, size, force, steps, share)


def _of_force(log: Log, none: Oscillation, limit_n: float | None) -> list[Oscillation]:
    """Return what the force alone shows to the end of a log: a ripple that a few encoder steps make."""
    n, period = log.position_m.size, log.period_s
    begin = 2 * n // 3
    force = log.force_n[begin:]
    if force.size < 20 or 20 * period > 0.5 or not np.ptp(log.position_m[begin:]):
        return []
    quick = signal.sosfiltfilt(signal.butter(2, 8.0, "highpass", fs=1 / period, output="sos"), force - force.mean())
    ripple = float(np.std(quick))
    turns = _turns(quick, np.full(quick.size, max(1.5 * ripple, 1e-12)))
    least = max(0.04 * abs(float(force.mean())), 4e-3 * (limit_n or float(np.abs(log.force_n).max())))
    if ripple < least or turns.size < 16 or force.size - turns[-1] > 2 * np.diff(turns).max():
        return []
    cycles, travel = np.diff(turns[::2]), float(np.ptp(np.quantile(log.position_m[begin:], (0.02, 0.98))))
    kind: Kind = "limit cycle" if float(np.std(cycles) / np.mean(cycles)) < 0.35 else "irregular"
    hertz = (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    return [_swing(log, none, kind, (begin, n), slice(begin, n), hertz, travel)]


def apparent_mass_kg(log: Log, device: Device, *, known: bool) -> float:
    """Return the mass that the force moves up to the largest speed; negative along the motion, infinite for none."""
    period, force = log.sample_time_s, np.repeat(log.force_n, log.hold)[: log.samples_m.size]
    speed = np.abs(ndimage.uniform_filter1d(np.gradient(log.samples_m), 5))
    peak, late = int(np.argmax(speed)), round(device.delay_samples * device.sample_time_s / period)
    first = int(np.flatnonzero(np.append(True, speed[:peak] < 0.03 * speed[peak]))[-1])
    force = force[max(first - late, 0) : peak - late + 1]
    x, time = log.samples_m[peak + 1 - force.size : peak + 1], period * np.arange(force.size)
    # Summed twice as a held force acts, with drag and friction, beside any start, speed and constant push.
    twice = np.append(0.0, np.cumsum(np.cumsum(force) - force / 2)[:-1]) * period**2
    drag = known * device.damping_ns_per_m * np.cumsum(x - x[:1]) * period
    drag += known * device.coulomb_friction_n * time**2 / 2 * np.sign(x[-1:] - x[:1])
    for powers, sign in itertools.product((2, 3), (1, -1)) if force.size >= 8 and force.any() else ():
        start = np.vander(time / time[-1], powers)
        fit, free = regression(np.column_stack([twice + sign * drag, start]), x), regression(start, x)
        rest = (math.inf, 0.0) if fit is None or free is None else (fit[1], free[1])
        clear = rest[0] < max(0.05 * rest[1], 0.5 * log.encoder_m) and rest[1] > 2 * log.encoder_m
        if fit is not None and clear and fit[0][0] * sign < 0:
            return -1 / float(fit[0][0])
    return math.inf
