"""Device and hand from their response to the logged force: delay, hand, resonance and stops, with their uncertainty."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from avc_casadi._util.arrays import BoolArray, FloatArray, Interval
from avc_casadi._util.progress import Stages
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.motion import SampledMotion
from avc_casadi.diagnose.oscillation import LEAST_ALIKE, Log, Oscillation, samples_alike
from avc_casadi.diagnose.plant import DeviceValue, EncoderSide, Hypothesis, IntendedLaw
from avc_casadi.diagnose.priors import (
    ASSUMED_SPREAD,
    DAMPING_SPREAD,
    MASS_SPREAD,
    Grid,
    Unknown,
    delays_of,
    hand_unknowns,
    mode_unknowns,
)
from avc_casadi.diagnose.windows import MOST_DELAY, LogWindow, windows_of
from avc_casadi.model.hands import Hand

_LEAST_DELAY = 2e-3
"""Shortest delay that is searched, ticks."""

_DRAWS = 12
"""Draws from the posterior of each structure."""

_INTERVAL_DRAWS = 1000
"""Draws from which the interval of a resonance is read."""

_INTERVAL_ENDS = (0.025, 0.975)
"""Shares of the posterior below the ends of that interval: 95 % are within."""

_INTERVAL_ODDS_LN = 3.0
"""ln of the odds, 20 to 1, up to which a less likely structure has a say in that interval."""

_RESONANCE_ODDS = 12.0
"""ln of the odds against a resonance that is not declared."""
_STOP_ODDS = 8.0
"""ln of the odds against travel stops."""

_BOUND_SPREADS = 4
"""Spreads to either side of its prior within which an unknown is searched."""

_MODE_LOWEST_HZ = 25.0
"""Lowest frequency of a resonance, Hz: what is slower is a hand."""

_ENCODER_SIDES: tuple[EncoderSide, ...] = ("motor", "handle")
"""Sides of a resonance on which an encoder may be."""

_MODE_DAMPING_RATIOS = (2e-3, 0.15)
"""Damping ratios of a resonance that are searched."""

_MODE_MASS_RATIOS = (0.1, 0.9)
"""Shares of the device's mass behind a resonance that are searched."""

_MOST_DAMPING_RATIO = 0.5
"""Largest damping ratio of a resonance that is drawn."""

_MODEL_ERROR = 5e-3
"""Share of the swing that no model explains."""

_BEGIN_LEVEL = 1.7
"""Residual, per noise, with which the first search weighs the prior."""

_SEARCH_STEP = 1e-6
"""Step of an unknown for a derivative, per size or spread of the unknown, whichever is larger.

A longer step makes the curvature along a badly determined direction, 1e9 below that along the best one, too large.
"""

_BEGIN_TRIES = 15
"""Evaluations of the first search."""

_REFINE_TRIES = 12
"""Evaluations of the second search, with the residual as noise."""

_MODE_TURNS = (0.75, 0.95, 1.2, 1.6)
"""Factors of the prior's frequency at which the search of a resonance begins."""

_LATE_START = 2.5
"""Ticks that a second search of a long delay begins later."""

_WHITE_FROM = 200
"""Samples of a residual from which on it tells whether it is white."""

_STOPS_STEPS = 14
"""Encoder steps of a swing above which it may meet travel stops."""

_STOP_SIDES = (0.96, 0.9, 0.84, 0.78, 0.72, 0.66, 0.6)
"""Places of stops that are tried, as shares of half of the travel, from the outside in."""

_STOPS_ALIKE = 1.3
"""Residual of stops, per that of the best ones, up to which those further out are taken."""

_STOPS_BETTER = 0.5
"""Residual with stops, per that without, below which they are taken."""

_UNEXPLAINED = 1
"""Residual, per noise, above which a structure does not explain the motion, and stops and a resonance are tried."""

_EXPLAINS_AS_WELL = 1.3
"""Residual, per that of the best answer, up to which another structure explains the log as well."""

_FRICTIONS = (0.8, 1.25)
"""Factors of a declared friction with which a delay is fitted too."""

_AS_LIKELY = 2.0
"""Residual, per that of the best, up to which a structure has a say about the error of a delay beside friction."""

_NEAR_BOUND = 1e-3
"""Share of the range of an unknown within which it stands at its bound."""

_LEAST_CURVATURE = 1e-6
"""Least curvature of the log likelihood along an axis of the posterior, for its width and its volume."""


@dataclass(frozen=True, eq=False)
class PlantFit:
    """One structure fitted to a log."""

    best: Hypothesis
    draws: tuple[Hypothesis, ...]
    """Draws from the posterior about the best answer."""
    cost: float
    """Minus ln of the evidence of the log."""
    misfit: float
    """Residual, per noise of the position."""
    scatter_m: float
    """Error of a reading of the position, root mean square, m."""
    delay_error: float
    """Standard deviation of the delay, ticks."""
    at_end: bool
    """Whether the delay is the longest that is searched."""
    resonance_hz: Interval | None = None
    """95 % of the posterior of the frequency of an undeclared resonance, Hz; None without one."""

    def explains_as_well(self, best: PlantFit) -> bool:
        """Return whether it explains the motion as well as the best fit, or to within the noise."""
        return self.misfit < max(1.0, _EXPLAINS_AS_WELL * best.misfit)

    def in_ticks(self, log: Log) -> PlantFit:
        """Return the fit of samples of a log in its ticks."""

        def in_ticks(hypothesis: Hypothesis) -> Hypothesis:
            return hypothesis.vary(sample_time_s=log.period_s, delay_samples=hypothesis.delay / log.hold)

        draws = tuple(map(in_ticks, self.draws))
        return replace(self, best=in_ticks(self.best), draws=draws, delay_error=self.delay_error / log.hold)


@dataclass(frozen=True, eq=False)
class _Solution:
    """The end of a search."""

    point: FloatArray
    """Unknowns, shape (u,)."""
    curvature: FloatArray
    """J' J of the residuals with the prior, shape (u, u)."""
    cost: float
    """Half of the sum of squares with the prior."""


@dataclass(frozen=True, eq=False)
class _Structure:
    """Unknowns of one structure with their prior, and its residuals."""

    design: IntendedLaw
    period_s: float
    hand: bool
    encoder_at: EncoderSide | None
    """Side of an undeclared resonance on which the encoder is; None without a resonance."""
    names: tuple[str, ...]
    """Names of the u unknowns; the delay is the first, those of a resonance are the last three."""
    middle: FloatArray
    """Middle of the prior of each, shape (u,)."""
    spread: FloatArray
    """Its standard deviation, shape (u,)."""
    most_delay: float
    """Longest delay that is searched, periods."""
    stops: tuple[float, float] | None = None

    @classmethod
    def of(
        cls,
        design: IntendedLaw,
        grid: Grid,
        unknowns: Sequence[Unknown],
        *,
        hand: bool,
        encoder_at: EncoderSide | None,
    ) -> _Structure:
        """Return the structure of some unknowns."""
        names = tuple(unknown.name for unknown in unknowns)
        middle = np.array([unknown.middle for unknown in unknowns])
        spread = np.array([unknown.spread for unknown in unknowns])
        most_delay = MOST_DELAY * grid.a_tick
        return cls(design, grid.period_s, hand, encoder_at, names, middle, spread, most_delay)

    @property
    def resonant(self) -> bool:
        """Whether it has a resonance that is not declared."""
        return self.encoder_at is not None

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the unknowns, each of shape (u,)."""
        low, high = self.middle - _BOUND_SPREADS * self.spread, self.middle + _BOUND_SPREADS * self.spread
        low[0], high[0] = max(low[0], _LEAST_DELAY), min(high[0], self.most_delay)
        if self.resonant:
            low[-3:] = [math.log(_MODE_LOWEST_HZ), math.log(_MODE_DAMPING_RATIOS[0]), _MODE_MASS_RATIOS[0]]
            high[-2:] = [math.log(_MODE_DAMPING_RATIOS[1]), _MODE_MASS_RATIOS[1]]
        return low, high

    def hypothesis(self, point: FloatArray) -> Hypothesis:
        """Return device and hand at a point of the unknowns, shape (u,)."""
        value = dict(zip(self.names, point.tolist(), strict=True))
        device = self.design.device
        changed: dict[str, DeviceValue] = {
            "delay_samples": max(value["delay"], _LEAST_DELAY),
            "sample_time_s": self.period_s,
        }
        if "device_mass" in value:
            changed["mass_kg"] = device.mass_kg * math.exp(value["device_mass"])
            changed["damping_ns_per_m"] = device.damping_ns_per_m * math.exp(value["device_damping"])
        hand = None
        if self.hand:
            hand = Hand(
                math.exp(value["hand_mass"]), math.exp(value["hand_damping"]), math.exp(value["hand_stiffness"])
            )
        if self.encoder_at is not None:
            changed["encoder_at"] = self.encoder_at
            changed["resonance"] = {
                "frequency_hz": self._released_hz(value),
                "damping_ratio": min(math.exp(value["mode_damping_ratio"]), _MOST_DAMPING_RATIO),
                "mass_ratio": value["mode_mass_ratio"],
            }
        return Hypothesis(device, hand, self.stops).vary(**changed)

    def resonance_hz(self, points: FloatArray) -> Interval | None:
        """Return the interval of the frequency of a released device's resonance, Hz, at points of shape (p, u)."""
        if not self.resonant:
            return None
        hertz = [self._released_hz(dict(zip(self.names, point, strict=True))) for point in points.tolist()]
        low_hz, high_hz = np.quantile(hertz, _INTERVAL_ENDS).tolist()
        return low_hz, high_hz

    def _released_hz(self, value: Mapping[str, float]) -> float:
        """Return the frequency of a released device's resonance, Hz, by the unknowns, of which one is that when held.

        With the motor (1 - s) M, the handle s M and the hand r M, f^2 is as 1/(1 - s) + 1/s, and held as
        1/(1 - s) + 1/(s + r). The motion shows the held one; the released one depends on s and r, less well known.
        """
        share = value["mode_mass_ratio"]
        mass_kg = self.design.device.mass_kg * math.exp(value.get("device_mass", 0.0))
        held_share = math.exp(value["hand_mass"]) / mass_kg if self.hand else 0.0
        motor = 1 / (1 - share)
        stiffer = (motor + 1 / share) / (motor + 1 / (share + held_share))
        return math.exp(value["mode_frequency"]) * math.sqrt(stiffer)

    def residuals(self, point: FloatArray, windows: Sequence[LogWindow]) -> list[FloatArray]:
        """Return the residual of the position in each window, m, at a point of the unknowns, shape (u,)."""
        motion = SampledMotion.of(self.hypothesis(point), self.period_s)
        return [self._residual(motion, window) for window in windows]

    def _residual(self, motion: SampledMotion, window: LogWindow) -> FloatArray:
        """Return the residual of the position between stops, m, at the ticks that are used.

        Projected out is motion that is not of the logged force: free motion from any state, the slow motion of the
        hand, and without a hand a weight that may change.
        """
        n = window.position.size
        forced = self._forced(motion, window)
        use, columns = window.use, [motion.free(n)]
        if self.stops is not None:
            # After each contact the motion goes on from any state; the contact itself is left out.
            between = np.abs(window.start + window.position - np.mean(self.stops)) <= np.ptp(self.stops) / 2
            use, columns = use & between, _anew(columns[0], between)
        columns.append(window.slow)
        if not self.hand:
            pushes = (np.ones(n), np.arange(n) / n)
            columns.append(np.stack([motion.response(motion.new + motion.old, push) for push in pushes], axis=1))
        if not use.any():
            # Stops that leave no motion at all.
            return np.full(1, np.ptp(window.position))
        basis = np.concatenate(columns, axis=1)[use]
        basis = np.where(np.abs(basis) < 1e-60, 0.0, basis)
        size = np.sqrt(np.mean(basis**2, axis=0))
        basis = basis[:, size > 0] / size[size > 0]
        unforced = (window.position - forced)[use]
        upright, spare = np.linalg.qr(basis)[0], unforced.size - basis.shape[1]
        if spare < basis.shape[1]:
            # Stops that leave hardly any motion explain all of it.
            return np.full(unforced.size, np.ptp(window.position))
        return np.asarray(unforced - upright @ (upright.T @ unforced)) * math.sqrt(unforced.size / spare)

    def _forced(self, motion: SampledMotion, window: LogWindow) -> FloatArray:
        """Return the position under the logged force and the friction of the device, from rest, shape (n,), m."""
        n = window.position.size
        now = window.past.size - n - motion.whole_delay
        force, force_before = window.past[now:][:n], window.past[now - 1 :][:n]
        forced = motion.response(motion.new, force) + motion.response(motion.old, force_before)
        friction_n = self.design.device.coulomb_friction_n
        if friction_n:
            forced = forced + motion.response(motion.new + motion.old, friction_n * window.rub)
        return forced

    def solve(self, first: FloatArray, windows: Sequence[LogWindow], levels: FloatArray, tries: int) -> _Solution:
        """Return the best point from a first one on; each window has the level of its noise, m."""

        def weighted(point: FloatArray) -> FloatArray:
            residuals = self.residuals(point, windows)
            parts = [residual / level for residual, level in zip(residuals, levels, strict=True)]
            return np.concatenate([*parts, (point - self.middle) / self.spread])

        def slope(point: FloatArray) -> FloatArray:
            # A step relative to an unknown alone would vanish for one that is about 0.
            steps = _SEARCH_STEP * np.maximum(np.abs(point), self.spread)
            steps = np.where(point + steps > high, -steps, steps)
            here = weighted(point)
            changes = [(weighted(point + step) - here) / step.sum() for step in np.diag(steps)]
            return np.stack(changes, axis=1)

        low, high = self.bounds
        result = optimize.least_squares(
            weighted,
            np.clip(first, low + 1e-6, high - 1e-6),
            jac=slope,
            bounds=(low, high),
            x_scale=self.spread,
            max_nfev=tries,
        )
        jacobian = np.asarray(result.jac)
        return _Solution(np.asarray(result.x), jacobian.T @ jacobian, float(result.cost))

    def rms(self, point: FloatArray, windows: Sequence[LogWindow]) -> list[float]:
        """Return the residual in each window, root mean square, m."""
        return [_rms(residual) for residual in self.residuals(point, windows)]


def _anew(free: FloatArray, between: BoolArray) -> list[FloatArray]:
    """Return free motion, shape (n, s), for each stretch between stops, from its first tick on and 0 elsewhere."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], between.astype(int), [0]])))
    blocks = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        block = np.zeros(free.shape)
        block[begin:end] = free[: end - begin]
        blocks.append(block)
    return blocks


def _structures(design: IntendedLaw, grid: Grid, lag: float, swing_hz: float, *, resonant: bool) -> list[_Structure]:
    """Return the structures that may have made a log: with and without a hand, each with a declared or a longer delay.

    A resonance is tried with the declared delay alone, the encoder on either side of it.
    """
    hand = hand_unknowns(design)
    device = [
        Unknown("device_mass", 0.0, MASS_SPREAD if design.known else ASSUMED_SPREAD),
        Unknown("device_damping", 0.0, DAMPING_SPREAD if design.known else ASSUMED_SPREAD),
    ]
    held = [*hand, *([] if design.known else device)]
    punctual, late = delays_of(design, grid, lag)
    if resonant:
        mode = mode_unknowns(swing_hz)
        return [
            _Structure.of(design, grid, [punctual, *unknowns, *mode], hand=with_hand, encoder_at=side)
            for with_hand, unknowns in ((True, held), (False, device))
            for side in _ENCODER_SIDES
        ]
    return [
        _Structure.of(design, grid, [delay, *unknowns], hand=with_hand, encoder_at=None)
        for with_hand, unknowns in ((True, held), (False, device))
        for delay in (punctual, late)
    ]


@dataclass(frozen=True, eq=False)
class _Trial:
    """A structure with its best point and its residual in the worst window, root mean square, m."""

    structure: _Structure
    point: FloatArray
    residual_m: float


@dataclass(frozen=True, eq=False)
class FitTask:
    """A swing of a log to which device and hand are fitted."""

    log: Log
    swing: Oscillation
    seed: int
    """That of the draws."""
    stages: Stages

    def by_samples(self) -> FitTask:
        """Return the task on the grid of the samples, for a clock whose ticks are none of them."""
        first, last = self.log.rows[[self.swing.first, self.swing.last - 1]].tolist()
        return replace(self, log=self.log.by_samples(), swing=replace(self.swing, first=first, last=last + 1))


def fit_log(task: FitTask, design: IntendedLaw, law: FittedLaw) -> tuple[Log, list[PlantFit]]:
    """Return device and hand in every structure, likeliest first, and the log that they are fitted to.

    Where ticks are missed, the force was held, or the law ran and the log lost it: what explains the motion better.
    """
    logs = [task.log]
    if task.log.missed_share:
        logs.append(task.log.with_force_between())
    fitted = []
    for log in logs:
        task = replace(task, log=log)
        fits = fit_plants(task, design, law.lag)
        if law.switch is not None and law.switch.by == "speed":
            fits = beside_friction(fits, task, design, law.lag, law.switch.keep)
        fitted.append((log, fits))
    return min(fitted, key=lambda log_and_fits: log_and_fits[1][0].misfit)


def fit_plants(task: FitTask, design: IntendedLaw, lag: float) -> list[PlantFit]:
    """Return device and hand in every structure, likeliest first; with a resonance or stops where nothing else fits.

    `lag` is that of the law, ticks. With a clock whose ticks are no samples the force is new after so many samples and
    one more: device and hand are fitted to the samples.
    """
    log = task.log
    if log.even:
        return _fits(task, design, Grid(log.period_s, 1.0), lag)
    fits = _fits(task.by_samples(), design, Grid(log.sample_time_s, log.hold), lag * log.hold)
    return [fit.in_ticks(log) for fit in fits]


def beside_friction(
    fits: Sequence[PlantFit], task: FitTask, design: IntendedLaw, lag: float, kept: float
) -> list[PlantFit]:
    """Return fits of a log whose force is switched by the speed, with the error that its friction gives the delay.

    What turns with the speed is friction, or a force that compensates it and comes late: the delay is as far off as it
    is in other structures, and with more or less friction, that leave about as little. A filter of the speed that
    keeps a share of it lags by share/(1 - share) ticks, which act as a delay: half of them may be either.
    """
    filter_lag = kept / (1 - kept)
    trials = list(fits)
    friction_n = design.device.coulomb_friction_n
    for factor in _FRICTIONS if friction_n else ():
        device = design.device.model_copy(update={"coulomb_friction_n": factor * friction_n})
        trials += fit_plants(task, replace(design, device=device), lag)
    most = _AS_LIKELY * min(trial.misfit for trial in trials)
    delays = [trial.best.delay for trial in trials if trial.misfit <= most]

    def error_of(fit: PlantFit) -> float:
        return max(fit.delay_error, 0.5 * filter_lag, *(abs(delay - fit.best.delay) for delay in delays))

    return [replace(fit, delay_error=error_of(fit)) for fit in fits]


def _fits(task: FitTask, design: IntendedLaw, grid: Grid, lag: float) -> list[PlantFit]:
    """Return device and hand in every structure, likeliest first, on the grid of a log; `lag` is in its periods."""
    log, swing, stages = task.log, task.swing, task.stages
    inside = log.position_m[swing.first : swing.last]
    scatter = math.hypot(log.encoder_m / math.sqrt(12), design.device.position_noise_rms_m)
    noise = math.hypot(scatter, _MODEL_ERROR * float(np.std(inside)))
    plain = _structures(design, grid, lag, swing.frequency_hz, resonant=False)
    windows = windows_of(log, swing, grid)
    trials = []
    for structure in plain:
        stages.begin("a hand and a delay" if structure.hand else "a released device and a delay")
        trials.append(_begin(structure, windows, noise))
    likeliest = min(trials, key=lambda trial: trial.residual_m)
    least = likeliest.residual_m
    # What the likeliest leaves is noise of the position where it is white, whether it is declared or not.
    left = np.concatenate(likeliest.structure.residuals(likeliest.point, windows))
    if left.size > _WHITE_FROM and samples_alike(left) <= LEAST_ALIKE:
        scatter, noise = max(scatter, least), max(noise, least)
    # Behind stops the acceleration is of a force that is not in the log.
    if least > _UNEXPLAINED * noise and swing.steps > _STOPS_STEPS:
        for structure in plain:
            stages.begin("travel stops")
            trials += _with_stops(structure, inside, windows, noise, least)
    # Stops explain a resonance too, as the motion begins anew after each contact: they do not stand in for it.
    if least > _UNEXPLAINED * noise and design.device.resonance is None:
        stages.begin("a resonance")
        resonant = _structures(design, grid, lag, swing.frequency_hz, resonant=True)
        trials += [_begin(structure, windows, noise) for structure in resonant]
    levels = _levels(trials, windows, noise)
    fits = []
    for trial in trials:
        stages.begin("errors of hand and delay")
        fits.append(_finish(trial, windows, levels, noise, scatter, task.seed))
    return _with_alternatives(sorted((fit for fit in fits if fit is not None), key=lambda fit: fit.cost))


def _with_alternatives(fits: Sequence[PlantFit]) -> list[PlantFit]:
    """Return fits, the intervals of their resonances over those that are about as likely, on either encoder side."""

    def interval_of(fit: PlantFit) -> Interval | None:
        near = [other for other in fits if other.cost < fit.cost + _INTERVAL_ODDS_LN]
        intervals = [other.resonance_hz for other in near if other.resonance_hz is not None]
        if fit.resonance_hz is None:
            return None
        return min(low for low, _ in intervals), max(high for _, high in intervals)

    return [replace(fit, resonance_hz=interval_of(fit)) for fit in fits]


def _with_stops(
    structure: _Structure, inside: FloatArray, windows: Sequence[LogWindow], noise: float, without: float
) -> list[_Trial]:
    """Return the trial of a structure with the widest stops that explain the motion, or none.

    `inside` is the position of the swing, m; `without` the residual without stops, m.
    """
    middle, half = (float(inside.max()) + float(inside.min())) / 2, float(np.ptp(inside)) / 2
    options = [
        _begin(replace(structure, stops=(middle - side * half, middle + side * half)), windows, noise)
        for side in _STOP_SIDES
    ]
    # A stop that is taken too far in leaves out a little motion; one too far out is motion that none explains.
    most = _STOPS_ALIKE * min(option.residual_m for option in options)
    good = [option for option in options if option.residual_m < most]
    # Where one further in explains no more the contact is out; with fewer samples a declared device has to do.
    bears_out = structure.design.known or len(good) > 1
    return good[:1] if bears_out and good[0].residual_m < _STOPS_BETTER * without else []


def _begin(structure: _Structure, windows: Sequence[LogWindow], noise: float) -> _Trial:
    """Return a structure with its best point from a few initial guesses."""
    levels = np.full(len(windows), _BEGIN_LEVEL * noise)
    turns = _MODE_TURNS if structure.resonant else (1.0,)
    late = structure.most_delay / MOST_DELAY
    delays = (0.0, _LATE_START * late) if structure.spread[0] > 2 * late else (0.0,)
    solutions = []
    for delay, turn in itertools.product(delays, turns):
        first = structure.middle.copy()
        first[0] += delay
        first[-3] += math.log(turn)
        solutions.append(structure.solve(first, windows, levels, _BEGIN_TRIES))
    point = min(solutions, key=lambda solution: solution.cost).point
    return _Trial(structure, point, max(structure.rms(point, windows)))


def _levels(trials: Sequence[_Trial], windows: Sequence[LogWindow], noise: float) -> FloatArray:
    """Return the noise of each window, m: the least residual, with as few independent samples as it has."""
    residuals_of_trials = [trial.structure.residuals(trial.point, windows) for trial in trials]
    levels = []
    for of_window in zip(*residuals_of_trials, strict=True):
        residual = min(of_window, key=_rms)
        levels.append(max(noise, _rms(residual)) * math.sqrt(samples_alike(residual)))
    return np.array(levels)


def _finish(
    trial: _Trial, windows: Sequence[LogWindow], levels: FloatArray, noise: float, scatter: float, seed: int
) -> PlantFit | None:
    """Refine with the residual as noise, and draw from the posterior; None of a resonance at an end of its range."""
    structure = trial.structure
    solution = structure.solve(trial.point, windows, levels, _REFINE_TRIES)
    point = solution.point
    values, vectors = np.linalg.eigh(solution.curvature)
    values = np.maximum(values, _LEAST_CURVATURE)
    random = np.random.default_rng(seed).standard_normal((_INTERVAL_DRAWS, point.size))
    low, high = structure.bounds
    samples = np.clip(point + (random / np.sqrt(values)) @ vectors.T, low + 1e-9, high - 1e-9)
    sample = samples[:_DRAWS]
    near = _NEAR_BOUND * (high - low)
    if structure.resonant and ((point > high - near) | (point < low + near))[-3:].any():
        return None
    # The evidence integrates over the posterior, to compare structures with different numbers of unknowns.
    volume = 0.5 * float(np.sum(np.log(values))) + float(np.sum(np.log(structure.spread)))
    odds = _RESONANCE_ODDS * structure.resonant + _STOP_ODDS * (structure.stops is not None)
    return PlantFit(
        best=structure.hypothesis(point),
        draws=tuple(map(structure.hypothesis, sample)),
        cost=solution.cost + volume + odds,
        misfit=min(structure.rms(point, windows)) / noise,
        scatter_m=scatter,
        delay_error=float(np.std(sample[:, 0])),
        at_end=bool(point[0] > high[0] - near[0]),
        resonance_hz=structure.resonance_hz(samples),
    )


def _rms(residual: FloatArray) -> float:
    return math.sqrt(float(np.mean(residual**2)))
