"""Device and hand from their response to the logged force: delay, hand, resonance and stops, with their uncertainty."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.diagnose.law import Law
from avc_casadi.diagnose.oscillation import LEAST_ALIKE, Log, Oscillation, samples_alike
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import Rendering, wall
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_ranges, no_hand
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Hands
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES

# Delays that are searched, samples; draws of each structure; ln odds against a resonance and against stops.
_LEAST_DELAY, _MOST_DELAY, _DRAWS, _RESONANCE_ODDS, _STOP_ODDS = 2e-3, 14.0, 12, 12.0, 8.0


@dataclass(frozen=True)
class Design:
    """What the loop was designed for: a device, whether it was declared or is assumed, and the hands."""

    device: Device
    known: bool
    hands: Hands

    @property
    def delay_samples(self) -> tuple[float, float]:
        """Range of the declared delay; an assumed one may be none or twice as long."""
        own = float(self.device.delay_samples)
        return self.device.range.delay_samples or ((own, own) if self.known else (0.0, 2 * own))

    def samples_a_tick(self, log: Log) -> float:
        """Return the samples of the device in a tick of a log, which may be longer."""
        ratio = log.period_s / self.device.sample_time_s
        return ratio if ratio > 1.3 else 1.0

    def latest(self, log: Log) -> float:
        """Return the longest declared delay in ticks of a log."""
        return self.delay_samples[1] / self.samples_a_tick(log)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A device, the hand on it or None, and the positions of travel stops."""

    device: Device
    hand: Hand | None
    stops: tuple[float, float] | None = None

    def vary(self, **values: object) -> Hypothesis:
        """Return the hypothesis with another value of its device; a delay below the least of a device is none."""
        if (delay := values.get("delay_samples")) is not None:
            values["delay_samples"] = delay if float(str(delay)) >= LEAST_DELAY_SAMPLES else 0.0
        whole = {**self.device.model_dump(exclude={"range"}), **values}
        return replace(self, device=Device.model_validate(whole))

    @property
    def delay(self) -> float:
        """Delay of the device, samples."""
        return float(self.device.delay_samples)


def growth(one: Hypothesis, law: Law, stiffness: float = 1.0, damping: float = 1.0) -> float:
    """Return the growth rate, 1/s, of the least damped mode of the loop of one rate, gains scaled."""
    period, late = one.device.sample_time_s, one.vary(delay_samples=one.delay + law.lag)
    body = Body.of(sampled_plant(late.device, one.hand or no_hand())).axes(0, 0)
    step = np.array([1 - law.keep, law.keep - 1, law.keep])
    force = np.array([stiffness * law.stiffness_n_per_m, 0, 0]) + damping * law.damping_ns_per_m / period * step
    return math.log(max(float(wall(body, Rendering(force, step)).radius), 1e-300)) / period


def stable(one: Hypothesis, law: Law, stiffness: float = 1.0, damping: float = 1.0) -> bool:
    """Return whether the loop decays."""
    return growth(one, law, stiffness, damping) < 0


@dataclass(frozen=True, eq=False)
class Fit:
    """One structure fitted to a log: best answer, draws about it, minus its log evidence, residual, reading errors."""

    best: Hypothesis
    draws: tuple[Hypothesis, ...]
    cost: float
    misfit: float
    scatter_m: float
    delay_error: float
    at_end: bool


@dataclass(frozen=True, eq=False)
class _Window:
    start: float
    position: FloatArray  # from the start
    past: FloatArray  # force, from the longest delay before
    rub: FloatArray  # sign of the velocity, smoothed
    use: BoolArray


@dataclass(frozen=True, eq=False)
class _Structure:
    """Unknowns of one structure with their prior, and its residuals."""

    design: Design
    period_s: float
    hand: bool
    resonant: bool
    names: tuple[str, ...]
    middle: FloatArray
    spread: FloatArray
    slow_hz: float
    stops: tuple[float, float] | None = None

    @property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the unknowns."""
        low, high = self.middle - 4 * self.spread, self.middle + 4 * self.spread
        low[0], high[0] = _LEAST_DELAY, _MOST_DELAY
        if self.resonant:
            low[-3:], high[-3:] = [math.log(25.0), math.log(2e-3), 0.1], [high[-3], math.log(0.15), 0.9]
        return low, high

    def answer(self, point: FloatArray) -> Hypothesis:
        """Return device and hand at a point."""
        value = dict(zip(self.names, point.tolist(), strict=True))
        device = self.design.device
        new: dict[str, object] = {"delay_samples": max(value["delay"], _LEAST_DELAY), "sample_time_s": self.period_s}
        if "device" in value:
            new["mass_kg"] = device.mass_kg * math.exp(value["device"])
            new["damping_ns_per_m"] = device.damping_ns_per_m * math.exp(value["drag"])
        if self.resonant:
            shape = math.exp(value["mode"]), min(math.exp(value["ratio"]), 0.5), value["share"]
            new["resonance"] = dict(zip(("frequency_hz", "damping_ratio", "mass_ratio"), shape, strict=True))
        hand = None
        if self.hand:
            hand = Hand(*(math.exp(value[key]) for key in ("mass", "damping", "stiffness")))
        return Hypothesis(device, hand, self.stops).vary(**new)

    def residual(self, point: FloatArray, window: _Window) -> FloatArray:
        """Return the residual of the position between stops."""
        one = self.answer(point)
        plant = sampled_plant(one.device, one.hand or no_hand())
        n, whole = window.position.size, int(plant.whole_delay[0])
        scale = np.array([self.period_s if name.endswith("_per_s") else 1.0 for name in plant.names])
        a = plant.matrix[0, 0] * scale[:, None] / scale
        new, old = plant.new[0, 0] * scale, plant.old[0, 0] * scale
        poles, row = np.asarray(np.poly(a)), plant.output_row

        def response(push: FloatArray, force: FloatArray) -> FloatArray:
            markov, state = [0.0], push.copy()
            for _ in range(poles.size - 1):
                markov.append(float(row @ state))
                state = a @ state
            return np.asarray(signal.lfilter(np.convolve(poles, markov)[: poles.size], poles, force, axis=0))

        lead = window.past.size - n
        forced = response(new, window.past[lead - whole :][:n]) + response(old, window.past[lead - whole - 1 :][:n])
        if self.design.device.coulomb_friction_n:
            forced = forced + response(new + old, self.design.device.coulomb_friction_n * window.rub)
        # Free motion from any state, the slow motion of the hand, and a weight.
        free, power = row[None, :], a
        while len(free) < n:
            free, power = np.concatenate([free, free @ power]), power @ power
        orders = np.arange(int(2 * self.slow_hz * n * self.period_s) + 2)
        slow = np.cos(np.pi * np.outer(np.arange(n) + 0.5, orders) / n)
        use, columns = window.use, [free[:n]]
        if self.stops is not None:
            # After each contact the motion goes on from any state; the contact itself is left out.
            between = np.abs(window.start + window.position - np.mean(self.stops)) <= np.ptp(self.stops) / 2
            use = use & between
            edges = np.flatnonzero(np.diff(np.concatenate([[0], between.astype(int), [0]])))
            columns = [np.zeros((n, free.shape[1])) for _ in edges[::2]]
            for block, begin, end in zip(columns, edges[::2], edges[1::2], strict=True):
                block[begin:end] = free[: end - begin]
        columns.append(slow)
        if not self.hand:
            pushes = np.ones(n), np.arange(n) / n
            columns.append(np.stack([response(new + old, push) for push in pushes], axis=1))
        basis = np.concatenate(columns, axis=1)[use]
        basis = np.where(np.abs(basis) < 1e-60, 0.0, basis)
        size = np.sqrt(np.mean(basis**2, axis=0))
        basis, rest = basis[:, size > 0] / size[size > 0], (window.position - forced)[use]
        upright, spare = np.linalg.qr(basis)[0], rest.size - basis.shape[1]
        if spare < basis.shape[1]:
            # Stops that leave hardly any motion explain all of it.
            return np.full(max(rest.size, 1), np.ptp(window.position))
        return np.asarray(rest - upright @ (upright.T @ rest)) * math.sqrt(rest.size / spare)

    def solve(
        self, first: FloatArray, windows: Sequence[_Window], levels: FloatArray, tries: int
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return the best point, the curvature there, and half the sum of squares with the prior."""

        def gap(point: FloatArray) -> FloatArray:
            residual = [self.residual(point, one) / level for one, level in zip(windows, levels, strict=True)]
            return np.concatenate([*residual, (point - self.middle) / self.spread])

        low, high = bounds = self.ends
        inner, step, size = np.clip(first, low + 1e-6, high - 1e-6), np.full(first.size, 1e-4), self.spread
        found = optimize.least_squares(gap, inner, bounds=bounds, x_scale=size, diff_step=step, max_nfev=tries)
        slope = np.asarray(found.jac)
        return np.asarray(found.x), slope.T @ slope, float(found.cost)


def _structures(design: Design, period_s: float, lag: float, hertz: float, *, resonant: bool) -> list[_Structure]:
    """Return the structures that may have made a log."""
    device, own = design.device, design.device.sample_time_s / period_s
    least, most = design.delay_samples
    wide = math.hypot(0.15, (most - least) / math.sqrt(12))
    punctual = (max((least + most) / 2 * own - lag, 0.0), max(wide * own, wide))
    late = (max(most * own - lag, 0.0), 4.0)
    box = np.log(np.maximum(hand_ranges(design.hands), device.metres_per_unit**2 * np.array([[1e-3], [0.1], [5.0]])))
    width = np.maximum((box[:, 1] - box[:, 0]) / 2, 0.4 if design.known else 1.1)
    hand = list(zip(("mass", "damping", "stiffness"), box.mean(axis=1), width, strict=True))
    free = [("device", 0.0, 0.06 if design.known else 2.0), ("drag", 0.0, 0.5 if design.known else 2.0)]
    mode = [("mode", math.log(max(hertz, 40.0)), 0.6), ("ratio", math.log(0.03), 0.6), ("share", 0.4, 0.15)]
    both = [*hand, *([] if design.known else free)]
    parts = [(True, punctual, both), (True, late, both), (False, punctual, free), (False, late, free)]
    parts = [(True, punctual, [*both, *mode])] if resonant else parts
    slow = min(float(np.clip(hertz / 3, 2.5, 40.0)), hertz / 2)
    found = []
    for hand_on, delay, unknowns in parts:
        names, middle, spread = zip(("delay", *delay), *unknowns, strict=True)
        unknown = names, np.array(middle), np.array(spread)
        found.append(_Structure(design, period_s, hand_on, resonant, *unknown, slow))
    return found


def _windows(log: Log, swing: Oscillation) -> list[_Window]:
    """Return the end of the oscillation and its beginning."""
    period, n, lead = log.period_s, log.position_m.size, int(_MOST_DELAY) + 2
    size = int(min(max(0.4, 6 / swing.frequency_hz) / period, 1500, n - lead))
    places = swing.last - size, swing.first + round(2 / swing.frequency_hz / period)
    last, first = (int(np.clip(place, lead, n - size)) for place in places)
    begins = [last, first] if abs(first - last) > size // 3 else [last]
    smooth = signal.savgol_filter(log.position_m, 5, 2, deriv=1)
    rub = np.tanh(smooth / max(0.05 * log.encoder_m, 1e-3 * float(np.std(smooth)), 1e-12))
    parts = [(start, slice(start, start + size)) for start in begins]
    x, force = log.position_m, log.force_n
    return [
        _Window(float(x[at]), x[part] - x[at], force[at - lead : at + size], rub[part], log.ran[part])
        for at, part in parts
    ]


def fit_plants(log: Log, swing: Oscillation, design: Design, lag: float, seed: int) -> list[Fit]:
    """Return device and hand in every structure, likeliest first; with a resonance or stops where nothing else fits."""
    period, hertz, part = log.period_s, swing.frequency_hz, log.position_m[swing.first : swing.last]
    scatter = math.hypot(log.encoder_m / math.sqrt(12), design.device.position_noise_rms_m)
    noise = math.hypot(scatter, 5e-3 * float(np.std(part)))
    plain, windows = _structures(design, period, lag, hertz, resonant=False), _windows(log, swing)
    trials = [_begin(one, windows, noise) for one in plain]
    least = min(residual for *_, residual in trials)
    # What the likeliest leaves is noise of the position where it is white, whether it is declared or not.
    one, point, _ = min(trials, key=lambda each: each[-1])
    rest = np.concatenate([one.residual(point, window) for window in windows])
    if rest.size > 200 and samples_alike(rest) <= LEAST_ALIKE:
        scatter, noise = max(scatter, least), max(noise, least)
    # Behind stops the acceleration is of a force that is not in the log.
    if least > 2 * noise and swing.steps > 14:
        middle, half = (float(part.max()) + float(part.min())) / 2, float(np.ptp(part)) / 2
        for one in plain:
            ends = [(middle - side * half, middle + side * half) for side in (0.96, 0.9, 0.84, 0.78, 0.72, 0.66, 0.6)]
            options = [_begin(replace(one, stops=stops), windows, noise) for stops in ends]
            # A stop that is taken too far in leaves out a little motion; one too far out is motion that none explains.
            most = 1.3 * min(residual for *_, residual in options)
            with_stops = [option for option in options if option[-1] < most]
            # Where one further in explains no more the contact is out; with fewer samples a declared device has to do.
            trials += with_stops[:1] if (design.known or with_stops[1:]) and with_stops[0][-1] < 0.5 * least else []
    if design.device.resonance is None and min(residual for *_, residual in trials) > 2 * noise:
        resonant = _structures(design, period, lag, hertz, resonant=True)
        trials += [_begin(one, windows, noise) for one in resonant]
    best = [min((one.residual(point, window) for one, point, _ in trials), key=_rms) for window in windows]
    levels = np.array([max(noise, _rms(residual)) * math.sqrt(samples_alike(residual)) for residual in best])
    fits = [_finish(one, windows, point, levels, noise, seed) for one, point, _ in trials]
    return sorted((replace(fit, scatter_m=scatter) for fit in fits if fit is not None), key=lambda fit: fit.cost)


def _begin(one: _Structure, windows: Sequence[_Window], noise: float) -> tuple[_Structure, FloatArray, float]:
    """Return a structure with its best point from a few initial guesses, and its residual."""
    firsts, level = [], np.full(len(windows), 1.7 * noise)
    turns = (0.75, 0.95, 1.2, 1.6) if one.resonant else (1.0,)
    for delay, turn in itertools.product((0.0, 2.5) if one.spread[0] > 2 else (0.0,), turns):
        first = one.middle.copy()
        first[0] += delay
        first[-3] += math.log(turn)
        firsts.append(one.solve(first, windows, level, 15))
    point = min(firsts, key=lambda each: each[2])[0]
    return one, point, max(_rms(one.residual(point, window)) for window in windows)


def _finish(
    one: _Structure, windows: Sequence[_Window], point: FloatArray, levels: FloatArray, noise: float, seed: int
) -> Fit | None:
    """Refine with the residual as noise, and draw from the posterior; None of a resonance at an end of its range."""
    point, curvature, cost = one.solve(point, windows, levels, 12)
    values, vectors = np.linalg.eigh(curvature)
    random = np.random.default_rng(seed).standard_normal((_DRAWS, point.size))
    sample = point + (random / np.sqrt(np.maximum(values, 1e-6))) @ vectors.T
    low, high = one.ends
    sample = np.clip(sample, low + 1e-9, high - 1e-9)
    # The evidence integrates over the posterior, to compare structures with different numbers of unknowns.
    volume = 0.5 * float(np.sum(np.log(np.maximum(values, 1e-6)))) + float(np.sum(np.log(one.spread)))
    near, odds = 1e-3 * (high - low), _RESONANCE_ODDS * one.resonant + _STOP_ODDS * (one.stops is not None)
    if one.resonant and ((point > high - near) | (point < low + near))[-3:].any():
        return None
    draws, misfit = tuple(map(one.answer, sample)), min(_rms(one.residual(point, window)) for window in windows) / noise
    at_end = bool(point[0] > high[0] - near[0])
    return Fit(one.answer(point), draws, cost + volume + odds, misfit, 0.0, float(np.std(sample[:, 0])), at_end)


def _rms(residual: FloatArray) -> float:
    return math.sqrt(float(np.mean(residual**2)))
