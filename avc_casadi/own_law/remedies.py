"""What would make a law of one's own deployable: one change or two, each as its loop shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.own_law.loops import Law, Loops

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.own_law.certificate import LawCertificate

_TRIED, _HALVINGS, _SHARES = 24, 12, (0.7, 0.5, 0.3, 0.2, 0.1, 0.03)


@dataclass(frozen=True)
class Remedy:
    """Changes that make the law deployable, as its loop shows."""

    changes: Mapping[str, float]
    disk_margin: float


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def first_law(problem: Problem) -> Law:
    """Return a spring and damper to begin with: the wall's k, or the largest share of it that a b holds soundly."""
    loops, stiffest = Loops(problem), problem.environment.stiffness_n_per_m or 1e3 * problem.device.metres_per_unit**2
    for share in (1.0, *_SHARES, *(0.1 * one for one in _SHARES)):
        law = Law(_rounded(share * stiffest))
        found = loops.damping_range(law)
        if found is not None:
            tried = [replace(law, damping_ns_per_m=b) for b in _dampings(found[1])]
            best = max(tried, key=loops.disk_margin)
            if loops.disk_margin(best) >= SOUND_DISK:
                return best
    return Law(_rounded(1e-3 * stiffest), 0.0)


def remedies(certificate: LawCertificate, loops: Loops) -> Iterator[Remedy]:
    """Yield changes that leave a sound disk margin and no noise that is felt, each as its loop shows."""
    problem, law, allowed = certificate.problem, certificate.law, certificate.damping_range_ns_per_m

    def sound(changed: Law, around: Loops = loops) -> float:
        loud = changed.noise_n(around.device) > certificate.quiet_n
        return 0.0 if loud else around.disk_margin(changed)

    def damped(stiffness: float, most: float) -> tuple[float, float]:
        """Return the b of the largest disk margin at a stiffness, and that margin."""
        soft = replace(law, stiffness_n_per_m=stiffness)
        best = max((replace(soft, damping_ns_per_m=b) for b in _dampings(most) if b or stiffness), key=sound)
        return best.damping_ns_per_m, sound(best)

    b, disk = (0.0, 0.0) if allowed is None else damped(law.stiffness_n_per_m, allowed[1])
    if disk >= SOUND_DISK:
        yield Remedy({"damping_ns_per_m": b}, disk)
    softer = _softer(law, sound)
    if softer is not None:
        yield Remedy({"stiffness_n_per_m": softer.stiffness_n_per_m}, sound(softer))
    if disk < SOUND_DISK and softer is None and law.stiffness_n_per_m:
        for share in _SHARES:
            k = _rounded(share * law.stiffness_n_per_m)
            found = loops.damping_range(replace(law, stiffness_n_per_m=k))
            b, disk = (0.0, 0.0) if found is None else damped(k, found[1])
            if disk >= SOUND_DISK:
                yield Remedy({"stiffness_n_per_m": k, "damping_ns_per_m": b}, disk)
                break
    if not certificate.quiet:
        for share in _SHARES[1:]:
            filtered = replace(law, cutoff_hz=_rounded(share * 0.5 / loops.period))
            if (disk := sound(filtered)) >= SOUND_DISK:
                yield Remedy({"cutoff_hz": filtered.cutoff_hz or 0.0}, disk)
                break
    quicker = {"sample_time_s": loops.period / 2}, {"delay_samples": 0}
    for change in quicker[: 2 if problem.device.delay_samples else 1]:
        beside = {"range": {"delay_samples": None}} if "delay_samples" in change else {}
        disk = sound(law, Loops(problem.changed(device={**change, **beside})))
        if disk >= SOUND_DISK:
            yield Remedy(change, disk)


def _dampings(most: float) -> list[float]:
    return [0.0, *(_rounded(most * share) for share in np.geomspace(1e-3, 1.0, _TRIED))]


def _softer(law: Law, sound: Callable[[Law], float]) -> Law | None:
    """Return the law with the largest smaller k that is sound; None where a thousandth of it is not."""
    low, high = 1e-3, 1.0

    def of(share: float) -> Law:
        return replace(law, stiffness_n_per_m=_rounded(share * law.stiffness_n_per_m))

    if not law.stiffness_n_per_m or sound(of(low)) < SOUND_DISK:
        return None
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if sound(of(middle)) >= SOUND_DISK else (low, middle)
    return of(low)
