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

# The grid of a log.

_CONTACT_SHARE = 1e-9
"""Share of the largest force above which a tick is in contact: rounding alone lies below it."""

_USUAL_STEP_QUANTILE = 0.1
"""Quantile of the steps of time that is a step without a missed tick."""

_USUAL_STEP_SCATTER = 0.3
"""Steps that differ from that quantile by less than this share count for the usual step."""

_PAUSE_STEPS = 40
"""Usual steps from which on a step is a pause, at which the log is cut."""

_BETWEEN_TICKS = (1.3, 1.7)
"""Steps, in periods, that are neither one tick nor two: only a clock that scatters has them."""

_TWO_TICKS = (1.7, 2.5)
"""Steps, in periods, that are of two ticks."""

_CLEAN_CLOCK_SHARE = 0.1
"""Steps between one tick and two, per step of two ticks, up to which the clock does not scatter."""

_FEW_POSITIONS = 12
"""Different positions below which their smallest difference is the encoder step: a lattice takes more."""

_SAME_POSITION_SHARE = 1e-6
"""Share of the range of the position up to which two positions differ by rounding alone."""

_FEWEST_FORCES = 4
"""Different forces below which a force is that of a relay and not held."""

_FEWEST_CHANGES = 12
"""Changes of the force below which a log does not tell whether it is held."""

_MOVES_PER_NEW_FORCE = 1.3
"""Changes of the position per change of the force up to which the force is not held."""

_LONGEST_HOLD = 8
"""Samples up to which a hold is always searched; beyond it, up to the median time between two changes."""

_ONE_PHASE_SHARE = 0.95
"""Share of events that have one phase where they come every so many ticks."""

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

# The mass that the force moves.

_AT_REST_SHARE = 0.03
"""Share of the largest speed below which a motion begins."""

_FEWEST_MOVING = 8
"""Samples of a motion below which its mass is not told."""

_MOVED_BY_FORCE_SHARE = 0.05
"""Share of the motion that a force leaves unexplained at most, where it moves the device."""

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
    hold: int
    """Samples of the log for which a force is held."""
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

    @property
    def touching(self) -> BoolArray:
        """Whether each tick is in contact, by its force, shape (n,)."""
        return np.asarray(np.abs(self.force_n) > _CONTACT_SHARE * float(np.abs(self.force_n).max(initial=0.0)))

    @property
    def time_s(self) -> FloatArray:
        """Time of each tick, shape (n,), s."""
        return np.asarray(self.start_s + np.arange(self.position_m.size) * self.period_s)

    def between(self, samples: int) -> FloatArray:
        """Return the position so many samples after each tick, shape (n,), m."""
        after = self.samples_m[samples :: self.hold]
        return np.pad(after, (0, self.position_m.size - after.size), mode="edge")


def log_of(columns: Columns, *, flip_force: bool = False) -> tuple[Log, list[str]]:
    """Return the longest stretch of a log without a pause on its grid, and notes for the user."""
    notes = list(columns.notes)
    steps = np.diff(columns.time_s)
    usual_step = _usual_step(steps)
    pauses = np.flatnonzero(steps > _PAUSE_STEPS * usual_step)
    edges = np.concatenate([[0], pauses + 1, [columns.time_s.size]])
    begin, end = max(itertools.pairwise(edges.tolist()), key=lambda stretch: stretch[1] - stretch[0])
    time = columns.time_s[begin:end]
    position = columns.position_m[begin:end]
    force = columns.force_n[begin:end] * (1.0 if flip_force else -1.0)
    if pauses.size:
        notes.append(f"{pauses.size} pauses in the log; the longest stretch is used, {time.size} samples")

    sample_steps = _ticks_between(np.diff(time), usual_step)
    sample_of_row = np.concatenate([[0], np.cumsum(sample_steps)])
    sample_time = float((time[-1] - time[0]) / sample_of_row[-1])
    samples = np.arange(sample_of_row[-1] + 1)
    row_of_sample = np.searchsorted(sample_of_row, samples, side="right") - 1
    even_position = np.interp(samples, sample_of_row, position)

    # Stamps scatter about a grid, or each about the one before.
    about_grid = float(np.std(time - time[0] - sample_of_row * sample_time))
    about_neighbour = float(np.std(np.diff(time) - sample_steps * sample_time))

    # Samples at which no new force is computed are left out.
    hold, first = _hold(position, force)
    ticks = slice(first, None, hold)
    log = Log(
        name=columns.file,
        period_s=sample_time * hold,
        sample_time_s=sample_time,
        hold=hold,
        missed_share=float(1 - time.size / samples.size),
        uneven_share=about_neighbour / sample_time if about_neighbour < about_grid else 0.0,
        position_m=even_position[ticks],
        force_n=force[row_of_sample][ticks],
        ran=(sample_of_row[row_of_sample] == samples)[ticks],
        encoder_m=_encoder_step(position),
        start_s=float(time[0]) + first * sample_time,
        samples_m=even_position[first:],
    )
    return log, notes


def _usual_step(steps: FloatArray) -> float:
    """Return the step of time from one row to the next where none is missed, s."""
    short = float(np.quantile(steps, _USUAL_STEP_QUANTILE))
    return float(np.mean(steps[np.abs(steps - short) < _USUAL_STEP_SCATTER * short]))


def _encoder_step(position: FloatArray) -> float:
    """Return the encoder step, m; of a swing over a few steps only the smallest difference is known."""
    values = np.unique(position)
    if 1 < values.size < _FEW_POSITIONS:
        gaps = np.diff(values)
        return float(gaps[gaps > _SAME_POSITION_SHARE * np.ptp(values)].min(initial=math.inf))
    return lattice_step(position) or 0.0


def _ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the ticks from row to row: missing ones stand apart, a scattering clock has steps of 1.5 periods too."""

    def share_of(limits: tuple[float, float], period: float) -> float:
        low, high = limits
        return float(np.mean((steps > low * period) & (steps < high * period)))

    median = float(np.median(steps))
    for period in (usual, median):
        if share_of(_BETWEEN_TICKS, period) <= _CLEAN_CLOCK_SHARE * share_of(_TWO_TICKS, period):
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    missed_from = _TWO_TICKS[1]
    return np.where(steps < missed_from * median, 1, np.round(steps / median)).astype(np.intp)


def _hold(position: FloatArray, force: FloatArray) -> tuple[int, int]:
    """Return the samples for which each force is held while the position changes (no relay), and the first new."""
    moves = np.diff(position) != 0
    changes = np.flatnonzero(np.diff(force) != 0) + 1
    if np.unique(force).size < _FEWEST_FORCES or changes.size < _FEWEST_CHANGES:
        return 1, 0
    if moves.sum() <= _MOVES_PER_NEW_FORCE * changes.size:
        return 1, 0
    longest = max(_LONGEST_HOLD, round(float(np.median(np.diff(changes)))))
    return even_phase(changes, longest) or (1, 0)


def even_phase(events: IndexArray, most: int) -> tuple[int, int] | None:
    """Return the ticks from one event to the next, where nearly all have one phase, and the phase.

    `events` are the ticks of the events; `most` is the longest time between two, ticks.
    """
    for ticks in range(most, 1, -1):
        phases = np.bincount(events % ticks, minlength=ticks)
        if phases.max() >= _ONE_PHASE_SHARE * events.size:
            return ticks, int(np.argmax(phases))
    return None


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

    @property
    def sustained(self) -> bool:
        """Whether it goes on."""
        return self.kind in {"growing", "limit cycle", "irregular"}


def find_oscillation(log: Log, limit_n: float | None) -> Oscillation:
    """Return the oscillation of a log: the fastest that persists, else the largest that decays."""
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


def samples_alike(residual: FloatArray) -> float:
    """Return the correlated samples per independent one, 1 + 2 sum rho^2 (Bartlett), at least 3 for rounding."""
    n = residual.size
    correlation = np.fft.irfft(np.abs(np.fft.rfft(residual - residual.mean(), 2 * n)) ** 2)[: n // 2]
    rho = correlation[1:] / max(correlation[0], 1e-300)
    return max(LEAST_ALIKE, 1 + 2 * float(np.sum(rho**2 - 1 / n)))


def _above(log: Log, cut_off_hz: float) -> Oscillation:
    """Return the oscillation of the position above a frequency."""
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
    """Return the ticks of alternating extremes, each so far from the one before, m."""
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
    """Return the turns of the strongest run of even cycles, or None; a run that lasts to the end counts twice."""
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
    """Measure the oscillation of some turning points; `none` where it hardly travels back."""
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
    """Return the tick from which on a swing that shrank keeps its size; None where it goes on shrinking."""
    steady_slope = _STEADY_RATE * frequency_hz
    for test in _STEADY_TESTS:
        if sizes.size <= test.turns or late_size <= test.resolved_steps * log.encoder_m:
            continue
        log_sizes = np.log(np.maximum(sizes[-test.turns :], 1e-15))
        (slope, _), covariance = np.polyfit(turns[-test.turns :] * log.period_s, log_sizes, 1, cov=True)
        largest_slope = max(2 * math.sqrt(covariance[0, 0]), steady_slope) if test.within_error else steady_slope
        if abs(slope) < largest_slope:
            return int(turns[-test.turns])
    return None


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
    """Return what the force alone shows to the end of a log: a ripple that a few encoder steps make."""
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


def apparent_mass_kg(log: Log, device: Device, *, known: bool) -> float:
    """Return the mass that the force moves up to the largest speed; negative along the motion, infinite for none.

    x(t) = -(1/m) (double integral of F + drag) + a start, a speed and, in a second trial, a constant push. The force is
    summed twice as a held one acts. Drag and friction are those of a known device, against the motion or with it.
    """
    sample_time = log.sample_time_s
    force = np.repeat(log.force_n, log.hold)[: log.samples_m.size]
    speed = np.abs(ndimage.uniform_filter1d(np.gradient(log.samples_m), 5))
    peak = int(np.argmax(speed))
    delay = round(device.delay_samples * device.sample_time_s / sample_time)
    first = int(np.flatnonzero(np.append(True, speed[:peak] < _AT_REST_SHARE * speed[peak]))[-1])
    # Of a motion that is fastest within the delay of the log's start, no force is in the log.
    force = force[max(first - delay, 0) : max(peak - delay + 1, 0)]
    if force.size < _FEWEST_MOVING or not force.any():
        return math.inf
    x = log.samples_m[peak + 1 - force.size : peak + 1]
    time = sample_time * np.arange(force.size)
    twice = np.append(0.0, np.cumsum(np.cumsum(force) - force / 2)[:-1]) * sample_time**2
    drag = known * device.damping_ns_per_m * np.cumsum(x - x[:1]) * sample_time
    drag += known * device.coulomb_friction_n * time**2 / 2 * np.sign(x[-1:] - x[:1])
    for powers, sign in itertools.product((2, 3), (1, -1)):
        start = np.vander(time / time[-1], powers)
        fit = regression(np.column_stack([twice + sign * drag, start]), x)
        without_force = regression(start, x)
        if fit is None or without_force is None:
            continue
        factors, residual = fit
        _, moved = without_force
        clear = residual < max(_MOVED_BY_FORCE_SHARE * moved, 0.5 * log.encoder_m) and moved > 2 * log.encoder_m
        if clear and factors[0] * sign < 0:
            return -1 / float(factors[0])
    return math.inf
