"""Coupling and environment in series at one sample, solved in closed form.

The coupling (k, b) joins the device at x to a massless tool at p, which meets the environment (k_e, b_e). Every rate is
gain * value - offset (a backward difference, filtered or not), so that with e = x - p and kappa = k + b gain

    f = kappa e - b offset_c    at the coupling,      f = kappa_e p - b_e offset_e    at the environment,

which is solved for f and p without iteration. A one-sided wall sees the tool's penetration max(p, 0) and never pulls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avc_casadi.scene._tick import Expr, Rate, Tick

FloatArray = NDArray[np.float64]

COUPLING_PARAMETERS = ("coupling_memory_s", "coupling_compliance_m_per_n", "series_stiffness_n_per_m")


@dataclass(frozen=True)
class Environment:
    """The virtual environment of a scene.

    Attributes:
        stiffness_n_per_m: k_e.
        damping_ns_per_m: b_e.
        one_sided: no force at x < 0, and none that pulls.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    one_sided: bool

    @property
    def present(self) -> bool:
        """Whether it can give any force at all."""
        return self.stiffness_n_per_m > 0 or self.damping_ns_per_m > 0


def coupling_parameters(
    damping_ns_per_m: ArrayLike, stiffness_n_per_m: ArrayLike, environment: Environment, rate_gain_per_s: float
) -> FloatArray:
    """Return b/kappa, 1/kappa and the stiffness in series over one sample, shape (..., 3).

    Args:
        damping_ns_per_m: b; infinite for a rigid coupling.
        stiffness_n_per_m: k; infinite for a rigid coupling.
        environment: the environment.
        rate_gain_per_s: gain of the rates, 1/T without a velocity filter.
    """
    b, k = np.broadcast_arrays(np.asarray(damping_ns_per_m, np.float64), np.asarray(stiffness_n_per_m, np.float64))
    kappa = k + b * rate_gain_per_s
    kappa_e = environment.stiffness_n_per_m + environment.damping_ns_per_m * rate_gain_per_s
    rigid = np.isinf(kappa)
    finite = np.where(rigid | (kappa == 0), 1.0, kappa)
    memory = np.where(rigid | (kappa == 0), 0.0, b / finite)
    compliance = np.where(rigid | (kappa == 0), 0.0, 1.0 / finite)
    series = np.where(rigid, kappa_e, np.where(kappa == 0, 0.0, finite * (kappa_e / (finite + kappa_e))))
    return np.stack([memory, compliance, series], axis=-1)


def series_force(tick: Tick, environment: Environment, *, rigid: bool) -> Expr:
    """Add coupling and environment; returns the force f on the device, positive against +x.

    Args:
        tick: the loop so far, with the measured position.
        environment: an environment that is present.
        rigid: join device and environment without a coupling.
    """
    import casadi as ca  # noqa: PLC0415

    x = tick.position
    k_e, b_e, one_sided = environment.stiffness_n_per_m, environment.damping_ns_per_m, environment.one_sided
    start = max(tick.start_m, 0.0) if one_sided else tick.start_m
    if rigid:
        free, series = x, None
    else:
        memory, compliance, series = (tick.parameter(name) for name in COUPLING_PARAMETERS)
        stretch = Rate(tick, "coupling_deflection")
        free = x - memory * stretch.offset
    offset: Expr = 0.0
    kappa_e = k_e
    if b_e > 0:
        surface = Rate(tick, "environment_deflection", start)
        kappa_e = k_e + b_e * surface.gain
        offset = b_e / kappa_e * surface.offset
    force = (kappa_e if series is None else series) * (free - offset)
    if one_sided:
        force = _pushing_only(tick, force, free, None if series is None else compliance)
    tool = x if series is None else free - compliance * force
    if series is not None:
        stretch.settle(x - tool)
    if b_e > 0:
        surface.settle(ca.fmax(tool, 0) if one_sided else tool)
    tick.trace("tool_m", tool)
    return force


def _pushing_only(tick: Tick, force: Expr, free: Expr, compliance: Expr | None) -> Expr:
    import casadi as ca  # noqa: PLC0415

    if tick.filter_share == 0:
        # The past of a plain difference never pushes a tool that is out of the wall: f > 0 implies p > 0.
        return ca.fmax(force, 0)
    if compliance is None:
        return ca.if_else(free > 0, ca.fmax(force, 0), 0)
    # A filtered rate still remembers the way in: at most the force that keeps the tool at the surface.
    return ca.fmax(ca.if_else(compliance * force > free, free / compliance, force), 0)


def contact_damper(tick: Tick, force: Expr, *, one_sided: bool) -> Expr:
    """Add the damper b_p between device and ground, in contact only, and never pulling."""
    import casadi as ca  # noqa: PLC0415

    damping = tick.parameter("contact_damping_ns_per_m")
    depth = ca.fmax(tick.position, 0) if one_sided else tick.position
    start = max(tick.start_m, 0.0) if one_sided else tick.start_m
    total = force + damping * Rate(tick, "contact_depth", start).settle(depth)
    if not one_sided:
        return total
    pushing = ca.fmax(total, 0)
    # Only a filtered rate outlasts the contact.
    return pushing if tick.filter_share == 0 else ca.if_else(depth > 0, pushing, 0)
