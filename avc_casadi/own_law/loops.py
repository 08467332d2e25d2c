"""The loops of a law of one's own with every hand and released: the worst of each number, and where they end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.loops.margins import SETTLED, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.ranges import hand_boxes, worst_held
from avc_casadi.loops.wall import RADIUS_TOLERANCE, Rendering
from avc_casadi.loops.walls import stable_walls
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import Hand, hand_corners, joined, no_hand
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.loops.ranges import Ranges
    from avc_casadi.loops.walls import Stretches
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.sampled_plant import SampledPlant

# A pole so near to 1 is that of a free device that stays.
_STAYS = 1e-9
# Dampings of a scan, of a zoom on one of its edges, zooms; searches of the ranges that confirm a limit, just inside it.
_SCAN, _FINE, _ZOOMS, _CONFIRMED, _INSIDE = 81, 17, 5, 4, 1e-6


@dataclass(frozen=True)
class Law:
    """The law; 0 and None mean absent.

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b, in the wall.
        local_damping_ns_per_m: b_p, everywhere.
        cutoff_hz: -3 dB frequency of the filter of the velocity.
    """

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

    def rendering(self, sample_time_s: float) -> Rendering:
        """Return the law as a sampled force of position, position before and filtered velocity."""
        pole = self.pole(sample_time_s)
        rate = (1 - pole) / sample_time_s * np.array([1.0, -1.0, 0.0])
        velocity = rate + np.array([0.0, 0.0, pole])
        force = np.array([self.stiffness_n_per_m, 0.0, 0.0]) + self.damper_ns_per_m * velocity
        return Rendering(force[None], velocity[None])

    def noise_n(self, device: Device) -> float:
        """Return the rms of the force on a device at rest, of white noise that spreads over steps of the encoder."""
        if device.position_noise_rms_m == 0:
            return 0.0
        pole = self.pole(device.sample_time_s)
        rate = self.damper_ns_per_m * (1 - pole) / device.sample_time_s
        noise = math.hypot(device.position_noise_rms_m, device.encoder_resolution_m / math.sqrt(12))
        return noise * math.sqrt((self.stiffness_n_per_m + rate) ** 2 + rate**2 * (1 - pole) / (1 + pole))


@dataclass(frozen=True)
class Case:
    """The loop released, or with the worst hand of the ranges; each number the worst found."""

    spectral_radius: float
    frequency_hz: float
    stable: bool
    settling_s: float
    damping_ratio: float
    damping_ratio_hz: float
    margins: Margins
    hand: dict[str, float]


class Loops:
    """The device of a problem with its hands, and without one, around any law."""

    def __init__(self, problem: Problem) -> None:
        self.device, self.period = problem.device, problem.device.sample_time_s
        self.corners = device_corners(problem.device, LINEAR_KEYS)
        self.hands = hand_corners(problem.hands.model_copy(update={"let_go": False}))
        if problem.device.mass_kg + float(np.min(self.hands.mass_kg)) == 0:
            raise UnsupportedError("is 0, as is that of the lightest hand: nothing moves", key="device.mass_kg")
        # With a hand, then released, where something has a mass then.
        self.boxes = hand_boxes(problem)
        # What a search of the ranges found worse than their corners.
        self.found: list[tuple[Device, Hand]] = []

    def case(self, law: Law, side: int) -> Case:
        """Return the worst of each number, at the corners of the ranges and at the worst points of a search."""
        box, hands = self.boxes[side], (self.hands, no_hand())[side]
        every = list(product(self.corners, [hands.pick(slice(i, i + 1)) for i in range(len(hands))]))
        every += [self.worst(law, box, measure) for measure in (_radius, _undamped, OpenLoop.swings)]
        loop = self.around(law, every)
        sizes, ratios = np.abs(loop.poles), damping_ratios(loop.poles)
        springy = law.stiffness_n_per_m > 0 or box["hand.stiffness_n_per_m"][0] > 0
        slowest = float(sizes[springy | (np.abs(loop.poles - 1) > _STAYS)].max(initial=0.0))
        with np.errstate(divide="ignore"):
            settling_s = self.period * math.log(SETTLED) / np.log(slowest) if slowest < 1 else math.inf
        hz = np.abs(np.angle(loop.poles)).ravel() / (2 * math.pi * self.period)
        return Case(
            spectral_radius=float(sizes.max()),
            frequency_hz=float(hz[sizes.argmax()]),
            stable=slowest < 1 - RADIUS_TOLERANCE,
            settling_s=float(settling_s),
            damping_ratio=float(ratios.min()),
            damping_ratio_hz=float(hz[ratios.argmin()]) if ratios.min() < 1 else 0.0,
            margins=loop.least(),
            hand=every[int(sizes.max(axis=1).argmax())][1].values(0),
        )

    def around(self, law: Law, every: Sequence[tuple[Device, Hand]]) -> OpenLoop:
        """Return the loops of pairs of device and hand."""
        plant = sampled_plant([device for device, _ in every], [hand for _, hand in every])
        return OpenLoop.around(plant, law.rendering(self.period))

    def worst(self, law: Law, box: Ranges, measure: Callable[[OpenLoop], FloatArray]) -> tuple[Device, Hand]:
        """Return where in the ranges of device and hand a measure of the loop is largest."""
        rendering = law.rendering(self.period)

        def of(plant: SampledPlant, _: object) -> ComplexArray:
            return measure(OpenLoop.around(plant, rendering)).astype(np.complex128)

        _, hand, device, _ = worst_held(self.device, box, of)
        return device, Hand(**{name: np.array([value]) for name, value in hand.items()})

    def disk_margin(self, law: Law) -> float:
        """Return the disk margin at the corners of the ranges and released; 0 where one is unstable."""
        people = [self.hands.pick(slice(i, i + 1)) for i in range(len(self.hands))]
        people += [no_hand().pick(slice(0, 1))] * (len(self.boxes) - 1)
        return self.around(law, [*product(self.corners, people), *self.found]).least().disk

    def _confirmed(self, law: Law) -> bool:
        """Search the ranges for what is unstable, and keep it."""
        before = len(self.found)
        for box in self.boxes:
            pair = self.worst(law, box, _radius)
            if np.abs(self.around(law, [pair]).poles).max() > 1 + _STAYS:
                self.found.append(pair)
        return len(self.found) == before

    def _walls(self, law: Law, dampers_ns_per_m: FloatArray) -> Stretches:
        """Return the intervals of stable stiffness for some dampings."""
        people = self.hands if len(self.boxes) == 1 else joined(self.hands, no_hand())
        for _, hand in self.found:
            people = joined(people, hand)
        devices = [*self.corners, *(device for device, _ in self.found)]
        return stable_walls(devices, people, dampers_ns_per_m, (-law.pole(self.period), 0.0))

    def largest_stiffness(self, law: Law) -> float:
        """Return the largest stable k at the dampers of a law: the end of its own interval, or of the softest."""
        for _ in range(_CONFIRMED):
            walls = self._walls(law, np.array([law.damper_ns_per_m]))
            low, high = walls.lowest_n_per_m[0], walls.largest_n_per_m[0]
            own = (low <= law.stiffness_n_per_m) & (law.stiffness_n_per_m <= high)
            limit = float(np.nan_to_num(high[own][0] if own.any() else high[0]))
            if not limit or self._confirmed(replace(law, stiffness_n_per_m=limit * (1 - _INSIDE))):
                break
        return limit

    def damping_range(self, law: Law) -> tuple[float, float] | None:
        """Return the lowest and the largest b at the k of a law, about its own or nearest to it; None without any."""
        pole, wall = law.pole(self.period), law.stiffness_n_per_m
        heavy = max(one.mass_kg for one in self.corners) + float(np.max(self.hands.mass_kg))
        top = 4 * max(heavy / self.period, 2 * max(one.damping_ns_per_m for one in self.corners))
        scan = np.append(0.0, np.geomspace(1e-5, 1.0, _SCAN) * top * (1 + pole) / (1 - pole))
        scan = np.unique(np.append(scan, law.damper_ns_per_m))
        for _ in range(_CONFIRMED):
            inside = np.flatnonzero(self._walls(law, scan).holds(wall))
            if not inside.size:
                return None
            runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
            first, last = min(runs, key=lambda run: np.abs(scan[run] - law.damper_ns_per_m).min())[[0, -1]]
            good, bad = scan[[first, last]], scan[[max(first - 1, 0), min(last + 1, len(scan) - 1)]]
            for _ in range(_ZOOMS):
                fine = np.linspace(good, bad, _FINE)
                stable = self._walls(law, fine.ravel()).holds(wall).reshape(fine.shape)
                row = np.maximum(stable.argmin(axis=0) - 1, 0)
                good, bad = fine[row, [0, 1]], fine[row + 1, [0, 1]]
            good[0] *= wall > 0 or first != 1  # without k and b there is no law
            ends = [replace(law, damping_ns_per_m=0.0, local_damping_ns_per_m=float(end)) for end in good]
            confirmed = [self._confirmed(one) for one in ends]
            if all(confirmed):
                break
        low, high = good - law.local_damping_ns_per_m
        return None if high < 0 else (max(float(low), 0.0), float(high))


def _radius(loop: OpenLoop) -> FloatArray:
    return np.asarray(np.abs(loop.poles).max(axis=1))


def _undamped(loop: OpenLoop) -> FloatArray:
    return np.asarray(1 - damping_ratios(loop.poles).min(axis=1))
