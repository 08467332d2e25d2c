"""The ladder: rigid device and friction, then amplifier, resonance and spring, each by its evidence in the log."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.identification.fit import (
    FIRST_RATE_PER_S,
    WORTH,
    Fit,
    Trial,
    Window,
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
from avc_casadi.identification.log import Record
from avc_casadi.identification.predictor import Observer, Predictor, linear_steps, taps_of
from avc_casadi.identification.regression import Start
from avc_casadi.identification.terms import (
    FRICTION,
    HIGHEST_RESONANCE,
    LOOP_RATIO,
    MASS_RATIO,
    OFFSET,
    RUNGS,
    Structure,
)


@dataclass(frozen=True, eq=False)
class Response:
    """Velocity of the measured position over commanded force."""

    frequency_hz: FloatArray
    velocity_per_force: ComplexArray
    coherence: FloatArray
    power: FloatArray

    @property
    def excites(self) -> BoolArray:
        """Whether the force excites the device, shape (frequencies,)."""
        return np.asarray(self.power > 1e-4)

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Lowest and highest coherent frequency, or None."""
        some = self.frequency_hz[(self.coherence > 0.6) & self.excites]
        return (float(some[0]), float(some[-1])) if some.size >= 3 else None


def frequency_response(records: Sequence[Record]) -> Response:
    """Return the response by Welch averaging over all records."""
    period = records[0].sample_time_s
    shortest = min(record.position_m.size for record in records)
    length = int(min(1 / period, shortest // 4))  # of a second
    sums: list[ComplexArray] = []
    for record in records:
        velocity = np.diff(record.position_m, prepend=record.position_m[0]) / period
        weight = record.position_m.size
        across = signal.csd(record.force_n, velocity, fs=1 / period, nperseg=length)[1]
        powers = [signal.welch(values, fs=1 / period, nperseg=length)[1] for values in (record.force_n, velocity)]
        sums.append(weight * np.array([across, *powers]))
    cross, force, velocity_power = np.sum(sums, axis=0)
    frequency = np.asarray(np.fft.rfftfreq(length, period), dtype=np.float64)
    tiny = 1e-300
    return Response(
        frequency[1:],
        (cross / (force + tiny))[1:],
        (np.abs(cross) ** 2 / (force.real * velocity_power.real + tiny))[1:],
        (force.real / (force.real.max() + tiny))[1:],
    )


def model_response(
    values: Mapping[str, float], structure: Structure, sample_time_s: float, frequency_hz: FloatArray
) -> ComplexArray:
    """Return the response of a model without its dry friction."""
    (step,) = linear_steps([values], structure, sample_time_s, taps_of(values), parts=0)
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    forces = step.force @ np.stack([z**-tap for tap in step.taps])
    identity = np.eye(step.matrix.shape[0])
    states = np.linalg.solve(z[:, None, None] * identity - step.matrix, forces.T[..., None])[..., 0]
    return np.asarray(states[:, step.output] * (1 - 1 / z) / sample_time_s)


def likely_resonances(
    response: Response, values: Mapping[str, float], structure: Structure, sample_time_s: float
) -> list[tuple[float, dict[str, float]]]:
    """Return the resonances that would explain the response best, up to a factor and a delay: misfit, and start."""
    use = (response.coherence > 0.3) & (response.frequency_hz > 5.0) & response.excites
    if use.sum() < 10:
        return []
    frequency, data = response.frequency_hz[use], response.velocity_per_force[use]
    weight = response.coherence[use] / np.maximum(1 - response.coherence[use], 0.1) / frequency
    root = np.sqrt(weight / weight.sum())
    # The model without resonance has put part of its lag into the delay.
    turns = sample_time_s * np.arange(-values["delay_samples"], 1.01, 0.25)

    def gap(point: FloatArray) -> tuple[FloatArray, dict[str, float]]:
        """Return the misfit at logarithms of frequency and damping ratio and the logit of the mass ratio."""
        mode = (math.exp(point[0]), math.exp(point[1]), 1 / (1 + math.exp(-point[2])))
        start = dict(zip(RUNGS["resonance"], mode, strict=True))
        ratio = data / model_response({**values, **start}, structure, sample_time_s, frequency)
        factor = float(np.exp(np.average(np.log(np.abs(ratio)), weights=weight)))
        phases = np.angle(ratio * np.exp(2j * np.pi * frequency * turns[:, None]))
        at = int(np.argmin(np.sum(weight * phases**2, axis=1)))
        start["mass_kg"] = values["mass_kg"] / factor
        start["delay_samples"] = max(values["delay_samples"] + float(turns[at]) / sample_time_s, 0.0)
        return np.concatenate([root * np.log(np.abs(ratio) / factor), root * phases[at]]), start

    def misfit(point: FloatArray) -> FloatArray:
        return gap(point)[0]

    top = min(HIGHEST_RESONANCE / sample_time_s, 1.3 * frequency[-1])
    grid = itertools.product(np.log(np.geomspace(15.0, top, 30)), [math.log(0.06)], (-1.7, -0.6, 0.4))
    points = sorted(map(np.array, grid), key=lambda point: float(np.sum(misfit(point) ** 2)))
    best = [points[0]]
    best += [point for point in points if abs(point[0] - points[0][0]) > 0.25][:1]
    ends = (math.log(10.0), math.log(2e-3), -4.0), (math.log(0.49 / sample_time_s), 0.0, 4.0)
    results = [optimize.least_squares(misfit, point, bounds=ends, max_nfev=8, loss="soft_l1") for point in best]
    return sorted(((float(one.cost), gap(one.x)[1]) for one in results), key=lambda one: one[0])


_ALIKE = 100.0
"""Collinearity beyond which the rest of the model has the same effect as a rung; an amplifier may have three times."""
# Half widths of coordinates beyond which a log does not tell a number.
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
# Usual shares of the mass beyond a resonance.
_SHARES = (0.1, 0.2, 0.35, 0.5, 0.7)


@dataclass
class Ladder:
    """The model of a log while it climbs."""

    predictor: Predictor
    window: Window
    response: Response
    start: Mapping[str, float]
    spring_start: Mapping[str, float]
    sides: Sequence[str]
    fit: Fit
    trials: dict[str, Trial] = field(default_factory=dict)
    rivals: dict[str, Fit] = field(default_factory=dict)
    half: FloatArray = field(default_factory=lambda: np.zeros(0))
    shares: tuple[float, float] | None = None

    @classmethod
    def climb(
        cls, predictor: Predictor, structure: Structure, start: Start, sides: Sequence[str], progress: Progress = SILENT
    ) -> Ladder:
        """Take the rungs that the log bears out, and find the intervals."""
        window = Window.of(predictor)
        first = Observer(max(FIRST_RATE_PER_S, slowest_observer(predictor)))
        values = {OFFSET: 0.0, **start.values}
        lowest = fine_fit(predictor, fit(predictor, structure, values, first, window, tolerance=1e-5), window)
        response = frequency_response(predictor.records)
        ladder = cls(predictor, window, response, values, start.spring_start, sides, lowest)
        ladder._try(("friction",))
        rest = [rung for rung in ("lag", "loop", "resonance", "spring") if rung not in structure.rungs]
        for step in range(3):
            progress.advance(step, 3, ", ".join(rest))
            best = ladder._try(rest)
            if best is None:
                break
            rest = [rung for rung in rest if rung != best and not {best, rung} <= {"lag", "loop"}]
        if "friction" not in ladder.fit.structure.rungs:
            ladder._try(("friction",))
        if "lag" in ladder.fit.structure.rungs:
            ladder._loop_in_place_of_a_lag()
        ladder.fit = fine_fit(predictor, ladder.fit, window, steps=30, tolerance=1e-10)
        ladder._prune()
        ladder._intervals()
        return ladder

    def _try(self, rungs: Sequence[str]) -> str | None:
        """Try rungs; take the best of those that the evidence supports, and of equals the simplest."""
        good: dict[str, Fit] = {}
        for rung in rungs:
            found = self._best(rung)
            if found is None:
                self.trials[rung] = Trial(rung, False, 0.0, 0.0, "no sign of it")
                continue
            trial = compare(self.fit, found, rung)
            why = self._doubt(found, rung) if trial.taken else ""
            self.trials[rung] = replace(trial, taken=trial.taken and not why, why=why)
            if self.trials[rung].taken:
                good[rung] = found
            else:
                self.rivals[rung] = found
        if not good:
            return None
        least = min(found.rms_m for found in good.values())
        taken = min(
            (rung for rung in good if good[rung].rms_m <= (1 + WORTH) * least), key=lambda rung: good[rung].search.size
        )
        for rung in good.keys() - {taken}:
            self.trials[rung] = replace(self.trials[rung], taken=False, why=f"{taken} explains more")
        self.rivals.pop(taken, None)
        self.fit = good[taken]
        return taken

    def _best(self, rung: str) -> Fit | None:
        """Return the best fit with one more rung, from each of its starts."""
        # A simpler model that misses much has an observer too fast for a search from a distant start.
        slow = min(self.fit.observer.rate_per_s, FIRST_RATE_PER_S)
        starts = list(self._starts(rung))
        if rung in {"lag", "loop"}:
            # One Gauss-Newton step from the best of them says whether any is worth a search.
            firsts = [
                evaluate(self.predictor, structure, structure.start(start), self.fit.observer, self.window)
                for structure, start in starts
            ]
            first = min(firsts, key=lambda one: one.rms_m)
            starts = [starts[firsts.index(first)]]
            if compare(self.fit, first, rung).standard_errors < 1:
                return None
        rough = [coarse_fit(self.predictor, structure, start, slow) for structure, start in starts]
        least = min((one.rms_m for one in rough), default=0.0)
        found = [fine_fit(self.predictor, one, self.window) for one in rough if one.rms_m <= 1.05 * least]
        best = min(found, key=lambda one: one.rms_m, default=None)
        if best is not None and rung == "resonance" and collinearity(best) > _ALIKE:
            return self._with_share(best, float(np.clip(best.values[MASS_RATIO], _SHARES[0], _SHARES[-1])))
        return best

    def _loop_in_place_of_a_lag(self) -> None:
        """Take a current loop where it does better than a lag, from one that is the same lag but for its delay."""
        values, period = self.fit.values, self.predictor.sample_time_s
        lag_hz = values["amplifier_bandwidth_hz"]
        start = {**values, "amplifier_bandwidth_hz": 2.618 * lag_hz, LOOP_RATIO: 1.5}
        start["delay_samples"] = max(values["delay_samples"] - 1 / (2 * np.pi * 6.854 * lag_hz * period), 0.0)
        structure = self.fit.structure.without("lag").with_rung("loop")
        loop = fit(self.predictor, structure, start, self.fit.observer, self.window)
        trial = compare(self.fit, loop, "loop")
        if trial.taken and not self._too_fast(loop):
            self.trials["loop"], self.fit = trial, loop
            self.rivals.pop("loop", None)
        else:
            self.rivals["loop"] = loop

    def _with_share(self, start: Fit, share: float) -> Fit:
        """Return a fit with its mass ratio fixed: with the encoder at the handle a log hardly changes with it."""
        structure = replace(start.structure, fixed={**start.structure.fixed, MASS_RATIO: share})
        return fit(self.predictor, structure, start.values, start.observer, self.window, steps=15, tolerance=1e-6)

    def _starts(self, rung: str) -> Iterator[tuple[Structure, dict[str, float]]]:
        values, period = self.fit.values, self.predictor.sample_time_s
        rich = self.fit.structure.with_rung(rung)
        if rung == "friction":
            likely = max(self.start[FRICTION], 0.02 * rich.units[FRICTION])
            # In a log dominated by friction a model without it is far off: the first start is nearer.
            for near in ({}, {key: self.start[key] for key in values if key in self.start}):
                yield rich, {**values, **near, FRICTION: likely}
        elif rung in {"lag", "loop"}:
            ratios = (0.7, 1.4) if rung == "loop" else (values[LOOP_RATIO],)
            for rate, ratio in itertools.product((0.8 / period, 0.3 / period, 0.1 / period), ratios):
                lagging = {**values, "amplifier_bandwidth_hz": max(rate, 1.0), LOOP_RATIO: ratio}
                late = late_samples(lagging, rich.order, period)
                yield rich, {**lagging, "delay_samples": max(values["delay_samples"] - late, 0.0)}
        elif rung == "resonance":
            if self.fit.observer.rate_per_s > 2 * FIRST_RATE_PER_S:
                values = coarse_fit(self.predictor, self.fit.structure, values, FIRST_RATE_PER_S).values
            found = []
            for side in self.sides:
                structure = replace(rich, encoder_at="handle" if side == "handle" else "motor")
                for cost, likely_mode in likely_resonances(self.response, values, structure, period):
                    found.append((cost, structure, {**values, **likely_mode}))
            found.sort(key=lambda one: one[0])
            yield from (one[1:] for one in found[:2] if one[0] < 3 * found[0][0])
        else:
            yield rich, {**values, **self.spring_start}

    def _doubt(self, rich: Fit, rung: str) -> str:
        """Return why a rung that betters the prediction is not told all the same, if it is not."""
        values, period, band = rich.values, self.predictor.sample_time_s, self.response.band_hz
        if rung == "resonance":
            if values["resonance.frequency_hz"] > min(HIGHEST_RESONANCE / period, 1.3 * band[1] if band else 0.0):
                return "beyond the frequencies that the log excites"
            if values["resonance.damping_ratio"] > 1.9:  # two real poles, which any small misfit has
                return "damped like no mode"
        if rung in {"lag", "loop"} and self._too_fast(rich):
            return "so fast that it is a shorter delay at this sample rate"
        if collinearity(rich) > _ALIKE * (3 if rung in {"lag", "loop"} else 1):
            return "the rest of the model has the same effect"
        return ""

    def _too_fast(self, rich: Fit) -> bool:
        """Return whether a lag is a delay; beside a resonance dry friction looks like a lag, as a scattered clock."""
        fastest = 0.6 if rich.structure.present("resonance.frequency_hz") else 1.5
        if any(record.scatter for record in self.predictor.records):
            fastest = 0.2
        return rich.values["amplifier_bandwidth_hz"] * self.predictor.sample_time_s > fastest

    def _without(self, rung: str) -> Fit:
        simple = self.fit.structure.without(rung)
        return fit(self.predictor, simple, self.fit.values, self.fit.observer, self.window, steps=15, tolerance=1e-6)

    def _drop(self, rung: str, without: Fit, trial: Trial) -> None:
        self.rivals[rung], self.trials[rung] = self.fit, trial
        self.fit = fine_fit(self.predictor, without, self.window, steps=30, tolerance=1e-10)

    def _prune(self) -> None:
        """Drop rungs that the whole model no longer bears out."""
        for rung in ("spring", "loop", "lag", "resonance", "friction"):
            if rung in self.fit.structure.rungs:
                without = self._without(rung)
                trial = compare(without, self.fit, rung)
                self.trials[rung] = trial
                if not trial.taken:
                    self._drop(rung, without, replace(trial, why="not borne out beside the rest"))

    def _intervals(self) -> None:
        """Find the intervals; a rung too vague for a model is dropped, and the rest is fitted again."""
        while True:
            self.half = half_widths(self.predictor, self.fit, self.window, self.rivals)
            if MASS_RATIO in self.fit.structure.fixed:
                self._other_shares()
            widths = dict(zip(self.fit.structure.names, self.half.tolist(), strict=True))
            wide = {name for name, half in widths.items() if half > WIDEST.get(name, np.inf)}
            if MASS_RATIO in wide:
                self.fit = self._with_share(self.fit, float(np.clip(self.fit.values[MASS_RATIO], 0.1, 0.7)))
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
        key = RUNGS[rung][0]
        if rung == "spring":
            return key in wide or self.fit.search[self.fit.structure.names.index(key)] <= widths[key]
        return bool(wide & ({key} if rung == "resonance" else {*RUNGS[rung]})) or (
            rung != "resonance" and self._too_fast(self.fit)
        )

    def _other_shares(self) -> None:
        """Widen the intervals to every usual mass ratio that predicts the log as well."""
        share = self.fit.values[MASS_RATIO]
        good = [(share, self.fit)]
        for side in ([one for one in _SHARES[::-1] if one < share], [one for one in _SHARES if one > share]):
            for at in side:
                other = self._with_share(self.fit, at)
                if compare(other, self.fit, "resonance").taken:
                    break
                good.append((at, other))
        self.half = self.half + np.max([np.abs(found.search - self.fit.search) for _, found in good], axis=0)
        self.shares = min(at for at, _ in good), max(at for at, _ in good)
