"""Coupling and environment in series at one sample, solved in closed form, and the contact law of a one-sided wall.

The coupling (k, b) joins the device at x to a massless tool at p, which meets the environment (k_e, b_e). Every rate is
gain * value - offset, so that f = kappa e - b offset_c = kappa_e p - b_e offset_e with e = x - p, kappa = k + b gain is
solved for f and p without iteration. The contact damper adds its own rate of x: y = f + b_p dx/dt. Two laws:

- clip-last: f and p are those of the environment on both sides, always, and F = max(0, y): one nonlinearity of a slope
  within [0, 1], around a linear loop;
- gated: the tool's penetration is max(p, 0), the coupling never pulls, and F = max(0, y) where x > 0, otherwise 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.runtime import PLAIN
from avc_casadi.simulation.tick import Expr, Rate, Tick, ca

LEAST_STIFFNESS_N_PER_M = 1e-20
"""Added to the stiffness of varying gains, so that its reciprocal is finite where they are 0, and no force with it.

Far below any gain, far above the smallest number of single precision."""


@dataclass(frozen=True)
class Environment:
    """The virtual environment of a scene."""

    stiffness_n_per_m: float
    damping_ns_per_m: float
    one_sided: bool
    clips_last: bool = False

    @property
    def present(self) -> bool:
        """Whether it can exert a force."""
        return self.stiffness_n_per_m > 0 or self.damped

    @property
    def damped(self) -> bool:
        """Whether it has a damper, whose rate needs a state."""
        return self.damping_ns_per_m > 0

    def by_law(self, clip_last: Expr, gated: Expr) -> Expr:
        """Select a value by contact law; a two-sided environment is linear, as the clip-last law is."""
        return clip_last if self.clips_last or not self.one_sided else gated


def coupling_parameters(
    damping_ns_per_m: ArrayLike, stiffness_n_per_m: ArrayLike, environment: Environment, rate_gain_per_s: float
) -> FloatArray:
    """Return b/kappa, 1/kappa and kappa kappa_e/(kappa + kappa_e), kappa = k + b r, shape (..., 3).

    r is `rate_gain_per_s`, 1/T by the backward difference: over a sample a coupling b, k is the spring kappa with a
    memory, and kappa_e is the wall's. A rigid coupling is infinite k.
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


def wall_force(tick: Tick, environment: Environment, *, rigid: bool, damped: bool) -> Expr:
    """Return the force of coupling, wall and contact damper on the device by the contact law, N, positive against +x.

    Their states are added to the sample.
    """
    force = _series_force(tick, environment, rigid=rigid)
    if damped:
        # The rate of the penetration would miss a part of the velocity at the first sample of a contact, and light
        # hands would bounce for ever.
        gains = tick.adaptive
        damping = tick.parameter("contact_damping_ns_per_m") if gains is None else gains.contact_damping_ns_per_m
        force += damping * Rate(tick, "contact_position", tick.start_m, view=tick.since_start).settle(tick.position)
    if not environment.one_sided:
        return force
    pushing = ca.fmax(force, 0)
    # Without the damper the gated force is never negative, and 0 outside the wall.
    return environment.by_law(pushing, ca.if_else(tick.position > 0, pushing, 0) if damped else force)


def _series_force(tick: Tick, environment: Environment, *, rigid: bool) -> Expr:
    """Return the force f of coupling and wall in series, N, before the one-sided contact.

    Over a sample both are springs with memories: f = series (x - what the coupling remembers - what the wall does).
    """
    x, by_law = tick.position, environment.by_law
    k_e = environment.stiffness_n_per_m
    b_e = environment.damping_ns_per_m
    one_sided = environment.one_sided
    offset: Expr = 0.0
    kappa_e = k_e
    if environment.damped:
        surface = _surface(tick, environment)
        kappa_e = k_e + b_e * surface.gain
        offset = b_e / kappa_e * surface.offset
    if rigid:
        free, series = x, None
    else:
        stretch = Rate(tick, "coupling_deflection")
        link = _link(tick, stretch, kappa_e, environment)
        series = link.series
        free = x - link.memory * stretch.offset
        if tick.adaptive is not None:
            free -= link.anchor_share * tick.adaptive.anchor_m
    force = (kappa_e if series is None else series) * (free - offset)
    if one_sided:
        force = by_law(force, _pushing_only(tick, force, free, None if series is None else link.compliance))
    tool = x if series is None else free - link.compliance * force
    if series is not None:
        stretch.settle(x - tool)
    depth = ca.fmax(tool, 0) if one_sided else tool
    if environment.damped:
        surface.settle(by_law(tool, depth))
    tick.trace("tool_m", tool)
    tick.environment_energy_j = 0.5 * k_e * depth * depth
    if series is not None:
        tick.coupling_energy_j = _spring_energy(tick, environment, x - tool, stretch.gain, link)
    return force


def _surface(tick: Tick, environment: Environment) -> Rate:
    """Return the deflection rate of the environment's spring: of the tool, or of its penetration."""
    penetration = max(tick.start_m, 0.0)

    def view(before: Expr) -> Expr:
        """Serve both laws with one state: in front of the wall the gated one takes it as a penetration of 0."""
        position = tick.since_start(before)
        return environment.by_law(position, ca.fmax(position, 0))

    gated = environment.one_sided and not environment.clips_last
    return Rate(tick, "environment_deflection", penetration if gated else tick.start_m, view=view)


@dataclass(frozen=True)
class _Link:
    """The coupling over one sample, with kappa = k + b gain."""

    memory: Expr
    """b/kappa, s."""
    compliance: Expr
    """1/kappa, m/N."""
    series: Expr
    """Stiffness of coupling and environment in series, N/m."""
    anchor_share: Expr = None
    """k/kappa, of gains that vary."""


def _link(tick: Tick, stretch: Rate, kappa_e: Expr, environment: Environment) -> _Link:
    """Return memory, compliance and series stiffness of the coupling over one sample, of a run or of current gains."""
    if tick.adapt is None:
        return _Link(
            memory=tick.parameter("coupling_memory_s"),
            compliance=tick.parameter("coupling_compliance_m_per_n"),
            series=tick.parameter("series_stiffness_n_per_m"),
        )
    # Out of contact the clip-last coupling stretches without a force on the device: nothing is stored there.
    depth = ca.fmax(stretch.before, 0) if environment.one_sided else stretch.before
    tick.adaptive = gains = tick.adapt(environment.by_law(depth, stretch.before), environment.one_sided)
    stretch.offset *= environment.by_law(1, gains.touching)
    kappa = gains.stiffness_n_per_m + gains.damping_ns_per_m * stretch.gain
    # Without gains there is no force, whatever the compliance: it only has to be finite.
    compliance = 1 / (kappa + LEAST_STIFFNESS_N_PER_M)
    series = kappa * (kappa_e / (kappa + kappa_e))
    memory = gains.damping_ns_per_m * compliance
    return _Link(memory, compliance, series, gains.stiffness_n_per_m * compliance)


def _spring_energy(tick: Tick, environment: Environment, deflection: Expr, rate_gain_per_s: Expr, link: _Link) -> Expr:
    """Return the energy of the coupling's spring that the hand can recover, J: k deflection^2/2; 0 of a rigid one.

    k is that of the link's kappa = k + b gain, with `rate_gain_per_s` the gain, 1/s.
    """
    if environment.one_sided:
        deflection = environment.by_law(ca.fmax(deflection, 0), deflection)
    if tick.adaptive is not None:
        stretch = deflection - tick.adaptive.anchor_m
        return 0.5 * tick.adaptive.stiffness_n_per_m * stretch * stretch
    compliant = link.compliance > 0
    stiffness = (1 - link.memory * rate_gain_per_s) / ca.if_else(compliant, link.compliance, 1)
    return ca.if_else(compliant, 0.5 * stiffness * deflection * deflection, 0)


def _pushing_only(tick: Tick, force: Expr, free: Expr, compliance: Expr | None) -> Expr:
    if tick.poles == PLAIN:
        # A plain difference never pushes a tool outside the wall: f > 0 implies p > 0.
        return ca.fmax(force, 0)
    if compliance is None:
        return ca.if_else(free > 0, ca.fmax(force, 0), 0)
    # A filtered rate still contains the approach: limited to the force that keeps the tool at the surface.
    return ca.fmax(ca.if_else(compliance * force > free, free / compliance, force), 0)
