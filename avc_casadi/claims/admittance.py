"""An admittance law on its device: stable with every hand and contact, by how much, its limits, and what would help.

The loop is broken where the velocity is commanded. Each number is the worst over what the handle may carry
(`loops.handle`): released, in a hand, pressed against a contact by a hand, leaning on a contact.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi.claims.contact_limit import ContactLimit
from avc_casadi.claims.handle_port import HandlePassivity, passivity
from avc_casadi.claims.law_limits import BeyondLimit, LawLimits, LimitSide, stacked
from avc_casadi.claims.sensor_motion import drift, velocity_noise
from avc_casadi.claims.stated_law import AnyLaw
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance, label_of
from avc_casadi.loops.damped_wall import RINGS_BELOW
from avc_casadi.loops.handle import Handle, HandleFamily, HandleSide, Pair, leading_poles, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK, Margins, OpenLoop, damping_ratios
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance
from avc_casadi.model.control_law import LawNumber
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.sensed import SensorProblem
from avc_casadi.model.table import shown

CHANGE_FACTORS: FloatArray = np.geomspace(1.0, 30.0, 13)[1:]
"""Factors by which a number is changed to find what would help."""
# Bisections of a change, to about a per cent.
_REFINEMENTS = 5
# Cases of a handle that touches nothing: held and released.
_WITHOUT_CONTACT = 2
DELAY_SHARES = (0.75, 0.5, 0.25, 0.0)
"""Shares of a delay that are looked at."""
# Limits that a certificate looks for: of mass, damping and contact.
_LIMITS = 3
# A pole within this share of the frequency of the handle on its sensor is its swing, if it keeps this share of decay.
_NEAR_SENSOR = 0.2
_KEPT_DECAY = 0.5
# By so much a change must raise the damping ratio of a law that rings, where none is enough.
_MORE_DAMPING = 2.0
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
        law_damping_ratio: the smallest of swings that a law can damp: not that of the handle on its sensor, where the
            drive hardly moves (`swings_of_law`).
    """

    handle: Handle
    spectral_radius: float
    frequency_hz: float
    stable: bool
    damping_ratio: float
    damping_ratio_hz: float
    law_damping_ratio: float
    law_damping_ratio_hz: float
    margins: Margins
    hand: dict[str, float]
    contact: dict[str, float]


@dataclass(frozen=True)
class AdmittanceRemedy:
    """One change of a law or device, and what its loops have then: the disk margin and the smallest damping ratio."""

    key: str
    value: float
    disk_margin: float
    damping_ratio: float


class SensorAnalysis:
    """The plants of a problem of a device with a force sensor around any of its laws."""

    def __init__(self, problem: SensorProblem, worst: Sequence[Hand] = ()) -> None:
        """Set up device, hands and contacts at the corners of their ranges; `worst` hands join with every device."""
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

    def rough_damping_ratio(self, law: AnyLaw) -> float:
        """Return the smallest damping ratio of a law at the points so far."""
        poles = OpenLoop.around(plants_of(self.pairs), law.law(self.period_s)).poles
        return float(damping_ratios(np.where(swings_of_law(poles, self.pairs), poles, 0.0)).min())

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
        """Return poles, damping ratios, margins and worst hand of a law on one side: hand, contact or released."""
        state_space = law.law(self.period_s)
        measures = (leading_poles(state_space), _lack_of_damping(state_space), _swings(state_space))
        pairs = side.corner_pairs + [side.worst_case(measure).pair for measure in measures]
        loop = OpenLoop.around(plants_of(pairs), state_space)
        sizes = np.abs(loop.poles)
        ratios = damping_ratios(loop.poles)
        of_law = damping_ratios(np.where(swings_of_law(loop.poles, pairs), loop.poles, 0.0))
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
            law_damping_ratio=float(of_law.min()),
            law_damping_ratio_hz=float(hz[of_law.argmin()]) if of_law.min() < 1 else 0.0,
            margins=loop.least(),
            hand=hand,
            contact=contact,
        )

    def stiffest_contact_n_per_m(self, law: AnyLaw) -> float:
        """Return the stiffest contact up to which every contact is stable; infinite without a limit, 0 where none is.

        Contacts have the declared damping. Up to the limit every hand is judged with every softer contact.
        """
        return ContactLimit(self.problem, law.law(self.period_s)).find()


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


def swings_of_law(poles: ComplexArray, pairs: Sequence[Pair]) -> BoolArray:
    """Return which poles (pairs, s) are not those of the handle's swing on its sensor, as with a drive that stands.

    Such a swing, of (m_s + m) d2x/dt2 + (b_s + b) dx/dt + (k_s + k) x = 0, no law damps. It counts as one of the law
    where the law takes more than half of its decay away.
    """
    standing = []
    for device, hand in pairs:
        sensor, (mass, damping, stiffness) = device.force_sensor, (float(value[0]) for value in vars(hand).values())
        whole_kg = sensor.handle_mass_kg + mass
        decay = (sensor.damping_ns_per_m + damping) / (2 * whole_kg)
        square = (sensor.stiffness_n_per_m + stiffness) / whole_kg - decay**2
        standing.append(np.exp((-decay + 1j * math.sqrt(max(square, 0.0))) * device.sample_time_s))
    alone = np.array(standing)[:, None]
    # A swing that turns by more than half a turn in a sample is seen at another frequency.
    turn, turn_alone = np.abs(np.angle(poles)), np.abs(np.angle(alone))
    near = np.abs(turn - turn_alone) < _NEAR_SENSOR * turn_alone
    kept = np.log(np.maximum(np.abs(poles), np.finfo(np.float64).tiny)) < _KEPT_DECAY * np.log(np.abs(alone))
    return np.asarray(~(near & kept))


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
        damped_by: of a law that rings, single changes with which it does not; the one that damps it most where none is
            enough. None where none was looked for.
    """

    cases: tuple[HandleCase, ...]
    stiffest_contact_n_per_m: float
    passivity: HandlePassivity
    damped_by: tuple[AdmittanceRemedy, ...] | None

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
    def least_damped(self) -> HandleCase:
        """The case with the smallest damping ratio of a swing that a law can damp."""
        return min(self.cases, key=lambda case: case.law_damping_ratio)

    @property
    def rings(self) -> bool:
        """Whether it is stable, and a swing leaves more than a quarter of its size to the next one."""
        return self.stable and self.least_damped.law_damping_ratio < RINGS_BELOW

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
        rings = f"; its damping ratio is {self.least_damped.law_damping_ratio:.2g}" if self.rings else ""
        return f"stable with every hand{' and contact' if self.touches else ''}, and released{rings}"


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
        return worded(self.beyond, self.problem.units)

    @property
    def beyond(self) -> BeyondLimit:
        """The number of an unstable law that is beyond a limit: the mass first, then the damping."""
        for key, value, stable in (
            ("admittance.mass_kg", self.law.mass_kg, self.mass_range_kg),
            ("admittance.damping_ns_per_m", self.law.damping_ns_per_m, self.damping_range_ns_per_m),
        ):
            if stable is not None:
                return BeyondLimit.of(key, value, stable)
        return BeyondLimit(LimitSide.NONE_STABLE)

    def __repr__(self) -> str:
        return f"AdmittanceCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "reason": self.reason}
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "law")}
        stated = {"problem": self.problem.name, "law": {"admittance": self.law.model_dump()}, "deployable": verdict}
        return self.problem.units.document(plain({**stated, **numbers}))


def unstable_at_corners_hz(problem: AdmittanceProblem, law: VirtualImpedance) -> float | None:
    """Return where a law swings that is unstable at a corner of the ranges; None where none is, without a search."""
    analysis = HandleAnalysis(problem)
    poles = OpenLoop.around(plants_of(analysis.pairs), law.law(analysis.period_s)).poles
    worst = complex(poles.flat[int(np.abs(poles).argmax())])
    if abs(worst) < 1 - RADIUS_TOLERANCE:
        return None
    return abs(float(np.angle(worst))) / (2 * math.pi * analysis.period_s)


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
    if law is not None and not isinstance(law, Mapping):
        raise InputError.of(f"is {shown(law)}; allowed: keys of [law] admittance, as a dict", key="law")
    if law:
        stated = stated.changed(law={"admittance": dict(law)})
    if stated.law is None:
        allowed = "allowed: [law] with admittance = { mass_kg, damping_ns_per_m }, or these values"
        raise InputError.of(f"is missing; {allowed}", file=label_of(problem), key="law")
    judged_law = stated.law.admittance
    analysis = HandleAnalysis(stated)
    ways = tuple(_ways(judged_law, stated)) if remedies else ()
    stages = Stages(progress, len(analysis.family.sides) + _LIMITS + len(ways))
    certificate = _judged(analysis, judged_law, stages, limits=limits)
    if not remedies:
        return certificate
    changes = []
    for way in () if certificate.passed and certificate.disk_margin >= SOUND_DISK else ways:
        stages.begin(f"another {way.key}")
        changes.append(_least_change(analysis, way))
    damped = damping_changes(analysis, judged_law) if certificate.passed and certificate.rings else ()
    return replace(certificate, remedies=tuple(remedy for remedy in changes if remedy is not None), damped_by=damped)


def _judged(analysis: HandleAnalysis, law: VirtualImpedance, stages: Stages, *, limits: bool) -> AdmittanceCertificate:
    """Return the verdict on a law on every side of the handle, with its limits where asked for, without remedies."""
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
        damped_by=None,
    )


@dataclass(frozen=True)
class Way:
    """Values of a number, the nearest to its own first, and what a value makes of law and problem.

    Attributes:
        from_value: its own value; None where a value between two of them means nothing.
    """

    key: str
    from_value: float | None
    values: tuple[float, ...]
    made: Callable[[float], tuple[Any, Any]]


def _ways(law: VirtualImpedance, problem: AdmittanceProblem) -> Iterator[Way]:
    """Yield changes of one number of law or device that may help, each with its values, the least change first."""
    device = problem.device
    factors = CHANGE_FACTORS

    def of_law(key: str) -> Callable[[float], tuple[VirtualImpedance, AdmittanceProblem]]:
        return lambda value: (law.with_number(key, value), problem)

    def of_device(key: str) -> Callable[[float], tuple[VirtualImpedance, AdmittanceProblem]]:
        return lambda value: (law, with_device_value(problem, key, value))

    for key in ("mass_kg", "damping_ns_per_m"):
        value = getattr(law, key)
        for direction in (1, -1) if value else ():
            yield Way(key, value, tuple((value * factors**direction).tolist()), of_law(key))
    fastest_hz = law.cutoff_hz or 0.4 / device.sample_time_s
    yield Way("cutoff_hz", fastest_hz, tuple((fastest_hz / factors).tolist()), of_law("cutoff_hz"))
    if law.cutoff_hz is not None:
        yield Way("cutoff_hz", law.cutoff_hz, tuple((law.cutoff_hz * factors).tolist()), of_law("cutoff_hz"))
    delays = tuple(device.delay_samples * share for share in DELAY_SHARES if device.delay_samples)
    yield Way("delay_samples", None, delays, of_device("delay_samples"))
    yield Way("sample_time_s", None, (device.sample_time_s / 2,), of_device("sample_time_s"))
    scaled = (
        ("drive_bandwidth_hz", 1),
        ("sensor_stiffness_n_per_m", 1),
        ("sensor_stiffness_n_per_m", -1),
        ("handle_mass_kg", -1),
    )
    for key, direction in scaled:
        value = device.value(key)
        yield Way(key, value, tuple((value * factors**direction).tolist()), of_device(key))


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


def _least_change(analysis: HandleAnalysis, way: Way) -> AdmittanceRemedy | None:
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
            ratio = analyses[best].rough_damping_ratio(way.made(best)[0])
            return AdmittanceRemedy(way.key, best, disk, ratio)
        before = None if before is None else value
    return None


def damping_changes(analysis: HandleAnalysis, law: VirtualImpedance) -> tuple[AdmittanceRemedy, ...]:
    """Return the changes of an admittance law and its device with which the law does not ring."""
    return changes_that_damp(analysis, law, _ways(law, analysis.problem))


def changes_that_damp(analysis: SensorAnalysis, law: AnyLaw, ways: Iterable[Way]) -> tuple[AdmittanceRemedy, ...]:
    """Return the first value of each number with which a law does not ring and has a sound disk margin.

    Where there is none, that is the change with the largest damping ratio, if it is twice as large as now.
    """
    enough, best = [], None
    for way in ways:
        for value in way.values:
            changed, problem = way.made(value)
            judged = analysis if problem is analysis.problem else analysis.changed(problem)
            ratio, disk = judged.rough_damping_ratio(changed), judged.rough_margin(changed)
            if disk < _SOUND_ROUGHLY:
                continue
            remedy = AdmittanceRemedy(way.key, float(f"{value:.3g}"), disk, ratio)
            if ratio >= RINGS_BELOW:
                enough.append(remedy)
                break
            best = remedy if best is None or ratio > best.damping_ratio else best
    if enough:
        return tuple(enough)
    helps = best is not None and best.damping_ratio >= _MORE_DAMPING * analysis.rough_damping_ratio(law)
    return (best,) if best is not None and helps else ()


def _refined(margin: Callable[[float], float], thin: float, sound: float) -> float:
    """Return the value nearest to `thin` whose disk margin `margin(value)` is sound, to a per cent, by bisection."""
    for _ in range(_REFINEMENTS):
        middle = math.sqrt(thin * sound)
        if margin(middle) >= _SOUND_ROUGHLY:
            sound = middle
        else:
            thin = middle
    rounded = float(f"{sound * (1 + math.copysign(5e-3, sound - thin)):.3g}")
    return rounded if margin(rounded) >= _SOUND_ROUGHLY else sound
