"""A causal coupling beside the paper's gains: the pair b(f), k(f) that it amounts to at each frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.json_values import plain
from avc_casadi.loops.wall import force_over_position, frozen_rendering
from avc_casadi.paper import equations as eq
from avc_casadi.paper.equations import loop_at

if TYPE_CHECKING:
    from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling


@dataclass(frozen=True, eq=False)
class CausalGains:
    """The series coupling that renders, at each frequency, what a causal coupling does; arrays of shape (n,).

    Attributes:
        damping_ns_per_m: b of Z_avc = Z_r Z_e/(Z_e - Z_r) for the rendered impedance Z_r, by (17); of either sign, as a
            causal coupling may render more than the wall; not a number where it renders the wall itself.
        stiffness_n_per_m: k of the same.
        impedance: perceived impedance Z_h = Z_d + H Z_r of the problem's model, N.s/m.
        magnitude_error: ||Z_h| - |Z_h_ds||, N.s/m, the goal (11).
        complex_error: |Z_h - Z_h_ds|/|Z_h_ds|.
    """

    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    impedance: ComplexArray
    magnitude_error: FloatArray
    complex_error: FloatArray

    @property
    def usable(self) -> BoolArray:
        """Where there is a pair."""
        return np.asarray(np.isfinite(self.stiffness_n_per_m))

    def document(self) -> dict[str, Any]:
        """Return JSON values: the pair and both errors at each frequency."""
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "magnitude_error", "complex_error")
        found: dict[str, Any] = plain({key: getattr(self, key) for key in keys})
        return found


def causal_gains(coupling: Coupling) -> CausalGains:
    """Return what a coupling renders at its problem's frequencies, of small motions in contact, as series gains."""
    problem = coupling.problem
    loop = loop_at(problem, problem.frequencies_hz())
    z = np.exp(2j * np.pi * loop.angle.turns)
    force = force_over_position(
        frozen_rendering(problem, *vars(coupling.table.at_rest).values()), z, coupling.runtime.state_feedback
    )
    rendered = force * np.asarray(eq.environment_impedance(loop.angle, problem.stability.model, 0.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping, stiffness = eq.coupling_gains(loop.angle, rendered * loop.environment / (loop.environment - rendered))
    felt, target = np.asarray(eq.perceived_impedance(loop.device, loop.hold, rendered)), np.asarray(loop.target)
    return CausalGains(
        damping_ns_per_m=np.where(np.isfinite(stiffness), damping, np.nan),
        stiffness_n_per_m=np.where(np.isfinite(stiffness), stiffness, np.nan),
        impedance=felt,
        magnitude_error=np.abs(np.abs(felt) - np.abs(target)),
        complex_error=np.abs(felt - target) / np.abs(target),
    )
