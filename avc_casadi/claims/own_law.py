"""A law of one's own, force = -(k x + (b + b_p) v): stable with every hand and released, by how much, and its limits.

x is the measured position, v its backward difference behind a first-order filter where one is given; outside the wall
b_p alone acts. Each number is the worst over the ranges of hand and device, of the linear loop with what is declared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi.claims.deployable import DetentClaim, detent_claim
from avc_casadi.claims.friction import FrictionCredit, credited
from avc_casadi.claims.impedance import stiffness_at_handle
from avc_casadi.claims.law_analysis import CaseResult, LawAnalysis, LawRemedy, SpringDamper, remedies_of
from avc_casadi.claims.law_limits import BeyondLimit, LawLimits, LimitSide, NumberLaws, nearest_limit
from avc_casadi.claims.law_points import corner_points, radius, worst
from avc_casadi.claims.stated_law import (
    ActingLaws,
    AnyLaw,
    StatedSystem,
    acting_laws,
    at_own_rate,
    is_system,
    noise_n,
    rendered_n_per_m,
    static_gain,
    step_noise_n,
    with_law,
)
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import AnyProblem, is_device, load_any, require_wall
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.model import quantity as q
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.law import Law
from avc_casadi.model.problem import Impedance, Problem

# A factor on all forces of a law: that of no force at all is no law.
_COMMON_GAIN = LawNumber(("gain",), 1.0, 1e-4)
_ALLOWED = {"k": q.STIFFNESS, "b": q.DAMPING, "b_p": q.DAMPING, "cutoff_hz": q.HERTZ}
"""What a file allows of these numbers of a spring and damper."""
_TYPED = _ALLOWED | {"b_p": q.SIGNED_DAMPING}
"""What a table [law] allows of them: b_p may give back what the device's damping takes away."""


@dataclass(frozen=True, eq=False, repr=False)
class LawCertificate(Printed):
    """Whether a law of one's own holds on a device, by how much, where its limits are, and what would help.

    Attributes:
        released: without a hand; None where nothing has a mass then.
        free: b_p alone, outside the wall, the worse of held and released; None without b_p.
        lowest_stiffness_n_per_m: from which k on the law is stable at this b, up to the largest.
        largest_stiffness_n_per_m: up to which k is stable at this b; 0 where none is. Not a number where limits were
            not looked for.
        damping_range_ns_per_m: lowest and largest b that are stable at this k; None where none is, or where limits
            were not looked for.
        largest_local_damping_ns_per_m: up to which b_p holds outside the wall; None without b_p.
        static_stiffness_n_per_m: at rest, at the handle.
        rendered_n_per_m: magnitude of force over position at the handle, by frequency in Hz.
        encoder_step_n: change of the force by one step of the encoder.
        noise_n: rms of the force at rest, of the noise of the position.
        step_noise_n: rms of the force while the device moves over steps of the encoder.
        quiet_n: rms below which the noise at rest is held by dry friction, or not felt.
        felt_n: rms from which on noise in motion is felt: dry friction holds none of it then.
        intervals: of a law with other pieces, by key the values at which it is stable with the others kept; None: none.
        largest_common_gain: up to which a factor on all of its forces holds; 0 where none does.
        smallest_common_gain: from which on it does, as a force limit leaves less of large forces; 0: any does.
        friction: up to which swing dry friction brings it to rest; None where that is not credited.
        detent: the detents outside the wall, where the law does not act; None without them, or where it acts
            everywhere. Each case of the law is judged in the steepest valley, too.

    Example:
        >>> avc.certify_law("knob", k=1.0, b=0.002, remedies=False).stable
        True
    """

    problem: Problem
    law: SpringDamper | ControlLaw | StatedSystem
    held: CaseResult
    released: CaseResult | None
    free: CaseResult | None
    lowest_stiffness_n_per_m: float
    largest_stiffness_n_per_m: float
    damping_range_ns_per_m: tuple[float, float] | None
    largest_local_damping_ns_per_m: float | None
    static_stiffness_n_per_m: float
    rendered_n_per_m: dict[float, float]
    encoder_step_n: float
    noise_n: float
    step_noise_n: float
    quiet_n: float
    felt_n: float
    remedies: tuple[LawRemedy, ...] | None
    intervals: Mapping[str, tuple[float, float] | None] | None = None
    largest_common_gain: float | None = None
    smallest_common_gain: float = 0.0
    friction: FrictionCredit | None = None
    detent: DetentClaim | None = None

    @property
    def limited(self) -> bool:
        """Whether the limits of its numbers were looked for."""
        return not math.isnan(self.largest_stiffness_n_per_m)

    @property
    def cases(self) -> tuple[CaseResult, ...]:
        """Held, and released and free where there are these."""
        return tuple(case for case in (self.held, self.released, self.free) if case is not None)

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with every hand and released, in the wall and outside, and in its detents."""
        return all(case.stable for case in self.cases) and self._detents_hold

    @property
    def _detents_hold(self) -> bool:
        return self.detent is None or self.detent.passed

    @property
    def disk_margin(self) -> float:
        """The smallest disk margin of all cases."""
        return min(case.margins.disk for case in self.cases)

    @property
    def leans(self) -> bool:
        """Whether it is not stable by itself, but friction brings a fast strike to rest, which is credited."""
        credited_friction = self.friction is not None and self.friction.suffices(self.problem.device)
        return not self.stable and self._detents_hold and credited_friction

    @property
    def passed(self) -> bool:
        """Whether it may be deployed: stable, with a disk margin of 0.15 or more; or it leans on friction."""
        return self.leans or (self.stable and self.disk_margin >= LEAST_DISK)

    @property
    def deployable(self) -> bool:
        """Whether the law may run on the device, as the row *Deployable* says: the same as `passed`."""
        return self.passed

    @property
    def sound(self) -> bool:
        """Whether nothing of it is doubted: no thin disk margin, no noise that is felt, no need of friction."""
        return self.disk_margin >= SOUND_DISK and self.quiet and not self.leans

    @property
    def quiet(self) -> bool:
        """Whether noise of the position gives no force that is felt."""
        return self.noise_n <= self.quiet_n

    @property
    def steps_are_felt(self) -> bool:
        """Whether steps of the encoder give a force that is felt while the device moves."""
        return self.step_noise_n > self.felt_n

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
        k = law.stiffness_n_per_m
        b = law.damping_ns_per_m
        b_p = law.local_damping_ns_per_m
        if self.free is not None and not self.free.stable and self.largest_local_damping_ns_per_m is not None:
            return BeyondLimit(
                LimitSide.ABOVE_OUTSIDE, "local_damping_ns_per_m", b_p, self.largest_local_damping_ns_per_m
            )
        if self.damping_range_ns_per_m is None:
            return BeyondLimit(LimitSide.NONE_STABLE, "damping_ns_per_m")
        low, high = self.damping_range_ns_per_m
        if not low <= b <= high:
            return BeyondLimit.of("damping_ns_per_m", b, (low, high))
        return BeyondLimit.of("stiffness_n_per_m", k, (self.lowest_stiffness_n_per_m, self.largest_stiffness_n_per_m))

    def __repr__(self) -> str:
        return f"LawCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return verdict, loops, limits and rendered stiffness as JSON values, in the units of the device."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "quiet": self.quiet}
        rendered = {f"at_{hz:g}_hz_n_per_m": value for hz, value in self.rendered_n_per_m.items()}
        judged = {"problem": self.problem.name, "deployable": {**verdict, "reason": self.reason}, "rendered": rendered}
        of_pieces = (
            ("intervals", "largest_common_gain", "smallest_common_gain") if isinstance(self.law, SpringDamper) else ()
        )
        left_out = ("problem", "rendered_n_per_m", *of_pieces)
        numbers = {key: value for key, value in vars(self).items() if key not in left_out}
        for key in ("friction", "detent"):
            if numbers[key] is None:
                del numbers[key]
        if not isinstance(self.law, SpringDamper):
            numbers["law"] = self.law.document()
        return self.problem.units.document(plain({"schema": "avc/1", "kind": "law", **judged, **numbers}))


def certify_law(  # noqa: PLR0913 - options by name, of a public call
    problem: AnyProblem,
    *,
    k: float | None = None,
    b: float | None = None,
    b_p: float | None = None,
    cutoff_hz: float | None = None,
    law: Any = None,
    remedies: bool = True,
    limits: bool = True,
    lean_on_friction: bool = False,
    progress: Progress = SILENT,
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
        limits: the stable interval of each number too; without them the verdict takes a few tenths of a second.
        lean_on_friction: credit the declared dry friction, which has to bring an impact of 1 m/s at the handle to rest.
        law: in place of the table `[law]` of the problem: its keys as a dict, or a discrete system C(z) with attributes
            A, B, C, D and dt, as of python-control or SciPy; force = -C(z) x. k, b, b_p and cutoff_hz replace its own.
        progress: receiver of the progress.

    Raises:
        InputError: a value that is refused, another dt than the sample time, or neither spring nor damper.
        UnsupportedError: nothing has a mass, more than 32 samples of delay, or the problem couples to another end.

    Example:
        >>> law = avc.certify_law("knob", k=1.0, b=0.002)
        >>> law.deployable, round(law.held.damping_ratio, 2)
        (False, 0.06)
    """
    stated = require_wall(law_problem(problem))
    how = _How(limits=limits, lean=lean_on_friction, progress=progress)
    typed = _allowed_gains({"k": k, "b": b, "b_p": b_p, "cutoff_hz": cutoff_hz})
    if is_system(law):
        if any(gain is not None for gain in typed.values()):
            raise InputError.of("is a discrete system, which has no k, b, b_p or cutoff_hz; leave them out", key="law")
        return _certify_pieces(StatedSystem.of(law, stated.device), stated, how, one_sided=False)
    # Of detents a spring and damper is one piece of several.
    plain_loops = stated.detent is None
    if plain_loops and law is None and stated.law is None and not (b_p or 0.0) < 0:
        plain_law = SpringDamper(k or 0.0, b or 0.0, b_p or 0.0, cutoff_hz)
        return _certify_spring_damper(plain_law, stated, how, remedies=remedies)
    # A law in a file without a wall acts everywhere, on both sides; k and b that are typed act in a wall.
    one_sided = (law is None and stated.law is None) or _has_wall(stated)
    stated = with_law(stated, law, typed)
    own_law = stated.law
    assert own_law is not None  # noqa: S101 - with_law gives one
    if plain_loops and own_law.is_spring_damper:
        plain_law = _spring_damper(own_law, one_sided=one_sided)
        return _certify_spring_damper(plain_law, stated, how, remedies=remedies)
    return _certify_pieces(own_law, stated, how, one_sided=one_sided)


def _allowed_gains(typed: Mapping[str, float | None]) -> Mapping[str, float | None]:
    """Return typed gains, or refuse those that a table [law] refuses."""
    q.refuse_quantities({key: (typed[key], allowed) for key, allowed in _TYPED.items()})
    return typed


def _has_wall(problem: Problem) -> bool:
    """Return whether a problem has a wall that gives a force."""
    return bool(problem.environment.stiffness_n_per_m or problem.environment.damping_ns_per_m)


@dataclass(frozen=True)
class _How:
    """What is computed beyond the verdict: limits of each number, and the swing up to which friction is credited.

    Each limit and each worst case is a stage of the progress.
    """

    limits: bool
    lean: bool
    progress: Progress


def _spring_damper(law: ControlLaw, *, one_sided: bool) -> SpringDamper:
    """Return a law of k, b, b_p and a filter as one; where it acts everywhere, b and b_p are the same."""
    dampers = law.damping_ns_per_m, law.local_damping_ns_per_m
    b, b_p = dampers if one_sided else (sum(dampers), 0.0)
    return SpringDamper(law.stiffness_n_per_m, b, b_p, getattr(law.velocity, "cutoff_hz", None))


@dataclass(frozen=True)
class _NumberLimits:
    """Intervals of stability of a law: of each of its numbers by key, and of a common factor of all that it gives."""

    of_numbers: dict[str, Interval | None]
    of_factor: Interval | None

    def largest(self, key: str) -> float | None:
        """Return the largest stable value of a number; None where the law has none, or no value is stable."""
        interval = self.of_numbers.get(key)
        return None if interval is None else interval[1]


def _number_limits(
    law: ControlLaw | StatedSystem,
    analysis: LawAnalysis,
    laws: Sequence[Law],
    acting_with: Callable[[ControlLaw | StatedSystem], ActingLaws],
    stages: Stages,
) -> _NumberLimits:
    """Return the stable interval of each number of a law, and of a common factor on all its forces.

    `laws` act; `acting_with` gives those that act with another value of a number. Each number is a stage.
    """
    limits = LawLimits(analysis.family, laws)
    of_numbers: dict[str, Interval | None] = {}
    if isinstance(law, ControlLaw):
        for number in law.numbers(analysis.period, analysis.lightest_kg):
            stages.begin("limits of its numbers")
            laws_of = NumberLaws(law, number, lambda table: acting_with(table).all)
            of_numbers[number.key] = limits.interval(number, laws_of)
    stages.begin("limits of all forces")
    return _NumberLimits(of_numbers, limits.interval(_COMMON_GAIN, lambda gains: [part.times(gains) for part in laws]))


def _certify_pieces(law: ControlLaw | StatedSystem, problem: Problem, how: _How, *, one_sided: bool) -> LawCertificate:
    """Judge any law in contact and outside: the interval of each of its numbers by the worst case of the ranges.

    `one_sided` says that it acts in a wall, outside which only a part of it acts.
    """
    _require_known_delay(problem)
    slower = law.rate_divider if isinstance(law, ControlLaw) else 1
    at_rate = at_own_rate(problem)
    if isinstance(law, ControlLaw) and at_rate.law is not None:
        law = at_rate.law
    analysis = LawAnalysis(at_rate)
    device = at_rate.device
    outside = one_sided and isinstance(law, ControlLaw) and law.acts_outside
    acting_with = partial(acting_laws, period_s=device.sample_time_s, outside=outside, detent=problem.detent)
    acting = acting_with(law)
    limit_count = len(law.numbers(device.sample_time_s)) + 1 if how.limits else 0
    stages = Stages(how.progress, limit_count + len(analysis.sides) * len(acting.all))
    limits = _NumberLimits({}, None)
    if how.limits:
        limits = _number_limits(law, analysis, acting.all, acting_with, stages)
    cases = [_worst_of(_cases(analysis, acting.in_contact, side, stages), slower) for side in analysis.sides]
    free = [case for side in analysis.sides for case in _cases(analysis, acting.outside, side, stages)]
    linear = acting.in_contact[0].linear
    static = static_gain(linear)
    stable = all(case.stable for case in (*cases, *free))
    least_factor, largest_factor = limits.of_factor or (0.0, 0.0)
    springs = (limits.of_numbers.get("stiffness_n_per_m") or (0.0, 0.0)) if how.limits else (math.nan, math.nan)
    return LawCertificate(
        problem=problem,
        law=law,
        held=cases[0],
        released=cases[1] if len(cases) > 1 else None,
        free=_worst_of(free, slower) if free else None,
        lowest_stiffness_n_per_m=springs[0],
        largest_stiffness_n_per_m=springs[1],
        damping_range_ns_per_m=limits.of_numbers.get("damping_ns_per_m"),
        largest_local_damping_ns_per_m=limits.largest("local_damping_ns_per_m"),
        static_stiffness_n_per_m=static if math.isinf(static) else stiffness_at_handle(device, static),
        rendered_n_per_m=rendered_n_per_m(linear, device),
        encoder_step_n=abs(float(linear.d[0, 0])) * device.encoder_resolution_m,
        noise_n=noise_n(law, device),
        step_noise_n=step_noise_n(law, device),
        quiet_n=analysis.quiet_n,
        felt_n=analysis.felt_n,
        remedies=None,
        intervals=limits.of_numbers if how.limits else None,
        largest_common_gain=largest_factor if how.limits else None,
        smallest_common_gain=least_factor if least_factor > _COMMON_GAIN.lowest else 0.0,
        friction=_credited(analysis, acting.all, law) if how.lean and not stable else None,
        detent=detent_claim(at_rate) if one_sided and problem.detent is not None else None,
    )


def _cases(analysis: LawAnalysis, laws: Sequence[Law], side: PlantFamily, stages: Stages) -> list[CaseResult]:
    """Return the worst case of each law on one side of the ranges."""
    cases = []
    for law in laws:
        stages.begin("worst cases")
        cases.append(analysis.case(StatedSystem(law), side))
    return cases


def _worst_of(cases: Sequence[CaseResult], slower: int) -> CaseResult:
    """Return the worst of each number of cases, and the margins of the smallest disk.

    The delay margin is in samples of the device, which a law at a slower rate skips.
    """
    slowest = max(cases, key=lambda case: case.spectral_radius)
    ringing = min(cases, key=lambda case: case.damping_ratio)
    margins = min((case.margins for case in cases), key=lambda margins: margins.disk)
    return replace(
        slowest,
        settling_s=max(case.settling_s for case in cases),
        damping_ratio=ringing.damping_ratio,
        damping_ratio_hz=ringing.damping_ratio_hz,
        margins=replace(margins, delay_samples=slower * margins.delay_samples),
    )


def _credited(analysis: LawAnalysis, laws: Sequence[Law], law: AnyLaw) -> FrictionCredit:
    """Return up to which swing, m, dry friction brings laws to rest that grow without it."""
    compensation = law.friction_compensation if isinstance(law, ControlLaw) else None
    full_speed = None if compensation is None else compensation.velocity_m_per_s
    at_points = [
        (part, [*corner_points(side, part.sectors), worst(part, side, radius).point])
        for part in laws
        for side in analysis.sides
    ]
    return credited(at_points, analysis.device, full_speed)


def _certify_spring_damper(law: SpringDamper, stated: Problem, how: _How, *, remedies: bool) -> LawCertificate:
    """Judge a spring and damper, force k x + (b + b_p) v: margins, limits by D-decomposition, and what helps.

    Only b_p acts outside the wall.
    """
    b_p, device = valid_law(law, stated).local_damping_ns_per_m, stated.device
    state_space = law.law(device.sample_time_s)
    analysis = LawAnalysis(stated)
    stages = Stages(how.progress, 1 + how.limits + remedies)
    stages.begin("worst cases")
    held, *released = (analysis.case(law, side) for side in analysis.sides)
    outside = [analysis.case(law.outside, side) for side in analysis.sides if b_p]
    acting = [state_space, *([law.outside.law(device.sample_time_s)] if b_p else [])]
    stable = all(case.stable for case in (held, *released, *outside))
    if how.limits:
        stages.begin("limits of k and b")
    only_local = analysis.damping_range(SpringDamper(0.0, b_p)) if b_p and how.limits else None
    springs = (analysis.stiffness_range(law) or (0.0, 0.0)) if how.limits else (math.nan, math.nan)
    certificate = LawCertificate(
        problem=stated,
        law=law,
        held=held,
        released=released[0] if released else None,
        free=min(outside, key=lambda case: (case.stable, case.margins.disk), default=None),
        lowest_stiffness_n_per_m=springs[0],
        largest_stiffness_n_per_m=springs[1],
        damping_range_ns_per_m=analysis.damping_range(law) if how.limits else None,
        largest_local_damping_ns_per_m=(only_local or (0.0, 0.0))[1] if b_p and how.limits else None,
        static_stiffness_n_per_m=stiffness_at_handle(device, law.stiffness_n_per_m),
        rendered_n_per_m=rendered_n_per_m(state_space, device),
        encoder_step_n=float(state_space.d[0, 0]) * device.encoder_resolution_m,
        noise_n=noise_n(law, device),
        step_noise_n=step_noise_n(law, device),
        quiet_n=analysis.quiet_n,
        felt_n=analysis.felt_n,
        remedies=() if remedies else None,
        friction=_credited(analysis, acting, law) if how.lean and not stable else None,
    )
    if not remedies or (certificate.passed and certificate.sound):
        return certificate
    stages.begin("what would help")
    return replace(certificate, remedies=tuple(remedies_of(law, stated, analysis)))


def law_problem(source: AnyProblem) -> Problem:
    """Return a problem, or a device file as one without a wall."""
    if isinstance(source, str | Path) and is_device(str(source)):
        file = load_device(source)
        nothing = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
        return Problem(name=file.name, title=file.title, device=file.device, environment=nothing)
    return load_any(source)


def valid_law(law: SpringDamper, problem: Problem) -> SpringDamper:
    """Return the law k, b, b_p and filter if its numbers are allowed, as those of the same keys in a file.

    Raises:
        InputError: a number out of its range, no gain at all, or a delay that is too long.
    """
    gains = {"k": law.stiffness_n_per_m, "b": law.damping_ns_per_m, "b_p": law.local_damping_ns_per_m}
    numbers = gains if law.cutoff_hz is None else {**gains, "cutoff_hz": law.cutoff_hz}
    q.refuse_quantities({key: (value, _ALLOWED[key]) for key, value in numbers.items()})
    if not any(gains.values()):
        raise InputError.of("is 0, and b and b_p are 0 too; give at least one of them", key="k")
    _require_known_delay(problem)
    return law


def _require_known_delay(problem: Problem) -> None:
    slowest = PlantFamily.of(problem).largest_delay_samples
    if slowest > MAX_DELAY_SAMPLES:
        limit = f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {slowest:g}"
        raise UnsupportedError(limit, key="device.delay_samples")
