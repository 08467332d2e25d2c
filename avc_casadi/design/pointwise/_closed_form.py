"""The paper's closed form: project the desired impedance onto Re Z >= 0, then go back to gains (steps 1 to 4)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.coupling import (
    GainSchedule,
    Status,
    gain_schedule,
)
from avc_casadi.design._rows import pointwise_notes
from avc_casadi.loop import Loop, coupling_gains, loop_at
from avc_casadi.support import ComplexArray, FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


@dataclass(frozen=True)
class Projection:
    """The projected impedance and the damping injection that it amounts to; arrays of shape (n,).

    The projection renders the desired impedance plus delta/H. In the paper's model without delay 1/H = 1 + s_t T/2, so
    that it is a damper delta and a virtual mass delta T/2 beside the desired wall.

    Attributes:
        impedance: Z of (13), N.s/m.
        rendered: Z_eavc of (15), N.s/m.
        coupling: Z_avc of (16), N.s/m; infinite where the coupling would have to be rigid.
        injected_damping_ns_per_m: delta = max(0, margin - Re Z_h_ds).
        virtual_mass_kg: delta T/2.
    """

    impedance: ComplexArray
    rendered: ComplexArray
    coupling: ComplexArray
    injected_damping_ns_per_m: FloatArray
    virtual_mass_kg: FloatArray


def project(problem: Problem, *, as_printed: bool = False) -> Projection:
    """Evaluate (10), (13), (15) and (16) at the problem's frequencies.

    Args:
        problem: the problem; the paper's margin is 0.
        as_printed: take s of (10) as printed, T(z-1)/(2(z+1)), which is T^2/4 times the right one.
    """
    loop = loop_at(problem, problem.frequencies_hz())
    desired, gap = (_printed_desired(problem, loop)) if as_printed else (loop.desired, loop.desired_gap)
    target = loop.device + loop.hold * desired
    delta = np.maximum(0.0, problem.stability.margin_ns_per_m - target.real)
    rendered = desired + delta / loop.hold
    difference = gap - delta / loop.hold
    with np.errstate(divide="ignore", invalid="ignore"):
        coupling = loop.environment * rendered / difference
    coupling = np.where(difference == 0, np.inf, coupling)
    return Projection(target + delta, rendered, coupling, delta, delta * problem.device.sample_time_s / 2)


def _printed_desired(problem: Problem, loop: Loop) -> tuple[ComplexArray, ComplexArray]:
    """Z_ds and Z_e - Z_ds with the printed s, whose inverse is 4/T^2 times too large."""
    scale = 4 / problem.device.sample_time_s**2
    desired = loop.desired.real + 1j * loop.desired.imag * scale
    return desired, loop.environment - desired


def solve_closed_form(problem: Problem, *, as_printed: bool = False) -> GainSchedule:
    """Solve by the paper's closed form, corrected or as printed.

    In the series structure rows whose spring and damper would be negative, infinite or outside the gain box are marked
    not realisable; their impedance is that of the projection. In the damped structure the spring and damper render the
    desired wall and the contact damper b_p = delta/Re H injects the damping; only the virtual mass is left out.

    Args:
        problem: the problem.
        as_printed: use (10) and (17) as the paper prints them.
    """
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    projection = project(problem, as_printed=as_printed)
    damped = problem.coupling.structure == "damped"
    with np.errstate(divide="ignore", invalid="ignore"):
        coupling = projection.coupling
        contact = np.zeros(coupling.shape)
        if damped:
            gap = loop.desired_gap
            coupling = np.where(gap == 0, np.inf, loop.environment * loop.desired / gap)
            contact = projection.injected_damping_ns_per_m / loop.hold.real
        b, k = coupling_gains(loop.angle, coupling)
        if as_printed:
            printed_s = problem.device.sample_time_s / 2 * loop.angle.sin / loop.angle.cos
            b, k = coupling.real, -coupling.imag * printed_s
    rigid = ~np.isfinite(coupling)
    b, k = np.where(rigid, np.inf, b), np.where(rigid, np.inf, k)
    reasons = tuple(_reason(problem, *row) for row in zip(b, k, contact, strict=True))
    status = tuple(Status.NOT_REALISABLE if reason else Status.SOLVED for reason in reasons)
    return gain_schedule(
        problem,
        "closed-form",
        (b, k, contact),
        status,
        solver="as-printed" if as_printed else None,
        reason=reasons,
        requested=(b, k),
        requested_contact=contact,
        impedance=None if damped else projection.impedance,
        solve_seconds=time.perf_counter() - started,
        notes=pointwise_notes(problem),
    )


def _reason(problem: Problem, b: float, k: float, contact: float) -> str:
    """Say why a row cannot be built, or nothing."""
    if not (np.isfinite(b) and np.isfinite(k)):
        return "asks for a rigid coupling: the rendered impedance equals the environment"
    faults = []
    box = problem.coupling
    for name, unit, value, (low, high) in (
        ("stiffness", "N/m", k, box.stiffness_n_per_m),
        ("damping", "N.s/m", b, box.damping_ns_per_m),
        ("contact damping", "N.s/m", contact, box.contact_damping_ns_per_m),
    ):
        if value < 0 or not np.isfinite(value):
            faults.append(f"asks for negative {name} {value:.6g} {unit}")
        elif not low <= value <= high:
            faults.append(f"asks for {name} {value:.6g} {unit} outside [{low:g}, {high:g}]")
    return "; ".join(faults)
