"""A law that a user states: the table `[law]`, or a discrete system of another package, as the loops see it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.linalg import schur, solve_sylvester

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi.claims.impedance import moving_stiffness_at_handle
from avc_casadi.model.control_law import ControlLaw, DifferenceVelocity, LawNumber, LowPassVelocity, TicksVelocity
from avc_casadi.model.device import Detent, Device
from avc_casadi.model.law import Law
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import plain as plain_number
from avc_casadi.model.table import shown

# Two sample times are the same to this share: 1/dt typed for a rate differs by rounding.
_SAME_TIME = 1e-9
# Poles of a law this far within the unit circle die away; those beyond it are refused, those between never end.
_DIES_AWAY = 1e-9


_LARGEST_ENTRY = 1e15
"""Largest entry of a matrix of a system: beyond any spring and damper at any rate, and its square is a number."""
# Frequencies at which what is rendered is told.
_RENDERED_HZ = (1.0, 10.0)
_LOW_PASS: str = LowPassVelocity.model_fields["kind"].default


class AnyLaw(Protocol):
    """What can be judged: something that gives a law at a sample time."""

    def law(self, sample_time_s: float) -> Law:
        """Return the law in contact."""


@dataclass(frozen=True, eq=False)
class StatedSystem:
    """A discrete system from the measured position to the force, positive against it, as a law without numbers."""

    stated: Law

    def law(self, sample_time_s: float) -> Law:  # noqa: ARG002 - it has the device's own
        """Return the law in contact."""
        return self.stated

    def numbers(self, sample_time_s: float) -> list[LawNumber]:  # noqa: ARG002
        """Return no number: its matrices have no name."""
        return []

    def document(self) -> dict[str, Any]:
        """Return its matrices, JSON values."""
        return {name: plain(getattr(self.stated, name)) for name in ("a", "b", "c", "d")}

    @classmethod
    def of(cls, system: Any, device: Device) -> StatedSystem:
        """Return the law of a system with attributes A, B, C, D and dt, as of python-control or SciPy.

        Raises:
            InputError: another sample time than the device's, several inputs or outputs, or a pole beyond 1.
        """
        dt, period = system.dt, device.sample_time_s
        is_time = isinstance(dt, int | float) and not isinstance(dt, bool)
        if not is_time or not period * (1 - _SAME_TIME) <= dt <= period * (1 + _SAME_TIME):
            allowed = f"allowed: {period:g} s (device.sample_time_s); discretise the system with this time"
            raise InputError.of(f"has dt = {shown(dt)}; {allowed}", key="law")
        a, b, c, d = (_matrix(name, getattr(system, name)) for name in "ABCD")
        states = a.shape[-1] if a.size else 0
        if d.shape != (1, 1):
            raise InputError.of(f"has {d.shape[1]} inputs and {d.shape[0]} outputs; allowed: one of each", key="law")
        if states:
            if a.shape != (states, states) or not b.size == c.size == states:
                sizes = ", ".join(f"{name} {part.shape}" for name, part in zip("ABC", (a, b, c), strict=True))
                raise InputError.of(f"has {sizes}; allowed: A n by n, B n by 1, C 1 by n", key="law")
            b, c = b.reshape((states, 1)), c.reshape((1, states))
        if not all((np.abs(part) <= _LARGEST_ENTRY).all() for part in (a, b, c, d)):
            allowed = f"allowed: finite numbers up to {plain_number(_LARGEST_ENTRY)}"
            raise InputError.of(f"has a matrix with invalid numbers; {allowed}", key="law")
        radius = float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)) if states else 0.0
        if radius > 1 + _DIES_AWAY:
            allowed = "allowed: at most 1, because the margins are for a controller that is stable by itself"
            raise InputError.of(f"has a pole of size {radius:.6g}; {allowed}", key="law")
        nothing = np.zeros((0, 1))
        return cls(Law(a, b, c, d, period) if states else Law(a, nothing, nothing.T, d, period))


def _matrix(name: str, given: Any) -> FloatArray:
    """Return a matrix of a system, or refuse what has other entries than real numbers."""
    try:
        matrix = np.atleast_2d(np.asarray(given))
    except ValueError:  # rows of other lengths
        matrix = np.atleast_2d(np.asarray(None))
    if matrix.dtype.kind not in "iuf" or matrix.ndim != 2:
        raise InputError.of(f"has {name} = {shown(given)}; allowed: a matrix of real numbers", key="law")
    return matrix.astype(np.float64)


def is_system(law: object) -> bool:
    """Return whether something is a discrete system, by its attributes."""
    return all(hasattr(law, name) for name in ("A", "B", "C", "D", "dt"))


def with_law(problem: Problem, law: Any, gains: Mapping[str, float | None]) -> Problem:
    """Return a problem with a law in place of its own, and gains in place of those of the law.

    Args:
        problem: with its own law, or none.
        law: a `ControlLaw`, the keys of a table `[law]`, or None, which keeps the problem's own.
        gains: by k, b, b_p and cutoff_hz; None keeps that of the law.

    Raises:
        InputError: a law of another kind, or a cutoff for a velocity that has none.
    """
    stated = problem
    if law is not None:
        if not isinstance(law, Mapping | ControlLaw):
            allowed = "allowed: keys of a table [law], or a discrete system with A, B, C, D and dt"
            raise InputError.of(f"is a {type(law).__name__}; {allowed}", key="law")
        table = law if isinstance(law, ControlLaw) else problem.units.read(dict(law))
        stated = problem.changed(law=None).changed(law=table)
    keys = {"k": "stiffness_n_per_m", "b": "damping_ns_per_m", "b_p": "local_damping_ns_per_m"}
    changes: dict[str, Any] = {key: gains[name] for name, key in keys.items() if gains[name] is not None}
    if gains["cutoff_hz"] is not None:
        changes["velocity"] = _with_cutoff(stated.law, gains["cutoff_hz"])
    return stated.changed(law=changes) if changes else stated


def _with_cutoff(law: ControlLaw | None, cutoff_hz: float) -> dict[str, Any]:
    """Return the keys of a low pass of the velocity: of that of a law, or behind its difference, which has none."""
    kind = DifferenceVelocity().kind if law is None else law.velocity.kind
    if kind not in (DifferenceVelocity().kind, _LOW_PASS):
        instead = f'leave it out, or replace the estimator: --velocity "low-pass {cutoff_hz:g} Hz"'
        raise InputError.of(
            f'is the cutoff of a low pass, but law.velocity is of kind "{kind}"; {instead}', key="cutoff_hz"
        )
    return {"kind": _LOW_PASS, "cutoff_hz": cutoff_hz}


def at_own_rate(problem: Problem) -> Problem:
    """Return a problem in which a law of a rate divider n runs at every sample: T n, and a delay of so many of these.

    A delay of d samples T is one of d/n samples T n, and what the device holds between is the same.
    """
    law, device = problem.law, problem.device
    if law is None or law.rate_divider == 1:
        return problem
    slower = law.rate_divider
    ranges = device.range
    if ranges.delay_samples is not None:
        low, high = ranges.delay_samples
        ranges = ranges.model_copy(update={"delay_samples": (low / slower, high / slower)})
    clock = {"sample_time_s": slower * device.sample_time_s, "delay_samples": device.delay_samples / slower}
    slow_device = device.model_copy(update={**clock, "range": ranges})
    return problem.model_copy(update={"device": slow_device, "law": law.model_copy(update={"rate_divider": 1})})


@dataclass(frozen=True)
class ActingLaws:
    """The laws that act in contact, and outside the wall, each with its nonlinear pieces as sectors."""

    in_contact: tuple[Law, ...]
    outside: tuple[Law, ...] = ()

    @property
    def all(self) -> tuple[Law, ...]:
        """All of them."""
        return (*self.in_contact, *self.outside)


def acting_laws(
    law: ControlLaw | StatedSystem, period_s: float, *, outside: bool, detent: Detent | None = None
) -> ActingLaws:
    """Return the laws that act, those outside the wall too on request; each in a valley of detents, too.

    A time between steps is a window of up to twice its timeout, as long as the motion is slow: the difference of fast
    motion and the longest window are judged.
    """
    if isinstance(law, StatedSystem):
        acting = ActingLaws((law.stated,))
    else:
        tables = [law]
        if isinstance(law.velocity, TicksVelocity):
            tables.append(law.model_copy(update={"velocity": DifferenceVelocity()}))
        acting = ActingLaws(
            in_contact=tuple(table.with_sectors(period_s) for table in tables),
            outside=tuple(table.with_sectors(period_s, contact=False) for table in tables if outside),
        )
    if detent is None:
        return acting
    valley = Law.spring_damper(detent.slope_n_per_m, detent.damping_ns_per_m, period_s)
    return ActingLaws(
        in_contact=(*acting.in_contact, *(part + valley for part in acting.in_contact)),
        outside=(*acting.outside, *(part + valley for part in acting.outside)),
    )


def static_gain(law: Law) -> float:
    """Return the size of force over position at rest; infinite with an integral."""
    if law.states and float(np.abs(np.linalg.eigvals(law.a) - 1).min()) < _DIES_AWAY:
        return math.inf
    return float(abs(law.transfer(np.array(1.0 + 0j))))


def rendered_n_per_m(law: Law, device: Device) -> dict[float, float]:
    """Return the magnitude of force over position at the handle, at the frequencies of a hand below half the rate."""
    hz = np.array([frequency for frequency in _RENDERED_HZ if frequency < 0.5 / law.sample_time_s])
    sampled = law.transfer(np.exp(2j * math.pi * hz * law.sample_time_s))
    return dict(zip(hz.tolist(), moving_stiffness_at_handle(device, sampled, hz).tolist(), strict=True))


def noise_n(law: AnyLaw, device: Device) -> float:
    """Return the rms of the force on a device at rest, of white noise that spreads over steps of the encoder."""
    if device.position_noise_rms_m == 0:
        return 0.0
    noise = math.hypot(device.position_noise_rms_m, device.encoder_resolution_m / math.sqrt(12))
    return noise * noise_gain(law.law(device.sample_time_s))


def step_noise_n(law: AnyLaw, device: Device) -> float:
    """Return the rms of the force on a device that moves over steps of the encoder, each an error of step/sqrt(12)."""
    return device.encoder_resolution_m / math.sqrt(12) * noise_gain(law.law(device.sample_time_s))


def noise_gain(law: Law) -> float:
    """Return `Law.noise_gain` of the part of a law that dies away: what integrals add the loop takes back.

    With A = Q [[P, R], [0, S]] Q^T, P what dies away, and P X - X S = -R, the states q - X r of Q^T s = (q, r) are
    those of P alone.
    """
    if not law.states:
        return law.noise_gain()
    upper, basis, fading = schur(law.a, sort=lambda real, imaginary: math.hypot(real, imaginary) < 1 - _DIES_AWAY)
    if fading == law.states:
        return law.noise_gain()
    into, out = basis.T @ law.b, law.c @ basis
    apart = solve_sylvester(upper[:fading, :fading], -upper[fading:, fading:], -upper[:fading, fading:])
    rest = Law(
        a=upper[:fading, :fading],
        b=into[:fading] - apart @ into[fading:],
        c=out[:, :fading],
        d=law.d,
        sample_time_s=law.sample_time_s,
    )
    return rest.noise_gain()
