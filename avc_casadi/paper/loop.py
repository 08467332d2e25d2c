"""The loop at given frequencies: everything of equations (7) to (12) that does not depend on the gains."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avc_casadi.paper import equations as eq
from avc_casadi.paper.numbers import NUMPY, Complex, NumberSystem, Real

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class Loop:
    """Impedances of device, environment and goal at one or many frequencies, in one number system."""

    angle: eq.SampleAngle
    device: Complex  # Z_d
    hold: Complex  # H
    environment: Complex  # Z_e
    desired: Complex  # Z_ds, mean of the realistic bounds
    desired_gap: Complex  # Z_e - Z_ds from the differences of the parameters, which do not cancel

    @property
    def target(self) -> Complex:
        """Z_h_ds = Z_d + H Z_ds   (10)."""
        return eq.perceived_impedance(self.device, self.hold, self.desired)

    @property
    def without_coupling(self) -> Complex:
        """Z_h = Z_d + H Z_e: perceived impedance of device and wall joined directly."""
        return eq.perceived_impedance(self.device, self.hold, self.environment)

    def rows(self, index: NDArray[np.intp]) -> Loop:
        """Return the loop at some of its frequencies, by their positions (numpy only)."""
        take = {field.name: getattr(self, field.name)[index] for field in fields(self) if field.name != "angle"}
        angle = replace(self.angle, **{name: getattr(self.angle, name)[index] for name in ("turns", "sin", "cos")})
        return Loop(angle=angle, **take)

    def rendered(self, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
        """Return Z_eavc, coupling and environment in series; 0 where both are 0   (9)."""
        coupling = eq.coupling_impedance(self.angle, damping_ns_per_m, stiffness_n_per_m)
        return eq.series(coupling, self.environment, numbers=self.angle.numbers)

    def sensitivity(self, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
        """Return dZ_h_avc/dZ_avc = H (Z_e/(Z_e + Z_avc))^2; 0 in free space."""
        coupling = eq.coupling_impedance(self.angle, damping_ns_per_m, stiffness_n_per_m)
        total = self.environment + coupling
        share = self.environment / np.where(total == 0, 1, total)
        return self.hold * share * share

    def perceived(
        self, damping_ns_per_m: Real, stiffness_n_per_m: Real, contact_damping_ns_per_m: Real = 0.0
    ) -> Complex:
        """Return Z_h_avc   (8)."""
        rendered = self.rendered(damping_ns_per_m, stiffness_n_per_m)
        return eq.perceived_impedance(self.device, self.hold, rendered, contact_damping_ns_per_m)


def loop_at(problem: Problem, frequency_hz: Real, numbers: NumberSystem = NUMPY) -> Loop:
    """Return the gain-free part of a problem's loop."""
    device, environment, model = problem.device, problem.environment, problem.stability.model
    upper, lower = problem.boundaries.upper, problem.boundaries.lower
    n = numbers.number
    desired_b = (n(upper.damping_ns_per_m) + n(lower.damping_ns_per_m)) / 2
    desired_k = (n(upper.stiffness_n_per_m) + n(lower.stiffness_n_per_m)) / 2
    environment_b, environment_k = n(environment.damping_ns_per_m), n(environment.stiffness_n_per_m)
    # From the bounds themselves: a gap of 1e-12 would vanish in the rounding of their mean.
    gap_b = ((environment_b - n(upper.damping_ns_per_m)) + (environment_b - n(lower.damping_ns_per_m))) / 2
    gap_k = ((environment_k - n(upper.stiffness_n_per_m)) + (environment_k - n(lower.stiffness_n_per_m))) / 2
    angle = eq.SampleAngle.at(numbers, frequency_hz, n(device.sample_time_s))
    return Loop(
        angle=angle,
        device=eq.device_impedance(angle, n(device.mass_kg), n(device.damping_ns_per_m)),
        hold=eq.hold(angle, model, device.delay_samples),
        environment=eq.environment_impedance(angle, model, environment_b, environment_k),
        desired=eq.environment_impedance(angle, model, desired_b, desired_k),
        desired_gap=eq.environment_impedance(angle, model, gap_b, gap_k),
    )
