"""Which virtual mass and damping an admittance device should render: the least effort with a sound disk margin.

The sensor alone must not move a handle at rest: 4 rms of its noise in the closed loop with the worst hand or contact,
and the drift of one of its steps, stay below the speed at which a trial counts a handle as moving.

The effort is that of a hand that moves the handle at 1 Hz, |j w M + B|, without the spring. Over a grid of dampings the
lightest sound mass is found at the corners of the ranges; the best law is confirmed by a search of the ranges, whose
worst plants join these.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi.claims.admittance import (
    AdmittanceCertificate,
    HandleAnalysis,
    certify_admittance,
    damping_changes,
    with_device_value,
)
from avc_casadi.claims.mass_spans import MassSpans, Span, held_span
from avc_casadi.claims.sensor_motion import drift, speed_at_rest, velocity_noise
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance
from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance
from avc_casadi.simulation.judge import AT_REST_M_PER_S

EFFORT_HZ = 1.0
"""Frequency of a hand that guides: the effort counts there."""
_CUTOFF_SHARES = (0.2, 0.1, 0.05, 0.025)
"""Low passes of the force that are tried where the file states none, as shares of the sample rate."""
# Dampings of a first look, and of each refinement about the best.
_COARSE = 3
_FINE = 7
# A damping that differs by less is not felt as another.
_FELT_RATIO = 1.01
# Bisections of the lightest mass that rests: to a hundredth of it, over five decades.
_BISECTIONS = 10
# A law is confirmed by at most so many searches, each of which may refuse it.
_SEARCHES = 5
# What a search refuses is set back by this share of its margin.
_BACK_OFF = 1.02
_FIRST_LIMIT = SOUND_DISK * _BACK_OFF
"""Disk margin of the first law at the corners of the ranges."""
_ANY_LAW = VirtualImpedance(mass_kg=1.0, damping_ns_per_m=1.0)
"""What stands for the law of a file that states none: neither a spring nor a low pass."""
_OTHER_STAGES = 3
"""Stages of a usual recommendation besides low passes and changes: a search, the law of the file, the certificate."""
_CHANGES = {
    "drive_bandwidth_hz": 2.0,
    "delay_samples": 0.5,
    "sample_time_s": 0.5,
    "sensor_stiffness_n_per_m": 2.0,
    "handle_mass_kg": 0.5,
}
"""Changes of a device whose effect is reported."""


NO_SOUND_LAW = (
    f"no virtual mass and damping has a disk margin of {SOUND_DISK} with every hand and contact, and keeps the handle "
    "at rest in spite of the sensor's noise and steps"
)
"""Why no law is recommended."""


@dataclass(frozen=True)
class BetterDevice:
    """The law of least effort with another value of the device, at the corners of the ranges."""

    key: str
    value: float
    mass_kg: float
    damping_ns_per_m: float
    effort_ns_per_m: float


@dataclass(frozen=True, eq=False, repr=False)
class AdmittanceRecommendation(Printed):
    """The law to run on an admittance device.

    Attributes:
        problem: the problem with the recommended law; with its own where there is none to recommend.
        certificate: the verdict on it; None where no law has a sound margin.
        effort_ns_per_m: force over speed of a hand that moves the handle at 1 Hz; infinite without a law.
        least_mass_kg: the lightest sound mass at the damping of the file; None where it states no law or none is sound.
        least_damping_ns_per_m: the least sound damping at the mass of the file; likewise.
        helps: the law of least effort if a value of the device were better, the one with the least effort first.

    Example:
        >>> found = avc.recommend_admittance("admittance/cobot")
        >>> found.passed, found.certificate.disk_margin >= 0.2
        (True, True)
    """

    problem: AdmittanceProblem
    certificate: AdmittanceCertificate | None
    effort_ns_per_m: float
    least_mass_kg: float | None
    least_damping_ns_per_m: float | None
    helps: tuple[BetterDevice, ...]

    @property
    def passed(self) -> bool:
        """Whether there is a law to run."""
        return self.certificate is not None and self.certificate.passed

    @property
    def law(self) -> VirtualImpedance | None:
        """The recommended law."""
        return None if self.certificate is None else self.certificate.law

    @property
    def reason(self) -> str:
        """What decides, in one line."""
        return NO_SOUND_LAW if self.certificate is None else self.certificate.reason

    def __repr__(self) -> str:
        return f"AdmittanceRecommendation({self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        judged = None if self.certificate is None else self.certificate.document()
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "certificate")}
        law = None if self.law is None else {"admittance": self.law.model_dump()}
        stated = {"problem": self.problem.name, "deployable": self.passed, "reason": self.reason, "law": law}
        return self.problem.units.document(plain({**stated, **numbers, "certificate": judged}))


def effort_ns_per_m(law: VirtualImpedance) -> float:
    """Return |j w M + B| at 1 Hz; a spring that the file states is no effort to spare."""
    return math.hypot(law.damping_ns_per_m, 2 * math.pi * EFFORT_HZ * law.mass_kg)


@dataclass(frozen=True)
class _Choice(MassSpans):
    """Sound laws of one device, one spring and one low pass.

    Attributes:
        analysis: the plants, which a law of least effort must leave at rest in spite of the sensor's noise.
    """

    analysis: HandleAnalysis

    @classmethod
    def among(cls, analysis: HandleAnalysis, base: VirtualImpedance) -> Self:
        """Return those of the plants of an analysis."""
        spans = MassSpans.of(analysis, base)
        return cls(spans.response, spans.scales, base, analysis.period_s, analysis)

    def masses(self, damping_ns_per_m: float, limit: float) -> Span:
        """Return the sound masses at a damping."""
        return held_span(
            lambda masses: self.response.sound(self.laws(masses, damping_ns_per_m), limit), self.scales.masses_kg
        )

    def dampings(self, mass_kg: float, limit: float) -> Span:
        """Return the sound dampings at a mass."""
        return held_span(
            lambda dampings: self.response.sound(self.laws(mass_kg, dampings), limit), self.scales.dampings_ns_per_m
        )

    def best(self, limit: float) -> VirtualImpedance | None:
        """Return the law of least effort that has a disk margin and rests; None where there is none.

        `limit` is the required disk margin. A scan of dampings is refined about the best until a hand feels no
        difference.
        """
        chosen = self._best_of(self._first_dampings, limit)
        ratio = self._first_dampings[1] / self._first_dampings[0]
        while chosen is not None and ratio > _FELT_RATIO:
            damping = chosen.damping_ns_per_m
            finer = self._best_of(damping * ratio ** np.linspace(-1.0, 1.0, _FINE), limit)
            chosen = chosen if finer is None or effort_ns_per_m(finer) > effort_ns_per_m(chosen) else finer
            ratio = ratio ** (2.0 / (_FINE - 1))
        return chosen

    def exists(self, limit: float) -> bool:
        """Return whether `best` has a law: one of the dampings of its first look has a sound mass that rests."""
        dampings = self._first_dampings[::-1].tolist()
        return any(self._lightest(damping, limit, math.inf) is not None for damping in dampings)

    @property
    def _first_dampings(self) -> FloatArray:
        return self.scales.dampings_ns_per_m[::_COARSE]

    def _best_of(self, dampings: FloatArray, limit: float) -> VirtualImpedance | None:
        """Return the law of least effort over some dampings, each with its lightest mass; None where there is none.

        The effort is at least the damping, N.s/m, so that heavier dampings than the least effort are not tried.
        """
        best, least = None, math.inf
        for damping in dampings.tolist():
            if damping > least:
                break
            law = self._lightest(damping, limit, least)
            if law is not None and effort_ns_per_m(law) < least:
                best, least = law, effort_ns_per_m(law)
        return best

    def _lightest(self, damping_ns_per_m: float, limit: float, most_effort: float) -> VirtualImpedance | None:
        """Return the law of the lightest sound mass at a damping that rests; None where there is none."""
        span = self.masses(damping_ns_per_m, limit)
        return None if math.isnan(span.low) else self._lightest_at_rest(damping_ns_per_m, span, most_effort)

    def _lightest_at_rest(self, damping_ns_per_m: float, span: Span, most_effort: float) -> VirtualImpedance | None:
        """Return the law of the lightest mass of a span that the sensor alone does not move; None where all move.

        None too where that is more than an effort that another law needs.
        """
        lightest = span.low or float(self.scales.masses_kg[0])
        heaviest = min(span.high, float(self.scales.masses_kg[-1]))

        def law_of(mass_kg: float) -> VirtualImpedance:
            return self.base.model_copy(update={"mass_kg": mass_kg, "damping_ns_per_m": damping_ns_per_m})

        if effort_ns_per_m(law_of(lightest)) >= most_effort:
            return None
        if self._rests(law_of(lightest)):
            return law_of(lightest)
        if heaviest <= lightest or not self._rests(law_of(heaviest)):
            return None
        # A heavier mass is moved less by noise: the limit is bisected.
        for _ in range(_BISECTIONS):
            middle = math.sqrt(lightest * heaviest)
            if self._rests(law_of(middle)):
                heaviest = middle
            else:
                lightest = middle
        return law_of(heaviest)

    def _rests(self, law: VirtualImpedance) -> bool:
        return rests(law, self.analysis)


def rests(law: VirtualImpedance, analysis: HandleAnalysis) -> bool:
    """Return whether the sensor alone moves a handle at rest more slowly than what counts as moving."""
    device = analysis.problem.device
    at_rest_m_per_s = AT_REST_M_PER_S / device.metres_per_unit
    drifts = drift(law, device)
    if speed_at_rest(0.0, drifts) >= at_rest_m_per_s:
        return False
    return speed_at_rest(velocity_noise(law, device, analysis.pairs), drifts) < at_rest_m_per_s


def recommend_admittance(problem: AnyAdmittance, progress: Progress = SILENT) -> AdmittanceRecommendation:
    """Recommend the virtual mass and damping of least effort with a disk margin of 0.2 with every hand and contact.

    A spring and a low pass of the force that the file states are kept; without a low pass one is chosen.

    Args:
        problem: an `AdmittanceProblem`, its file or name.
        progress: told which stage begins.

    Raises:
        InputError: a value that is refused.

    Example:
        >>> avc.recommend_admittance("admittance/cobot").law.cutoff_hz
        40.0
    """
    stated = as_admittance(problem)
    stated_law = stated.law.admittance if stated.law else None
    base = stated_law or _ANY_LAW
    analysis = HandleAnalysis(stated)
    law, limit = None, _FIRST_LIMIT
    cutoffs = _cutoffs(base, stated)
    stages = Stages(progress, len(cutoffs) + _OTHER_STAGES + len(_CHANGES))
    for _ in range(_SEARCHES):
        law = _least_effort(analysis, [base.model_copy(update={"cutoff_hz": hz}) for hz in cutoffs], limit, stages)
        if law is None:
            break
        law = _rounded(law)
        cutoffs = (law.cutoff_hz,)
        stages.begin("hands and contacts")
        margin = analysis.confirmed_margin(law)
        if margin >= SOUND_DISK and rests(law, analysis):
            break
        if margin < SOUND_DISK:
            limit *= min(_BACK_OFF * SOUND_DISK / max(margin, SOUND_DISK / 2), _BACK_OFF**4)
        law = None
    stages.begin("least mass and damping")
    least_mass, least_damping = _at_own(analysis, stated_law, limit)
    if law is None:
        return AdmittanceRecommendation(stated, None, math.inf, least_mass, least_damping, ())
    chosen = stated.changed(law={"admittance": law.model_dump(exclude_none=True)})
    stages.begin("certificate")
    return AdmittanceRecommendation(
        problem=chosen,
        certificate=_certified(chosen, law, analysis),
        effort_ns_per_m=effort_ns_per_m(law),
        least_mass_kg=least_mass,
        least_damping_ns_per_m=least_damping,
        helps=tuple(_better_devices(analysis, law, limit, stages)),
    )


def _certified(chosen: AdmittanceProblem, law: VirtualImpedance, analysis: HandleAnalysis) -> AdmittanceCertificate:
    """Return the certificate of a law; of one that rings with what damps it."""
    certificate = certify_admittance(chosen, remedies=False)
    if not (certificate.passed and certificate.rings):
        return certificate
    return replace(certificate, damped_by=damping_changes(HandleAnalysis(chosen, analysis.worst_hands), law))


def why_no_law(problem: AdmittanceProblem) -> str:
    """Return why no law is recommended, as the corners of the ranges show it at once; empty where one may be."""
    base = problem.law.admittance if problem.law and problem.law.admittance else _ANY_LAW
    analysis = HandleAnalysis(problem)
    # A low pass takes the sensor's noise away: the lowest one is the likeliest to have a law.
    for cutoff_hz in reversed(_cutoffs(base, problem)):
        choice = _Choice.among(analysis, base.model_copy(update={"cutoff_hz": cutoff_hz}))
        if choice.exists(_FIRST_LIMIT):
            return ""
    return NO_SOUND_LAW


def _cutoffs(base: VirtualImpedance, problem: AdmittanceProblem) -> tuple[float | None, ...]:
    if base.cutoff_hz is not None:
        return (base.cutoff_hz,)
    return (None, *(_two_digits(share / problem.device.sample_time_s) for share in _CUTOFF_SHARES))


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _rounded(law: VirtualImpedance) -> VirtualImpedance:
    """Return the law with numbers of three digits, rounded up."""
    update = {key: _up(getattr(law, key)) for key in ("mass_kg", "damping_ns_per_m")}
    return law.model_copy(update=update)


def _up(value: float) -> float:
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / step * (1 - 1e-9)) * step:.6g}")


def _least_effort(
    analysis: HandleAnalysis, bases: Sequence[VirtualImpedance], limit: float, stages: Stages
) -> VirtualImpedance | None:
    laws = []
    for base in bases:
        stages.begin("force without a filter" if base.cutoff_hz is None else f"force below {base.cutoff_hz:g} Hz")
        laws.append(_Choice.among(analysis, base).best(limit))
    return min((law for law in laws if law is not None), key=effort_ns_per_m, default=None)


def _at_own(analysis: HandleAnalysis, law: VirtualImpedance | None, limit: float) -> tuple[float | None, float | None]:
    """Return the lightest sound mass, kg, at a law's damping, and the least sound damping, N.s/m, at its mass.

    Each is None where there is none. `limit` is the required disk margin.
    """
    if law is None:
        return None, None
    choice = _Choice.among(analysis, law)
    mass = choice.masses(law.damping_ns_per_m, limit).low if law.damping_ns_per_m else math.nan
    damping = choice.dampings(law.mass_kg, limit).low if law.mass_kg else math.nan
    known = [None if math.isnan(value) else value for value in (mass, damping)]
    return known[0], known[1]


def _better_devices(
    analysis: HandleAnalysis, law: VirtualImpedance, limit: float, stages: Stages
) -> Iterator[BetterDevice]:
    """Yield each change of the device that allows a law of less effort, with that law, the least effort first.

    `limit` is the required disk margin; each change is a stage.
    """
    problem = analysis.problem
    devices = []
    for key, factor in _CHANGES.items():
        stages.begin(f"with another {key}")
        before = problem.device.value(key)
        if before == 0:
            continue
        changed = analysis.changed(with_device_value(problem, key, before * factor))
        better = _Choice.among(changed, law).best(limit)
        if better is not None and effort_ns_per_m(better) < effort_ns_per_m(law):
            effort = effort_ns_per_m(better)
            devices.append(BetterDevice(key, before * factor, better.mass_kg, better.damping_ns_per_m, effort))
    yield from sorted(devices, key=lambda better: better.effort_ns_per_m)
