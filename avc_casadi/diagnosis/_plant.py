"""Device and hand as they answered the commanded force: delay, hand and resonance, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, signal

from avc_casadi.diagnosis._declared import Declared
from avc_casadi.diagnosis._log import Log
from avc_casadi.diagnosis._oscillation import Swing
from avc_casadi.loop import Hand, SampledPlant, no_hand, sampled_plant
from avc_casadi.problem import Device
from avc_casadi.support import BoolArray, FloatArray

_LONGEST_DELAY = 14.0
_WINDOW_S = 0.4
_CYCLES = 6.0
_LATER_CYCLES = 2.0
# Below a third of the oscillation, motion is the hand's own doing; within these frequencies.
_SLOW_HZ = (2.5, 40.0)
_SHORTEST_DELAY = 0.002
# What an encoder leaves over is no fresh noise in every sample; over few steps it is alike from cycle to cycle.
_ALIKE = 3.0
_FEW_STEPS = 14.0
# No device is a mass, a spring and a damper more closely than this share of its motion.
_NEVER_BETTER = 5e-3
# ln of the odds against a resonance that nobody declared, for each of its three numbers.
_ODDS = 4.0
# Where a search begins: frequencies of a resonance over that of the oscillation, and samples of more delay.
_TRIED = (0.75, 0.95, 1.2, 1.6)
_LATER = 2.5
_REWEIGHED = 2
# What is damped more than this is no resonance.
_MOST_DAMPED = 0.15
# A resonance is looked for where rigid mechanics leave so many times what encoder and noise do.
_UNEXPLAINED = 2.0
# How far, in samples, a delay may lie from the declared one: where it may be what is wrong, and where it is not.
_LATE, _PUNCTUAL = 4.0, 0.15
# Numbers that have died away further only make the arithmetic slow.
_NOTHING = 1e-60
_MODE = ("ln_frequency", "ln_ratio", "share")


@dataclass(frozen=True)
class Answer:
    """A device with the hand that holds it.

    Attributes:
        device: with its delay from the commanded force to the motion.
        hand: None let go.
    """

    device: Device
    hand: Hand | None

    def without_mode(self) -> Answer:
        """Return the same with rigid mechanics."""
        return Answer(_device(self.device, {"resonance": None}), self.hand)

    def delayed(self, samples: float) -> Answer:
        """Return the same with another delay."""
        return Answer(_device(self.device, {"delay_samples": max(samples, 0.0)}), self.hand)


@dataclass(frozen=True, eq=False)
class Fit:
    """One structure fitted to a log.

    Attributes:
        held: whether a hand holds the device.
        mode: "none", "declared" or "found": where its resonance comes from.
        late: whether the delay was free to be another than the declared one.
        point: the best, in the unknowns of the search.
        answer: the same as device and hand.
        draws: others that the log bears out as well.
        cost: minus the logarithm of the evidence: half the sum of squares, with what was known before, and `volume`.
        volume: logarithm of how much of what was thought possible the log leaves.
        misfit: residual of the window that it explains best, over what encoder and noise leave.
    """

    held: bool
    mode: str
    late: bool
    point: FloatArray
    answer: Answer
    draws: tuple[Answer, ...]
    cost: float
    volume: float
    misfit: float


@dataclass(frozen=True, eq=False)
class _Window:
    position: FloatArray
    past: FloatArray  # force, from `_LONGEST_DELAY` samples before
    rub: FloatArray  # sign of the velocity, smoothed
    use: BoolArray
    before: bool  # whether it lies before the oscillation, when a hand may still have held the device


def fit_plants(log: Log, swing: Swing, declared: Declared, lag: int, draws: int, seed: int) -> list[Fit]:
    """Fit device and hand, held and let go, with and without a resonance, likeliest first.

    Args:
        log: on its grid.
        swing: its oscillation.
        declared: what is known before.
        lag: samples of the declared delay that lie between position and logged force.
        draws: others to draw of each.
        seed: of the draws.
    """
    windows = _windows(log, swing)
    swings = float(np.std(swing.fast_m[swing.first : swing.last]))
    noise = math.hypot(log.encoder_m / math.sqrt(12), declared.device.position_noise_rms_m, _NEVER_BETTER * swings)
    mode = "declared" if declared.device.resonance else "none"
    hertz = swing.found.frequency_hz
    # One thing at a time is wrong: the delay, a hand that is not there, or a resonance that nobody declared.
    structures = [(True, mode, True), (True, mode, False)]
    if declared.known:
        structures.append((False, mode, False))
    searches = [_Search(windows, log, declared, lag, *structure, hertz) for structure in structures]
    points = [search.begin(noise) for search in searches]
    if mode == "none" and min(float(point[1].max()) for point in points) > _UNEXPLAINED * noise:
        searches.append(_Search(windows, log, declared, lag, True, "found", False, hertz))
        points.append(searches[-1].begin(noise))
    # What no structure explains of a window is noise to all of them.
    found = swing.found
    cycles = max(_WINDOW_S * found.frequency_hz, _CYCLES) if found.steps < _FEW_STEPS else 0.0
    unexplained = np.min([search.of_all(point[1]) for search, point in zip(searches, points, strict=True)], axis=0)
    level = np.maximum(noise, unexplained) * math.sqrt(_ALIKE + cycles)
    fits = [search.finish(point[0], level, noise, draws, seed) for search, point in zip(searches, points, strict=True)]
    # Whoever let go held the device before: that part of the log is as well explained as by the best hand.
    hands = [(search, fit) for search, fit in zip(searches, fits, strict=True) if fit.held]
    before = min(search.cost_before(fit.point, level) for search, fit in hands)
    if any(window.before for window in windows):
        # Then that hand is part of the explanation, with its own unknowns.
        before += min(fit.volume for _, fit in hands)
    fits = [fit if fit.held else replace(fit, cost=fit.cost + before) for fit in fits]
    return sorted(fits, key=lambda fit: fit.cost)


def _windows(log: Log, swing: Swing) -> list[_Window]:
    """Choose where to look: the end of the oscillation, its beginning, and the strongest motion before it if small."""
    period, found = log.ticks.period_s, swing.found
    hertz = found.frequency_hz
    size = int(min(max(_WINDOW_S, _CYCLES / hertz) / period, log.position_m.size - _LONGEST_DELAY - 2))
    # What lets go of the device does so before it swings.
    places = [swing.last - size, swing.first + round(_LATER_CYCLES / hertz / period)]
    if not found.steps > 12:
        power = np.convolve(swing.fast_m**2, np.ones(size), mode="valid")
        places.append(int(np.argmax(power)))
    lead = int(_LONGEST_DELAY) + 2
    chosen: list[int] = []
    for place in places:
        start = int(np.clip(place, lead, log.position_m.size - size))
        if all(abs(start - other) > size // 3 for other in chosen):
            chosen.append(start)
    smooth = signal.savgol_filter(log.position_m, 9, 2, deriv=1)
    least = 0.05 * max(log.encoder_m, 1e-9)
    rub = np.tanh(smooth / least)
    return [
        _Window(
            log.position_m[start : start + size] - log.position_m[start],
            log.force_n[start - lead : start + size],
            np.asarray(rub[start : start + size]),
            log.ran[start : start + size],
            start < swing.first,
        )
        for start in chosen
    ]


class _Search:
    """One structure: its unknowns, what is known of them before, and what it leaves of the log."""

    def __init__(
        self,
        windows: Sequence[_Window],
        log: Log,
        declared: Declared,
        lag: int,
        held: bool,
        mode: str,
        late: bool,
        hertz: float,
    ) -> None:
        self.held, self.mode, self.late = held, mode, late
        self._hertz = hertz
        self._slow_hz = float(np.clip(hertz / 3, *_SLOW_HZ))
        # The first window is the end of the oscillation.
        self._kept = np.array([held or index == 0 or not window.before for index, window in enumerate(windows)])
        self._windows = [window for window, kept in zip(windows, self._kept, strict=True) if kept]
        self._log, self._declared = log, declared
        self.names: list[str] = ["delay"]
        device = declared.device
        meant = declared.longest_delay * device.sample_time_s / log.ticks.period_s - lag
        middle, spread = [max(meant, 0.0)], [_LATE if late else _PUNCTUAL]
        if held:
            self.names += ["ln_mass", "ln_damping", "ln_stiffness"]
            centre, width = declared.hand_prior()
            middle += centre.tolist()
            spread += width.tolist()
        else:
            self.names += ["ln_device_mass", "ln_device_damping"]
            middle += [0.0, 0.0]
            spread += [0.06, 0.5]
        if mode == "declared":
            self.names.append("ln_frequency")
            middle.append(math.log(device.resonance.frequency_hz if device.resonance else 1.0))
            spread.append(0.05)
        elif mode == "found":
            self.names += _MODE
            middle += [math.log(max(hertz, 40.0)), math.log(0.03), 0.4]
            spread += [0.6, 0.6, 0.15]
        self._middle, self._spread = np.array(middle), np.array(spread)
        reach = np.where(self._spread > 0, 4 * self._spread, 1.0)
        self._low, self._high = self._middle - reach, self._middle + reach
        self._low[0], self._high[0] = _SHORTEST_DELAY, _LONGEST_DELAY
        if mode == "found":
            self._low[-1], self._high[-1] = 0.1, 0.9
            self._high[-2] = math.log(_MOST_DAMPED)

    def answer(self, point: FloatArray) -> Answer:
        """Return device and hand at a point."""
        value = dict(zip(self.names, point.tolist(), strict=True))
        device = self._declared.device
        changed: dict[str, object] = {
            "delay_samples": max(value["delay"], _SHORTEST_DELAY),
            "sample_time_s": self._log.ticks.period_s,
        }
        if not self.held:
            changed["mass_kg"] = device.mass_kg * math.exp(value["ln_device_mass"])
            changed["damping_ns_per_m"] = device.damping_ns_per_m * math.exp(value["ln_device_damping"])
        if self.mode == "declared":
            shape = {} if device.resonance is None else device.resonance.model_dump()
            changed["resonance"] = {**shape, "frequency_hz": math.exp(value["ln_frequency"])}
        elif self.mode == "found":
            changed["resonance"] = {
                "frequency_hz": math.exp(value["ln_frequency"]),
                "damping_ratio": min(math.exp(value["ln_ratio"]), 0.5),
                "mass_ratio": value["share"],
            }
        hand = None
        if self.held:
            hand = Hand(*(math.exp(value[name]) for name in ("ln_mass", "ln_damping", "ln_stiffness")))
        return Answer(_device(device, changed), hand)

    def left(self, point: FloatArray) -> FloatArray:
        """Return what a point leaves of the measured position, m."""
        answer = self.answer(point)
        plant = sampled_plant(answer.device, answer.hand or no_hand())
        return np.concatenate([self._left_of(window, plant) for window in self._windows])

    def _left_of(self, window: _Window, plant: SampledPlant) -> FloatArray:
        row, whole = plant.measured, int(plant.whole_delay[0])
        n = window.position.size
        lead = window.past.size - n
        period = self._log.ticks.period_s
        scale = np.array([period if name.endswith("_per_s") else 1.0 for name in plant.names], dtype=np.float64)
        matrix = plant.matrix[0, 0] * scale[:, None] / scale
        new, old = plant.new[0, 0] * scale, plant.old[0, 0] * scale
        poles = np.asarray(np.poly(matrix), dtype=np.float64)
        late = window.past[lead - whole : lead - whole + n]
        later = window.past[lead - whole - 1 : lead - whole - 1 + n]
        # Position before the force of its own sample acts: the answer begins a sample later.
        forced = _filtered(matrix, new, row, poles, late) + _filtered(matrix, old, row, poles, later)
        rubs = self._declared.device.coulomb_friction_n
        if rubs:
            forced = forced + _filtered(matrix, new + old, row, poles, rubs * window.rub)
        # Free motion from any state, and what the hand does slowly.
        free = np.empty((n, matrix.shape[0]))
        state = row.copy()
        for index in range(n):
            free[index] = state
            state = state @ matrix
        seconds = n * period
        orders = np.arange(int(2 * self._slow_hz * seconds) + 2)
        slow = np.cos(np.pi * np.outer(np.arange(n) + 0.5, orders) / n)
        columns = [free, slow]
        if not self.held:
            # A weight is a force that the log does not hold; a hand's spring gives in to it at once.
            pushes = (np.ones(n), np.arange(n) / n)
            columns.append(np.stack([_filtered(matrix, new + old, row, poles, push) for push in pushes], axis=1))
        basis = np.concatenate(columns, axis=1)[window.use]
        basis = basis / np.sqrt(np.mean(basis**2, axis=0) + 1e-300)
        basis[np.abs(basis) < _NOTHING] = 0.0
        rest = (window.position - forced)[window.use]
        upright, _ = np.linalg.qr(basis)
        return np.asarray(rest - upright @ (upright.T @ rest))

    def begin(self, noise: float) -> tuple[FloatArray, FloatArray]:
        """Return the best point from a few starts, and what it leaves of each window, root mean square."""
        best, least = self._middle, math.inf
        even = np.full(len(self._windows), noise)
        for delay in (self._middle[0], self._middle[0] + _LATER)[: 2 if self.late else 1]:
            for factor in _TRIED if self.mode == "found" else (1.0,):
                first = self._middle.copy()
                first[0] = delay
                if self.mode == "found":
                    first[self.names.index("ln_frequency")] = math.log(factor * self._hertz)
                solved = self._solve(first, even, 20)
                if solved.cost < least:
                    best, least = solved.x, float(solved.cost)
        # A hand that moves at once within a window spoils that window, and not what the others say.
        for _ in range(_REWEIGHED):
            best = self._solve(best, np.maximum(noise, self.of_windows(best)), 12).x
        return best, self.of_windows(best)

    def of_all(self, left: FloatArray) -> FloatArray:
        """Return what is left of every window, without bound of those that this structure says nothing of."""
        found = np.full(self._kept.size, np.inf)
        found[self._kept] = left
        return found

    def cost_before(self, point: FloatArray, level: FloatArray) -> float:
        """Return the share of the cost from before the oscillation."""
        rows = zip(self._windows, self.of_windows(point), level[self._kept], strict=True)
        return sum(
            (float(0.5 * np.count_nonzero(one.use) * (left / scale) ** 2) for one, left, scale in rows if one.before),
            0.0,
        )

    def of_windows(self, point: FloatArray) -> FloatArray:
        """Return what a point leaves of each window, root mean square."""
        ends = np.cumsum([np.count_nonzero(window.use) for window in self._windows])[:-1]
        return np.array([math.sqrt(float(np.mean(part**2))) for part in np.split(self.left(point), ends)])

    def finish(self, point: FloatArray, level: FloatArray, noise: float, draws: int, seed: int) -> Fit:
        """Polish at the level of what is not explained, and draw others that explain as much."""
        solved = self._solve(point, level[self._kept], 12)
        curvature = solved.jac.T @ solved.jac
        values, vectors = np.linalg.eigh(curvature)
        random = np.random.default_rng(seed).standard_normal((draws, point.size))
        spread = (random / np.sqrt(np.maximum(values, 1e-6))) @ vectors.T
        some = np.clip(solved.x + spread, self._low + 1e-9, self._high - 1e-9)
        odds = 3 * _ODDS if self.mode == "found" else 0.0
        # An integral over the spread of the unknowns weighs structures of several of them.
        volume = 0.5 * float(np.sum(np.log(np.maximum(values, 1e-6)))) + float(np.sum(np.log(self._spread)))
        return Fit(
            held=self.held,
            mode=self.mode,
            late=self.late,
            point=solved.x,
            answer=self.answer(solved.x),
            draws=tuple(self.answer(each) for each in some),
            cost=float(solved.cost) + odds + volume,
            volume=volume,
            misfit=float(self.of_windows(solved.x).min()) / noise,
        )

    def _solve(self, first: FloatArray, level: FloatArray, evaluations: int) -> optimize.OptimizeResult:
        first = np.clip(first, self._low + 1e-6, self._high - 1e-6)
        levels = np.repeat(level, [np.count_nonzero(window.use) for window in self._windows])

        def gap(point: FloatArray) -> FloatArray:
            return np.concatenate([self.left(point) / levels, (point - self._middle) / self._spread])

        return optimize.least_squares(
            gap,
            first,
            bounds=(self._low, self._high),
            x_scale=self._spread,
            diff_step=np.full(first.size, 1e-4),
            max_nfev=evaluations,
        )


def _device(device: Device, changed: Mapping[str, object]) -> Device:
    """Return a device with some keys changed, known exactly."""
    return Device.model_validate({**device.model_dump(exclude={"range"}), **changed})


def _filtered(
    matrix: FloatArray, push: FloatArray, row: FloatArray, poles: FloatArray, force: FloatArray
) -> FloatArray:
    """Return the answer of a position to a force that is positive against it."""
    if not push.any():
        return np.zeros(force.size)
    markov, state = [0.0], push.copy()
    for _ in range(poles.size - 1):
        markov.append(float(row @ state))
        state = matrix @ state
    zeros = np.convolve(poles, markov)[: poles.size]
    return np.asarray(signal.lfilter(zeros, poles, force))
