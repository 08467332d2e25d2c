"""The variants of the study: one problem with its scope, slope limit or contact damping varied."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

Study = Literal["scope", "slope", "contact"]

HANDS_HZ = (1.0, 50.0)
"""Frequencies at which hands move and contact chatters."""
_BAND_FACTORS = (1.5, 2.0, 4.0, 10.0)
_SLOPE_LIMITS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_CONTACT_SHARES = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)
"""Largest contact damping as a share of 2 m/T, where a sampled damper alone becomes unstable."""


@dataclass(frozen=True)
class Variant:
    """One variant to be solved by `schedule`.

    Attributes:
        study: which quantity is varied.
        label: its value, in words.
        value: its value as a number, or None where it has none (no limit, all frequencies, hands).
        constant: whether the gains may not vary with frequency.
        problem: the problem to solve.
    """

    study: Study
    label: str
    value: float | None
    constant: bool
    problem: Problem


def variants(problem: Problem) -> list[Variant]:
    """List the variants of the study of a problem, all with its own model, box and objective unless said otherwise.

    - scope: its own frequency, bands, all frequencies, hands; each with adaptive and with constant gains;
    - slope: limits on the slopes under the problem's own scope;
    - contact: limits on b_p with structure `damped`, complex error and scope `hands`, adaptive and constant.

    Where the problem names no frequencies of interaction, those of hands are taken, so that what is minimised is what
    is measured.
    """
    if problem.schedule.interaction_hz is None:
        problem = problem.changed(schedule={"interaction_hz": HANDS_HZ})
    found: list[Variant] = []
    settings = problem.stability
    factors = sorted({*_BAND_FACTORS, settings.band_factor} - {1.0})
    scopes: list[tuple[str, float | None, dict[str, Any]]] = [
        ("own frequency", 1.0, {"scope": "pointwise"}),
        *((f"band {factor:g}", factor, {"scope": "band", "band_factor": factor}) for factor in factors),
        ("all frequencies", None, {"scope": "all"}),
        ("hands", None, {"scope": "hands"}),
    ]
    for label, value, keys in scopes:
        scoped = problem.changed(stability=keys)
        found += [
            Variant("scope", label, value, False, scoped),
            Variant("scope", label, value, True, scoped),
        ]
    found.append(Variant("slope", "constant", 0.0, True, problem))
    for limit in (*_SLOPE_LIMITS, None):
        label = "no limit" if limit is None else f"{limit:g}"
        found.append(Variant("slope", label, limit, False, problem.changed(schedule={"slope_limit": limit})))
    largest = 2 * problem.device.mass_kg / problem.device.sample_time_s
    for share in _CONTACT_SHARES if largest > 0 else (0.0,):
        damped = problem.changed(
            coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, share * largest)},
            stability={"scope": "hands"},
            realism={"objective": "complex"},
        )
        value = share * largest
        found += [
            Variant("contact", f"{value:g} N.s/m", value, False, damped),
            Variant("contact", f"{value:g} N.s/m", value, True, damped),
        ]
    return found
