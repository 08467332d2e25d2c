"""Coupling and environment in series at one sample, solved in closed form.

The coupling (k, b) joins the device at x to a massless tool at p, which meets the environment (k_e, b_e). Every rate is
gain * value - offset (a backward difference, filtered or not), so that with e = x - p and kappa = k + b gain

    f = kappa e - b offset_c    at the coupling,      f = kappa_e p - b_e offset_e    at the environment,

which is solved for f and p without iteration. A one-sided wall sees the tool's penetration max(p, 0) and never pulls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi.scene.loop._tick import Expr, Rate, Tick
from avc_casadi.support import FloatArray

# N/m: far below any gain, far above the least of single precision.
_NO_GAINS = 1e-20
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

    @property
    def damped(self) -> bool:
        """Whether it has a damper, whose rate needs a state."""
        return self.damping_ns_per_m > 0


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
    offset: Expr = 0.0
    kappa_e = k_e
    if environment.damped:
        surface = Rate(tick, "environment_deflection", start)
        kappa_e = k_e + b_e * surface.gain
        offset = b_e / kappa_e * surface.offset
    if rigid:
        free, series = x, None
    else:
        stretch = Rate(tick, "coupling_deflection")
        memory, compliance, series, anchor_share = _gains(tick, stretch, kappa_e, one_sided=one_sided)
        free = x - memory * stretch.offset
        if tick.adapted is not None:
            free -= anchor_share * tick.adapted.anchor_m
    force = (kappa_e if series is None else series) * (free - offset)
    if one_sided:
        force = _pushing_only(tick, force, free, None if series is None else compliance)
    tool = x if series is None else free - compliance * force
    if series is not None:
        stretch.settle(x - tool)
    if environment.damped:
        surface.settle(ca.fmax(tool, 0) if one_sided else tool)
    tick.trace("tool_m", tool)
    depth = ca.fmax(tool, 0) if one_sided else tool
    tick.environment_energy_j = 0.5 * k_e * depth * depth
    if series is not None:
        tick.coupling_energy_j = _spring_energy(tick, x - tool, stretch.gain, memory, compliance)
    return force


def _gains(tick: Tick, stretch: Rate, kappa_e: Expr, *, one_sided: bool) -> tuple[Expr, Expr, Expr, Expr]:
    """Return b/kappa, 1/kappa, the stiffness in series and k/kappa: parameters of a run, or from the gains of now."""
    if tick.adapt is None:
        memory, compliance, series = (tick.parameter(name) for name in COUPLING_PARAMETERS)
        return memory, compliance, series, None
    tick.adapted = gains = tick.adapt(stretch.before, one_sided)
    stretch.forget(gains.touching)
    kappa = gains.stiffness_n_per_m + gains.damping_ns_per_m * stretch.gain
    # Without gains there is no force, whatever the compliance: it only has to be a number.
    compliance = 1 / (kappa + _NO_GAINS)
    series = kappa * (kappa_e / (kappa + kappa_e))
    return gains.damping_ns_per_m * compliance, compliance, series, gains.stiffness_n_per_m * compliance


def _spring_energy(tick: Tick, deflection: Expr, rate_gain_per_s: Expr, memory: Expr, compliance: Expr) -> Expr:
    import casadi as ca  # noqa: PLC0415

    if tick.adapted is not None:
        stretch = deflection - tick.adapted.anchor_m
        return 0.5 * tick.adapted.stiffness_n_per_m * stretch * stretch
    some = compliance > 0
    stiffness = (1 - memory * rate_gain_per_s) / ca.if_else(some, compliance, 1)
    return ca.if_else(some, 0.5 * stiffness * deflection * deflection, 0)


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
    """Add the damper b_p between device and ground, in contact only, and never pulling.

    It acts on the velocity of the device. The rate of the depth alone would miss a part of it at the first sample of a
    contact, and light hands then bounce for ever.
    """
    import casadi as ca  # noqa: PLC0415

    adapted = tick.adapted
    damping = tick.parameter("contact_damping_ns_per_m") if adapted is None else adapted.contact_damping_ns_per_m
    total = force + damping * Rate(tick, "contact_position", tick.start_m).settle(tick.position)
    return ca.if_else(tick.position > 0, ca.fmax(total, 0), 0) if one_sided else total
