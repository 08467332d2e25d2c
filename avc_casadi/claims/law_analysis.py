"""Spring and damper around every plant of a problem: stable, by how much, up to which values, and what would help."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain, combinations
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.open_end import AboveZero
from avc_casadi.claims.law_points import LawPoint, Measure, around, corner_points, radius, worst
from avc_casadi.claims.stated_law import AnyLaw, noise_n
from avc_casadi.loops.margins import SOUND_DISK, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE, PlantFamily
from avc_casadi.loops.stable_walls import Stretches, stable_walls
from avc_casadi.model.hands import joined
from avc_casadi.model.law import Law
from avc_casadi.model.problem import Problem

_FORCE_THRESHOLD_N = 0.05
"""Rms of a force at the handle below which noise of it is taken as not felt."""
# A limit is confirmed by at most so many searches of the ranges, so far below the boundary.
_SEARCHES = 4
_JUST_BELOW = 1 - 1e-6
# Changes of a law that are looked at: down to this share of a value, and dampers from one share of the largest to
# another, so many.
_LEAST_SHARE = 0.01
_DAMPER_SHARES = (1e-3, 1.0, 24)
# A rough disk margin is right to a per cent.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK
# Values of a law that a user can change, the spring first; of b the best one is looked at.
_KEYS = ("stiffness_n_per_m", "cutoff_hz", "local_damping_ns_per_m", "damping_ns_per_m")


@dataclass(frozen=True)
class SpringDamper:
    """The numbers of a law: k, b in the wall, b_p everywhere, and the -3 dB frequency of a filter of the velocity."""

    stiffness_n_per_m: float = 0.0
    damping_ns_per_m: float = 0.0
    local_damping_ns_per_m: float = 0.0
    cutoff_hz: float | None = None

    @property
    def damper_ns_per_m(self) -> float:
        """The sum b + b_p."""
        return self.damping_ns_per_m + self.local_damping_ns_per_m

    def pole(self, sample_time_s: float) -> float:
        """Return the pole of the filter; 0 without one."""
        return 0.0 if self.cutoff_hz is None else math.exp(-2 * math.pi * self.cutoff_hz * sample_time_s)

    def law(self, sample_time_s: float) -> Law:
        """Return the law that the loops see."""
        pole = self.pole(sample_time_s)
        return Law.spring_damper(self.stiffness_n_per_m, self.damper_ns_per_m, sample_time_s, pole)

    @property
    def outside(self) -> SpringDamper:
        """The law outside the wall."""
        return replace(self, stiffness_n_per_m=0.0, damping_ns_per_m=0.0)


def _round(value: float) -> float:
    return float(f"{value:.3g}")


@dataclass(frozen=True)
class CaseResult:
    """The loop released, or with the worst hand of the ranges; each number the worst found."""

    spectral_radius: float
    frequency_hz: float
    stable: bool
    settling_s: float
    damping_ratio: float
    damping_ratio_hz: float
    margins: Margins
    hand: dict[str, float]


@dataclass(frozen=True)
class LawRemedy:
    """Changes that make the law deployable, as its loop shows."""

    changes: Mapping[str, float]
    disk_margin: float


class LawAnalysis:
    """The plants of a problem around any spring and damper: its numbers, its limits, and what would help it."""

    def __init__(self, problem: Problem) -> None:
        """Set up the plants of a problem, and the force below which a noise counts as quiet, N.

        Raises:
            UnsupportedError: neither device nor lightest hand has a mass.
        """
        self.family = PlantFamily.of(problem)
        self.device = problem.device
        self.period = problem.device.sample_time_s
        self.lightest_kg = problem.lightest_kg
        if problem.device.mass_kg + float(np.min(self.family.held.mass_kg)) == 0:
            raise UnsupportedError(
                "device.mass_kg and the mass of the lightest hand are 0; one of them must be above 0",
                key="device.mass_kg",
            )
        # What a search of the ranges found worse than their corners.
        self.worst_points: list[LawPoint] = []
        # Rms of a force below which dry friction holds it, or it is not felt.
        self.felt_n = _FORCE_THRESHOLD_N * self.device.metres_per_unit
        self.quiet_n = max(self.device.coulomb_friction_n, self.felt_n)

    @property
    def sides(self) -> tuple[PlantFamily, ...]:
        """With a hand, then released, where something has a mass then."""
        return self.family.sides

    def around(self, law: AnyLaw, points: Sequence[LawPoint]) -> OpenLoop:
        """Return the loops of a law at points."""
        return around(law.law(self.period), points)

    def worst(self, law: AnyLaw, side: PlantFamily, measure: Measure) -> LawPoint:
        """Return where in the ranges of device, hand and slopes a measure of the loop is largest."""
        return worst(law.law(self.period), side, measure).point

    def case(self, law: AnyLaw, side: PlantFamily) -> CaseResult:
        """Return radius, settling time, damping ratio, margins and worst hand of a law on one side: held or released.

        Each is the worst of the corners of the ranges and of points that searches for it find.
        """
        measures = (radius, _lack_of_damping, OpenLoop.swings)
        corners = corner_points(side, law.law(self.period).sectors)
        points = corners + [self.worst(law, side, measure) for measure in measures]
        loop = self.around(law, points)
        sizes = np.abs(loop.poles)
        ratios = damping_ratios(loop.poles)
        slowest = float(sizes.max())
        hz = np.abs(np.angle(loop.poles)).ravel() / (2 * math.pi * self.period)
        return CaseResult(
            spectral_radius=slowest,
            frequency_hz=float(hz[sizes.argmax()]),
            stable=slowest < 1 - RADIUS_TOLERANCE,
            settling_s=float(loop.settling_s().max()) if slowest < 1 else math.inf,
            damping_ratio=float(ratios.min()),
            damping_ratio_hz=float(hz[ratios.argmin()]) if ratios.min() < 1 else 0.0,
            margins=loop.least(),
            hand=points[int(sizes.max(axis=1).argmax())].hand.values(0),
        )

    def _loops(self, law: SpringDamper) -> list[OpenLoop]:
        """Return the loops at the corners of the ranges and at what searches found, in the wall and outside."""
        corners = (point for side in self.sides for point in corner_points(side, law.law(self.period).sectors))
        points = [*corners, *self.worst_points]
        acting = [place for place in {law, law.outside} if place.stiffness_n_per_m or place.damper_ns_per_m]
        return [self.around(place, points) for place in acting]

    def rough_margin(self, law: SpringDamper) -> float:
        """Return the disk margin of a law to a per cent, at the points so far; 0 where one is unstable or loud."""
        if noise_n(law, self.device) > self.quiet_n:
            return 0.0
        return min(loop.quick_disk_margin for loop in self._loops(law))

    def sound(self, laws: Iterable[SpringDamper]) -> Iterator[tuple[SpringDamper, float]]:
        """Yield the first of some laws whose disk margin is sound at the corners and in the ranges, and that margin."""
        for law in laws:
            if self.rough_margin(law) < SOUND_DISK:
                continue
            self.worst_points += [self.worst(law, side, OpenLoop.swings) for side in self.sides]
            disk = min(loop.least().disk for loop in self._loops(law))
            if disk >= SOUND_DISK:
                yield law, disk
                return

    def variants(self, law: SpringDamper, keys: Sequence[str], steps: int) -> Iterator[SpringDamper]:
        """Yield a law with smaller values of some keys, the largest first; of b the best alone.

        `steps` is the number of values of each key.
        """
        if not keys:
            yield law
        elif keys[0] == "damping_ns_per_m":
            yield from self._best_damped(law)
        else:
            largest = 0.5 / self.period if keys[0] == "cutoff_hz" else getattr(law, keys[0])
            for share in _LEAST_SHARE ** (np.arange(1, steps + 1) / steps) if largest else ():
                changed = replace(law, **{keys[0]: _round(share * largest)})
                yield from self.variants(changed, keys[1:], steps)

    def _best_damped(self, law: SpringDamper) -> Iterator[SpringDamper]:
        """Yield the law with the damper b of the largest disk margin; without a spring the largest b of a sound one."""
        allowed = self.damping_range(law)
        if allowed is None:
            return
        dampers = [_round(allowed[1] * share) for share in (0.0, *np.geomspace(*_DAMPER_SHARES))]
        laws = [replace(law, damping_ns_per_m=b) for b in dampers if b or law.stiffness_n_per_m]
        sound = [damped for damped in laws if self.rough_margin(damped) > _SOUND_ROUGHLY]
        # Without a spring the best damper is none.
        yield max(laws, key=self.rough_margin) if law.stiffness_n_per_m or not sound else sound[-1]

    def _confirm(self, *laws: SpringDamper) -> bool:
        """Search the ranges for what is unstable with a law, and keep it."""
        worst_of_laws = [(law, self.worst(law, side, radius)) for law in laws for side in self.sides]
        worse = [point for law, point in worst_of_laws if self.around(law, [point]).closed.radius.max() >= 1]
        self.worst_points += worse
        return not worse

    def _walls(self, law: SpringDamper, dampers_ns_per_m: FloatArray) -> Stretches:
        """Return the intervals of stable stiffness for some dampings."""
        hands = [side.held for side in self.sides] + [point.hand for point in self.worst_points]
        devices = [*self.family.devices, *(point.device for point in self.worst_points)]
        return stable_walls(devices, reduce(joined, hands), dampers_ns_per_m, (-law.pole(self.period), 0.0))

    def stiffness_range(self, law: SpringDamper) -> tuple[float, float] | None:
        """Return the lowest and largest k at the dampers of a law, about its own or the softest; None without any."""
        low, high = 0.0, 0.0
        for _ in range(_SEARCHES):
            walls = self._walls(law, np.array([law.damper_ns_per_m]))
            lowest, largest = walls.lowest_n_per_m[0], walls.largest_n_per_m[0]
            around_law = (lowest <= law.stiffness_n_per_m) & (law.stiffness_n_per_m <= largest)
            column = int(around_law.argmax())
            # An end is a value that is judged stable: just inside the edge.
            low, high = (float(np.nan_to_num(edges[column])) for edges in (lowest, largest))
            low, high = max(low, 0.0) / _JUST_BELOW, high * _JUST_BELOW
            ends = [replace(law, stiffness_n_per_m=k) for k in {low, high} if k]
            if self._confirm(*ends):
                break
        return (low, high) if high else None

    def damping_range(self, law: SpringDamper) -> tuple[float, float] | None:
        """Return the lowest and the largest b at the k of a law, about its own or nearest to it; None without any."""
        stiffness = law.stiffness_n_per_m
        scan = self._dampers_ns_per_m(law)
        for _ in range(_SEARCHES):
            inside = np.flatnonzero(self._walls(law, scan).holds(stiffness))
            if not inside.size:
                return None
            runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
            first, last = min(runs, key=lambda run: np.abs(scan[run] - law.damper_ns_per_m).min())[[0, -1]]
            stable = scan[[first, last]]
            unstable = scan[[max(first - 1, 0), min(last + 1, len(scan) - 1)]]
            # An end is a value that is judged stable: just inside the edge.
            edges = self._edges(law, stable, unstable)
            edges = np.where(edges == stable, edges, edges + (1 - _JUST_BELOW) * np.abs(edges) * [1, -1])
            ends = [replace(law, damping_ns_per_m=0.0, local_damping_ns_per_m=float(edge)) for edge in edges]
            if self._confirm(*ends):
                break
        low, high = (edges - law.local_damping_ns_per_m).tolist()
        if high < 0:
            return None
        # Without k, b and b_p there is no law.
        sole = not stiffness and not law.local_damping_ns_per_m and first <= 1
        return AboveZero(scan[1]) if sole else max(low, 0.0), high

    def _dampers_ns_per_m(self, law: SpringDamper) -> FloatArray:
        """Return the dampers of a scan, N.s/m: 0, that of the law, and 81 up to 4 max(m/T, 2 b_d) (1 + p)/(1 - p).

        m is the mass of the heaviest device with the heaviest hand, T the sample time, b_d the largest damping of a
        device, and p the pole of the velocity filter, 0 without one.
        """
        pole = law.pole(self.period)
        drag = max(device.damping_ns_per_m for device in self.family.devices)
        largest = 4 * max(self.family.heaviest_kg / self.period, 2 * drag) * (1 + pole) / (1 - pole)
        return np.unique([0.0, law.damper_ns_per_m, *(np.geomspace(1e-5, 1.0, 81) * largest)])

    def _edges(self, law: SpringDamper, stable: FloatArray, unstable: FloatArray) -> FloatArray:
        """Return the last stable dampers between stable and unstable ones, N.s/m, by five scans of 17 each.

        `stable` and `unstable` are those at the lower and the upper end, shape (2,).
        """
        for _ in range(5):
            between = np.linspace(stable, unstable, 17)
            holds = self._walls(law, between.ravel()).holds(law.stiffness_n_per_m).reshape(between.shape)
            row = np.maximum(holds.argmin(axis=0) - 1, 0)
            stable = between[row, [0, 1]]
            unstable = between[row + 1, [0, 1]]
        return stable


def _lack_of_damping(loop: OpenLoop) -> FloatArray:
    return np.asarray(1 - damping_ratios(loop.poles).min(axis=1))


def remedies_of(law: SpringDamper, problem: Problem, analysis: LawAnalysis) -> Iterator[LawRemedy]:
    """Yield the fewest changes of k, b, b_p and filter that give a sound disk margin and a quiet force.

    Then half the sample time, and no delay, each where it alone gives such a margin.
    """
    for count in range(1, len(_KEYS) + 1):
        # The more values change at once, the coarser are their steps.
        ways = (analysis.variants(law, keys, 30 // count**2) for keys in combinations(_KEYS, count))
        sound = dict(remedied for laws in ways for remedied in analysis.sound(laws))
        for changed, disk in sound.items():
            changes = {key: getattr(changed, key) for key in _KEYS if getattr(changed, key) != getattr(law, key)}
            yield LawRemedy(changes, disk)
        if sound:
            break
    quicker: list[dict[str, Any]] = [{"sample_time_s": analysis.period / 2}]
    quicker += [{"delay_samples": 0}] if analysis.device.delay_samples else []
    for change in quicker:
        ranges = {"range": {"delay_samples": None}} if "delay_samples" in change else {}
        for _, disk in LawAnalysis(problem.changed(device={**change, **ranges})).sound([law]):
            yield LawRemedy(change, disk)


def first_law(problem: Problem) -> SpringDamper:
    """Return a spring and damper to begin with: the wall's k, or the largest share of it that a b holds soundly."""
    stiffest = problem.environment.stiffness_n_per_m or 1e3 * problem.device.metres_per_unit**2
    analysis = LawAnalysis(problem)
    wall = SpringDamper(stiffest)
    laws = chain(analysis.variants(wall, _KEYS[-1:], 1), analysis.variants(wall, (_KEYS[0], _KEYS[-1]), 8))
    return next((law for law, _ in analysis.sound(laws)), SpringDamper(_round(1e-3 * stiffest)))
