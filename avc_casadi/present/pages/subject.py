"""Shared parts of the pages: a problem in a line, quantities of its motion, gains and limits in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.terminal import Mark, Row

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.schedule import GainSchedule

RIGID = 100.0
"""A spring so many times stiffer than the wall renders the wall itself."""

_GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")

Quantities = Callable[[float | None, str], str]
"""Formatter of a value with its unit on a linear device."""


def quantities(units: Units, digits: int = 3) -> Quantities:
    """Return a formatter of values in linear units as those of a motion.

    Args:
        units: of the motion.
        digits: significant ones.
    """
    return lambda value, unit: quantity(value, units.unit(unit), digits)


def headline(problem: Problem, shown: str) -> str:
    """Return a problem in a line: wall, device, rate and delay.

    Args:
        problem: the problem.
        shown: as the user names it.
    """
    device, wall, told = problem.device, problem.environment, quantities(problem.units)
    late = f"{device.delay_samples:g} sample{'' if device.delay_samples == 1 else 's'} of delay"
    parts = ((wall.stiffness_n_per_m, "N/m"), (wall.damping_ns_per_m, "N.s/m"))
    rendered = ", ".join(told(value, unit) for value, unit in parts if value) or "none"
    rate = quantity(1 / device.sample_time_s, "Hz")
    return f"{shown}   wall {rendered} · device {told(device.mass_kg, 'kg')}, {rate}, {late}"


def gains_text(table: Mapping[str, Sequence[float | None]], problem: Problem) -> str:
    """Return gains in words, with their spans: spring, damper and contact damper, or the wall rendered directly.

    Args:
        table: ``damping_ns_per_m``, ``stiffness_n_per_m`` and ``contact_damping_ns_per_m``; None where there is none.
        problem: with the wall that is rendered.
    """
    told, wall = quantities(problem.units), problem.environment.stiffness_n_per_m
    b, k, b_p = ([one for one in table[key] if one is not None] for key in _GAINS)
    parts = [f"contact damper b_p {span(b_p, told, 'N.s/m')}"] if max(b_p, default=0.0) > 0 else []
    if not k:
        return ", ".join([*parts, "no spring"])
    if min(k) >= RIGID * wall:
        return ", ".join([*parts, "wall rendered directly"])
    parts.append(f"spring k {span(k, told, 'N/m')}")
    return ", ".join(parts + ([f"damper b {span(b, told, 'N.s/m')}"] if max(b, default=0.0) > 0 else []))


def span(values: Sequence[float], told: Quantities, unit: str) -> str:
    """Return the least and the largest value, or the only one."""
    low, high = told(min(values), unit), told(max(values), unit)
    return low if low == high else f"{low} to {high}"


def passive_limit(limit_n_per_m: float | None, units: Units) -> Row:
    """Return the largest static stiffness of any passive linear rendering as a row; NaN where none is known.

    Args:
        limit_n_per_m: 2 b_d/((1 + d) T) at the worst of the ranges.
        units: of the motion.
    """
    if limit_n_per_m is None or math.isnan(limit_n_per_m):
        return Row("Passive limit", "known for a rigid device, ideal amplifier and whole samples of delay only")
    told = quantities(units)(limit_n_per_m, "N/m")
    return Row("Passive limit", f"{told} static for any passive linear rendering (sampled-data)")


def deployable(verdict: dict[str, Any] | None) -> Row:
    """Return the verdict on deployment as a row: the claims that hold, or the first that fails.

    Args:
        verdict: ``deployable`` of a document; None where no row has gains.
    """
    if verdict is None:
        return Row("Deployable", "no: no row has gains", Mark.FAIL)
    failed = [claim for claim in verdict.get("claims", ()) if not claim["pass"]]
    if verdict["pass"]:
        thin = verdict.get("thin", "")
        said = f"yes: linearly stable with every hand and released{thin}"
        return Row("Deployable", said, Mark.CAUTION if thin else Mark.PASS)
    sentence = failed[0]["sentence"] if failed else verdict["sentence"]
    return Row("Deployable", f"no: {sentence}", Mark.FAIL)


def counts(found: dict[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", without zeros."""
    return ", ".join(f"{count} {name}" for name, count in found.items() if count) or "none"


def plural(count: int, thing: str) -> str:
    """Return a number of things: "1 row", "3 rows"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def holes(schedule: GainSchedule) -> str:
    """Describe what runs at the frequencies without gains; empty where there are none, or no others."""
    usable = schedule.usable
    without = len(usable) - int(usable.sum())
    if without in {0, len(usable)}:
        return ""
    return f"{without} of {len(usable)} frequencies have no gains: those of the rows beside them run there"
