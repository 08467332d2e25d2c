"""One structure of device and hand: its unknowns with their priors, its residuals in a log, and their least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from avc_casadi._util.arrays import BoolArray, FloatArray, Interval
from avc_casadi.diagnose.motion import SampledMotion
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
    shake_unknown,
)
from avc_casadi.diagnose.windows import MOST_DELAY, LogWindow
from avc_casadi.model.hands import Hand

_LEAST_DELAY = 2e-3
"""Shortest delay that is searched, ticks."""

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

_SEARCH_STEP = 1e-6
"""Step of an unknown for a derivative, per size or spread of the unknown, whichever is larger.

A longer step makes the curvature along a badly determined direction, 1e9 below that along the best one, too large.
"""

_INTERVAL_ENDS = (0.025, 0.975)
"""Shares of the posterior below the ends of that interval: 95 % are within."""


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """The end of a search."""

    point: FloatArray
    """Unknowns, shape (u,)."""
    curvature: FloatArray
    """J' J of the residuals with the prior, shape (u, u)."""
    cost: float
    """Half of the sum of squares with the prior."""


@dataclass(frozen=True, eq=False)
class PlantStructure:
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
    ) -> PlantStructure:
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
        shake_hz = math.exp(value["shake_frequency"]) if "shake_frequency" in value else None
        return Hypothesis(device, hand, self.stops, shake_hz).vary(**changed)

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
        hypothesis = self.hypothesis(point)
        motion = SampledMotion.of(hypothesis, self.period_s)
        return [self._residual(motion, window, hypothesis.shake_hz) for window in windows]

    def _residual(self, motion: SampledMotion, window: LogWindow, shake_hz: float | None) -> FloatArray:
        """Return the residual of the position between stops, m, at the ticks that are used.

        Projected out is motion that is not of the logged force: free motion from any state, the slow motion of the
        hand, a steady sine of `shake_hz`, and without a hand a weight that may change.
        """
        n = window.position.size
        forced = self._forced(motion, window)
        use, columns = window.use, [motion.free(n)]
        if self.stops is not None:
            # After each contact the motion goes on from any state; the contact itself is left out.
            between = np.abs(window.start + window.position - np.mean(self.stops)) <= np.ptp(self.stops) / 2
            use, columns = use & between, _anew(columns[0], between)
        columns.append(window.slow)
        if shake_hz is not None:
            angle = 2 * math.pi * shake_hz * self.period_s * np.arange(n)
            columns.append(np.stack([np.cos(angle), np.sin(angle)], axis=1))
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

    def solve(self, first: FloatArray, windows: Sequence[LogWindow], levels: FloatArray, tries: int) -> LeastSquares:
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
        return LeastSquares(np.asarray(result.x), jacobian.T @ jacobian, float(result.cost))

    def rms(self, point: FloatArray, windows: Sequence[LogWindow]) -> list[float]:
        """Return the residual in each window, root mean square, m."""
        return [root_mean_square(residual) for residual in self.residuals(point, windows)]


def _anew(free: FloatArray, between: BoolArray) -> list[FloatArray]:
    """Return free motion, shape (n, s), for each stretch between stops, from its first tick on and 0 elsewhere."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], between.astype(int), [0]])))
    blocks = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        block = np.zeros(free.shape)
        block[begin:end] = free[: end - begin]
        blocks.append(block)
    return blocks


def structures_of(
    design: IntendedLaw, grid: Grid, lag: float, swing_hz: float, *, resonant: bool
) -> list[PlantStructure]:
    """Return the structures that may have made a log: with and without a hand, each with a declared or a longer delay.

    A resonance is tried with the declared delay alone, the encoder on either side of it.
    """
    held, device = _held_unknowns(design), _device_unknowns(design)
    punctual, late = delays_of(design, grid, lag)
    if resonant:
        mode = mode_unknowns(swing_hz)
        return [
            PlantStructure.of(design, grid, [punctual, *unknowns, *mode], hand=with_hand, encoder_at=side)
            for with_hand, unknowns in ((True, held), (False, device))
            for side in _ENCODER_SIDES
        ]
    return [
        PlantStructure.of(design, grid, [delay, *unknowns], hand=with_hand, encoder_at=None)
        for with_hand, unknowns in ((True, held), (False, device))
        for delay in (punctual, late)
    ]


def shaken_structure(design: IntendedLaw, grid: Grid, lag: float, swing_hz: float) -> PlantStructure:
    """Return the structure of a held device that something outside shakes at the frequency of the swing.

    A loop that swings by itself grows first, or has harmonics as its force is limited or its wall is left. Its motion
    is not that of a device with the declared delay under the logged force and a steady sine.
    """
    punctual, _ = delays_of(design, grid, lag)
    unknowns = [punctual, *_held_unknowns(design), shake_unknown(swing_hz)]
    return PlantStructure.of(design, grid, unknowns, hand=True, encoder_at=None)


def _device_unknowns(design: IntendedLaw) -> list[Unknown]:
    """Return ln of mass and damping of the device, over what its file states or what is assumed."""
    return [
        Unknown("device_mass", 0.0, MASS_SPREAD if design.known else ASSUMED_SPREAD),
        Unknown("device_damping", 0.0, DAMPING_SPREAD if design.known else ASSUMED_SPREAD),
    ]


def _held_unknowns(design: IntendedLaw) -> list[Unknown]:
    """Return the unknowns of a held device: of its hand, which hides what a file states of the device."""
    return [*hand_unknowns(design), *([] if design.known else _device_unknowns(design))]


def root_mean_square(residual: FloatArray) -> float:
    """Return the root of the mean of squares of a residual."""
    return math.sqrt(float(np.mean(residual**2)))
