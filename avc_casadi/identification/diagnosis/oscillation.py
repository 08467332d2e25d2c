"""Detection of the oscillation in a log: onset, frequency, amplitude and growth rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.diagnosis.envelope import (
    LOWEST_HZ,
    cycle_samples,
    envelope_of,
    growth_of,
    level_from,
    line_of,
    travel_of_cycles,
)
from avc_casadi.identification.diagnosis.limit_cycle import CountLimitCycle, find_count_limit_cycle, goes_back, passes
from avc_casadi.identification.diagnosis.log import Log

Kind = Literal["none", "decaying", "growing", "limit cycle", "irregular"]

_WINDOW_S = 0.25
# A slow motion over encoder steps leaves a sawtooth error with a fundamental of 0.32 steps; a position that toggles
# between two steps has one of 0.64.
_LEAST_STEPS = 0.37
_LEAST_M = 1e-7  # at the hand, as the force below
# Share of the power in a line and its harmonics.
_LINE = 0.5
# Log ratio of frequencies up to which two windows hold one oscillation.
_SAME = 0.25
# A scene counts a ripple of 7 % of the mean force as buzzing.
_RIPPLE, _LEAST_N = 0.07, 0.02
_RESTLESS_HZ, _RESTLESS_STEPS = 8.0, 1.2
# It decays to this share of its beginning, or persists.
_FALLS = 0.55
_FEWEST_CYCLES = 5.0
_SHORTEST_S = 0.25


@dataclass(frozen=True)
class Oscillation:
    """An oscillation of the measured position.

    Attributes:
        kind: none, decaying, growing, a limit cycle, or irregular: persistent without one frequency.
        frequency_hz, frequency_error_hz: and its standard error.
        peak_to_peak_m: of the position at its largest, high-passed, and no more than in two cycles as measured.
        force_peak_to_peak_n: of the commanded force there.
        steps: peak to peak in encoder steps; NaN without an encoder.
        growth_per_s, growth_error_per_s: growth rate of the amplitude while it was small; NaN where no growth was seen.
        begins_s, ends_s: times of the log.
        contact_share: share of its time with a force.
        at_rest_m: of the rest of the log, root mean square above `LOWEST_HZ`.
        largest_force_n: commanded during it.
        at_force_limit_share: share of its time in which the force saturates, which bounds it.
    """

    kind: Kind
    frequency_hz: float = math.nan
    frequency_error_hz: float = math.nan
    peak_to_peak_m: float = math.nan
    force_peak_to_peak_n: float = math.nan
    steps: float = math.nan
    growth_per_s: float = math.nan
    growth_error_per_s: float = math.nan
    begins_s: float = math.nan
    ends_s: float = math.nan
    contact_share: float = math.nan
    at_rest_m: float = math.nan
    largest_force_n: float = math.nan
    at_force_limit_share: float = 0.0

    @property
    def looks(self) -> str:
        """The kind as it is seen: whether a steady one is a limit cycle of the loop is for the verdict to say."""
        return "steady" if self.kind == "limit cycle" else self.kind

    @property
    def sustained(self) -> bool:
        """Whether it is self-sustained."""
        return self.kind in {"growing", "limit cycle", "irregular"}


@dataclass(frozen=True, eq=False)
class TracedOscillation:
    """The oscillation with its traces.

    Attributes:
        found: its parameters.
        first, last: its first and last sample.
        fast_m: the position above `LOWEST_HZ`, shape (n,).
        envelope_m: amplitude of `fast_m`, shape (n,).
    """

    found: Oscillation
    first: int
    last: int
    fast_m: FloatArray
    envelope_m: FloatArray


# With fewer cycles in a window a line cannot be separated from slower motion: Hann's lobe is four bins wide.
_CYCLES_OF_A_WINDOW = 2.5
# Slow oscillations: so many times longer windows, and motion over so many steps that quantisation cannot mimic it.
_LONGER, _FAR_STEPS = 4.0, 14.0


def find_oscillation(log: Log) -> TracedOscillation:
    """Find the oscillation of a log; one below `LOWEST_HZ` where there is no faster one."""
    found = _found(log)
    fast = found.found
    if fast.sustained and fast.frequency_hz > _CYCLES_OF_A_WINDOW / _WINDOW_S:
        return found
    slow = _found_in_longer_windows(log)
    # What runs away gets slower at the force limit, and leaves the frequencies at which it began.
    lasts = fast.kind == "decaying" and (log.position_m.size - found.last) * log.ticks.period_s < _WINDOW_S
    slower = lasts and slow.found.kind == "irregular" and _speed(slow) > _speed(found)
    goes_on = (slow.found.kind in {"limit cycle", "growing"} and not slow.found.steps < _FAR_STEPS) or slower
    beside = fast.sustained and not _passes(log, found) and _speed(found) > _speed(slow)
    return slow if goes_on and not beside else found


def _found_in_longer_windows(log: Log) -> TracedOscillation:
    """Find the oscillation of a log with a compressed time scale, and return it in its own time."""
    ticks = replace(log.ticks, sample_time_s=log.ticks.sample_time_s / _LONGER)
    swing = _found(replace(log, ticks=ticks, start_s=log.start_s / _LONGER))
    one = swing.found
    rates = {
        key: getattr(one, key) / _LONGER
        for key in ("frequency_hz", "frequency_error_hz", "growth_per_s", "growth_error_per_s")
    }
    times = {key: getattr(one, key) * _LONGER for key in ("begins_s", "ends_s")}
    return replace(swing, found=replace(one, **rates, **times))


def _found(log: Log) -> TracedOscillation:
    """Find the oscillation of a log above `LOWEST_HZ`."""
    period = log.ticks.period_s
    position = log.position_m
    n = position.size
    fast = _above(position, period)
    size = min(n, max(32, round(_WINDOW_S / period)))
    hop = max(1, size // 4)
    starts = np.arange(0, n - size + 1, hop)
    lines = np.array([line_of(fast[start : start + size], period) for start in starts])
    amplitude, frequency, share = lines.T
    least = max(_LEAST_STEPS * log.encoder_m, _LEAST_M / log.reach_m)
    swings = (amplitude > least) & (share > _LINE)
    found = _swings(log, fast, starts, size, swings, amplitude, frequency, kind=None)
    going = [swing for swing in found if swing.found.sustained]
    toggling = None if any(swing.last >= n - 2 * hop for swing in going) else find_count_limit_cycle(log)
    if not going and toggling is not None:
        return _toggled(log, fast, toggling)
    dying = any(swing.found.kind == "decaying" and swing.last >= n - 2 * hop for swing in found)
    # After a touch the search continues.
    after = max((swing.last for swing in going), default=0)
    if not dying and all(_passes(log, swing) for swing in going):
        left = [start for start in starts if start >= after]
        restless = np.isin(starts, [start for start in left if _unsettled(log, fast, slice(start, start + size))])
        # With slow beats, as over a few counts, the speed has the frequency of the loop.
        speed = np.gradient(fast)
        quick = np.array([line_of(speed[start : start + size], period) for start in starts]).T
        more = _swings(log, fast, starts, size, restless, quick[0], quick[1], kind="irregular")
        if toggling is not None:
            more = [_toggled(log, fast, toggling)]
        found = more if going and more else [*found, *more]
    if found:
        return _that_counts(found, n - 2 * hop)
    rest = fast[n // 2 :]
    return TracedOscillation(Oscillation("none", at_rest_m=_rms(rest)), 0, n, fast, np.abs(signal.hilbert(fast)))


def _that_counts(found: Sequence[TracedOscillation], end: int) -> TracedOscillation:
    """Return the dominant oscillation: one that persists to the end of the log, else the fastest."""
    going = [swing for swing in found if swing.found.sustained] or list(found)
    return max(going, key=lambda swing: (swing.last >= end, _speed(swing)))


def _passes(log: Log, swing: TracedOscillation) -> bool:
    part = log, swing.first, swing.last, swing.found.frequency_hz
    return passes(*part) or not goes_back(*part)


def _speed(swing: TracedOscillation) -> float:
    return swing.found.peak_to_peak_m * swing.found.frequency_hz


def _swings(
    log: Log,
    fast: FloatArray,
    starts: IndexArray,
    size: int,
    flags: BoolArray,
    amplitude: FloatArray,
    frequency: FloatArray,
    *,
    kind: Kind | None,
) -> list[TracedOscillation]:
    """Measure every stretch of flagged windows that is long enough."""
    period = log.ticks.period_s
    found = []
    for run in _runs(flags, frequency, together=kind is not None):
        first, last = int(starts[run[0]]), int(starts[run[1] - 1]) + size
        strong = np.arange(*run)
        weight = amplitude[strong] ** 2 + 1e-30
        hertz = float(np.average(frequency[strong], weights=weight))
        spread = math.sqrt(float(np.average((frequency[strong] - hertz) ** 2, weights=weight)))
        if (last - first) * period >= max(_SHORTEST_S, _FEWEST_CYCLES / hertz):
            found.append(_measured(log, fast, first, last, hertz, spread, kind))
    return found


def _unsettled(log: Log, fast: FloatArray, part: slice) -> bool:
    """Return whether position or force are unsettled: in encoder steps, or relative to the force as in a scene."""
    motion, ripple = _ripples(log, fast, part)
    return motion > max(_RESTLESS_STEPS * log.encoder_m, _LEAST_M / log.reach_m) or ripple > max(
        _RIPPLE * abs(float(log.force_n[part].mean())), _LEAST_N * log.reach_m
    )


def _ripples(log: Log, fast: FloatArray, part: slice) -> tuple[float, float]:
    """Return the ripple of position and force, root mean square."""
    force = log.force_n[part]
    filtered = signal.butter(2, _RESTLESS_HZ, "highpass", fs=1 / log.ticks.period_s, output="sos")
    motion, ripple = (signal.sosfiltfilt(filtered, one) for one in (fast[part], force - force.mean()))
    return _rms(motion), _rms(ripple)


def _falls(log: Log, fast: FloatArray, first: int, last: int) -> bool:
    """Return whether an irregular oscillation decays: at all frequencies, and in the force too."""
    quarter = max((last - first) // 4, min(last - first, 32))
    early, late = (_ripples(log, fast, part) for part in (slice(first, first + quarter), slice(last - quarter, last)))
    return all(end < _FALLS * begin for begin, end in zip(early, late, strict=True))


def _measured(
    log: Log, fast: FloatArray, first: int, last: int, hertz: float, spread: float, kind: Kind | None
) -> TracedOscillation:
    """Measure an oscillation between two samples."""
    period = log.ticks.period_s
    smooth = cycle_samples(hertz, period)
    envelope = envelope_of(fast, hertz, period)
    inside = envelope[first:last]
    top = float(np.quantile(inside, 0.9))
    floor = max(0.4 * log.encoder_m, 1e-9 / log.reach_m)
    # It begins where the envelope last crosses a tenth of its maximum, or the floor of the encoder.
    low = max(0.1 * top, min(2 * floor, 0.5 * top))
    reached = first + int(np.argmax(inside >= 0.7 * top))
    below = np.flatnonzero(envelope[:reached] < low)
    begins = int(below[-1]) + 1 if below.size else first
    growth, error = growth_of(envelope, begins, reached, period, hertz)
    quarter = max(smooth, (last - reached) // 4)
    early, late = float(np.mean(envelope[reached : reached + quarter])), float(np.mean(envelope[last - quarter : last]))
    decay, decay_error = growth_of(envelope, reached, last - smooth, period, hertz)
    irregular = kind
    kind = "limit cycle" if irregular is None else irregular
    level = level_from(envelope, reached, last, smooth, period, hertz)
    if irregular is None and late < _FALLS * early and level is not None:
        begins = reached = level
        growth, error = math.nan, math.nan
    elif (
        (irregular is None or (not log.ticks.missed_share and _falls(log, fast, first, last)))
        and late < _FALLS * early
        and decay < -3 * decay_error
    ):
        kind, growth, error = "decaying", decay, decay_error
    elif irregular is None and (late > 1.6 * early or (last - reached) * period * hertz < 3):
        kind = "growing"
    stretch = slice(max(first, reached if kind != "decaying" else first), last)
    force = log.force_n[stretch]
    travel = min(_peak_to_peak(fast[stretch]), travel_of_cycles(log.position_m[stretch], period, hertz))
    return TracedOscillation(
        Oscillation(
            kind=kind,
            frequency_hz=hertz,
            frequency_error_hz=max(spread, 0.02 * hertz / math.sqrt(max(1.0, (last - first) * period * hertz))),
            peak_to_peak_m=travel,
            force_peak_to_peak_n=_peak_to_peak(force),
            steps=travel / log.encoder_m if log.encoder_m else math.nan,
            growth_per_s=growth,
            growth_error_per_s=error,
            begins_s=log.start_s + begins * period,
            ends_s=log.start_s + last * period,
            contact_share=float(np.mean(log.touching[stretch])),
            at_rest_m=_rms(fast[: max(begins, 1)]),
        ),
        begins,
        last,
        fast,
        envelope,
    )


def _toggled(log: Log, fast: FloatArray, toggling: CountLimitCycle) -> TracedOscillation:
    """Return a limit cycle over a few counts that lasts until the log ends."""
    period, first, last = log.ticks.period_s, toggling.first, toggling.last
    hertz = 1 / (toggling.cycle * period)
    cycles = (last - first) / toggling.cycle
    force = log.force_n[first:last]
    return TracedOscillation(
        Oscillation(
            kind="limit cycle",
            frequency_hz=hertz,
            frequency_error_hz=hertz * max(toggling.scatter, 0.02) / math.sqrt(cycles),
            peak_to_peak_m=toggling.steps * log.encoder_m,
            force_peak_to_peak_n=_peak_to_peak(force),
            steps=toggling.steps,
            begins_s=log.start_s + first * period,
            ends_s=log.start_s + last * period,
            contact_share=float(np.mean(log.touching[first:last])),
            at_rest_m=_rms(fast[: max(first, 1)]),
        ),
        first,
        last,
        fast,
        envelope_of(fast, hertz, period),
    )


def _above(position: FloatArray, period: float) -> FloatArray:
    filtered = signal.butter(3, LOWEST_HZ, "highpass", fs=1 / period, output="sos")
    return np.asarray(
        signal.sosfiltfilt(filtered, position - position.mean(), padtype="even", padlen=min(position.size - 1, 600))
    )


def _runs(flags: BoolArray, frequency: FloatArray, *, together: bool) -> list[tuple[int, int]]:
    """Return runs of windows with one frequency, or with any; one window in between may fail."""
    runs: list[list[int]] = []
    for index in np.flatnonzero(flags):
        hertz = frequency[index]
        same = runs and (together or abs(math.log(hertz / frequency[runs[-1][-1]])) < _SAME)
        if same and index - runs[-1][-1] <= 2:
            runs[-1].append(int(index))
        else:
            runs.append([int(index)])
    return [(run[0], run[-1] + 1) for run in runs]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _peak_to_peak(values: FloatArray) -> float:
    low, high = np.quantile(values, (0.01, 0.99))
    return float(high - low)
