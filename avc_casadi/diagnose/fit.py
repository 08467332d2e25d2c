"""Device and hand from their response to the logged force: delay, hand, resonance and stops, with their uncertainty."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi._util.progress import Stages
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import LEAST_ALIKE, Log, Oscillation, samples_alike
from avc_casadi.diagnose.plant import Hypothesis, IntendedLaw
from avc_casadi.diagnose.priors import Grid
from avc_casadi.diagnose.structure import PlantStructure, root_mean_square, shaken_structure, structures_of
from avc_casadi.diagnose.windows import MOST_DELAY, LogWindow, windows_of

_DRAWS = 12
"""Draws from the posterior of each structure."""

_INTERVAL_DRAWS = 1000
"""Draws from which the interval of a resonance is read."""

_INTERVAL_ODDS_LN = 3.0
"""ln of the odds, 20 to 1, up to which a less likely structure has a say in that interval."""

_RESONANCE_ODDS = 12.0
"""ln of the odds against a resonance that is not declared."""
_STOP_ODDS = 8.0
"""ln of the odds against travel stops."""
_SHAKE_ODDS = 8.0
"""ln of the odds against a shaking from outside."""

_MODEL_ERROR = 5e-3
"""Share of the swing that no model explains."""

_BEGIN_LEVEL = 1.7
"""Residual, per noise, with which the first search weighs the prior."""

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

        return replace(
            self,
            best=in_ticks(self.best),
            draws=tuple(map(in_ticks, self.draws)),
            delay_error=self.delay_error / log.hold,
        )


@dataclass(frozen=True, eq=False)
class _Trial:
    """A structure with its best point and its residual in the worst window, root mean square, m."""

    structure: PlantStructure
    point: FloatArray
    residual_m: float


@dataclass(frozen=True, eq=False)
class FitTask:
    """A swing of a log to which device and hand are fitted."""

    log: Log
    swing: Oscillation
    law: FittedLaw
    seed: int
    """That of the draws."""
    stages: Stages

    def by_samples(self) -> FitTask:
        """Return the task on the grid of the samples, for a clock whose ticks are none of them."""
        first, last = self.log.rows[[self.swing.first, self.swing.last - 1]].tolist()
        return replace(self, log=self.log.by_samples(), swing=replace(self.swing, first=first, last=last + 1))


def fit_log(task: FitTask, design: IntendedLaw) -> tuple[Log, list[PlantFit]]:
    """Return device and hand in every structure, likeliest first, and the log that they are fitted to.

    Where ticks are missed, the force was held, or the law ran and the log lost it: what explains the motion better.
    """
    logs = [task.log]
    if task.log.missed_share:
        logs.append(task.log.with_force_between())
    fitted = []
    for log in logs:
        task = replace(task, log=log)
        fits = fit_plants(task, design)
        switch = task.law.switch
        if switch is not None and switch.by == "speed":
            fits = beside_friction(fits, task, design, switch.keep)
        fitted.append((log, fits))
    return min(fitted, key=lambda log_and_fits: log_and_fits[1][0].misfit)


def fit_plants(task: FitTask, design: IntendedLaw) -> list[PlantFit]:
    """Return device and hand in every structure, likeliest first; with a resonance or stops where nothing else fits.

    With a clock whose ticks are no samples the force is new after so many samples and one more: device and hand are
    fitted to the samples.
    """
    log, lag = task.log, task.law.lag
    if log.even:
        return _fits(task, design, Grid(log.period_s, 1.0), lag)
    fits = _fits(task.by_samples(), design, Grid(log.sample_time_s, log.hold), lag * log.hold)
    return [fit.in_ticks(log) for fit in fits]


def beside_friction(fits: Sequence[PlantFit], task: FitTask, design: IntendedLaw, kept: float) -> list[PlantFit]:
    """Return fits of a log whose force is switched by the speed, with the error that its friction gives the delay.

    What turns with the speed is friction, or a force that compensates it and comes late: the delay is as far off as it
    is in other structures, and with more or less friction, that leave about as little. A filter of the speed that
    keeps a share of it lags by share/(1 - share) ticks, which act as a delay: half of them may be either.
    """
    filter_lag = kept / (1 - kept)
    # Each friction is searched anew: a fit that begins at the declared friction's stays near it.
    all_fits = list(fits)
    friction_n = design.device.coulomb_friction_n
    for factor in _FRICTIONS if friction_n else ():
        device = design.device.model_copy(update={"coulomb_friction_n": factor * friction_n})
        all_fits += fit_plants(task, replace(design, device=device))
    most = _AS_LIKELY * min(fit.misfit for fit in all_fits)
    delays = [fit.best.delay for fit in all_fits if fit.misfit <= most]

    def error_of(fit: PlantFit) -> float:
        return max(fit.delay_error, 0.5 * filter_lag, *(abs(delay - fit.best.delay) for delay in delays))

    return [replace(fit, delay_error=error_of(fit)) for fit in fits]


def _fits(task: FitTask, design: IntendedLaw, grid: Grid, lag: float) -> list[PlantFit]:
    """Return device and hand in every structure, likeliest first, on the grid of a log; `lag` is in its periods."""
    log, swing, stages = task.log, task.swing, task.stages
    inside = log.position_m[swing.first : swing.last]
    scatter = math.hypot(log.encoder_m / math.sqrt(12), design.device.position_noise_rms_m)
    noise = math.hypot(scatter, _MODEL_ERROR * float(np.std(inside)))
    plain = structures_of(design, grid, lag, swing.frequency_hz, resonant=False)
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
        resonant = structures_of(design, grid, lag, swing.frequency_hz, resonant=True)
        trials += [_begin(structure, windows, noise) for structure in resonant]
    # A hand or a table may shake a stable loop steadily. A law that is not linear swings steadily by itself although
    # its linear part is stable, and the first harmonic of its force would be taken for such a shaking.
    if swing.kind == "limit cycle" and task.law.linear:
        stages.begin("a shaking from outside")
        trials.append(_begin(shaken_structure(design, grid, lag, swing.frequency_hz), windows, noise))
    refinement = _Refinement(windows, _levels(trials, windows, noise), noise, scatter, task.seed)
    fits = []
    for trial in trials:
        stages.begin("errors of hand and delay")
        fit = refinement.of(trial)
        if fit is not None:
            fits.append(fit)
    return _with_alternatives(sorted(fits, key=lambda fit: fit.cost))


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
    structure: PlantStructure, inside: FloatArray, windows: Sequence[LogWindow], noise: float, without: float
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


def _begin(structure: PlantStructure, windows: Sequence[LogWindow], noise: float) -> _Trial:
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
        residual = min(of_window, key=root_mean_square)
        levels.append(max(noise, root_mean_square(residual)) * math.sqrt(samples_alike(residual)))
    return np.array(levels)


@dataclass(frozen=True, eq=False)
class _Refinement:
    """How the trials of a log are refined: with what they leave as the noise of each window."""

    windows: Sequence[LogWindow]
    levels: FloatArray
    """Noise of each window, m."""
    noise_m: float
    """Noise of the position, m, root mean square: of encoder, sensor and model."""
    scatter_m: float
    """The part of it that a reading has."""
    seed: int
    """That of the draws."""

    def of(self, trial: _Trial) -> PlantFit | None:
        """Refine a trial, and draw from its posterior; None of a resonance at an end of its range."""
        structure = trial.structure
        solution = structure.solve(trial.point, self.windows, self.levels, _REFINE_TRIES)
        point = solution.point
        values, vectors = np.linalg.eigh(solution.curvature)
        values = np.maximum(values, _LEAST_CURVATURE)
        random = np.random.default_rng(self.seed).standard_normal((_INTERVAL_DRAWS, point.size))
        low, high = structure.bounds
        samples = np.clip(point + (random / np.sqrt(values)) @ vectors.T, low + 1e-9, high - 1e-9)
        sample = samples[:_DRAWS]
        near = _NEAR_BOUND * (high - low)
        if structure.resonant and ((point > high - near) | (point < low + near))[-3:].any():
            return None
        # The evidence integrates over the posterior, to compare structures with different numbers of unknowns.
        volume = 0.5 * float(np.sum(np.log(values))) + float(np.sum(np.log(structure.spread)))
        best = structure.hypothesis(point)
        odds = _RESONANCE_ODDS * structure.resonant + _STOP_ODDS * (best.stops is not None)
        odds += _SHAKE_ODDS * (best.shake_hz is not None)
        return PlantFit(
            best=best,
            draws=tuple(map(structure.hypothesis, sample)),
            cost=solution.cost + volume + odds,
            misfit=min(structure.rms(point, self.windows)) / self.noise_m,
            scatter_m=self.scatter_m,
            delay_error=float(np.std(sample[:, 0])),
            at_end=bool(point[0] > high[0] - near[0]),
            resonance_hz=structure.resonance_hz(samples),
        )
