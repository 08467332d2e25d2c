"""The worst hand and motion for a tuned coupling: random search, then local search about the worst found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Hands
from avc_casadi.model.scene import Motion, Press, Stroke
from avc_casadi.simulation.population.trial import Conditions, judged

if TYPE_CHECKING:
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.schedule import GainSchedule


_A = Hands()
HAND_BOUNDS: dict[str, tuple[float, float]] = {
    "mass_kg": _A.mass_kg,
    "damping_ns_per_m": _A.damping_ns_per_m,
    "stiffness_n_per_m": _A.stiffness_n_per_m,
}
"""Those of set A."""
WIDER_BOUNDS: dict[str, tuple[float, float]] = {
    "mass_kg": (0.0, 0.6),
    "damping_ns_per_m": (0.5, 40.0),
    "stiffness_n_per_m": (50.0, 2000.0),
}
"""Beyond what the designs were made for."""
# The target rests for a second before the end, in a wall that is pressed: otherwise the search finds people who still
# move by themselves.
MOTION_BOUNDS: dict[str, tuple[float, float]] = {
    "speed_m_per_s": (0.05, 0.5),
    "end_m": (0.005, 0.02),
    "frequency_hz": (1.0, 4.0),
    "amplitude_m": (0.0, 0.015),
}
_MOTIONS = 24
_HANDS = 120
_ROUNDS = 8
_KEPT = 4
_SHRINK = 0.6


@dataclass(frozen=True)
class WorstCase:
    """The worst hand and motion that a search found.

    Attributes:
        hand: its numbers.
        motion: numbers of the motion; frequency and amplitude are those of taps after the approach.
        peak_velocity_m_per_s: largest true velocity in the last half second.
        stable: at rest by the criterion of the study.
        tried: runs of the search.
        broken: how many of them did not come to rest.
    """

    hand: dict[str, float]
    motion: dict[str, float]
    peak_velocity_m_per_s: float
    stable: bool
    tried: int
    broken: int

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return dict(vars(self))


def worst_case(
    problem: Problem,
    gains: Gains | GainSchedule,
    conditions: Conditions,
    seed: int,
    hand_bounds: dict[str, tuple[float, float]] | None = None,
) -> WorstCase:
    """Search for the run that is least at rest at its end.

    Args:
        problem: device and wall.
        gains: the coupling.
        conditions: what of the device is simulated.
        seed: of the search.
        hand_bounds: box of the hands; None is that of set A.
    """
    bounds = HAND_BOUNDS if hand_bounds is None else hand_bounds
    random = np.random.default_rng(seed)
    low, high = np.array([*bounds.values(), *MOTION_BOUNDS.values()]).T
    hands = len(bounds)
    found: list[tuple[float, bool, FloatArray]] = []
    tried = broken = 0

    def run(points: FloatArray) -> None:
        """Points share their motion; shape (n, d) in shares of the box."""
        nonlocal tried, broken
        values = low + (high - low) * points
        result = judged(problem, gains, Hand(*values[:, :hands].T), _motion(values[0, hands:]), conditions)
        peak = np.where(np.isfinite(result.peak_velocity_m_per_s), result.peak_velocity_m_per_s, np.inf)
        tried, broken = tried + len(points), broken + int((~result.stable).sum())
        found.extend((float(peak[row]), bool(result.stable[row]), points[row]) for row in np.argsort(-peak)[:_KEPT])

    for _ in range(_MOTIONS):
        points = random.random((_HANDS, len(low)))
        # Extremes are likelier to break than the middle.
        edges = random.random(points.shape)
        points = np.where(edges < 0.15, 0.0, np.where(edges > 0.85, 1.0, points))
        points[:, hands:] = points[0, hands:]
        run(points)
    spread = 0.15
    for _ in range(_ROUNDS):
        found.sort(key=lambda item: -item[0])
        for _, _, centre in found[:_KEPT]:
            points = np.clip(centre + spread * random.standard_normal((_HANDS, len(low))), 0.0, 1.0)
            points[:, hands:] = points[0, hands:]
            run(points)
        spread *= _SHRINK
    peak, stable, point = max(found, key=lambda item: item[0])
    worst = low + (high - low) * point
    return WorstCase(
        hand=dict(zip(bounds, map(float, worst[:hands]), strict=True)),
        motion=dict(zip(MOTION_BOUNDS, map(float, worst[hands:]), strict=True)),
        peak_velocity_m_per_s=min(peak, 1e6),
        stable=stable,
        tried=tried,
        broken=broken,
    )


def _motion(values: FloatArray) -> Motion:
    speed, end, frequency, amplitude = (float(value) for value in values)
    if amplitude < 1e-4:
        return Press(start_m=-0.01, end_m=end, speed_m_per_s=speed)
    return Stroke(start_m=-0.01, end_m=end, speed_m_per_s=speed, frequency_hz=frequency, amplitude_m=amplitude)
