"""Rows of a law with more pieces than a spring and damper: what it is, its intervals, and the noise of its force."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from avc_casadi._util.arrays import Interval
from avc_casadi.claims.friction import FrictionCredit, least_friction_n
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.claims.stated_law import StatedSystem
from avc_casadi.model.control_law import (
    ControlLaw,
    KalmanVelocity,
    LowPassVelocity,
    TicksVelocity,
    WindowVelocity,
)
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import (
    Mark,
    Part,
    Parts,
    Row,
    Value,
    caution,
    commas,
    grade,
    parts,
    quantity_of,
    row,
    stable_ends,
)

GAINS = {
    "stiffness_n_per_m": "k",
    "damping_ns_per_m": "b",
    "local_damping_ns_per_m": "b_p",
    "integral_n_per_m_s": "ki",
    "virtual_mass_kg": "virtual mass",
    "friction_compensation.force_n": "compensation",
    "force_feedback.cutoff_hz": "low pass",
    "admittance.mass_kg": "mass",
    "admittance.damping_ns_per_m": "damping",
}
"""Names of the gains of a law in an answer."""


def named(law: ControlLaw | StatedSystem) -> tuple[Part, ...]:
    """Return what a law is: its gains that are not 0, its velocity and its filters."""
    if isinstance(law, StatedSystem):
        return (f"a discrete system of {law.stated.states} states",)
    return commas(_pieces(law))


def as_stated(law: ControlLaw | StatedSystem, problem: Problem) -> tuple[Part, ...]:
    """Return what a judged law is, with the rate divider of its problem: it is judged as a law of that slower rate."""
    return named(problem.law if isinstance(law, ControlLaw) and problem.law is not None else law)


def _pieces(law: ControlLaw) -> Iterator[Parts]:
    """Yield the gains of a law, its estimator of the velocity and its filters, each with its number."""
    for key, name in GAINS.items():
        value = getattr(law, key, 0.0)
        if value:
            yield name, Value.of(key, value)
    if isinstance(law.velocity, WindowVelocity):
        yield "velocity over", Value(law.velocity.samples, "samples")
    if isinstance(law.velocity, LowPassVelocity):
        yield "velocity below", Value(law.velocity.cutoff_hz, "frequency")
    if isinstance(law.velocity, KalmanVelocity):
        yield "Kalman velocity below", Value(law.velocity.bandwidth_hz, "frequency")
    if isinstance(law.velocity, TicksVelocity):
        yield "velocity by the time between steps, up to", Value(law.velocity.timeout_s, "time")
    for item in law.filters:
        hz = getattr(item, "frequency_hz", getattr(item, "cutoff_hz", None))
        yield item.kind, None if hz is None else Value(hz, "frequency")
    yield from _nonlinear(law)


def _nonlinear(law: ControlLaw) -> Iterator[Parts]:
    """Yield the pieces that are not linear, and the rate of a slower law."""
    if law.dead_zone_m:
        yield "dead zone", Value(law.dead_zone_m, "length")
    if law.integral_limit_n is not None:
        yield "integral up to", Value(law.integral_limit_n, "force")
    if law.friction_compensation is not None:
        force, speed = law.friction_compensation.force_n, law.friction_compensation.velocity_m_per_s
        yield "friction compensation", Value(force, "force"), "from", Value(speed, "speed")
    if law.rate_divider > 1:
        yield f"at every {ordinal(law.rate_divider)} sample"


def ordinal(number: int) -> str:
    """Return 2 as 2nd."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th") if number % 100 not in (11, 12, 13) else "th"
    return f"{number}{ending}"


def acting_outside(law: ControlLaw | StatedSystem) -> str:
    """Return the names of what acts outside the wall."""
    names = {
        "local_damping_ns_per_m": "b_p",
        "virtual_mass_kg": "virtual mass",
        "friction_compensation": "friction compensation",
    }
    return " and ".join(name for key, name in names.items() if getattr(law, key, None))


def limits(intervals: Mapping[str, Interval | None], largest_gain: float) -> list[Row]:
    """Return the stable interval of each number with the others kept, and the largest factor on all forces."""
    factor = ("all forces times", Value(largest_gain, "number")) if largest_gain else "none is stable"
    return [*number_limits(intervals), row("Largest gain", factor)]


def number_limits(intervals: Mapping[str, Interval | None]) -> list[Row]:
    """Return the stable interval of each number with the others kept."""
    return [row(f"Stable {GAINS.get(key, key)}", _stretch(key, ends)) for key, ends in intervals.items()]


def limited(result: LawCertificate) -> list[Row]:
    """Return a warning where a law that a force limit cuts is not stable with what is left."""
    limit_n = result.problem.device.max_force_n
    if limit_n is None or not result.smallest_common_gain:
        return []
    left = ("of", Value(limit_n, "force"), "may leave less than", Value(result.smallest_common_gain, "share"))
    return [row("Force limit", left, "of the command: unstable then", mark=Mark.CAUTION)]


def friction(result: LawCertificate) -> list[Row]:
    """Return what a friction compensation is to the least friction, and up to which swing friction is credited."""
    rows = []
    law = result.law
    credit = result.friction
    device = result.problem.device
    if isinstance(law, ControlLaw) and law.friction_compensation is not None:
        force_n, least_n = law.friction_compensation.force_n, least_friction_n(device)
        how = "above" if force_n > least_n else "up to"
        source = "" if device.range.coulomb_friction_n is not None else "(half of what is declared)"
        least = ("the least friction,", Value(least_n, "force"), source)
        pushes = ("pushes with", Value(force_n, "force"), f", {how}", least)
        rows.append(row("Compensation", pushes, mark=caution(force_n > least_n)))
    if credit is not None:
        rows.append(row("By friction", _credit(credit), mark=grade(credit.suffices(device), Mark.FAIL)))
    return rows


def _credit(credit: FrictionCredit) -> tuple[Part, ...]:
    """Return up to which swing friction brings a law to rest."""
    of = ("(friction", Value(credit.friction_n, "force"), ")")
    if math.isinf(credit.swing_m):
        return parts("every swing comes to rest", of)
    if not credit.swing_m:
        return parts("no swing comes to rest", of)
    swing = ("swings up to", Value(credit.swing_m, "length"), "at", Value(credit.frequency_hz, "frequency"))
    return parts(swing, ", impacts up to", Value(credit.speed_m_per_s, "speed"), "come to rest", of)


def _stretch(key: str, ends: Interval | None) -> tuple[Part, ...]:
    """Return an interval; one without an end says so."""
    if ends is None:
        return ("none, with the other values unchanged",)
    low, high = stable_ends(ends, quantity_of(key))
    if math.isinf(ends[0]) and math.isinf(ends[1]):
        return ("any",)
    if math.isinf(ends[1]):
        return parts(low, "or more")
    return parts("up to", high) if math.isinf(ends[0]) else parts(low, "to", high)


def law_limits(result: LawCertificate) -> list[Row]:
    """Return what the law renders, its limits, and the noise of its force."""
    at_rest = (Value(result.static_stiffness_n_per_m, "stiffness"), "at rest")
    moving = [(Value(stiffness, "stiffness"), f"at {hz:g} Hz") for hz, stiffness in result.rendered_n_per_m.items()]
    springs = (result.lowest_stiffness_n_per_m, result.largest_stiffness_n_per_m)
    allowed = result.damping_range_ns_per_m
    limits_of = [
        row("Stable k", _stretch("stiffness_n_per_m", springs) if springs[1] else "none", "at this b"),
        row("Stable b", "none" if allowed is None else _stretch("damping_ns_per_m", allowed), "at this k"),
    ]
    if not result.limited:
        limits_of = [row("Limits", "not computed")]
    elif result.intervals is not None:
        limits_of = [*limits(result.intervals, result.largest_common_gain or 0.0), *limited(result)]
    return [
        row("Rendered", commas([at_rest, *moving])),
        *limits_of,
        force_noise(result),
    ]


def force_noise(result: LawCertificate) -> Row:
    """Return the noise of the force: at rest where noise is declared, else in motion over steps of the encoder."""
    step = (";", Value(result.encoder_step_n, "force"), "for one encoder step")
    if result.noise_n or not result.step_noise_n:
        at_rest = (Value(result.noise_n, "force"), "rms at rest")
        verdict = _felt(not result.quiet, result.quiet_n) if result.noise_n else None
        return row("Force noise", at_rest, verdict, step, mark=caution(not result.quiet))
    in_motion = (Value(result.step_noise_n, "force"), "rms in motion")
    return row(
        "Force noise", in_motion, _felt(result.steps_are_felt, result.felt_n), step, mark=caution(result.steps_are_felt)
    )


def _felt(felt: bool, limit_n: float) -> tuple[Part, ...]:
    """Return whether noise is felt, and from where on it is."""
    return parts(f", {'felt' if felt else 'not felt'} (limit", Value(limit_n, "force"), ")")


def number_over(law: ControlLaw, problem: Problem) -> str:
    """Return the key of a number over which the stable springs of a law are drawn: its damping, or another."""
    keys = [number.key for number in law.numbers(problem.device.sample_time_s)]
    others = [key for key in keys if key != "stiffness_n_per_m"]
    damping = "damping_ns_per_m"
    return problem.units.key(damping if damping in keys or not others else others[0])
