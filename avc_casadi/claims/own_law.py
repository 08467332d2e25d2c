"""A law of one's own, force = -(k x + (b + b_p) v): stable with every hand and released, by how much, and its limits.

x is the measured position, v its backward difference behind a first-order filter where one is given; outside the wall
b_p alone acts. Each number is the worst over the ranges of hand and device, of the linear loop with what is declared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain, combinations
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi._util.printed import Printed
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.claims.law_limits import BeyondLimit, LawLimits, LimitSide, corner_pairs, nearest_limit
from avc_casadi.claims.stated_law import (
    AnyLaw,
    StatedSystem,
    is_system,
    noise_n,
    rendered_n_per_m,
    static_gain,
    with_law,
)
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import AnyProblem, is_device, load_any, require_wall
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE, PlantFamily
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.loops.walls import Stretches, stable_walls
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, joined
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Impedance, Problem

FORCE_THRESHOLD_N = 0.05
"""Rms of a force at the handle below which noise of it is taken as not felt."""
# A factor on all forces of a law: that of no force at all is no law.
_COMMON_GAIN = LawNumber(("gain",), 1.0, 1e-4)
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

Pair = tuple[Device, Hand]
"""A device without ranges in a hand."""


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
        self.family = PlantFamily.of(problem)
        self.device = problem.device
        self.period = problem.device.sample_time_s
        if problem.device.mass_kg + float(np.min(self.family.held.mass_kg)) == 0:
            raise UnsupportedError(
                "is 0, and so is the mass of the lightest hand; one of them must be above 0", key="device.mass_kg"
            )
        # What a search of the ranges found worse than their corners.
        self.worst_pairs: list[Pair] = []
        # Rms of a force below which dry friction holds it, or it is not felt.
        self.quiet_n = max(self.device.coulomb_friction_n, FORCE_THRESHOLD_N * self.device.metres_per_unit)

    @property
    def sides(self) -> tuple[PlantFamily, ...]:
        """With a hand, then released, where something has a mass then."""
        return self.family.sides

    def around(self, law: AnyLaw, pairs: Sequence[Pair]) -> OpenLoop:
        """Return the loops of pairs of device and hand."""
        plant = sampled_plant([device for device, _ in pairs], [hand for _, hand in pairs])
        return OpenLoop.around(plant, law.law(self.period))

    def worst(self, law: AnyLaw, side: PlantFamily, measure: Callable[[OpenLoop], FloatArray]) -> Pair:
        """Return where in the ranges of device and hand a measure of the loop is largest."""
        state_space = law.law(self.period)

        def of_plants(plant: SampledPlant, _: object) -> ComplexArray:
            return measure(OpenLoop.around(plant, state_space)).astype(np.complex128)

        worst = side.worst_case(of_plants)
        return worst.device, Hand(**{name: np.array([value]) for name, value in worst.hand.items()})

    def case(self, law: AnyLaw, side: PlantFamily) -> CaseResult:
        """Return the worst of each number, at the corners of the ranges and at the worst points of a search."""
        measures = (_radius, _lack_of_damping, OpenLoop.swings)
        pairs = corner_pairs(side) + [self.worst(law, side, measure) for measure in measures]
        loop = self.around(law, pairs)
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
            hand=pairs[int(sizes.max(axis=1).argmax())][1].values(0),
        )

    def _loops(self, law: SpringDamper) -> list[OpenLoop]:
        """Return the loops at the corners of the ranges and at what searches found, in the wall and outside."""
        pairs = [*(pair for side in self.sides for pair in corner_pairs(side)), *self.worst_pairs]
        acting = [place for place in {law, law.outside} if place.stiffness_n_per_m or place.damper_ns_per_m]
        return [self.around(place, pairs) for place in acting]

    def rough_margin(self, law: SpringDamper) -> float:
        """Return the disk margin of a law to a per cent, at the points so far; 0 where one is unstable or loud."""
        if noise_n(law, self.device) > self.quiet_n:
            return 0.0
        return min(loop.quick_disk_margin for loop in self._loops(law))

    def sound(self, laws: Iterable[SpringDamper]) -> Iterator[tuple[SpringDamper, float]]:
        """Yield the first law with a sound disk margin, and that, which a search of the ranges does not refute."""
        for law in laws:
            if self.rough_margin(law) < SOUND_DISK:
                continue
            self.worst_pairs += [self.worst(law, side, OpenLoop.swings) for side in self.sides]
            disk = min(loop.least().disk for loop in self._loops(law))
            if disk >= SOUND_DISK:
                yield law, disk
                return

    def variants(self, law: SpringDamper, keys: Sequence[str], steps: int) -> Iterator[SpringDamper]:
        """Yield a law with other values of some keys, the largest first; of b the best alone."""
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
        """Yield the law with the damper of the widest margin; without a spring the largest with a sound one."""
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
        pairs = [(law, self.worst(law, side, _radius)) for law in laws for side in self.sides]
        worse = [pair for law, pair in pairs if self.around(law, [pair]).closed.radius.max() >= 1]
        self.worst_pairs += worse
        return not worse

    def _walls(self, law: SpringDamper, dampers_ns_per_m: FloatArray) -> Stretches:
        """Return the intervals of stable stiffness for some dampings."""
        hands = [side.held for side in self.sides] + [hand for _, hand in self.worst_pairs]
        devices = [*self.family.devices, *(device for device, _ in self.worst_pairs)]
        return stable_walls(devices, reduce(joined, hands), dampers_ns_per_m, (-law.pole(self.period), 0.0))

    def largest_stiffness(self, law: SpringDamper) -> float:
        """Return the largest stable k at the dampers of a law: the end of its own interval, or of the softest."""
        for _ in range(_SEARCHES):
            walls = self._walls(law, np.array([law.damper_ns_per_m]))
            low = walls.lowest_n_per_m[0]
            high = walls.largest_n_per_m[0]
            around_law = (low <= law.stiffness_n_per_m) & (law.stiffness_n_per_m <= high)
            limit = float(np.nan_to_num(high[around_law][0] if around_law.any() else high[0]))
            if not limit or self._confirm(replace(law, stiffness_n_per_m=limit * _JUST_BELOW)):
                break
        return limit

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
            edges = self._edges(law, stable, unstable)
            edges[0] *= stiffness > 0 or first != 1  # without k and b there is no law
            ends = [replace(law, damping_ns_per_m=0.0, local_damping_ns_per_m=float(edge)) for edge in edges]
            if self._confirm(*ends):
                break
        low, high = edges - law.local_damping_ns_per_m
        return None if high < 0 else (max(float(low), 0.0), float(high))

    def _dampers_ns_per_m(self, law: SpringDamper) -> FloatArray:
        """Return the dampers of a scan: 0, that of the law, and up to four times m/T or twice the device's own.

        Behind a filter of pole p dampers may be (1 + p)/(1 - p) larger.
        """
        pole = law.pole(self.period)
        drag = max(device.damping_ns_per_m for device in self.family.devices)
        largest = 4 * max(self.family.heaviest_kg / self.period, 2 * drag) * (1 + pole) / (1 - pole)
        return np.unique([0.0, law.damper_ns_per_m, *(np.geomspace(1e-5, 1.0, 81) * largest)])

    def _edges(self, law: SpringDamper, stable: FloatArray, unstable: FloatArray) -> FloatArray:
        """Return the last stable dampers between stable and unstable ones, ever closer to these."""
        for _ in range(5):
            between = np.linspace(stable, unstable, 17)
            holds = self._walls(law, between.ravel()).holds(law.stiffness_n_per_m).reshape(between.shape)
            row = np.maximum(holds.argmin(axis=0) - 1, 0)
            stable = between[row, [0, 1]]
            unstable = between[row + 1, [0, 1]]
        return stable


def _radius(loop: OpenLoop) -> FloatArray:
    return loop.closed.radius


def _lack_of_damping(loop: OpenLoop) -> FloatArray:
    return np.asarray(1 - damping_ratios(loop.poles).min(axis=1))


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
        intervals: of a law with other pieces, by key the values at which it is stable with the others kept; None: none.
        largest_common_gain: up to which a factor on all of its forces holds; 0 where none does.

    Example:
        >>> avc.certify_law("knob", k=1.0, b=0.002, remedies=False).stable
        True
    """

    problem: Problem
    law: SpringDamper | ControlLaw | StatedSystem
    held: CaseResult
    released: CaseResult | None
    free: CaseResult | None
    largest_stiffness_n_per_m: float
    damping_range_ns_per_m: tuple[float, float] | None
    largest_local_damping_ns_per_m: float | None
    static_stiffness_n_per_m: float
    rendered_n_per_m: dict[float, float]
    encoder_step_n: float
    noise_n: float
    quiet_n: float
    remedies: tuple[LawRemedy, ...] | None
    intervals: Mapping[str, tuple[float, float] | None] | None = None
    largest_common_gain: float | None = None

    @property
    def cases(self) -> tuple[CaseResult, ...]:
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
        return worded(self, self.problem.units)

    @property
    def beyond(self) -> BeyondLimit:
        """The number of an unstable law that is beyond a limit: b_p outside the wall first, then b, then k."""
        law = self.law
        if not isinstance(law, SpringDamper):
            return nearest_limit(law, self.intervals or {}, self.problem.device.sample_time_s)
        k, b, b_p = law.stiffness_n_per_m, law.damping_ns_per_m, law.local_damping_ns_per_m
        if self.free is not None and not self.free.stable and self.largest_local_damping_ns_per_m is not None:
            return BeyondLimit(
                LimitSide.ABOVE_OUTSIDE, "local_damping_ns_per_m", b_p, self.largest_local_damping_ns_per_m
            )
        if self.damping_range_ns_per_m is None:
            return BeyondLimit(LimitSide.NONE_STABLE, "damping_ns_per_m")
        low, high = self.damping_range_ns_per_m
        if b > high:
            return BeyondLimit(LimitSide.ABOVE, "damping_ns_per_m", b, high)
        if b < low:
            return BeyondLimit(LimitSide.BELOW, "damping_ns_per_m", b, low)
        return BeyondLimit(LimitSide.ABOVE, "stiffness_n_per_m", k, self.largest_stiffness_n_per_m)

    def __repr__(self) -> str:
        return f"LawCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "quiet": self.quiet}
        rendered = {f"at_{hz:g}_hz_n_per_m": value for hz, value in self.rendered_n_per_m.items()}
        own = {"problem": self.problem.name, "deployable": {**verdict, "reason": self.reason}, "rendered": rendered}
        of_pieces = ("intervals", "largest_common_gain") if isinstance(self.law, SpringDamper) else ()
        left_out = ("problem", "rendered_n_per_m", *of_pieces)
        numbers = {key: value for key, value in vars(self).items() if key not in left_out}
        if not isinstance(self.law, SpringDamper):
            numbers["law"] = self.law.document()
        return self.problem.units.document(plain({"schema": "avc/1", "kind": "law", **own, **numbers}))


def certify_law(
    problem: AnyProblem,
    *,
    k: float | None = None,
    b: float | None = None,
    b_p: float | None = None,
    cutoff_hz: float | None = None,
    law: Any = None,
    remedies: bool = True,
) -> LawCertificate:
    """Judge your own law, force = -(k x + (b + b_p) v) or the table `[law]` of the problem, on a device.

    The wall of the problem is not used, but for where a virtual mass and b_p act: outside it too.

    Args:
        problem: device and hands: a problem, its file or name, or a device file or its name.
        k: spring, N/m; N.m/rad of a device that turns.
        b: damper in the wall, N.s/m or N.m.s/rad.
        b_p: damper that acts outside the wall too.
        cutoff_hz: of a first-order filter of the velocity; None: no filter.
        remedies: look for what would help too, of a plain law: k, b, b_p and the filter.
        law: in place of the table `[law]` of the problem: its keys as a dict, or a discrete system C(z) with attributes
            A, B, C, D and dt, as of python-control or SciPy; force = -C(z) x. k, b, b_p and cutoff_hz replace its own.

    Raises:
        InputError: a value that is refused, another dt than the sample time, or neither spring nor damper.
        UnsupportedError: nothing has a mass, more than 32 samples of delay, or the problem couples to another end.

    Example:
        >>> law = avc.certify_law("knob", k=1.0, b=0.002)
        >>> law.passed, round(law.held.damping_ratio, 2)
        (False, 0.06)
    """
    stated = require_wall(law_problem(problem))
    if is_system(law):
        if any(gain is not None for gain in (k, b, b_p, cutoff_hz)):
            raise InputError.of("is a discrete system, which has no k, b, b_p or cutoff_hz; leave them out", key="law")
        return _certify_pieces(StatedSystem.of(law, stated.device), None, stated)
    if law is None and stated.law is None and not (b_p or 0.0) < 0:
        return _certify_spring_damper(SpringDamper(k or 0.0, b or 0.0, b_p or 0.0, cutoff_hz), stated, remedies)
    wall = stated.environment
    # A law in a file without a wall acts everywhere, on both sides; k and b that are typed act in a wall.
    one_sided = (law is None and stated.law is None) or bool(wall.stiffness_n_per_m or wall.damping_ns_per_m)
    stated = with_law(stated, law, {"k": k, "b": b, "b_p": b_p, "cutoff_hz": cutoff_hz})
    own = stated.law
    assert own is not None  # noqa: S101 - with_law gives one
    if own.is_spring_damper:
        return _certify_spring_damper(_spring_damper(own, one_sided=one_sided), stated, remedies)
    outside = StatedSystem(own.outside(stated.device.sample_time_s)) if one_sided and own.acts_outside else None
    return _certify_pieces(own, outside, stated)


def _spring_damper(law: ControlLaw, *, one_sided: bool) -> SpringDamper:
    """Return a law of k, b, b_p and a filter as one; where it acts everywhere, b and b_p are the same."""
    dampers = law.damping_ns_per_m, law.local_damping_ns_per_m
    b, b_p = dampers if one_sided else (sum(dampers), 0.0)
    return SpringDamper(law.stiffness_n_per_m, b, b_p, getattr(law.velocity, "cutoff_hz", None))


def _certify_pieces(own: ControlLaw | StatedSystem, outside: StatedSystem | None, problem: Problem) -> LawCertificate:
    """Judge any law in contact and outside: the interval of each of its numbers by bisection on the worst case."""
    _require_known_delay(problem)
    analysis = LawAnalysis(problem)
    device = problem.device
    limits = LawLimits(analysis.family)
    intervals = limits.of_numbers(own, one_sided=outside is not None)
    in_contact = own.law(device.sample_time_s)
    acting = [in_contact] if outside is None else [in_contact, outside.stated]
    held, *released = (analysis.case(own, side) for side in analysis.sides)
    free = [] if outside is None else [analysis.case(outside, side) for side in analysis.sides]
    largest = limits.interval(_COMMON_GAIN, lambda gain: [law.times(gain) for law in acting])
    static = static_gain(in_contact)
    return LawCertificate(
        problem=problem,
        law=own,
        held=held,
        released=released[0] if released else None,
        free=min(free, key=lambda case: (case.stable, case.margins.disk), default=None),
        largest_stiffness_n_per_m=(intervals.get("stiffness_n_per_m") or (0.0, 0.0))[1],
        damping_range_ns_per_m=intervals.get("damping_ns_per_m"),
        largest_local_damping_ns_per_m=(intervals.get("local_damping_ns_per_m") or (0.0, None))[1],
        static_stiffness_n_per_m=static if math.isinf(static) else stiffness_at_handle(device, static),
        rendered_n_per_m=rendered_n_per_m(in_contact),
        encoder_step_n=abs(float(in_contact.d[0, 0])) * device.encoder_resolution_m,
        noise_n=noise_n(own, device),
        quiet_n=analysis.quiet_n,
        remedies=None,
        intervals=intervals,
        largest_common_gain=(largest or (0.0, 0.0))[1],
    )


def _certify_spring_damper(law: SpringDamper, stated: Problem, remedies: bool) -> LawCertificate:
    """Judge a spring and damper: k and b by D-decomposition, and what would help."""
    b_p, device = valid_law(law, stated).local_damping_ns_per_m, stated.device
    state_space = law.law(device.sample_time_s)
    analysis = LawAnalysis(stated)
    held, *released = (analysis.case(law, side) for side in analysis.sides)
    outside = [analysis.case(law.outside, side) for side in analysis.sides if b_p]
    only_local = analysis.damping_range(SpringDamper(0.0, b_p)) if b_p else None
    certificate = LawCertificate(
        problem=stated,
        law=law,
        held=held,
        released=released[0] if released else None,
        free=min(outside, key=lambda case: (case.stable, case.margins.disk), default=None),
        largest_stiffness_n_per_m=analysis.largest_stiffness(law),
        damping_range_ns_per_m=analysis.damping_range(law),
        largest_local_damping_ns_per_m=(only_local or (0.0, 0.0))[1] if b_p else None,
        static_stiffness_n_per_m=stiffness_at_handle(device, law.stiffness_n_per_m),
        rendered_n_per_m=rendered_n_per_m(state_space),
        encoder_step_n=float(state_space.d[0, 0]) * device.encoder_resolution_m,
        noise_n=noise_n(law, device),
        quiet_n=analysis.quiet_n,
        remedies=() if remedies else None,
    )
    if not remedies or (certificate.passed and certificate.disk_margin >= SOUND_DISK and certificate.quiet):
        return certificate
    return replace(certificate, remedies=tuple(_remedies(law, stated, analysis)))


def law_problem(source: AnyProblem) -> Problem:
    """Return a problem, or a device file as one without a wall."""
    if isinstance(source, str | Path) and is_device(str(source)):
        file = load_device(source)
        nothing = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
        return Problem(name=file.name, title=file.title, device=file.device, environment=nothing)
    return load_any(source)


def valid_law(law: SpringDamper, problem: Problem) -> SpringDamper:
    """Return the law if its numbers are allowed."""
    gains = {"k": law.stiffness_n_per_m, "b": law.damping_ns_per_m, "b_p": law.local_damping_ns_per_m}
    allowed = "is {:g}; allowed: 0 or a positive finite number"
    faults = {key: allowed.format(value) for key, value in gains.items() if not (math.isfinite(value) and value >= 0)}
    if law.cutoff_hz is not None and not (math.isfinite(law.cutoff_hz) and law.cutoff_hz > 0):
        faults["cutoff_hz"] = f"is {law.cutoff_hz:g}; allowed: a positive finite number"
    if not faults and not any(gains.values()):
        faults["k"] = "is 0, and so are b and b_p; give at least one of them"
    if faults:
        raise InputError([Fault("", None, key, message) for key, message in faults.items()])
    _require_known_delay(problem)
    return law


def _require_known_delay(problem: Problem) -> None:
    slowest = PlantFamily.of(problem).largest_delay_samples
    if slowest > MAX_DELAY_SAMPLES:
        limit = f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {slowest:g}"
        raise UnsupportedError(limit, key="device.delay_samples")


def _remedies(law: SpringDamper, problem: Problem, analysis: LawAnalysis) -> Iterator[LawRemedy]:
    """Yield the fewest changes that leave a sound disk margin and no noise that is felt, each as its loop shows."""
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
