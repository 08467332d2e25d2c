"""A law of one's own, force = -(k x + (b + b_p) v): stable with every hand and released, by how much, and its limits.

x is the measured position, v its backward difference behind a first-order filter where one is given; outside the wall
b_p alone acts. Each number is the worst over the ranges of hand and device, of the linear loop with what is declared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, product
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi._util.text import quantity
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import AnyProblem, as_problem, is_device, with_wall
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.system import hand_boxes, worst_case
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES, RADIUS_TOLERANCE
from avc_casadi.loops.walls import Stretches, stable_walls
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_corners, joined, no_hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Impedance, Problem

FORCE_THRESHOLD_N = 0.05
"""Rms of a force at the handle below which noise of it is taken as not felt."""
# A limit is confirmed by at most so many searches of the ranges.
_SEARCHES = 4
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

    def noise_n(self, device: Device) -> float:
        """Return the rms of the force on a device at rest, of white noise that spreads over steps of the encoder."""
        if device.position_noise_rms_m == 0:
            return 0.0
        noise = math.hypot(device.position_noise_rms_m, device.encoder_resolution_m / math.sqrt(12))
        return noise * self.law(device.sample_time_s).noise_gain()

    @property
    def outside(self) -> SpringDamper:
        """The law outside the wall."""
        return replace(self, stiffness_n_per_m=0.0, damping_ns_per_m=0.0)


def _round(value: float) -> float:
    return float(f"{value:.3g}")


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


@dataclass(frozen=True)
class Remedy:
    """Changes that make the law deployable, as its loop shows."""

    changes: Mapping[str, float]
    disk_margin: float


class Loops:
    """The device of a problem with its hands, and without one, around any law."""

    def __init__(self, problem: Problem) -> None:
        self.device, self.period = problem.device, problem.device.sample_time_s
        self.corners = device_corners(problem.device, LINEAR_KEYS)
        hands = hand_corners(problem.hands.model_copy(update={"let_go": False}))
        if problem.device.mass_kg + float(np.min(hands.mass_kg)) == 0:
            raise UnsupportedError("is 0, as is that of the lightest hand: nothing moves", key="device.mass_kg")
        # With a hand, then released, where something has a mass then.
        self.boxes = hand_boxes(problem)
        self.hands = [hands, no_hand()][: len(self.boxes)]
        # What a search of the ranges found worse than their corners.
        self.worst_pairs: list[tuple[Device, Hand]] = []
        # Rms of a force below which dry friction holds it, or it is not felt.
        self.quiet_n = max(self.device.coulomb_friction_n, FORCE_THRESHOLD_N * self.device.metres_per_unit)

    def pairs(self, side: int) -> list[tuple[Device, Hand]]:
        """Return every corner of the device with every corner of the hands, or with none."""
        hands = self.hands[side]
        return list(product(self.corners, [hands.pick(slice(i, i + 1)) for i in range(len(hands))]))

    def around(self, law: SpringDamper, every: Sequence[tuple[Device, Hand]]) -> OpenLoop:
        """Return the loops of pairs of device and hand."""
        plant = sampled_plant([device for device, _ in every], [hand for _, hand in every])
        return OpenLoop.around(plant, law.law(self.period))

    def worst(self, law: SpringDamper, side: int, measure: Callable[[OpenLoop], FloatArray]) -> tuple[Device, Hand]:
        """Return where in the ranges of device and hand a measure of the loop is largest."""
        closed_law = law.law(self.period)

        def of(plant: SampledPlant, _: object) -> ComplexArray:
            return measure(OpenLoop.around(plant, closed_law)).astype(np.complex128)

        _, hand, device, _ = worst_case(self.device, self.boxes[side], of)
        return device, Hand(**{name: np.array([value]) for name, value in hand.items()})

    def case(self, law: SpringDamper, side: int) -> Case:
        """Return the worst of each number, at the corners of the ranges and at the worst points of a search."""
        measures = (_radius, lambda loop: 1 - damping_ratios(loop.poles).min(axis=1), OpenLoop.swings)
        every = self.pairs(side) + [self.worst(law, side, of) for of in measures]
        loop = self.around(law, every)
        sizes, ratios = np.abs(loop.poles), damping_ratios(loop.poles)
        slowest = float(sizes.max())
        hz = np.abs(np.angle(loop.poles)).ravel() / (2 * math.pi * self.period)
        return Case(
            spectral_radius=slowest,
            frequency_hz=float(hz[sizes.argmax()]),
            stable=slowest < 1 - RADIUS_TOLERANCE,
            settling_s=float(loop.settling_s().max()) if slowest < 1 else math.inf,
            damping_ratio=float(ratios.min()),
            damping_ratio_hz=float(hz[ratios.argmin()]) if ratios.min() < 1 else 0.0,
            margins=loop.least(),
            hand=every[int(sizes.max(axis=1).argmax())][1].values(0),
        )

    def _loops(self, law: SpringDamper) -> list[OpenLoop]:
        """Return the loops at the corners of the ranges and at what searches found, in the wall and outside."""
        every = [*(pair for side in range(len(self.boxes)) for pair in self.pairs(side)), *self.worst_pairs]
        both = {law, law.outside}
        return [self.around(one, every) for one in both if one.stiffness_n_per_m or one.damper_ns_per_m]

    def rough_margin(self, law: SpringDamper) -> float:
        """Return the disk margin of a law to a per cent, at the points so far; 0 where one is unstable or loud."""
        if law.noise_n(self.device) > self.quiet_n:
            return 0.0
        loops = self._loops(law)
        stable = all(loop.closed.radius.max() < 1 for loop in loops)
        return 2 / max(float(loop.swings().max()) for loop in loops) if stable else 0.0

    def sound(self, laws: Iterable[SpringDamper]) -> Iterator[tuple[SpringDamper, float]]:
        """Yield the first law with a sound disk margin, and that, which a search of the ranges does not refute."""
        for law in laws:
            if self.rough_margin(law) >= SOUND_DISK:
                self.worst_pairs += [self.worst(law, side, OpenLoop.swings) for side in range(len(self.boxes))]
                if (disk := min(loop.least().disk for loop in self._loops(law))) >= SOUND_DISK:
                    yield law, disk
                    return

    def variants(self, law: SpringDamper, keys: Sequence[str], steps: int) -> Iterator[SpringDamper]:
        """Yield a law with other values of some keys, the largest first; of b the best alone."""
        if not keys:
            yield law
        elif keys[0] == "damping_ns_per_m":
            if (allowed := self.damping_range(law)) is not None:
                each = (_round(allowed[1] * share) for share in (0.0, *np.geomspace(1e-3, 1.0, 24)))
                laws = [replace(law, damping_ns_per_m=b) for b in each if b or law.stiffness_n_per_m]
                most = [one for one in laws if self.rough_margin(one) > 1.02 * SOUND_DISK]
                # Without a spring the best damper is none.
                yield max(laws, key=self.rough_margin) if law.stiffness_n_per_m or not most else most[-1]
        else:
            largest = 0.5 / self.period if keys[0] == "cutoff_hz" else getattr(law, keys[0])
            for share in 0.01 ** (np.arange(1, steps + 1) / steps) if largest else ():
                one = replace(law, **{keys[0]: _round(share * largest)})
                yield from self.variants(one, keys[1:], steps)

    def _confirm(self, *laws: SpringDamper) -> bool:
        """Search the ranges for what is unstable with a law, and keep it."""
        pairs = [(law, self.worst(law, side, _radius)) for law in laws for side in range(len(self.boxes))]
        worse = [pair for law, pair in pairs if self.around(law, [pair]).closed.radius.max() >= 1]
        self.worst_pairs += worse
        return not worse

    def _walls(self, law: SpringDamper, dampers_ns_per_m: FloatArray) -> Stretches:
        """Return the intervals of stable stiffness for some dampings."""
        people = self.hands[0]
        for hand in (*self.hands[1:], *(hand for _, hand in self.worst_pairs)):
            people = joined(people, hand)
        devices = [*self.corners, *(device for device, _ in self.worst_pairs)]
        return stable_walls(devices, people, dampers_ns_per_m, (-law.pole(self.period), 0.0))

    def largest_stiffness(self, law: SpringDamper) -> float:
        """Return the largest stable k at the dampers of a law: the end of its own interval, or of the softest."""
        for _ in range(_SEARCHES):
            walls = self._walls(law, np.array([law.damper_ns_per_m]))
            low, high = walls.lowest_n_per_m[0], walls.largest_n_per_m[0]
            own = (low <= law.stiffness_n_per_m) & (law.stiffness_n_per_m <= high)
            limit = float(np.nan_to_num(high[own][0] if own.any() else high[0]))
            if not limit or self._confirm(replace(law, stiffness_n_per_m=limit * (1 - 1e-6))):
                break
        return limit

    def damping_range(self, law: SpringDamper) -> tuple[float, float] | None:
        """Return the lowest and the largest b at the k of a law, about its own or nearest to it; None without any."""
        pole, wall = law.pole(self.period), law.stiffness_n_per_m
        heavy = max(one.mass_kg for one in self.corners) + float(np.max(self.hands[0].mass_kg))
        top = 4 * max(heavy / self.period, 2 * max(one.damping_ns_per_m for one in self.corners))
        scan = np.append(0.0, np.geomspace(1e-5, 1.0, 81) * top * (1 + pole) / (1 - pole))
        scan = np.unique(np.append(scan, law.damper_ns_per_m))
        for _ in range(_SEARCHES):
            inside = np.flatnonzero(self._walls(law, scan).holds(wall))
            if not inside.size:
                return None
            runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
            first, last = min(runs, key=lambda run: np.abs(scan[run] - law.damper_ns_per_m).min())[[0, -1]]
            good, bad = scan[[first, last]], scan[[max(first - 1, 0), min(last + 1, len(scan) - 1)]]
            for _ in range(5):  # closer to both edges
                fine = np.linspace(good, bad, 17)
                stable = self._walls(law, fine.ravel()).holds(wall).reshape(fine.shape)
                row = np.maximum(stable.argmin(axis=0) - 1, 0)
                good, bad = fine[row, [0, 1]], fine[row + 1, [0, 1]]
            good[0] *= wall > 0 or first != 1  # without k and b there is no law
            ends = [replace(law, damping_ns_per_m=0.0, local_damping_ns_per_m=float(end)) for end in good]
            if self._confirm(*ends):
                break
        low, high = good - law.local_damping_ns_per_m
        return None if high < 0 else (max(float(low), 0.0), float(high))


def _radius(loop: OpenLoop) -> FloatArray:
    return loop.closed.radius


@dataclass(frozen=True, eq=False, repr=False)
class LawCertificate(Printed):
    """Whether a law of one's own holds on a device, by how much, where its limits are, and what would help.

    Attributes:
        released: without a hand; None where nothing has a mass then.
        free: b_p alone, outside the wall, the worse of held and released; None without b_p.
        largest_stiffness_n_per_m: up to which k holds at this b; 0 where none does.
        damping_range_ns_per_m: lowest and largest b that hold at this k; None where none does.
        largest_local_damping_ns_per_m: up to which b_p holds outside the wall; None without b_p.
        static_stiffness_n_per_m: at rest, at the handle.
        rendered_n_per_m: magnitude of force over position at the handle, by frequency in Hz.
        encoder_step_n: change of the force by one step of the encoder.
        noise_n: rms of the force at rest, of the noise of the position.
        quiet_n: rms below which that is held by dry friction, or not felt.

    Example:
        >>> avc.certify_law("knob", k=1.0, b=0.002, remedies=False).stable
        True
    """

    problem: Problem
    law: SpringDamper
    held: Case
    released: Case | None
    free: Case | None
    largest_stiffness_n_per_m: float
    damping_range_ns_per_m: tuple[float, float] | None
    largest_local_damping_ns_per_m: float | None
    static_stiffness_n_per_m: float
    rendered_n_per_m: dict[float, float]
    encoder_step_n: float
    noise_n: float
    quiet_n: float
    remedies: tuple[Remedy, ...] | None

    @property
    def cases(self) -> tuple[Case, ...]:
        """Held, and released and free where there are these."""
        return tuple(case for case in (self.held, self.released, self.free) if case is not None)

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with every hand and released, in the wall and outside."""
        return all(case.stable for case in self.cases)

    @property
    def disk_margin(self) -> float:
        """The smallest disk margin of all cases."""
        return min(case.margins.disk for case in self.cases)

    @property
    def passed(self) -> bool:
        """Whether it may be deployed: stable, with a disk margin of 0.15 or more."""
        return self.stable and self.disk_margin >= LEAST_DISK

    @property
    def quiet(self) -> bool:
        """Whether noise of the position gives no force that is felt."""
        return self.noise_n <= self.quiet_n

    @property
    def reason(self) -> str:
        """What decides, in one line."""
        largest, allowed, law = self.largest_stiffness_n_per_m, self.damping_range_ns_per_m, self.law
        device, b, k = self.problem.device, self.law.damping_ns_per_m, self.law.stiffness_n_per_m
        delay = f"{device.delay_samples:g} sample{'' if device.delay_samples == 1 else 's'} of delay"
        ranges = ", over [device.range]" if device_ranges(device, LINEAR_KEYS) else ""
        damper, spring = (partial(quantity, unit=self.problem.units.unit(one)) for one in ("N.s/m", "N/m"))
        late = f"with {delay} at {1 / device.sample_time_s:g} Hz{ranges}"
        low, high, free = *(allowed or (0.0, 0.0)), self.free is None or self.free.stable
        b_p, alone = law.local_damping_ns_per_m, self.largest_local_damping_ns_per_m
        if self.stable:
            thin = f"a disk margin of {self.disk_margin:.2g} is {'thin' if self.passed else f'below {LEAST_DISK}'}"
            doubts = [thin] if self.disk_margin < SOUND_DISK else []
            doubts += [] if self.quiet else ["noise of the position shakes the handle through b"]
            whose = "with every hand and released" if any(self.held.hand.values()) else "released; nobody holds it"
            return f"stable, but {', and '.join(doubts)}" if doubts else f"stable {whose}"
        unstable = {
            f"b_p {damper(b_p)} is above its largest outside the wall, {damper(alone)}, {late}": not free,
            f"no b holds this k {late}": allowed is None,
            f"b {damper(b)} is above its largest, {damper(high)}, {late}": b > high,
            f"b {damper(b)} is below the {damper(low)} that this k needs {late}": b < low,
            f"k {spring(k)} is above its largest, {spring(largest)}, {late}": True,
        }
        return f"unstable: {next(text for text, holds in unstable.items() if holds)}"

    def __repr__(self) -> str:
        return f"LawCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "quiet": self.quiet}
        rendered = {f"at_{hz:g}_hz_n_per_m": value for hz, value in self.rendered_n_per_m.items()}
        own = {"problem": self.problem.name, "deployable": {**verdict, "reason": self.reason}, "rendered": rendered}
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "rendered_n_per_m")}
        return self.problem.units.document(plain({"schema": "avc/1", "kind": "law", **own, **numbers}))


def certify_law(
    problem: AnyProblem,
    *,
    k: float = 0.0,
    b: float = 0.0,
    b_p: float = 0.0,
    cutoff_hz: float | None = None,
    remedies: bool = True,
) -> LawCertificate:
    """Judge your own spring and damper, force = -(k x + (b + b_p) v), on a device: its wall is not used.

    Args:
        problem: device and hands: a problem, its file or name, or a device file or its name.
        k: spring, N/m; N.m/rad of a device that turns.
        b: damper in the wall, N.s/m or N.m.s/rad.
        b_p: damper that acts outside the wall too.
        cutoff_hz: of a first-order filter of the velocity; None: no filter.
        remedies: look for what would help too.

    Raises:
        InputError: a value that is refused, or neither spring nor damper.
        UnsupportedError: nothing has a mass, more than 32 samples of delay, or the problem couples to another end.

    Example:
        >>> law = avc.certify_law("knob", k=1.0, b=0.002)
        >>> law.passed, round(law.held.damping_ratio, 2)
        (False, 0.06)
    """
    stated = with_wall(law_problem(problem))
    law = valid_law(SpringDamper(k, b, b_p, cutoff_hz), stated.device)
    loops, device = Loops(stated), stated.device
    sides = range(len(loops.boxes))
    held, *released = (loops.case(law, side) for side in sides)
    outside = [loops.case(law.outside, side) for side in sides if b_p]
    period = device.sample_time_s
    own = law.law(period)
    certificate = LawCertificate(
        problem=stated,
        law=law,
        held=held,
        released=released[0] if released else None,
        free=min(outside, key=lambda case: (case.stable, case.margins.disk), default=None),
        largest_stiffness_n_per_m=loops.largest_stiffness(law),
        damping_range_ns_per_m=loops.damping_range(law),
        largest_local_damping_ns_per_m=(loops.damping_range(SpringDamper(0.0, b_p)) or (0.0, 0.0))[1] if b_p else None,
        static_stiffness_n_per_m=stiffness_at_handle(device, k),
        rendered_n_per_m={
            hz: float(abs(own.transfer(np.exp(2j * math.pi * hz * period)))) for hz in (1.0, 10.0) if hz < 0.5 / period
        },
        encoder_step_n=float(own.d[0, 0]) * device.encoder_resolution_m,
        noise_n=law.noise_n(device),
        quiet_n=loops.quiet_n,
        remedies=() if remedies else None,
    )
    if not remedies or (certificate.passed and certificate.disk_margin >= SOUND_DISK and certificate.quiet):
        return certificate
    return replace(certificate, remedies=tuple(_remedies(law, stated, loops)))


def law_problem(source: AnyProblem) -> Problem:
    """Return a problem, or a device file as one without a wall."""
    if isinstance(source, str | Path) and is_device(str(source)):
        file = load_device(source)
        nothing = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
        return Problem(name=file.name, title=file.title, device=file.device, environment=nothing)
    return as_problem(source)


def valid_law(law: SpringDamper, device: Device) -> SpringDamper:
    """Return the law if its numbers are allowed."""
    gains = {"k": law.stiffness_n_per_m, "b": law.damping_ns_per_m, "b_p": law.local_damping_ns_per_m}
    what = "is {:g}; allowed: 0 or a positive finite number"
    faults = {key: what.format(value) for key, value in gains.items() if not (math.isfinite(value) and value >= 0)}
    if law.cutoff_hz is not None and not (math.isfinite(law.cutoff_hz) and law.cutoff_hz > 0):
        faults["cutoff_hz"] = f"is {law.cutoff_hz:g}; allowed: a positive finite number"
    if not faults and not any(gains.values()):
        faults["k"] = "is 0, and so are b and b_p: there is no law; give at least one of them"
    if faults:
        raise InputError([Fault("", None, key, message) for key, message in faults.items()])
    slowest = max(corner.delay_samples for corner in device_corners(device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        what = f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {slowest:g}"
        raise UnsupportedError(what, key="device.delay_samples")
    return law


def _remedies(law: SpringDamper, problem: Problem, loops: Loops) -> Iterator[Remedy]:
    """Yield the fewest changes that leave a sound disk margin and no noise that is felt, each as its loop shows."""
    for count in range(1, len(_KEYS) + 1):
        each = (loops.variants(law, keys, 30 // count**2) for keys in combinations(_KEYS, count))
        some = dict(one for laws in each for one in loops.sound(laws))
        for other, disk in some.items():
            changes = {key: getattr(other, key) for key in _KEYS if getattr(other, key) != getattr(law, key)}
            yield Remedy(changes, disk)
        if some:
            break
    quicker: list[dict[str, Any]] = [{"sample_time_s": loops.period / 2}]
    quicker += [{"delay_samples": 0}] if loops.device.delay_samples else []
    for change in quicker:
        beside = {"range": {"delay_samples": None}} if "delay_samples" in change else {}
        for _, disk in Loops(problem.changed(device={**change, **beside})).sound([law]):
            yield Remedy(change, disk)


def first_law(problem: Problem) -> SpringDamper:
    """Return a spring and damper to begin with: the wall's k, or the largest share of it that a b holds soundly."""
    stiffest = problem.environment.stiffness_n_per_m or 1e3 * problem.device.metres_per_unit**2
    loops, wall = Loops(problem), SpringDamper(stiffest)
    laws = chain(loops.variants(wall, _KEYS[-1:], 1), loops.variants(wall, (_KEYS[0], _KEYS[-1]), 8))
    return next((law for law, _ in loops.sound(laws)), SpringDamper(_round(1e-3 * stiffest)))
