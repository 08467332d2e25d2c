"""What would make a law of one's own deployable: one change or two, each as its loop shows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.own_law.loops import Law, Loops

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.own_law.certificate import LawCertificate

_TRIED, _SHARES, _FINE = 24, (0.7, 0.5, 0.3, 0.2, 0.1, 0.03), tuple(0.85**step for step in range(1, 30))


@dataclass(frozen=True)
class Remedy:
    """Changes that make the law deployable, as its loop shows."""

    changes: Mapping[str, float]
    disk_margin: float


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _dampings(law: Law, most: float) -> list[Law]:
    shares = (0.0, *np.geomspace(1e-3, 1.0, _TRIED))
    laws = [replace(law, damping_ns_per_m=_rounded(most * share)) for share in shares]
    return [one for one in laws if one.damping_ns_per_m or one.stiffness_n_per_m]


def first_law(problem: Problem) -> Law:
    """Return a spring and damper to begin with: the wall's k, or the largest share of it that a b holds soundly."""
    loops, stiffest = Loops(problem), problem.environment.stiffness_n_per_m or 1e3 * problem.device.metres_per_unit**2
    for share in (1.0, *_SHARES, *(0.1 * one for one in _SHARES)):
        law = Law(_rounded(share * stiffest))
        found = loops.damping_range(law)
        if found is not None:
            best = max(_dampings(law, found[1]), key=loops.disk_margin)
            if loops.disk_margin(best) >= SOUND_DISK:
                return best
    return Law(_rounded(1e-3 * stiffest), 0.0)


def remedies(certificate: LawCertificate, loops: Loops) -> Iterator[Remedy]:
    """Yield changes that leave a sound disk margin and no noise that is felt, each as its loop shows."""
    device, law, allowed = certificate.problem.device, certificate.law, certificate.damping_range_ns_per_m

    def margin(changed: Law, around: Loops = loops) -> float:
        loud = changed.noise_n(around.device) > certificate.quiet_n
        return 0.0 if loud else around.disk_margin(changed)

    def sound(laws: Iterable[Law], *keys: str) -> Iterator[Remedy]:
        """Yield the first sound law, with what it changes."""
        for one in laws:
            if (disk := margin(one)) >= SOUND_DISK:
                yield Remedy({key: getattr(one, key) for key in keys}, disk)
                return

    def softer(shares: tuple[float, ...]) -> Iterator[Law]:
        for share in shares if law.stiffness_n_per_m else ():
            yield replace(law, stiffness_n_per_m=_rounded(share * law.stiffness_n_per_m))

    def damped(laws: Iterable[Law]) -> Iterator[Law]:
        for one in laws:
            if (found := loops.damping_range(one)) is not None:
                yield max(_dampings(one, found[1]), key=margin)

    best = [] if allowed is None else [max(_dampings(law, allowed[1]), key=margin)]
    one_change = [*sound(best, "damping_ns_per_m")]
    one_change += sound(softer(_FINE), "stiffness_n_per_m")
    yield from one_change or sound(damped(softer(_SHARES)), "stiffness_n_per_m", "damping_ns_per_m")
    if not certificate.quiet:
        cutoffs = (replace(law, cutoff_hz=_rounded(share * 0.5 / loops.period)) for share in _SHARES[1:])
        yield from sound(cutoffs, "cutoff_hz")
    quicker = {"sample_time_s": loops.period / 2}, {"delay_samples": 0}
    for change in quicker[: 2 if device.delay_samples else 1]:
        beside = {"range": {"delay_samples": None}} if "delay_samples" in change else {}
        disk = margin(law, Loops(certificate.problem.changed(device={**change, **beside})))
        if disk >= SOUND_DISK:
            yield Remedy(change, disk)
