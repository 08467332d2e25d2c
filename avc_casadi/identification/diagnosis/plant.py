"""Identification of device and hand from their response to the force: delay, hand and resonance, with uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, device_as
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.noise_floor import LONGEST_DELAY, Level, Window, rms_of, windows_of
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation
from avc_casadi.model.hands import Hand, no_hand
from avc_casadi.model.sampled_plant import SampledPlant, sampled_plant

# Below a third of the oscillation frequency the motion is the hand's own; within these frequencies, and below half of
# it.
_SLOW_HZ = (2.5, 40.0)
_SHORTEST_DELAY = 0.002
# ln of the prior odds against an undeclared resonance, for each of its three parameters.
_ODDS = 4.0
# Initial guesses: frequency of a resonance over that of the oscillation, and additional delay, samples.
_TRIED = (0.75, 0.95, 1.2, 1.6)
_LATER = 2.5
_REWEIGHED = 2
# A mode that is damped more is no resonance, and a slower one no undeclared structure but a hand.
_MOST_DAMPED, _SLOWEST_HZ = 0.15, 25.0
# Range of a delay about the declared one where it may be the cause, samples.
_LATE = 4.0
# Share of the search range from its end within which a value counts as not found.
_AT_END = 1e-3
# Smaller numbers only slow the arithmetic.
_NOTHING = 1e-60
# Prior spread of ln mass and damping of a free device: of a declared one, of an assumed one.
_DECLARED, _ASSUMED = [0.06, 0.5], [1.1, 1.1]
_MODE = ("ln_frequency", "ln_ratio", "share")


@dataclass(frozen=True, eq=False)
class Fit:
    """One structure fitted to a log.

    Attributes:
        held: whether a hand is on the device, as a mass or through a grip.
        mode: "none", "declared" or "found": source of its resonance.
        late: whether the delay was free to differ from the declared one.
        point: the estimate, in search coordinates.
        answer: the same as device and hand.
        draws: posterior draws.
        cost: minus the log evidence: half the sum of squares, with the prior, and `volume`.
        volume: logarithm of the posterior over the prior volume.
        misfit: residual of the window with the best fit, relative to encoder and noise.
        at_end: unknowns at the end of the search range: not found. A delay of 0 is found.
    """

    held: bool
    mode: str
    late: bool
    point: FloatArray
    answer: Hypothesis
    draws: tuple[Hypothesis, ...]
    cost: float
    volume: float
    misfit: float
    at_end: tuple[str, ...]


class Search:
    """One structure: its unknowns, their prior, and its residuals."""

    def __init__(
        self,
        windows: Sequence[Window],
        log: Log,
        declared: Declared,
        lag: int,
        held: bool,
        mode: str,
        late: bool,
        hertz: float,
        *,
        grip: bool = False,
    ) -> None:
        self.held, self.mode, self.late, self.grip = held, mode, late, grip
        self._hertz = hertz
        self._slow_hz = min(float(np.clip(hertz / 3, *_SLOW_HZ)), hertz / 2)
        # The first window is the end of the oscillation.
        self._count = len(windows)
        self._windows = {
            index: window for index, window in enumerate(windows) if held or index == 0 or not window.before
        }
        self._log, self._declared = log, declared
        self.names: list[str] = ["delay"]
        device = declared.device
        own = device.sample_time_s / log.ticks.period_s
        within, wide = declared.delay_prior()
        meant = (declared.longest_delay if late else within) * own - lag
        middle, spread = [max(meant, 0.0)], [_LATE if late else max(wide * own, wide)]
        if held:
            # The mass behind a grip hardly moves at the oscillation frequency.
            self.names += [*([] if grip else ["ln_mass"]), "ln_damping", "ln_stiffness"]
            centre, width = declared.grip_prior() if grip else declared.hand_prior()
            middle += centre.tolist()
            spread += width.tolist()
        if not (held and declared.known):
            self.names += ["ln_device_mass", "ln_device_damping"]
            middle += [0.0, 0.0]
            spread += _DECLARED if declared.known else _ASSUMED
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
        self._low[0], self._high[0] = _SHORTEST_DELAY, LONGEST_DELAY
        if mode == "found":
            self._low[-1], self._high[-1] = 0.1, 0.9
            self._high[-2] = math.log(_MOST_DAMPED)
            self._low[-3] = math.log(_SLOWEST_HZ)

    def answer(self, point: FloatArray) -> Hypothesis:
        """Return device and hand at a point."""
        value = dict(zip(self.names, point.tolist(), strict=True))
        device = self._declared.device
        changed: dict[str, object] = {
            "delay_samples": max(value["delay"], _SHORTEST_DELAY),
            "sample_time_s": self._log.ticks.period_s,
        }
        if "ln_device_mass" in value:
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
            mass = math.exp(value["ln_mass"]) if "ln_mass" in value else 0.0
            hand = Hand(mass, math.exp(value["ln_damping"]), math.exp(value["ln_stiffness"]))
        return Hypothesis(device_as(device, changed), hand)

    def left(self, point: FloatArray) -> dict[int, FloatArray]:
        """Return the residual of the measured position at a point, m, in the windows that this structure describes."""
        answer = self.answer(point)
        plant = sampled_plant(answer.device, answer.hand or no_hand())
        return {index: self._left_of(window, plant) for index, window in self._windows.items()}

    def _gaps(self, point: FloatArray, level: Level) -> dict[int, FloatArray]:
        """Return the normalised residuals, with the part beyond half a step of the encoder."""
        half = self._log.encoder_m / 2
        return {
            index: np.concatenate(
                [left / level.rms_m[index], np.maximum(np.abs(left) - half, 0.0) / level.beyond_m[index]]
            )
            for index, left in self.left(point).items()
        }

    def _left_of(self, window: Window, plant: SampledPlant) -> FloatArray:
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
        # Position before the force of its own sample acts: the response begins a sample later.
        forced = _filtered(matrix, new, row, poles, late) + _filtered(matrix, old, row, poles, later)
        rubs = self._declared.device.coulomb_friction_n
        if rubs:
            forced = forced + _filtered(matrix, new + old, row, poles, rubs * window.rub)
        # Free motion from any initial state, and slow motion of the hand.
        free = _free_motion(matrix, row, n)
        seconds = n * period
        orders = np.arange(int(2 * self._slow_hz * seconds) + 2)
        slow = np.cos(np.pi * np.outer(np.arange(n) + 0.5, orders) / n)
        columns = [free] if self.grip else [free, slow]
        if self.grip or not self.held:
            # A weight is an unlogged force, as is the slow motion of a hand behind a grip; the spring of a hand yields
            # to it at once.
            pushes = [np.ones(n), np.arange(n) / n, *(slow.T[1:] if self.grip else ())]
            columns.append(np.stack([_filtered(matrix, new + old, row, poles, push) for push in pushes], axis=1))
        basis = np.concatenate(columns, axis=1)[window.use]
        basis = basis / np.sqrt(np.mean(basis**2, axis=0) + 1e-300)
        basis[np.abs(basis) < _NOTHING] = 0.0
        rest = (window.position - forced)[window.use]
        upright, _ = np.linalg.qr(basis)
        return np.asarray(rest - upright @ (upright.T @ rest))

    def begin(self, noise: float) -> FloatArray:
        """Return the best point from a few initial guesses."""
        best, least = self._middle, math.inf
        even = Level.of({}, self._count, noise, 0.0)
        for delay in (self._middle[0], self._middle[0] + _LATER)[: 2 if self.late else 1]:
            for factor in _TRIED if self.mode == "found" else (1.0,):
                first = self._middle.copy()
                first[0] = delay
                if self.mode == "found":
                    first[self.names.index("ln_frequency")] = math.log(factor * self._hertz)
                solved = self._solve(first, even, 20)
                if solved.cost < least:
                    best, least = solved.x, float(solved.cost)
        # A sudden motion of the hand within a window spoils that window, not the evidence of the others.
        for _ in range(_REWEIGHED):
            best = self._solve(best, Level.of(self.left(best), self._count, noise, 0.0), 12).x
        return best

    def cost_before(self, point: FloatArray, level: Level) -> float:
        """Return the share of the cost of the windows before the oscillation."""
        gaps = self._gaps(point, level)
        return sum((float(0.5 * gap @ gap) for index, gap in gaps.items() if self._windows[index].before), 0.0)

    def finish(self, point: FloatArray, level: Level, noise: float, draws: int, seed: int) -> Fit:
        """Refine with the residual as the noise level, and draw from the posterior."""
        solved = self._solve(point, level, 12)
        curvature = solved.jac.T @ solved.jac
        values, vectors = np.linalg.eigh(curvature)
        random = np.random.default_rng(seed).standard_normal((draws, point.size))
        spread = (random / np.sqrt(np.maximum(values, 1e-6))) @ vectors.T
        some = np.clip(solved.x + spread, self._low + 1e-9, self._high - 1e-9)
        odds = 3 * _ODDS if self.mode == "found" else 0.0
        # The evidence integrates over the posterior, to compare structures with different numbers of unknowns.
        volume = 0.5 * float(np.sum(np.log(np.maximum(values, 1e-6)))) + float(np.sum(np.log(self._spread)))
        near = _AT_END * (self._high - self._low)
        ends = (solved.x > self._high - near) | ((solved.x < self._low + near) & (np.array(self.names) != "delay"))
        return Fit(
            at_end=tuple(name for name, there in zip(self.names, ends, strict=True) if there),
            held=self.held,
            mode=self.mode,
            late=self.late,
            point=solved.x,
            answer=self.answer(solved.x),
            draws=tuple(self.answer(each) for each in some),
            cost=float(solved.cost) + odds + volume,
            volume=volume,
            misfit=min(rms_of(left) for left in self.left(solved.x).values()) / noise,
        )

    def _solve(self, first: FloatArray, level: Level, evaluations: int) -> optimize.OptimizeResult:
        first = np.clip(first, self._low + 1e-6, self._high - 1e-6)

        def gap(point: FloatArray) -> FloatArray:
            return np.concatenate([*self._gaps(point, level).values(), (point - self._middle) / self._spread])

        return optimize.least_squares(
            gap,
            first,
            bounds=(self._low, self._high),
            x_scale=self._spread,
            diff_step=np.full(first.size, 1e-4),
            max_nfev=evaluations,
        )


def _free_motion(matrix: FloatArray, row: FloatArray, samples: int) -> FloatArray:
    """Return row A^n of every sample n, shape (samples, states): each doubling takes one product."""
    free, power = row[None, :], matrix
    while len(free) < samples:
        free, power = np.concatenate([free, free @ power]), power @ power
    return free[:samples]


def _filtered(
    matrix: FloatArray, push: FloatArray, row: FloatArray, poles: FloatArray, force: FloatArray
) -> FloatArray:
    """Return the response of a position to a force that is positive against it."""
    if not push.any():
        return np.zeros(force.size)
    markov, state = [0.0], push.copy()
    for _ in range(poles.size - 1):
        markov.append(float(row @ state))
        state = matrix @ state
    zeros = np.convolve(poles, markov)[: poles.size]
    return np.asarray(signal.lfilter(zeros, poles, force))


# No device follows a mass-spring-damper model more closely than this share of its motion.
_NEVER_BETTER = 5e-3
# A resonance is tried where the residual of rigid mechanics exceeds encoder and noise by this factor.
_UNEXPLAINED = 2.0


def fit_plants(log: Log, swing: TracedOscillation, declared: Declared, lag: int, draws: int, seed: int) -> list[Fit]:
    """Fit device and hand, held and released, with and without a resonance, likeliest first.

    Args:
        log: on its tick grid.
        swing: its oscillation.
        declared: prior knowledge.
        lag: samples of the declared delay that lie between position and logged force.
        draws: number of posterior draws of each.
        seed: of the random draws.
    """
    windows = windows_of(log, swing)
    swings = float(np.std(swing.fast_m[swing.first : swing.last]))
    noise = math.hypot(log.encoder_m / math.sqrt(12), declared.device.position_noise_rms_m, _NEVER_BETTER * swings)
    mode = "declared" if declared.device.resonance else "none"
    hertz = swing.found.frequency_hz
    # Possible deviations: the delay, a missing hand, both, or an undeclared resonance.
    structures = [(True, mode, True), (True, mode, False)]
    if declared.known:
        structures += [(False, mode, False), (False, mode, True)]
    searches = [Search(windows, log, declared, lag, *structure, hertz) for structure in structures]
    if declared.known:
        searches.append(Search(windows, log, declared, lag, True, mode, False, hertz, grip=True))
    points = [search.begin(noise) for search in searches]
    left = [search.left(point) for search, point in zip(searches, points, strict=True)]
    # A resonance may explain better what a grip explains.
    plain = [_most(one) for search, one in zip(searches, left, strict=True) if not search.grip]
    if mode == "none" and min(plain) > _UNEXPLAINED * noise:
        searches.append(Search(windows, log, declared, lag, True, "found", False, hertz))
        points.append(searches[-1].begin(noise))
        left.append(searches[-1].left(points[-1]))
    best = {index: min((one[index] for one in left if index in one), key=rms_of) for index in range(len(windows))}
    level = Level.of(best, len(windows), noise, log.encoder_m)
    fits = [search.finish(point, level, noise, draws, seed) for search, point in zip(searches, points, strict=True)]
    # A released device was held before: that part of the log is explained as well as by the best hand.
    hands = [(search, fit) for search, fit in zip(searches, fits, strict=True) if fit.held]
    before = min(search.cost_before(fit.point, level) for search, fit in hands)
    if any(window.before for window in windows):
        # Then that hand is part of the hypothesis, with its own unknowns.
        before += min(fit.volume for _, fit in hands)
    fits = [fit if fit.held else replace(fit, cost=fit.cost + before) for fit in fits]
    # A resonance at the end of the search range counts as not found.
    fits = [fit for fit in fits if fit.mode != "found" or not set(_MODE) & set(fit.at_end)]
    return sorted(fits, key=lambda fit: fit.cost)


def _most(left: Mapping[int, FloatArray]) -> float:
    return max(rms_of(one) for one in left.values())
