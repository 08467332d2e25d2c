"""What the paper's projection really is: the desired wall, a damper delta and a small virtual mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import Comparable, FloatArray
from avc_casadi.design.methods import solve
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.equations import tustin
from avc_casadi.paper.loop import Loop

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avc_casadi.model.problem import Problem


# The largest damper that a problem can state.
_MOST_NS_PER_M = 1e9


@dataclass(frozen=True, eq=False)
class DampingInjection(Comparable):
    """The projection read as damping injection; arrays of shape (n,), 0 where the desired wall is passive already.

    Z_h = Z_h_ds + delta with delta = max(0, margin - Re Z_h_ds), so that the coupling renders Z_ds + delta/H. In the
    paper's model without delay 1/H = 1 + s_t T/2: a damper delta and a virtual mass delta T/2.

    Attributes:
        injected_damping_ns_per_m: delta.
        virtual_mass_kg: the part of delta/H that behaves as a mass, Im(delta/H)/Im(s_t).
        contact_damper_ns_per_m: b_p = delta/Re H, which renders delta in the damped structure; not a number where
            Re H <= 0 and no damper can.
        residual_error: |H b_p - delta|/|Z_h_ds|, the relative error of a damper without the virtual mass.
        damped_realisable: whether the damped structure holds it: spring and damper in the gain box render the desired
            wall, and b_p, however large, the injected damping.
        damped_reason: why not; empty where it does.
    """

    injected_damping_ns_per_m: FloatArray
    virtual_mass_kg: FloatArray
    contact_damper_ns_per_m: FloatArray
    residual_error: FloatArray
    damped_realisable: NDArray[np.bool_]
    damped_reason: tuple[str, ...]


def damping_injection(problem: Problem, loop: Loop) -> DampingInjection:
    """Read the closed form of a problem as damping injection."""
    delta = project(problem).injected_damping_ns_per_m
    hold = np.asarray(loop.hold)
    can = hold.real > 0
    needed = delta > 0
    contact = np.where(needed, np.where(can, delta / np.where(can, hold.real, 1.0), np.nan), 0.0)
    size = np.abs(loop.target)
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = np.where(needed, np.abs(hold * contact - delta) / size, 0.0)
    mass = np.imag(delta / hold) / tustin(loop.angle).imag
    damped = solve(_damped(problem), "closed-form")
    return DampingInjection(delta, mass, contact, residual, damped.usable, damped.reason)


def _damped(problem: Problem) -> Problem:
    """The same problem in the damped structure, any contact damping allowed."""
    return problem.changed(coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, _MOST_NS_PER_M)})
