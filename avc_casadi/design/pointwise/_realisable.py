"""Which gains of the closed form can be built, judged with the rounding of what they were computed from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import BoolArray, ComplexArray, FloatArray

if TYPE_CHECKING:
    from avc_casadi.loop import Loop
    from avc_casadi.problem import Problem

ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""Rounding of a sum of a few terms, relative to their magnitudes."""

RIGID = "asks for a rigid coupling: the rendered impedance equals the environment"
FREE_SPACE = "asks for an impedance that no coupling renders in free space (b_e = k_e = 0)"
NOTHING = "nothing to render: environment and goal are free space (b_e = k_e = 0), so that any coupling does the same"


@dataclass(frozen=True)
class Quotient:
    """Z_avc = Z_e Z_eavc/(Z_e - Z_eavc) with its rounding; arrays of shape (n,), N.s/m.

    Attributes:
        coupling: Z_avc.
        rounding: how far it may be off.
        rigid: the difference below the line is nothing but rounding.
        nothing: environment and rendered impedance are 0, so that every coupling will do.
        impossible: the environment is 0 and the rendered impedance is not.
    """

    coupling: ComplexArray
    rounding: FloatArray
    rigid: BoolArray
    nothing: BoolArray
    impossible: BoolArray

    @classmethod
    def of(cls, loop: Loop, desired: ComplexArray, gap: ComplexArray, injected: FloatArray) -> Quotient:
        """Divide, for Z_eavc = desired + injected/H.

        Args:
            loop: the loop at n frequencies.
            desired: Z_ds, shape (n,).
            gap: Z_e - Z_ds, shape (n,).
            injected: damping delta of the projection, shape (n,); 0 where it injects nothing.
        """
        push = injected / loop.hold
        rendered, difference = desired + push, gap - push
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
    """Put gains that lie outside an interval by no more than rounding onto its end."""
    inside = np.clip(value, *ends)
    return np.where(np.abs(value - inside) <= rounding, inside, value)


def why_not(problem: Problem, b: float, k: float, contact: float) -> str:
    """Say why finite gains cannot be built, or nothing."""
    faults = []
    box = problem.coupling
    for name, unit, value, (low, high) in (
        ("stiffness", "N/m", k, box.stiffness_n_per_m),
        ("damping", "N.s/m", b, box.damping_ns_per_m),
        ("contact damping", "N.s/m", contact, box.contact_damping_ns_per_m),
    ):
        if not np.isfinite(value):
            faults.append(f"asks for {name} that is not finite")
        elif value < 0:
            faults.append(f"asks for negative {name} {value:.6g} {unit}")
        elif not low <= value <= high:
            faults.append(f"asks for {name} {value:.6g} {unit} outside [{low:g}, {high:g}]")
    return "; ".join(faults)
