"""A log on the grid of its ticks, and the oscillation in it: frequency and size by its turning points."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage, signal

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.diagnose.clock import clock_of, ticks_between, usual_step
from avc_casadi.diagnose.steady import levels_off
from avc_casadi.identification.log import Columns, lattice_step

Kind = Literal["none", "decaying", "growing", "limit cycle", "irregular"]

# The grid of a log.

_CONTACT_SHARE = 1e-9
"""Share of the largest force above which a tick is in contact: rounding alone lies below it."""

_PAUSE_STEPS = 40
"""Usual steps from which on a step is a pause, at which the log is cut."""

_FEW_POSITIONS = 12
"""Different positions below which their smallest difference is the encoder step: a lattice takes more."""

_SAME_POSITION_SHARE = 1e-6
"""Share of the range of the position up to which two positions differ by rounding alone."""

# The oscillation.

_ABOVE_HZ = (4.0, 1.0, 0.25)
"""Frequencies, Hz, below which motion is left out, in turn: slow motion of the hand is no oscillation."""

_EVEN_TURNS = 8
"""Fewest turning points of an even cycle."""

_GROWING_TURNS = 5
"""Fewest turning points of an oscillation that grows."""

_UNEVEN_CYCLE = 0.6
"""|ln| of the ratio of two cycles from which on they are not even."""

_GROWN = 1.5
"""Ratio of the last swing of a run of a few turns to its first from which on it grows."""

_GOES_ON_SHARE = 0.8
"""Share of the log after which a swing has to be present to go on."""

_NOISY_STEPS = 14
"""Encoder steps, peak to peak, up to which what decays may be noise of the position."""

_RESOLVED_STEPS = 4
"""Encoder steps of the envelope from which on the encoder resolves a motion."""

_HIGH_PASS_LIMIT = 0.2
"""Cut-off, cycles a tick, up to which slow motion can be filtered out."""

_LEAST_TURN_STEPS = 1.2
"""Encoder steps by which two turning points differ at least."""

_LEAST_TURN_RANGE = 2e-4
"""Share of the range of the position by which two turning points differ at least."""

_LEAST_TURN_ENVELOPE = 0.6
"""Share of the envelope (half of peak to peak) by which two turning points differ at least."""

_LEAST_RETURN_STEPS = 0.5
"""Encoder steps that an oscillation travels back in a cycle at least."""

_LEAST_RETURN_SHARE = 0.05
"""Share of its swings that an oscillation travels back at least, beside its slow motion."""

_LARGE_QUANTILE = 0.9
"""Quantile of the swings with which the size at the end is compared."""

_DECAYED = 0.6
"""Ratio of the size at the end to the large swings below which it decays."""

_KEPT = 0.8
"""Ratio of the size at the end to the large swings above which it may grow."""

_REST_SHARE = 0.1
"""Share of a log at its end in which a device that came to rest stands still."""

_REST_RANGE = 0.01
"""Range of the position of a device that stands still, per range of the log: noise beside the encoder steps."""

_STILL_STEPS = 1.01
"""Encoder steps by which the reading of a device that stands still may toggle."""

_STILL_RANGE = 1e-3
"""Share of the range of a log up to which what decays stands still."""

_REST_FORCE = 0.1
"""Range of the force at rest, per range of the log, up to which it does not shake the device."""

_REST_CYCLES = 1.0
"""Cycles of a swing that a rest lasts at least: longer than any turn."""

_RESTING_SWINGS = 2
"""Fewest swings, from turn to turn, of one that comes to rest."""

_RESTING_GROWTH = 1.1
"""Ratio of a swing to the one before up to which a swing comes to rest."""

_RESTING_FALL = 0.85
"""Ratio of the last swing to the largest below which a swing comes to rest by itself, not as it is stopped."""

_GROWN_FROM_EARLY = 1.3
"""Ratio of the size at the end to that of the first quarter above which it grows."""

_GROWN_FROM_MIDDLE = 1.1
"""Ratio of the size at the end to that of the middle third above which it grows."""

_STEADY_RATE = 0.02
"""Change of ln(size) a cycle up to which a size is steady."""


@dataclass(frozen=True)
class _SteadyTest:
    """When the last turning points of a swing that shrank are steady."""

    turns: int
    """Turning points that are looked at."""
    resolved_steps: float
    """Encoder steps above which the size at the end has to be."""
    within_error: bool
    """Whether a slope of ln(size) within two of its standard deviations is none."""


_STEADY_TESTS = (_SteadyTest(20, 1.6, within_error=True), _SteadyTest(8, 12.0, within_error=False))
"""Twenty turning points, or eight where the encoder resolves them well."""

_ENDS_BY_CYCLES = 2.5
"""Cycles without a turning point at the end of a log up to which the oscillation lasts to the end."""

_SILENT_CONTACT_S = 1.0
"""Time in contact without a swing, s, after which a short oscillation has decayed."""

_SILENT_CONTACT_CYCLES = 8
"""The same time in cycles."""

_SHORT_TURNS = 16
"""Swings below which an oscillation is short; turning points that a ripple of the force has at least."""

FORCE_QUANTILES = (0.01, 0.99)
"""Quantiles of the force between which its peak to peak counts: single ticks are left out."""

# A ripple of the force.

_RIPPLE_ABOVE_HZ = 8.0
"""Frequency, Hz, above which a ripple of the force is searched."""

_RIPPLE_TURN = 1.5
"""Standard deviations of the ripple by which two of its turning points differ."""

_RIPPLE_OF_FORCE = 0.04
"""Share of the mean force from which on a ripple counts."""

_RIPPLE_OF_LIMIT = 4e-3
"""Share of the force limit from which on a ripple counts."""

_TRAVEL_QUANTILES = (0.02, 0.98)
"""Quantiles of the position between which its travel under a ripple counts."""

_EVEN_CYCLES = 0.35
"""Standard deviation of the cycles, as a share of their mean, below which a ripple is a limit cycle."""

LEAST_ALIKE = 3.0
"""Correlated samples per independent one of a white residual, with rounding."""


@dataclass(frozen=True, eq=False)
class Log:
    """One record on an even grid; the force counts against +position and is held over missed ticks.

    A tick is the time from one new force to the next, of n in all; a sample is a row of the log, `hold` of them a tick.
    """

    name: str
    period_s: float
    """Time of a tick, s."""
    sample_time_s: float
    """Time of a sample, s."""
    hold: float
    """Samples of the log for which a force is held, in the mean."""
    missed_share: float
    """Share of the samples that are not in the log."""
    uneven_share: float
    """Scatter of the clock from each sample to the next, as a share of a sample; 0 where it scatters about a grid."""
    position_m: FloatArray
    """Position at each tick, shape (n,), m."""
    force_n: FloatArray
    """Force at each tick, shape (n,), N."""
    ran: BoolArray
    """Whether each tick is in the log, shape (n,)."""
    encoder_m: float
    """Encoder step, m; 0 where the position shows none."""
    start_s: float
    """Time of the first tick, s."""
    samples_m: FloatArray
    """Positions of all samples from the first tick on, m."""
    rows: IndexArray
    """The sample of each tick, shape (n,)."""
    early: FloatArray
    """How much earlier than its sample each tick is, by a clock whose ticks are no samples, shape (n,), samples."""

    @property
    def touching(self) -> BoolArray:
        """Whether each tick is in contact, by its force, shape (n,)."""
        return np.asarray(np.abs(self.force_n) > _CONTACT_SHARE * float(np.abs(self.force_n).max(initial=0.0)))

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick, shape (n,), s."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.period_s)

    @property
    def even(self) -> bool:
        """Whether all ticks are as many samples apart."""
        return float(self.hold).is_integer()

    def between(self, samples: FloatArray | float) -> FloatArray:
        """Return the position so many samples after that of each tick, shape (n,), m."""
        return np.asarray(np.interp(self.rows + samples, np.arange(self.samples_m.size), self.samples_m))

    def held_force_n(self) -> FloatArray:
        """Return the force at each sample from the first tick on, N."""
        return np.repeat(self.force_n, np.diff(self.rows, append=self.samples_m.size))

    def with_force_between(self) -> Log:
        """Return the log with a force at missed ticks between those about them: the law ran, and the log lost it."""
        ticks = np.arange(self.force_n.size)
        return replace(self, force_n=np.interp(ticks, ticks[self.ran], self.force_n[self.ran]))

    def by_samples(self) -> Log:
        """Return the log on the grid of its samples, from the first tick on; a force is held until the next tick."""
        held = np.diff(self.rows, append=self.samples_m.size)
        rows = np.arange(self.samples_m.size)
        return replace(
            self,
            period_s=self.sample_time_s,
            hold=1.0,
            position_m=self.samples_m,
            force_n=self.held_force_n(),
            ran=np.repeat(self.ran, held),
            rows=rows,
            early=np.zeros(rows.size),
        )


def log_of(columns: Columns, *, flip_force: bool = False) -> tuple[Log, list[str]]:
    """Return the longest stretch of a log without a pause, on the ticks of its force, and notes for the user."""
    notes = list(columns.notes)
    steps = np.diff(columns.time_s)
    usual_step_s = usual_step(steps)
    pauses = np.flatnonzero(steps > _PAUSE_STEPS * usual_step_s)
    edges = np.concatenate([[0], pauses + 1, [columns.time_s.size]])
    begin, end = max(itertools.pairwise(edges.tolist()), key=lambda stretch: stretch[1] - stretch[0])
    time = columns.time_s[begin:end]
    position = columns.position_m[begin:end]
    force = columns.force_n[begin:end] * (1.0 if flip_force else -1.0)
    if pauses.size:
        notes.append(f"{pauses.size} gaps in the log; only the longest part is used, {time.size} samples")

    sample_steps = ticks_between(np.diff(time), usual_step_s)
    sample_of_row = np.concatenate([[0], np.cumsum(sample_steps)])
    sample_time = float((time[-1] - time[0]) / sample_of_row[-1])
    samples = np.arange(sample_of_row[-1] + 1)
    row_of_sample = np.searchsorted(sample_of_row, samples, side="right") - 1
    even_position = np.interp(samples, sample_of_row, position)

    # Stamps scatter about a grid, or each about the one before.
    about_grid = float(np.std(time - time[0] - sample_of_row * sample_time))
    about_neighbour = float(np.std(np.diff(time) - sample_steps * sample_time))

    # Samples at which no new force is computed are left out.
    clock = clock_of(even_position, force[row_of_sample])
    ticks = clock.rows(samples.size)
    first = int(ticks[0])
    log = Log(
        name=columns.file,
        period_s=sample_time * clock.period,
        sample_time_s=sample_time,
        hold=clock.period,
        missed_share=float(1 - time.size / samples.size),
        uneven_share=about_neighbour / sample_time if about_neighbour < about_grid else 0.0,
        position_m=even_position[ticks],
        force_n=force[row_of_sample][ticks],
        ran=(sample_of_row[row_of_sample] == samples)[ticks],
        encoder_m=_encoder_step(position),
        start_s=float(time[0]) + first * sample_time,
        samples_m=even_position[first:],
        rows=ticks - first,
        early=ticks - clock.times(samples.size),
    )
    return log, notes


def _encoder_step(position: FloatArray) -> float:
    """Return the encoder step, m; of a swing over a few steps only the smallest difference is known."""
    values = np.unique(position)
    if 1 < values.size < _FEW_POSITIONS:
        gaps = np.diff(values)
        return float(gaps[gaps > _SAME_POSITION_SHARE * np.ptp(values)].min(initial=math.inf))
    return lattice_step(position) or 0.0


@dataclass(frozen=True, eq=False)
class Oscillation:
    """An oscillation of the measured position between two ticks of a log of n ticks."""

    kind: Kind
    first: int
    """First tick of it."""
    last: int
    """Tick after its last."""
    fast_m: FloatArray
    """The position without its slow motion, shape (n,), m."""
    envelope_m: FloatArray
    """Half of the range of the fast motion about each tick, shape (n,), m."""
    frequency_hz: float = math.nan
    peak_to_peak_m: float = 0.0
    force_peak_to_peak_n: float = 0.0
    steps: float = math.inf
    """Peak to peak in encoder steps."""
    contact_share: float = 0.0
    """Share of it in contact."""
    rest_from: int | None = None
    """Tick from which on the device stands still, to the end of the log; None where it does not."""

    @property
    def sustained(self) -> bool:
        """Whether it goes on."""
        return self.kind in {"growing", "limit cycle", "irregular"}

    def rest_from_s(self, log: Log) -> float | None:
        """Return the time of a log from which on the device stands still, s; None where it does not."""
        return None if self.rest_from is None else float(log.time_s[self.rest_from])


def find_oscillation(log: Log, limit_n: float | None) -> Oscillation:
    """Return the oscillation of a log: one that comes to rest, the fastest that persists, else the largest decaying."""
    resting = _coming_to_rest(log)
    if resting is not None:
        return resting
    late = _GOES_ON_SHARE * log.position_m.size
    oscillations = [_above(log, cut_off_hz) for cut_off_hz in _ABOVE_HZ]
    for oscillation, cut_off_hz in zip(oscillations, _ABOVE_HZ, strict=True):
        if oscillation.sustained and oscillation.last > late and oscillation.frequency_hz > 2 * cut_off_hz:
            return oscillation
    # What decays over few steps may be noise of the position, which shakes the force.
    decays_to_end = any(
        oscillation.kind == "decaying" and oscillation.last > late and oscillation.steps > _NOISY_STEPS
        for oscillation in oscillations
    )
    if not decays_to_end:
        oscillations += _of_force(log, oscillations[0], limit_n)

    def sustained_and_speed(oscillation: Oscillation) -> tuple[bool, float]:
        return oscillation.sustained, oscillation.peak_to_peak_m * np.nan_to_num(oscillation.frequency_hz)

    best = max(oscillations, key=sustained_and_speed)
    if best.kind != "none":
        return best
    # Where nothing swings, the fastest motion that the encoder resolves.
    for oscillation in oscillations:
        if oscillation.envelope_m.max() > _RESOLVED_STEPS * log.encoder_m:
            return oscillation
    return oscillations[-1]


def _coming_to_rest(log: Log) -> Oscillation | None:
    """Return the swing after which the device stands still to the end of a log; None where it does not.

    Each swing is smaller than the one before: what is stopped while it swings, by a hand or without force, is told by
    its swing alone.
    """
    rest_from = _rest_from(log)
    if rest_from is None:
        return None
    position, n = log.position_m, log.position_m.size
    fast = position - float(np.median(position[rest_from:]))
    least_turn = 2 * max(_STILL_STEPS * log.encoder_m, _STILL_RANGE * float(np.ptp(position)))
    turns = _turns(fast, np.full(n, least_turn))
    sizes = np.abs(np.diff(fast[turns]))
    if sizes.size < _RESTING_SWINGS:
        return None
    largest = int(np.argmax(sizes))
    turns, sizes = turns[largest:], sizes[largest:]
    grows = np.any(sizes[1:] > _RESTING_GROWTH * sizes[:-1] + log.encoder_m)
    if sizes.size < _RESTING_SWINGS or grows or sizes[-1] > _RESTING_FALL * sizes[0]:
        return None
    cycle = 2 * float(turns[-1] - turns[0]) / sizes.size
    if n - rest_from < _REST_CYCLES * cycle:
        return None
    window = min(n, max(5, round(cycle)))
    envelope = (ndimage.maximum_filter1d(fast, window) - ndimage.minimum_filter1d(fast, window)) / 2
    span = slice(int(turns[0]), max(rest_from, int(turns[-1]) + 1))
    none = Oscillation("none", 0, n, fast, envelope)
    swing = _swing(log, none, "decaying", span, span, 1 / (cycle * log.period_s), float(sizes[0]))
    return replace(swing, rest_from=rest_from)


def _rest_from(log: Log) -> int | None:
    """Return the tick from which on the position stays to the end, and the force does not shake it; None without."""
    position, n = log.position_m, log.position_m.size
    late = position[-max(round(_REST_SHARE * n), 5) :]
    travel, spread = float(np.ptp(position)), float(np.ptp(late))
    toggles = _STILL_STEPS * log.encoder_m
    if not travel or spread > max(toggles, _REST_RANGE * travel):
        return None
    # The noise of a reading is white; a motion, however small, is not.
    if spread > toggles and samples_alike(late) > LEAST_ALIKE:
        return None
    # A reading that stays within a step has no motion left in it, so that a slow end of the motion counts as motion.
    still = toggles if spread <= toggles else max(_STILL_RANGE * travel, spread)
    moves = np.flatnonzero(np.abs(position - np.median(late)) > still)
    rest_from = int(moves[-1]) + 1 if moves.size else 0
    shaken = float(np.ptp(log.force_n[rest_from:])) > _REST_FORCE * float(np.ptp(log.force_n))
    return None if shaken or n - rest_from < late.size else rest_from


def samples_alike(residual: FloatArray) -> float:
    """Return the correlated samples per independent one, 1 + 2 sum rho^2 (Bartlett), at least 3 for rounding."""
    n = residual.size
    correlation = np.fft.irfft(np.abs(np.fft.rfft(residual - residual.mean(), 2 * n)) ** 2)[: n // 2]
    rho = correlation[1:] / max(correlation[0], 1e-300)
    return max(LEAST_ALIKE, 1 + 2 * float(np.sum(rho**2 - 1 / n)))


def _above(log: Log, cut_off_hz: float) -> Oscillation:
    """Return the oscillation of the position above a frequency, Hz, by extremes of the high-passed position."""
    period, n = log.period_s, log.position_m.size
    fast = log.position_m - log.position_m.mean()
    if cut_off_hz * period <= _HIGH_PASS_LIMIT and cut_off_hz * n * period >= 1:
        pad = min(n - 1, round(2 / cut_off_hz / period))
        high_pass = signal.butter(3, cut_off_hz, "highpass", fs=1 / period, output="sos")
        fast = signal.sosfiltfilt(high_pass, fast, padtype="even", padlen=pad)
    window = min(n, max(5, round(1 / cut_off_hz / period)))
    envelope = (ndimage.maximum_filter1d(fast, window) - ndimage.minimum_filter1d(fast, window)) / 2
    least_turn = max(_LEAST_TURN_STEPS * log.encoder_m, _LEAST_TURN_RANGE * float(np.ptp(fast)))
    none = Oscillation("none", 0, n, fast, envelope)
    turns = _turns(fast, np.maximum(least_turn, _LEAST_TURN_ENVELOPE * envelope))
    run = _even_run(turns, np.abs(np.diff(fast[turns])))
    if run is not None:
        return _measure(log, none, turns[run], even=True)
    recent = turns[turns > n - max(n // 3, 1)]
    goes_on = recent.size > 10 and n - recent[-1] < 4 * float(np.mean(np.diff(recent)))
    return _measure(log, none, recent, even=False) if goes_on else none


def _turns(fast: FloatArray, least_swing: FloatArray) -> IndexArray:
    """Return the ticks of alternating extremes of a motion, each at least `least_swing`, m, from the one before."""
    turns: list[int] = []
    high = low = 0
    rising: bool | None = None
    for tick, (value, least) in enumerate(zip(fast.tolist(), least_swing.tolist(), strict=True)):
        high = tick if value > fast[high] else high
        low = tick if value < fast[low] else low
        if rising is not False and fast[high] - value > least:
            turns.append(high)
            rising, low = False, tick
        elif rising is not True and value - fast[low] > least:
            turns.append(low)
            rising, high = True, tick
    return np.array(turns, dtype=np.intp)


def _even_run(turns: IndexArray, swings: FloatArray) -> slice | None:
    """Return the turns of the strongest run of even cycles, or None; `swings` are the ways between turns, m.

    The strength is the sum of squared speeds; a run that lasts to the end counts twice.
    """
    if turns.size < _GROWING_TURNS:
        return None
    cycles = turns[2:] - turns[:-2]
    uneven = np.abs(np.log(cycles[1:] / cycles[:-1])) > _UNEVEN_CYCLE
    best, most = None, 0.0
    for begin, end in itertools.pairwise([-1, *np.flatnonzero(uneven).tolist(), cycles.size - 1]):
        run = slice(begin + 1, end + 3)
        turn_count = run.stop - run.start
        inside = swings[run.start : run.stop - 1]
        to_end = run.stop == turns.size
        grows = turn_count >= _GROWING_TURNS and inside[-1] > _GROWN * inside[0] and to_end
        strength = float(np.sum((inside / np.diff(turns[run])) ** 2) * (1.0 + to_end))
        if (turn_count >= _EVEN_TURNS or grows) and strength > most:
            best, most = run, strength
    return best


def _measure(log: Log, none: Oscillation, turns: IndexArray, *, even: bool) -> Oscillation:
    """Return kind, frequency and size of an oscillation with these turning points; `none` without a way back."""
    period, n = log.period_s, log.position_m.size
    sizes = np.abs(np.diff(none.fast_m[turns]))
    frequency_hz = (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    if not _travels_back(log, turns, sizes):
        return none

    late_count = 3 if sizes.size >= _EVEN_TURNS else 1  # so few turns grow: the last is the size
    late_size = float(np.median(sizes[-max(late_count, sizes.size // 4) :]))
    large_size = float(np.quantile(sizes, _LARGE_QUANTILE))
    first = int(turns[0])
    kind: Kind = "limit cycle" if even else "irregular"
    if even and late_size < _DECAYED * large_size:
        steady_from = _steady_from(log, turns, sizes, late_size, frequency_hz)
        kind = "decaying" if steady_from is None else "limit cycle"
        first = first if steady_from is None else steady_from
    elif even and late_size > _KEPT * large_size and _grows(sizes, late_size):
        kind = "growing"

    lasts_to_end = n - turns[-1] < _ENDS_BY_CYCLES / frequency_hz / period
    last = n if lasts_to_end else int(turns[-1]) + 1
    silent_contact_s = np.count_nonzero(log.touching[last:]) * period
    silent = silent_contact_s > _SILENT_CONTACT_S and silent_contact_s * frequency_hz > _SILENT_CONTACT_CYCLES
    if kind != "growing" and sizes.size < _SHORT_TURNS and silent:
        kind = "decaying"
    measured_ticks = max(round(3 / frequency_hz / period), (last - first) // 2)
    inside = slice(max(first, last - measured_ticks), last)
    return _swing(log, none, kind, slice(first, last), inside, frequency_hz, late_size)


def _travels_back(log: Log, turns: IndexArray, sizes: FloatArray) -> bool:
    """Return whether the position itself, with its slow motion, goes back and forth."""
    moves = np.diff(log.position_m[turns[0] : turns[-1] + 1])
    back = min(float(moves[moves > 0].sum()), -float(moves[moves < 0].sum()))
    few_steps = back < _LEAST_RETURN_STEPS * log.encoder_m * sizes.size / 2
    return not few_steps and not back < _LEAST_RETURN_SHARE * float(sizes.sum()) / 2


def _steady_from(log: Log, turns: IndexArray, sizes: FloatArray, late_size: float, frequency_hz: float) -> int | None:
    """Return the tick from which on a swing that shrank keeps its size; None where it goes on shrinking.

    `sizes` are the ways between turning points, m, `late_size` those at the end: their logarithm has no slope there.
    """
    steady_slope = _STEADY_RATE * frequency_hz
    for test in _STEADY_TESTS:
        if sizes.size <= test.turns or late_size <= test.resolved_steps * log.encoder_m:
            continue
        log_sizes = np.log(np.maximum(sizes[-test.turns :], 1e-15))
        (slope, _), covariance = np.polyfit(turns[-test.turns :] * log.period_s, log_sizes, 1, cov=True)
        largest_slope = max(2 * math.sqrt(covariance[0, 0]), steady_slope) if test.within_error else steady_slope
        if abs(slope) < largest_slope:
            return int(turns[-test.turns])
    resolved = late_size > _STEADY_TESTS[-1].resolved_steps * log.encoder_m
    levels_off_at = levels_off(sizes[int(np.argmax(sizes)) :]) if resolved else None
    return None if levels_off_at is None else int(turns[turns.size - 1 - levels_off_at])


def _grows(sizes: FloatArray, late_size: float) -> bool:
    """Return whether the size at the end is above that of the first quarter and of the middle third."""
    early = float(np.median(sizes[: max(2, sizes.size // 4)]))
    middle = float(np.median(sizes[sizes.size // 3 : 2 * sizes.size // 3]))
    return late_size > max(_GROWN_FROM_EARLY * early, _GROWN_FROM_MIDDLE * middle)


def _swing(
    log: Log, none: Oscillation, kind: Kind, span: slice, inside: slice, frequency_hz: float, size: float
) -> Oscillation:
    """Return an oscillation with its force, measured inside a part of its span, and its size in encoder steps."""
    return Oscillation(
        kind=kind,
        first=span.start,
        last=span.stop,
        fast_m=none.fast_m,
        envelope_m=none.envelope_m,
        frequency_hz=frequency_hz,
        peak_to_peak_m=size,
        force_peak_to_peak_n=float(np.ptp(np.quantile(log.force_n[inside], FORCE_QUANTILES))),
        steps=size / log.encoder_m if log.encoder_m else math.inf,
        contact_share=float(np.mean(log.touching[span])),
    )


def _of_force(log: Log, none: Oscillation, limit_n: float | None) -> list[Oscillation]:
    """Return what the force alone shows in the last third of a log: a ripple that a few encoder steps make."""
    n, period = log.position_m.size, log.period_s
    begin = 2 * n // 3
    force, position = log.force_n[begin:], log.position_m[begin:]
    if force.size < 20 or 20 * period > 0.5 or not np.ptp(position):
        return []
    high_pass = signal.butter(2, _RIPPLE_ABOVE_HZ, "highpass", fs=1 / period, output="sos")
    quick = signal.sosfiltfilt(high_pass, force - force.mean())
    ripple = float(np.std(quick))
    turns = _turns(quick, np.full(quick.size, max(_RIPPLE_TURN * ripple, 1e-12)))
    largest_force = limit_n or float(np.abs(log.force_n).max())
    least = max(_RIPPLE_OF_FORCE * abs(float(force.mean())), _RIPPLE_OF_LIMIT * largest_force)
    if ripple < least or turns.size < _SHORT_TURNS or force.size - turns[-1] > 2 * np.diff(turns).max():
        return []
    cycles = np.diff(turns[::2])
    kind: Kind = "limit cycle" if float(np.std(cycles) / np.mean(cycles)) < _EVEN_CYCLES else "irregular"
    frequency_hz = (turns.size - 1) / 2 / (period * float(turns[-1] - turns[0]))
    travel = float(np.ptp(np.quantile(position, _TRAVEL_QUANTILES)))
    return [_swing(log, none, kind, slice(begin, n), slice(begin, n), frequency_hz, travel)]
