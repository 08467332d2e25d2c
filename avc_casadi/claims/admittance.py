"""An admittance law on its device: stable with every hand and contact, by how much, its limits, and what would help.

The loop is broken where the velocity is commanded. Each number is the worst over what the handle may carry
(`loops.handle`): released, in a hand, pressed against a contact by a hand, leaning on a contact.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi._util.text import quantity
from avc_casadi.claims.handle_port import HandlePassivity, passivity
from avc_casadi.claims.law_limits import LawLimits, stacked
from avc_casadi.claims.sensor_motion import drift, velocity_noise
from avc_casadi.claims.stated_law import AnyLaw
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance, label_of
from avc_casadi.loops.handle import Handle, HandleFamily, HandleSide, Pair, leading_poles, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import (
    STIFFEST_CONTACT_N_PER_M,
    AdmittanceProblem,
    Contact,
    VirtualImpedance,
)
from avc_casadi.model.control_law import LawNumber
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.sensed import SensorProblem

Interval = tuple[float, float]

# A limit is confirmed by at most so many searches of the ranges, so far inside the boundary.
_SEARCHES = 4
_JUST_INSIDE = 1e-6
# Contacts of a scan: from the softest on, so many to a decade, and bisections between two of them.
_SOFTEST_CONTACT_N_PER_M = 1.0
_CONTACTS_PER_DECADE = 12
_BISECTIONS = 40
# Changes that are looked at: up to this factor, in so many steps; then bisections to about a per cent.
_MOST_CHANGE = 30.0
_CHANGES = 12
_REFINEMENTS = 5
# Cases of a handle that touches nothing: held and released.
_WITHOUT_CONTACT = 2
# Shares of a delay that are looked at.
_DELAY_SHARES = (0.75, 0.5, 0.25, 0.0)
# Limits that a certificate looks for: of mass, damping and contact.
_LIMITS = 3
# A rough disk margin is right to a per cent.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK


@dataclass(frozen=True)
class HandleCase:
    """The loop with what the handle carries; each number the worst found.

    Attributes:
        handle: held, pressed, leaning or released.
        hand: the hand with the smallest disk margin, or of an unstable loop with the largest spectral radius; all 0
            without one.
        contact: what it touches then; all 0 without one.
    """

    handle: Handle
    spectral_radius: float
    frequency_hz: float
    stable: bool
    damping_ratio: float
    damping_ratio_hz: float
    margins: Margins
    hand: dict[str, float]
    contact: dict[str, float]


@dataclass(frozen=True)
class AdmittanceRemedy:
    """One change that makes the law deployable, as its loops show: key, value, and the disk margin then."""

    key: str
    value: float
    disk_margin: float


class SensorAnalysis:
    """The plants of a problem of a device with a force sensor around any of its laws."""

    def __init__(self, problem: SensorProblem, worst: Sequence[Hand] = ()) -> None:
        self.problem = problem
        self.family = HandleFamily.of(problem)
        self.period_s = problem.device.sample_time_s
        corners = [pair for side in self.family.sides for pair in side.corner_pairs]
        devices = self.family.sides[0].devices
        # What searches found worse than the corners joins these.
        self.pairs: list[Pair] = corners + [(device, hand) for device in devices for hand in worst]
        self._corners = len(corners)

    @property
    def worst_hands(self) -> list[Hand]:
        """What the handle carries where a search found a loop that is worse than those of the corners."""
        return [hand for _, hand in self.pairs[self._corners :]]

    def changed(self, problem: SensorProblem) -> Self:
        """Return the analysis of another device, which begins with what was the worst of this one."""
        return type(self)(problem, self.worst_hands)

    def rough_margin(self, law: AnyLaw) -> float:
        """Return the disk margin of a law to a per cent, at the points so far; 0 where one is unstable."""
        return OpenLoop.around(plants_of(self.pairs), law.law(self.period_s)).quick_disk_margin

    def confirmed_margin(self, law: AnyLaw) -> float:
        """Return the disk margin of a law after a search of the ranges, whose worst points are kept."""
        measure = _swings(law.law(self.period_s))
        self.pairs += [side.worst_case(measure).pair for side in self.family.sides if side.handle != "released"]
        return self.rough_margin(law)

    def refusing(self, law: AnyLaw, *, sound: bool) -> list[Pair]:
        """Return where a search of the ranges finds that a law is unstable, or that its disk margin is not sound."""
        state_space = law.law(self.period_s)
        measure, limit = (_swings(state_space), 2 / SOUND_DISK) if sound else (leading_poles(state_space), 1.0)
        worst = [side.worst_case(measure) for side in self.family.sides if side.handle != "released"]
        return [case.pair for case in worst if case.radius >= limit]

    def is_sound(self, law: AnyLaw, limit: float) -> bool:
        """Return whether the disk margin is at least a limit, as a search of the ranges finds it."""
        return self.rough_margin(law) >= limit and self.confirmed_margin(law) >= limit

    def case(self, law: AnyLaw, side: HandleSide) -> HandleCase:
        """Return the worst of each number, at the corners of the ranges and at the worst points of a search."""
        state_space = law.law(self.period_s)
        measures = (leading_poles(state_space), _lack_of_damping(state_space), _swings(state_space))
        pairs = side.corner_pairs + [side.worst_case(measure).pair for measure in measures]
        loop = OpenLoop.around(plants_of(pairs), state_space)
        sizes = np.abs(loop.poles)
        ratios = damping_ratios(loop.poles)
        hz = np.abs(np.angle(loop.poles)).ravel() / (2 * math.pi * self.period_s)
        stable = float(sizes.max()) < 1 - RADIUS_TOLERANCE
        worst = loop.swings() if stable else sizes.max(axis=1)
        hand, contact = side.parts(pairs[int(worst.argmax())][1].values(0))
        self.pairs += pairs[len(side.corner_pairs) :] if side.handle != "released" else []
        return HandleCase(
            handle=side.handle,
            spectral_radius=float(sizes.max()),
            frequency_hz=float(hz[sizes.argmax()]),
            stable=stable,
            damping_ratio=float(ratios.min()),
            damping_ratio_hz=float(hz[ratios.argmin()]) if ratios.min() < 1 else 0.0,
            margins=loop.least(),
            hand=hand,
            contact=contact,
        )

    def stiffest_contact_n_per_m(self, law: AnyLaw) -> float:
        """Return the stiffest contact up to which every contact is stable; infinite without a limit, 0 where none is.

        Contacts have the declared damping. Up to the limit every hand is judged with every softer contact.
        """
        return _ContactLimit(self.problem, law.law(self.period_s)).find()


class HandleAnalysis(SensorAnalysis):
    """The plants of an admittance problem around any of its laws."""

    problem: AdmittanceProblem

    def interval(self, law: VirtualImpedance, key: str) -> Interval | None:
        """Return the interval of a number of the law in which it is stable with the others kept; None: there is none.

        Of a number that is 0 now the interval is that about 1, for the scan needs a size to begin with.
        """
        number = LawNumber((key,), getattr(law, key) or 1.0)
        changed = LawLimits(self.family, measure=leading_poles)

        def laws_of(values: FloatArray) -> list[Law]:
            return [stacked([law.with_number(key, value).law(self.period_s) for value in values.tolist()])]

        return changed.interval(number, laws_of)


@dataclass(frozen=True)
class _ContactLimit:
    """The stiffest contact that a law is stable with: a scan of contacts at the corners of the rest, then searches."""

    problem: SensorProblem
    law: Law

    def find(self) -> float:
        """Return the limit; infinite where the stiffest that a file may state is stable, 0 where no contact is."""
        rest = [pair for side in self._touching((0.0, 0.0)) for pair in side.corner_pairs]
        stiffnesses = self._scan()
        limit = 0.0
        for _ in range(_SEARCHES):
            limit = self._first_unstable(rest, stiffnesses)
            if not limit:
                break
            worst = [
                side.worst_case(leading_poles(self.law)) for side in self._touching((0.0, limit * (1 - _JUST_INSIDE)))
            ]
            sides = self._touching((0.0, limit))
            unstable = [(side, case) for side, case in zip(sides, worst, strict=True) if case.radius >= 1]
            if not unstable:
                break
            for side, case in unstable:
                hand, contact = side.parts(case.hand)
                sums = {key: np.array([hand[key] + contact[key]]) for key in hand}
                sums["stiffness_n_per_m"] = np.array([hand["stiffness_n_per_m"]])
                rest.append((case.device, Hand(**sums)))
                stiffnesses = np.union1d(stiffnesses, [contact["stiffness_n_per_m"]])
        return math.inf if limit >= STIFFEST_CONTACT_N_PER_M else limit

    def _scan(self) -> FloatArray:
        softest = _SOFTEST_CONTACT_N_PER_M * self.problem.device.metres_per_unit**2
        decades = math.log10(STIFFEST_CONTACT_N_PER_M / softest)
        scan = np.geomspace(softest, STIFFEST_CONTACT_N_PER_M, 1 + math.ceil(decades * _CONTACTS_PER_DECADE))
        return np.append(0.0, scan)

    def _touching(self, stiffness_n_per_m: Interval) -> list[HandleSide]:
        """Return the sides with a contact of a range of springs and of the declared dampers."""
        problem = self.problem
        contact = Contact(stiffness_n_per_m=(0.0, 1.0), damping_ns_per_m=problem.contact.damping_ns_per_m)
        contact = contact.model_copy(update={"stiffness_n_per_m": stiffness_n_per_m})
        return HandleFamily.touching(problem.device, problem.hands, contact)

    def _radii(self, rest: Sequence[Pair], stiffness_n_per_m: FloatArray) -> FloatArray:
        """Return the largest spectral radius with each contact."""
        pairs = [(device, _stiffer(hand, spring)) for spring in stiffness_n_per_m.tolist() for device, hand in rest]
        radii = OpenLoop.around(plants_of(pairs), self.law).closed.radius
        return np.asarray(radii.reshape(len(stiffness_n_per_m), -1).max(axis=1))

    def _first_unstable(self, rest: Sequence[Pair], stiffnesses: FloatArray) -> float:
        """Return the last stable contact before the first of a scan that is not, by bisection."""
        unstable = np.flatnonzero(self._radii(rest, stiffnesses) >= 1)
        if not unstable.size:
            return float(stiffnesses[-1])
        if not unstable[0]:
            return 0.0
        low, high = stiffnesses[unstable[0] - 1], stiffnesses[unstable[0]]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            stable = self._radii(rest, np.array([middle]))[0] < 1
            low, high = (middle, high) if stable else (low, middle)
        return float(low)


def _stiffer(hand: Hand, stiffness_n_per_m: float) -> Hand:
    """Return what the handle carries with a stiffer spring."""
    return replace(hand, stiffness_n_per_m=hand.stiffness_n_per_m + stiffness_n_per_m)


def _lack_of_damping(law: Law) -> Callable[[SampledPlant, object], ComplexArray]:
    def of_plants(plant: SampledPlant, _: object) -> ComplexArray:
        ratios = damping_ratios(closed(Body.of(plant).flat(), law).poles)
        return np.asarray(1 - ratios.min(axis=1), dtype=np.complex128)

    return of_plants


def _swings(law: Law) -> Callable[[SampledPlant, object], ComplexArray]:
    def of_plants(plant: SampledPlant, _: object) -> ComplexArray:
        return np.asarray(OpenLoop.around(plant, law).swings(), dtype=np.complex128)

    return of_plants


@dataclass(frozen=True, eq=False, repr=False)
class HandleVerdict(Printed):
    """Whether a law may run on a device with a force sensor, and by how much.

    Attributes:
        cases: the loop with what the handle carries: held, pressed and leaning where there is a contact, released.
        stiffest_contact_n_per_m: up to which every contact is stable; 0 where none is, infinite without a limit. Not a
            number where limits were not looked for.
        passivity: whether it is passive at the handle, which is more than stability with hands and contacts asks for.
    """

    cases: tuple[HandleCase, ...]
    stiffest_contact_n_per_m: float
    passivity: HandlePassivity

    @property
    def touches(self) -> bool:
        """Whether the handle is judged against a contact."""
        return len(self.cases) > _WITHOUT_CONTACT

    @property
    @abstractmethod
    def cause(self) -> str:
        """Which number of an unstable law is beyond which limit."""

    @property
    def worst(self) -> HandleCase:
        """The case with the largest spectral radius if one is unstable, else that with the smallest disk margin."""
        return max(
            self.cases, key=lambda case: (not case.stable, case.spectral_radius * (not case.stable), -case.margins.disk)
        )

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with every hand and contact, and released."""
        return all(case.stable for case in self.cases)

    @property
    def limited(self) -> bool:
        """Whether its limits were looked for."""
        return not math.isnan(self.stiffest_contact_n_per_m)

    @property
    def disk_margin(self) -> float:
        """The smallest disk margin of all cases."""
        return min(case.margins.disk for case in self.cases)

    @property
    def passed(self) -> bool:
        """Whether it may run: stable, with a disk margin of 0.15 or more."""
        return self.stable and self.disk_margin >= LEAST_DISK

    @property
    def deployable(self) -> bool:
        """Whether the law may run on the device, as the row *Deployable* says: the same as `passed`."""
        return self.passed

    @property
    def reason(self) -> str:
        """What decides, in one line."""
        if not self.stable:
            return f"unstable: {self.cause}"
        if self.disk_margin < SOUND_DISK:
            how = "thin" if self.passed else f"below {LEAST_DISK}"
            return f"stable, but a disk margin of {self.disk_margin:.2g} is {how}"
        return f"stable with every hand{' and contact' if self.touches else ''}, and released"


@dataclass(frozen=True, eq=False, repr=False)
class AdmittanceCertificate(HandleVerdict):
    """Whether an admittance law may run on its device, by how much, where its limits are, and what would help.

    Attributes:
        problem: device, hands and contact, with the law that is judged.
        mass_range_kg: the virtual masses that are stable with this damping; None where none is, or where limits were
            not looked for.
        damping_range_ns_per_m: the dampings that are stable with this mass; likewise.
        noise_m_per_s: largest rms speed of command, drive and handle at rest, of the noise and the steps of the sensor,
            with the judged hands and contacts and released; infinite where a loop is unstable.
        drift_m_per_s: velocity of a released handle whose reading is one step of the sensor off; infinite without
            damping, 0 on a spring.
        remedies: single changes that make it sound; None where none was looked for.

    Example:
        >>> avc.certify_admittance("admittance/cobot", remedies=False).stable
        True
    """

    problem: AdmittanceProblem
    law: VirtualImpedance
    mass_range_kg: Interval | None
    damping_range_ns_per_m: Interval | None
    noise_m_per_s: float
    drift_m_per_s: float
    remedies: tuple[AdmittanceRemedy, ...] | None

    @property
    def cause(self) -> str:
        """Which number of an unstable law is beyond which limit."""
        if not self.limited:
            return f"it swings at {self.worst.frequency_hz:.3g} Hz"
        unit = self.problem.units.unit
        mass, damping = self.law.mass_kg, self.law.damping_ns_per_m
        ranges = (
            ("mass", mass, self.mass_range_kg, unit("kg"), "damping"),
            ("damping", damping, self.damping_range_ns_per_m, unit("N.s/m"), "mass"),
        )
        for name, value, stable, symbol, other in ranges:
            if stable is None:
                continue
            is_low = value < stable[0]
            limit = quantity(stable[0] if is_low else stable[1], symbol)
            side = "least" if is_low else "largest"
            beyond = f"is {'below' if is_low else 'above'} the {side} at this {other}, {limit}"
            return f"{name} {quantity(value, symbol)} {beyond}"
        return "neither another mass at this damping nor another damping at this mass is stable"

    def __repr__(self) -> str:
        return f"AdmittanceCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "reason": self.reason}
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "law")}
        own = {"problem": self.problem.name, "law": {"admittance": self.law.model_dump()}, "deployable": verdict}
        return self.problem.units.document(plain({**own, **numbers}))


def certify_admittance(
    problem: AnyAdmittance,
    *,
    law: Mapping[str, Any] | None = None,
    remedies: bool = True,
    limits: bool = True,
    progress: Progress = SILENT,
) -> AdmittanceCertificate:
    """Judge the law of an admittance device: stable with every hand and contact, its limits, and what would help.

    Args:
        problem: an `AdmittanceProblem`, its file or name.
        law: keys of `[law] admittance` in place of those of the problem: mass_kg, damping_ns_per_m, stiffness_n_per_m,
            cutoff_hz.
        remedies: look for what would help too.
        limits: find the stable masses, dampings and contacts too.
        progress: told which stage begins.

    Raises:
        InputError: a value that is refused, or no law.

    Example:
        >>> heavy = avc.certify_admittance("admittance/cobot", law={"damping_ns_per_m": 20.0}, remedies=False)
        >>> heavy.passed
        False
    """
    stated = as_admittance(problem)
    if law:
        stated = stated.changed(law={"admittance": dict(law)})
    if stated.law is None:
        allowed = "allowed: [law] with admittance = { mass_kg, damping_ns_per_m }, or these values"
        raise InputError.of(f"is missing; {allowed}", file=label_of(problem), key="law")
    own = stated.law.admittance
    analysis = HandleAnalysis(stated)
    ways = tuple(_ways(own, stated)) if remedies else ()
    stages = Stages(progress, len(analysis.family.sides) + _LIMITS + len(ways))
    certificate = _judged(analysis, own, stages, limits=limits)
    if not remedies:
        return certificate
    found = []
    for way in () if certificate.passed and certificate.disk_margin >= SOUND_DISK else ways:
        stages.begin(f"another {way.key}")
        found.append(_least_change(analysis, way))
    return replace(certificate, remedies=tuple(remedy for remedy in found if remedy is not None))


def _judged(analysis: HandleAnalysis, law: VirtualImpedance, stages: Stages, *, limits: bool) -> AdmittanceCertificate:
    """Return the verdict on a law, and its limits, without remedies."""
    problem, cases = analysis.problem, []
    for side in analysis.family.sides:
        stages.begin(f"handle {side.handle}")
        cases.append(analysis.case(law, side))
    masses = dampings = None
    stiffest = math.nan
    if limits:
        stages.begin("stable masses")
        masses = analysis.interval(law, "mass_kg")
        stages.begin("stable dampings")
        dampings = analysis.interval(law, "damping_ns_per_m")
        stages.begin("stiffest contact")
        stiffest = analysis.stiffest_contact_n_per_m(law)
    return AdmittanceCertificate(
        problem=problem,
        law=law,
        cases=tuple(cases),
        mass_range_kg=masses,
        damping_range_ns_per_m=dampings,
        stiffest_contact_n_per_m=stiffest,
        noise_m_per_s=velocity_noise(law, problem.device, analysis.pairs),
        drift_m_per_s=drift(law, problem.device),
        passivity=passivity(analysis.family.sides[0].devices, law.law(analysis.period_s)),
        remedies=None,
    )


@dataclass(frozen=True)
class _Way:
    """Values of a number, the nearest to its own first, and what a value makes of law and problem.

    Attributes:
        from_value: its own value; None where a value between two of them means nothing.
    """

    key: str
    from_value: float | None
    values: tuple[float, ...]
    made: Callable[[float], tuple[VirtualImpedance, AdmittanceProblem]]


def _ways(law: VirtualImpedance, problem: AdmittanceProblem) -> Iterator[_Way]:
    device = problem.device
    factors = np.geomspace(1.0, _MOST_CHANGE, _CHANGES + 1)[1:]

    def of_law(key: str) -> Callable[[float], tuple[VirtualImpedance, AdmittanceProblem]]:
        return lambda value: (law.with_number(key, value), problem)

    def of_device(key: str) -> Callable[[float], tuple[VirtualImpedance, AdmittanceProblem]]:
        return lambda value: (law, with_device_value(problem, key, value))

    for key in ("mass_kg", "damping_ns_per_m"):
        value = getattr(law, key)
        for direction in (1, -1) if value else ():
            yield _Way(key, value, tuple((value * factors**direction).tolist()), of_law(key))
    fastest_hz = law.cutoff_hz or 0.4 / device.sample_time_s
    yield _Way("cutoff_hz", fastest_hz, tuple((fastest_hz / factors).tolist()), of_law("cutoff_hz"))
    if law.cutoff_hz is not None:
        yield _Way("cutoff_hz", law.cutoff_hz, tuple((law.cutoff_hz * factors).tolist()), of_law("cutoff_hz"))
    delays = tuple(device.delay_samples * share for share in _DELAY_SHARES if device.delay_samples)
    yield _Way("delay_samples", None, delays, of_device("delay_samples"))
    yield _Way("sample_time_s", None, (device.sample_time_s / 2,), of_device("sample_time_s"))
    scaled = (
        ("drive_bandwidth_hz", 1),
        ("sensor_stiffness_n_per_m", 1),
        ("sensor_stiffness_n_per_m", -1),
        ("handle_mass_kg", -1),
    )
    for key, direction in scaled:
        value = device.value(key)
        yield _Way(key, value, tuple((value * factors**direction).tolist()), of_device(key))


def with_device_value(problem: AdmittanceProblem, key: str, value: float) -> AdmittanceProblem:
    """Return a problem whose device has another value of a key, its range moved by the same factor."""
    device = problem.device
    if key == "sample_time_s":
        return problem.model_copy(update={"device": device.model_copy(update={key: value})})
    ranges = dict(device.ranges)
    interval = ranges.pop(key, None)
    changed = device.with_values(**{key: value})
    if interval is not None and device.value(key):
        factor = value / device.value(key)
        ranges[key] = (interval[0] * factor, interval[1] * factor)
    kept = device.range.model_copy(update={**dict.fromkeys(device.ranges), **ranges})
    return problem.model_copy(update={"device": changed.model_copy(update={"range": kept})})


def _least_change(analysis: HandleAnalysis, way: _Way) -> AdmittanceRemedy | None:
    """Return the least change of a number that leaves a sound disk margin, as its loops show; None where none does.

    The first sound one of its values is taken, by bisection towards the one before, and confirmed by a search.
    """
    analyses: dict[float, HandleAnalysis] = {}

    def margin(value: float, *, confirmed: bool = False) -> float:
        changed, problem = way.made(value)
        if problem is analysis.problem:
            analyses[value] = analysis
        elif value not in analyses:
            analyses[value] = analysis.changed(problem)
        judged = analyses[value]
        return judged.confirmed_margin(changed) if confirmed else judged.rough_margin(changed)

    before = way.from_value
    for value in way.values:
        if margin(value) < _SOUND_ROUGHLY:
            before = None if before is None else value
            continue
        best = value if before is None else _refined(margin, before, value)
        disk = margin(best, confirmed=True)
        if disk >= SOUND_DISK:
            return AdmittanceRemedy(way.key, best, disk)
        before = None if before is None else value
    return None


def _refined(margin: Callable[[float], float], thin: float, sound: float) -> float:
    """Return the value nearest to one that is thin which is sound, to about a per cent, rounded towards the sound."""
    for _ in range(_REFINEMENTS):
        middle = math.sqrt(thin * sound)
        if margin(middle) >= _SOUND_ROUGHLY:
            sound = middle
        else:
            thin = middle
    rounded = float(f"{sound * (1 + math.copysign(5e-3, sound - thin)):.3g}")
    return rounded if margin(rounded) >= _SOUND_ROUGHLY else sound
