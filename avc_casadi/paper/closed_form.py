"""The paper's closed form: project the desired impedance onto Re Z >= 0, then go back to gains (steps 1 to 4)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.equations import ImpedanceLoop, coupling_gains, environment_impedance, loop_at
from avc_casadi.paper.rows import SolveRecord, gain_schedule, pointwise_notes

ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""Rounding of a sum of a few terms, relative to their magnitudes."""


@dataclass(frozen=True)
class Quotient:
    """Z_avc = Z_e Z_eavc/(Z_e - Z_eavc) with its rounding; arrays of shape (n,), N.s/m.

    Attributes:
        coupling: Z_avc, infinite where it would have to be rigid, 0 in free space.
        rounding: bound of its rounding error.
        rigid: where the rendered impedance equals the environment, but for rounding.
        nothing: where environment and rendered impedance are free space.
        impossible: where the environment is free space, but the rendered impedance is not.
    """

    coupling: ComplexArray
    rounding: FloatArray
    rigid: BoolArray
    nothing: BoolArray
    impossible: BoolArray

    @classmethod
    def of(cls, loop: ImpedanceLoop, desired: ComplexArray, gap: ComplexArray, injected: FloatArray) -> Quotient:
        """Return Z_avc = Z_e Z/(Z_e - Z) of Z = desired + injected/H, with its rounding, N.s/m.

        `gap` is Z_e - desired, given apart, as it may be small; `injected` is the damper of the projection.
        """
        push = injected / loop.hold
        rendered = desired + push
        difference = gap - push
        terms = np.abs(loop.device.real) + np.abs(loop.hold.real * desired.real)
        terms = terms + np.abs(loop.hold.imag * desired.imag) + injected
        push_off = np.where(injected > 0, ROUNDING * terms / np.abs(loop.hold), 0.0)
        rendered_off = ROUNDING * (np.abs(desired) + np.abs(push)) + push_off
        difference_off = ROUNDING * (np.abs(gap) + np.abs(push)) + push_off
        free = loop.environment == 0
        rigid = ~free & (np.abs(difference) <= difference_off)
        nothing = free & (np.abs(rendered) <= rendered_off)
        below = np.where(free | rigid, 1.0, difference)
        coupling = np.where(rigid, np.inf, np.where(free, 0.0, loop.environment * rendered / below))
        scale = np.abs(loop.environment / below)
        rounding = scale * (rendered_off + np.abs(rendered) * (ROUNDING + difference_off / np.abs(below)))
        return cls(coupling, rounding, rigid, nothing, free & ~nothing)


def placed(value: FloatArray, rounding: FloatArray, ends: tuple[float, float]) -> FloatArray:
    """Return gains, those outside an interval by rounding alone moved to its end."""
    inside = np.clip(value, *ends)
    return np.where(np.abs(value - inside) <= rounding, inside, value)


def why_not(problem: Problem, b: float, k: float, contact: float) -> str:
    """Return why finite gains cannot be built, or nothing."""
    box = problem.coupling
    stiffness_unit = problem.units.unit("N/m")
    damping_unit = problem.units.unit("N.s/m")
    faults = (
        _fault("stiffness", k, stiffness_unit, box.stiffness_n_per_m),
        _fault("damping", b, damping_unit, box.damping_ns_per_m),
        _fault("contact damping", contact, damping_unit, box.contact_damping_ns_per_m),
    )
    return "; ".join(filter(None, faults))


def _fault(name: str, value: float, unit: str, ends: tuple[float, float]) -> str:
    """Return why one gain cannot be built, or nothing."""
    low, high = ends
    if not np.isfinite(value):
        return f"needs {name} that is not finite"
    if value < 0:
        return f"needs negative {name} {value:.6g} {unit}"
    if not low <= value <= high:
        return f"needs {name} {value:.6g} {unit} outside [{low:g}, {high:g}]"
    return ""


@dataclass(frozen=True)
class Projection:
    """The projected impedance and its equivalent damping injection; arrays of shape (n,), N.s/m.

    Attributes:
        impedance: Z of (13).
        rendered: Z_eavc of (15).
        coupling: Z_avc of (16): infinite where it would have to be rigid, 0 in free space.
        injected_damping_ns_per_m: delta = max(0, margin - Re Z_h_ds).
    """

    impedance: ComplexArray
    rendered: ComplexArray
    coupling: ComplexArray
    injected_damping_ns_per_m: FloatArray


def project(problem: Problem, *, as_printed: bool = False) -> Projection:
    """Evaluate (10), (13), (15) and (16) at the problem's frequencies."""
    loop = loop_at(problem, problem.frequencies_hz())
    desired, gap = _desired(problem, loop, as_printed=as_printed)
    target = loop.device + loop.hold * desired
    delta = np.maximum(0.0, margin_over_range(problem) - target.real)
    coupling = Quotient.of(loop, desired, gap, delta).coupling
    return Projection(target + delta, desired + delta / loop.hold, coupling, delta)


def _desired(problem: Problem, loop: ImpedanceLoop, *, as_printed: bool) -> tuple[ComplexArray, ComplexArray]:
    """Return Z_ds and Z_e - Z_ds; the printed s is imaginary as Tustin's: Im alone has the stiffness, 4/T^2 times."""
    if not as_printed:
        return loop.desired, loop.desired_gap
    upper = problem.boundaries.upper
    lower = problem.boundaries.lower
    b = (upper.damping_ns_per_m + lower.damping_ns_per_m) / 2
    k = (upper.stiffness_n_per_m + lower.stiffness_n_per_m) / 2
    tustin = environment_impedance(loop.angle, "paper", b, k)
    desired = tustin.real + 4j / problem.device.sample_time_s**2 * tustin.imag
    return desired, loop.environment - desired


CANNOT_BE_RIGID = "needs a rigid coupling: the rendered impedance equals the environment"
FREE_SPACE = "needs an impedance that no coupling renders in free space (b_e = k_e = 0)"
NOTHING_TO_RENDER = (
    "nothing to render: environment and goal are free space (b_e = k_e = 0), so that any coupling does the same"
)


def solve_closed_form(problem: Problem, *, as_printed: bool = False) -> GainSchedule:
    """Return the gains of the closed form, corrected or as printed; those outside the gain box are not realisable.

    With the structure `damped` the projection's damper is a contact damper, otherwise it goes into the series gains.
    """
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    projection = project(problem, as_printed=as_printed)
    delta = projection.injected_damping_ns_per_m
    damped = problem.coupling.structure == "damped"
    desired, gap = _desired(problem, loop, as_printed=as_printed and not damped)
    none = np.zeros(delta.shape)
    quotient = Quotient.of(loop, desired, gap, none if damped else delta)
    contact = none
    if damped:
        with np.errstate(divide="ignore", invalid="ignore"):
            contact = np.where(delta > 0, delta / loop.hold.real, 0.0)
    b, k = _series_gains(problem, loop, quotient, as_printed=as_printed)
    reasons = tuple(
        _reason(problem, rigid=rigid, impossible=impossible, gains=gains)
        for rigid, impossible, *gains in zip(quotient.rigid, quotient.impossible, b, k, contact, strict=True)
    )
    status = tuple(Status.NOT_REALISABLE if reason else Status.SOLVED for reason in reasons)
    record = SolveRecord(
        solver="as-printed" if as_printed else None,
        reason=reasons,
        solve_seconds=time.perf_counter() - started,
        notes=(*pointwise_notes(problem), *((NOTHING_TO_RENDER,) if quotient.nothing.all() else ())),
    )
    schedule = gain_schedule(problem, "closed-form", (b, k, contact), status, record)
    # The projection is known where the gains that would render it are not realisable.
    return replace(
        schedule,
        impedance=schedule.impedance if damped else projection.impedance,
        requested_damping_ns_per_m=b,
        requested_stiffness_n_per_m=k,
        requested_contact_damping_ns_per_m=contact,
    )


def _series_gains(
    problem: Problem, loop: ImpedanceLoop, quotient: Quotient, *, as_printed: bool
) -> tuple[FloatArray, FloatArray]:
    """Return (b, k) of Z_avc, each (n,), by (17) or as it is printed; infinite where it is rigid.

    (17): k = -Im(Z_avc) (2/T) tan(phi), b = Re(Z_avc) - k T/2.
    As printed: k = -Im(Z_avc) (T/2) tan(phi), b = Re(Z_avc).
    """
    box = problem.coupling
    sample_time_s = problem.device.sample_time_s
    coupling = quotient.coupling
    with np.errstate(divide="ignore", invalid="ignore"):
        if as_printed:
            per_impedance = sample_time_s / 2 * loop.angle.sin / loop.angle.cos
            b, k = coupling.real, -coupling.imag * per_impedance
        else:
            per_impedance = 2 / sample_time_s * loop.angle.sin / loop.angle.cos
            b, k = coupling_gains(loop.angle, coupling)
        b = placed(b, quotient.rounding + ROUNDING * np.abs(coupling), box.damping_ns_per_m)
        k = placed(k, per_impedance * quotient.rounding, box.stiffness_n_per_m)
    b, k = (np.where(quotient.rigid, np.inf, np.where(quotient.impossible, np.nan, gain)) for gain in (b, k))
    b = np.where(quotient.nothing, box.damping_ns_per_m[0], b)
    k = np.where(quotient.nothing, box.stiffness_n_per_m[0], k)
    return b, k


def _reason(problem: Problem, *, rigid: bool, impossible: bool, gains: Sequence[float]) -> str:
    """Return why the gains (b, k, b_p) of one frequency are not realisable, or nothing."""
    if rigid:
        return CANNOT_BE_RIGID
    return FREE_SPACE if impossible else why_not(problem, *gains)
