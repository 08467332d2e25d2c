"""The ladder: rigid device and friction, then amplifier, resonance and spring, each by its evidence in the log."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.identification.fit import (
    FIRST_RATE_PER_S,
    WORTH,
    Fit,
    FitTrial,
    Partition,
    coarse_fit,
    collinearity,
    compare,
    evaluate,
    fine_fit,
    fit,
    half_widths,
    late_samples,
    slowest_observer,
)
from avc_casadi.identification.predictor import Predictor, SteadyObserver
from avc_casadi.identification.regression import Start
from avc_casadi.identification.response import (
    BEYOND_BAND,
    ResonanceStart,
    Response,
    frequency_response,
    likely_resonances,
)
from avc_casadi.identification.terms import (
    FRICTION,
    HIGHEST_RESONANCE,
    LOOP_RATIO,
    MASS_RATIO,
    OFFSET,
    RUNGS,
    ModelStructure,
)

_ALIKE = 100.0
"""Collinearity beyond which the rest of the model has the same effect as a rung; ..."""
_ALIKE_AMPLIFIER = 3 * _ALIKE
"""... an amplifier may have three times of it."""
WIDEST = {
    "mass_kg": 0.35,
    "damping_ns_per_m": 0.4,
    "delay_samples": 1.0,
    FRICTION: 0.4,
    "amplifier_bandwidth_hz": 0.5,
    LOOP_RATIO: 0.5,
    "resonance.frequency_hz": 0.15,
    "resonance.damping_ratio": 1.4,
    MASS_RATIO: 2.0,
    "stiffness_n_per_m": 0.4,
}
"""Half widths of search coordinates beyond which a log does not tell a number."""
_SHARES = (0.1, 0.2, 0.35, 0.5, 0.7)
"""Usual shares of the mass beyond a resonance."""
_AMPLIFIERS = {"lag", "loop"}
"""Rungs of which a model has one at most."""

_MOST_RUNGS = 3
"""Rungs beside friction that a model may have."""
# Most evaluations of a fit, and the share of the squared error by which a step must lower it for the search to go on:
# of the first rung, of a rung that is tried or dropped, and of the model as it is answered.
_FIRST_TOLERANCE = 1e-5
_REFIT_STEPS = 15
_REFIT_TOLERANCE = 1e-6
_FINAL_STEPS = 30
_FINAL_TOLERANCE = 1e-10
_NEARLY_BEST = 1.05
"""Coarse fits are refined whose error is up to so many times the least."""
_HOPELESS = 1
"""An amplifier is searched where its first step betters the held-out error by so many standard errors at least."""
_LIKELY_FRICTION = 0.02
"""Least friction of a start, in the unit of its coordinate."""
_START_RATES = (0.8, 0.3, 0.1)
"""Bandwidths of an amplifier from which its search starts, as shares of the sample rate."""
_LOWEST_START_RATE_HZ = 1.0
"""Lowest of these bandwidths."""
_START_LOOP_RATIOS = (0.7, 1.4)
"""Damping ratios of a current loop from which its search starts."""
_FAST_OBSERVER = 2
"""A model whose observer is faster than so many times the first rate is fitted again with a slow one."""
_MOST_RESONANCES = 2
"""Resonances from which a search starts, at most."""
_MUCH_WORSE = 3
"""A second resonance is tried where its misfit is less than so many times the best."""
_DAMPED_LIKE_NONE = 1.9
"""Damping ratio beyond which a mode is two real poles, which any small misfit has."""
_FASTEST_LAG = 1.5
"""Largest bandwidth of an amplifier that is told from a delay, as a share of the sample rate; ..."""
_FASTEST_LAG_BESIDE_RESONANCE = 0.6
"""... beside a resonance, where dry friction looks like a lag; ..."""
_FASTEST_LAG_OF_SCATTERED_CLOCK = 0.2
"""... and where the clock scatters, which looks like a lag too."""
_LAG_LIKE_RATIO = 1.5
"""Damping ratio z of a current loop that is nearly a lag: its poles are w (z - sqrt(z^2 - 1)), and a fast one."""
_LOOP_OVER_LAG = 2.618
"""Frequency w of that loop over its slow pole, which is the lag, ..."""
_FAST_POLE_OVER_LAG = 6.854
"""... and its fast pole over the slow one, which adds to the delay."""


@dataclass(frozen=True, eq=False)
class _StartPoint:
    """A structure, and values from which its search starts."""

    structure: ModelStructure
    values: dict[str, float]


@dataclass
class Ladder:
    """The model of a log while it climbs.

    `trials` and `rivals` are the rungs that were tried and the fits of those that were not taken; `half` is half the
    interval of each coordinate, shape (free,); `shares` is the range of a mass ratio that the log does not tell.
    """

    predictor: Predictor
    window: Partition
    response: Response
    start: Mapping[str, float]
    spring_start: Mapping[str, float]
    sides: Sequence[str]
    fit: Fit
    trials: dict[str, FitTrial] = field(default_factory=dict)
    rivals: dict[str, Fit] = field(default_factory=dict)
    half: FloatArray = field(default_factory=lambda: np.zeros(0))
    shares: tuple[float, float] | None = None

    @classmethod
    def climb(
        cls,
        predictor: Predictor,
        structure: ModelStructure,
        start: Start,
        sides: Sequence[str],
        progress: Progress = SILENT,
    ) -> Ladder:
        """Return the model of the records after it took every rung (a part such as friction) that the log bears out.

        It begins with the lowest `structure` from the values of `start`; `sides` are where the encoder may sit. The
        intervals follow.
        """
        window = Partition.of(predictor)
        first = SteadyObserver(max(FIRST_RATE_PER_S, slowest_observer(predictor)))
        values = {OFFSET: 0.0, **start.values}
        rough = fit(predictor, structure, values, first, window, tolerance=_FIRST_TOLERANCE)
        lowest = fine_fit(predictor, rough, window)
        response = frequency_response(predictor.records)
        ladder = cls(predictor, window, response, values, start.spring_start, sides, lowest)
        ladder._try(("friction",))
        rest = [rung for rung in ("lag", "loop", "resonance", "spring") if rung not in structure.rungs]
        for step in range(_MOST_RUNGS):
            progress.advance(step, _MOST_RUNGS, ", ".join(rest))
            best = ladder._try(rest)
            if best is None:
                break
            rest = [rung for rung in rest if rung != best and not {best, rung} <= _AMPLIFIERS]
        if "friction" not in ladder.fit.structure.rungs:
            ladder._try(("friction",))
        if "lag" in ladder.fit.structure.rungs:
            ladder._loop_in_place_of_a_lag()
        ladder.fit = fine_fit(predictor, ladder.fit, window, steps=_FINAL_STEPS, tolerance=_FINAL_TOLERANCE)
        ladder._prune()
        ladder._intervals()
        return ladder

    def _try(self, rungs: Sequence[str]) -> str | None:
        """Try rungs (parts of the model, such as a resonance); take the best that the evidence supports, or None.

        Of those that predict alike the one of the fewest parameters is taken; the others stay as rivals.
        """
        supported: dict[str, Fit] = {}
        for rung in rungs:
            rich = self._best(rung)
            if rich is None:
                self.trials[rung] = FitTrial(rung, False, 0.0, 0.0, "no sign of it")
                continue
            trial = compare(self.fit, rich, rung)
            doubt = self._doubt(rich, rung) if trial.taken else ""
            self.trials[rung] = replace(trial, taken=trial.taken and not doubt, why=doubt)
            if self.trials[rung].taken:
                supported[rung] = rich
            else:
                self.rivals[rung] = rich
        if not supported:
            return None
        least_m = min(rich.rms_m for rich in supported.values())
        equals = [rung for rung, rich in supported.items() if rich.rms_m <= (1 + WORTH) * least_m]
        taken = min(equals, key=lambda rung: supported[rung].search.size)
        for rung in supported.keys() - {taken}:
            self.trials[rung] = replace(self.trials[rung], taken=False, why=f"{taken} explains more")
        self.rivals.pop(taken, None)
        self.fit = supported[taken]
        return taken

    def _best(self, rung: str) -> Fit | None:
        """Return the best fit with one more rung (a part of the model) from each of its starts; None without a sign."""
        # A simpler model that misses much has an observer too fast for a search from a distant start.
        slow = min(self.fit.observer.rate_per_s, FIRST_RATE_PER_S)
        starts = list(self._starts(rung))
        if rung in _AMPLIFIERS:
            # One Gauss-Newton step from the best of them says whether any is worth a search.
            firsts = [self._evaluate(start) for start in starts]
            first = min(firsts, key=lambda candidate: candidate.rms_m)
            starts = [starts[firsts.index(first)]]
            if compare(self.fit, first, rung).standard_errors < _HOPELESS:
                return None
        rough = [coarse_fit(self.predictor, start.structure, start.values, slow) for start in starts]
        least_m = min((candidate.rms_m for candidate in rough), default=0.0)
        fine = [
            fine_fit(self.predictor, candidate, self.window)
            for candidate in rough
            if candidate.rms_m <= _NEARLY_BEST * least_m
        ]
        best = min(fine, key=lambda candidate: candidate.rms_m, default=None)
        if best is not None and rung == "resonance" and collinearity(best) > _ALIKE:
            return self._with_share(best, _usual_share(best))
        return best

    def _evaluate(self, start: _StartPoint) -> Fit:
        search = start.structure.start(start.values)
        return evaluate(self.predictor, start.structure, search, self.fit.observer, self.window)

    def _loop_in_place_of_a_lag(self) -> None:
        """Take a current loop of second order where it predicts better than a lag of first order, from a like one."""
        values, period_s = self.fit.values, self.predictor.sample_time_s
        lag_hz = values["amplifier_bandwidth_hz"]
        start = {**values, "amplifier_bandwidth_hz": _LOOP_OVER_LAG * lag_hz, LOOP_RATIO: _LAG_LIKE_RATIO}
        fast_pole_samples = 1 / (2 * np.pi * _FAST_POLE_OVER_LAG * lag_hz * period_s)
        start["delay_samples"] = max(values["delay_samples"] - fast_pole_samples, 0.0)
        structure = self.fit.structure.without("lag").with_rung("loop")
        loop = fit(self.predictor, structure, start, self.fit.observer, self.window)
        trial = compare(self.fit, loop, "loop")
        if trial.taken and not self._too_fast(loop):
            self.trials["loop"] = trial
            self.fit = loop
            self.rivals.pop("loop", None)
        else:
            self.rivals["loop"] = loop

    def _with_share(self, start: Fit, share: float) -> Fit:
        """Return a fit with its mass ratio fixed: with the encoder at the handle a log hardly changes with it."""
        structure = replace(start.structure, fixed={**start.structure.fixed, MASS_RATIO: share})
        return self._refit(structure, start)

    def _refit(self, structure: ModelStructure, start: Fit) -> Fit:
        """Return the fit of a structure from the values of another fit, under its observer, in few steps."""
        return fit(
            self.predictor,
            structure,
            start.values,
            start.observer,
            self.window,
            steps=_REFIT_STEPS,
            tolerance=_REFIT_TOLERANCE,
        )

    def _starts(self, rung: str) -> Iterator[_StartPoint]:
        """Yield the points from which the search for a rung starts."""
        structure = self.fit.structure.with_rung(rung)
        if rung == "friction":
            yield from self._friction_starts(structure)
        elif rung in _AMPLIFIERS:
            yield from self._amplifier_starts(structure)
        elif rung == "resonance":
            yield from self._resonance_starts(structure)
        else:
            yield _StartPoint(structure, {**self.fit.values, **self.spring_start})

    def _friction_starts(self, structure: ModelStructure) -> Iterator[_StartPoint]:
        values = self.fit.values
        likely_n = max(self.start[FRICTION], _LIKELY_FRICTION * structure.units[FRICTION])
        yield _StartPoint(structure, {**values, FRICTION: likely_n})
        # In a log dominated by friction a model without it is far off: the first start is nearer.
        first = {key: self.start[key] for key in values if key in self.start}
        yield _StartPoint(structure, {**values, **first, FRICTION: likely_n})

    def _amplifier_starts(self, structure: ModelStructure) -> Iterator[_StartPoint]:
        """Yield starts for an amplifier: some bandwidths and damping ratios, each with its lag taken from the delay."""
        values, period_s = self.fit.values, self.predictor.sample_time_s
        ratios = _START_LOOP_RATIOS if structure.order == 2 else (values[LOOP_RATIO],)
        for rate, ratio in itertools.product(_START_RATES, ratios):
            bandwidth_hz = max(rate / period_s, _LOWEST_START_RATE_HZ)
            lagging = {**values, "amplifier_bandwidth_hz": bandwidth_hz, LOOP_RATIO: ratio}
            # Its lag was in the delay.
            delay = max(values["delay_samples"] - late_samples(lagging, structure.order, period_s), 0.0)
            yield _StartPoint(structure, {**lagging, "delay_samples": delay})

    def _resonance_starts(self, structure: ModelStructure) -> Iterator[_StartPoint]:
        """Yield the likeliest resonances of the frequency response, with the encoder at the motor or the handle."""
        values, period_s = self.fit.values, self.predictor.sample_time_s
        if self.fit.observer.rate_per_s > _FAST_OBSERVER * FIRST_RATE_PER_S:
            values = coarse_fit(self.predictor, self.fit.structure, values, FIRST_RATE_PER_S).values
        likely: list[tuple[ModelStructure, ResonanceStart]] = []
        for side in self.sides:
            of_side = replace(structure, encoder_at="handle" if side == "handle" else "motor")
            likely += [(of_side, start) for start in likely_resonances(self.response, values, of_side, period_s)]
        likely.sort(key=lambda pair: pair[1].misfit)
        for of_side, start in likely[:_MOST_RESONANCES]:
            if start.misfit < _MUCH_WORSE * likely[0][1].misfit:
                yield _StartPoint(of_side, start.values)

    def _doubt(self, rich: Fit, rung: str) -> str:
        """Return why a rung that betters the prediction is not taken all the same; empty where it may be.

        A resonance beyond the band or damped like none, an amplifier like a delay, or what the rest of the model
        explains.
        """
        values, period_s = rich.values, self.predictor.sample_time_s
        if rung == "resonance":
            band_hz = self.response.band_hz
            highest_hz = BEYOND_BAND * band_hz[1] if band_hz else 0.0
            if values["resonance.frequency_hz"] > min(HIGHEST_RESONANCE / period_s, highest_hz):
                return "beyond the frequencies that the log excites"
            if values["resonance.damping_ratio"] > _DAMPED_LIKE_NONE:
                return "damped like no mode"
        if rung in _AMPLIFIERS and self._too_fast(rich):
            return "so fast that it is a shorter delay at this sample rate"
        if collinearity(rich) > (_ALIKE_AMPLIFIER if rung in _AMPLIFIERS else _ALIKE):
            return "the rest of the model has the same effect"
        return ""

    def _too_fast(self, rich: Fit) -> bool:
        """Return whether a lag is a delay; beside a resonance dry friction looks like a lag, as a scattered clock."""
        beside_resonance = rich.structure.present("resonance.frequency_hz")
        fastest = _FASTEST_LAG_BESIDE_RESONANCE if beside_resonance else _FASTEST_LAG
        if any(record.scatter for record in self.predictor.records):
            fastest = _FASTEST_LAG_OF_SCATTERED_CLOCK
        return rich.values["amplifier_bandwidth_hz"] * self.predictor.sample_time_s > fastest

    def _without(self, rung: str) -> Fit:
        return self._refit(self.fit.structure.without(rung), self.fit)

    def _drop(self, rung: str, without: Fit, trial: FitTrial) -> None:
        self.rivals[rung] = self.fit
        self.trials[rung] = trial
        self.fit = fine_fit(self.predictor, without, self.window, steps=_FINAL_STEPS, tolerance=_FINAL_TOLERANCE)

    def _prune(self) -> None:
        """Drop rungs (parts of the model) without which the whole model predicts as well."""
        for rung in ("spring", "loop", "lag", "resonance", "friction"):
            if rung in self.fit.structure.rungs:
                without = self._without(rung)
                trial = compare(without, self.fit, rung)
                self.trials[rung] = trial
                if not trial.taken:
                    self._drop(rung, without, replace(trial, why="not supported by the log, given the other terms"))

    def _intervals(self) -> None:
        """Find half the interval of each parameter; a part of the model whose own is too wide is dropped, then anew.

        A mass ratio that the log leaves open is fixed at a usual one.
        """
        while True:
            self.half = half_widths(self.predictor, self.fit, self.window, self.rivals)
            if MASS_RATIO in self.fit.structure.fixed:
                self._other_shares()
            widths = dict(zip(self.fit.structure.names, self.half.tolist(), strict=True))
            wide = {name for name, half in widths.items() if half > WIDEST.get(name, np.inf)}
            if MASS_RATIO in wide:
                self.fit = self._with_share(self.fit, _usual_share(self.fit))
                continue
            rungs = [rung for rung in ("spring", "loop", "lag", "resonance") if rung in self.fit.structure.rungs]
            vague = next((rung for rung in rungs if self._vague(rung, wide, widths)), None)
            if vague is None:
                return
            without = self._without(vague)
            self._drop(vague, without, replace(self.trials[vague], taken=False, why="too vague for a model"))
            if vague == "loop":
                self._try(("lag",))

    def _vague(self, rung: str, wide: set[str], widths: Mapping[str, float]) -> bool:
        """Return whether the interval of a rung is too wide for a model, or an amplifier a delay by now."""
        key = RUNGS[rung][0]
        if rung == "spring":
            return key in wide or self.fit.search[self.fit.structure.names.index(key)] <= widths[key]
        if rung == "resonance":
            return key in wide
        return bool(wide & {*RUNGS[rung]}) or self._too_fast(self.fit)

    def _other_shares(self) -> None:
        """Widen the intervals to every usual mass ratio that predicts the log as well."""
        share = self.fit.values[MASS_RATIO]
        fits = {share: self.fit}
        smaller = [usual for usual in reversed(_SHARES) if usual < share]
        larger = [usual for usual in _SHARES if usual > share]
        for direction in (smaller, larger):
            for usual in direction:
                rival = self._with_share(self.fit, usual)
                if compare(rival, self.fit, "resonance").taken:
                    break
                fits[usual] = rival
        self.half = self.half + np.max([np.abs(rival.search - self.fit.search) for rival in fits.values()], axis=0)
        self.shares = min(fits), max(fits)


def _usual_share(fit_of_log: Fit) -> float:
    """Return the mass ratio of a fit, within the usual ones."""
    return float(np.clip(fit_of_log.values[MASS_RATIO], _SHARES[0], _SHARES[-1]))
