"""A law of any pieces as one step, from the measured position to the force, as scenes and exported C run it.

Linear blocks are those of the claims, `Law`, in series; pieces that are not linear are themselves. A block
s+ = A s + B y runs in the basis of the real Schur form of A, as s + (A - 1) s + B y: poles near 1, of filters that are
slow beside the sample rate, then keep their digits in single precision, which a companion matrix loses.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.linalg import schur

from avc_casadi.model import law_pieces as p
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.law import Law
from avc_casadi.simulation.tick import Expr, Step, StepBuilder, ca

# A pole nearer to 1 than this runs as a change of its state.
_NEAR_ONE = 0.5


@lru_cache(maxsize=256)
def law_step(law: ControlLaw, sample_time_s: float, *, one_sided: bool, start_m: float = 0.0) -> Step:
    """Return the step of a law: position_m as measured to force_n, positive against +x.

    One-sided, spring, damper and integral act where the position is above 0, together never pull, and the integral is 0
    elsewhere. The device has rested at `start_m` before the first sample. A law with a `rate_divider` of n runs at the
    first of every n samples and keeps its force in the others.
    """
    run = _Run(law.period_s(sample_time_s), start_m)
    position = run.builder.input("position_m")
    growth = run.growth(law.velocity.piece, position)
    in_wall = sum((run.force(force, position, growth) for force in law.forces_in_wall()), ca.SX(0))
    if one_sided:
        inside = position > 0
        in_wall = ca.if_else(inside, ca.fmax(in_wall, 0), 0)
        run.empty_integral_unless(inside)
    command = in_wall + sum((run.force(force, position, growth) for force in law.forces_everywhere()), ca.SX(0))
    for item in law.filter_pieces:
        command = run.linear(item.law(run.period_s), command)
    if law.rate_divider > 1:
        command = _held(run.builder, command, law.rate_divider)
    return run.builder.build("law", force_n=command)


def _held(builder: StepBuilder, command: Expr, divider: int) -> Expr:
    """Run what stands in a builder at every n-th sample alone, and keep its command between."""
    waits, before = builder.state("waits"), builder.state("kept_force_n")
    runs = waits < 0.5
    builder.follow("waits", waits)
    builder.follow("kept_force_n", command)
    builder.only_where(runs)
    builder.follow("waits", ca.if_else(runs, divider - 1, waits - 1))
    return ca.if_else(runs, command, before)


def realised(law: Law) -> Law:
    """Return a law with the same transfer function, its A in real Schur form; a shift register stays as it is."""
    if not np.any(np.triu(law.a)):
        return law
    form, basis = schur(law.a)
    return Law(form, basis.T @ law.b, law.c @ basis, law.d, law.sample_time_s)


@dataclass
class _Run:
    """The step of a law while it is built."""

    period_s: float
    start_m: float
    builder: StepBuilder = field(default_factory=StepBuilder)
    _blocks: int = 0
    _integral: Expr = None

    def growth(self, velocity: p.Velocity, position: Expr) -> Expr:
        """Return the estimate of v T."""
        if isinstance(velocity, p.Ticks):
            return self._ticks(velocity.samples(self.period_s), position)
        value, rests_at = position, self.start_m
        for block in velocity.blocks(self.period_s):
            value = self.linear(block, value, rests_at)
            rests_at = 0.0  # what does not move has no velocity
        return value

    def linear(self, law: Law, value: Expr, rests_at: float = 0.0) -> Expr:
        """Add a linear block that has rested at a value before."""
        block = realised(law)
        self._blocks += 1
        names = [f"block{self._blocks}_{row + 1}" for row in range(block.states)]
        initial = (block.rest * rests_at).tolist() if block.states else []
        states = [self.builder.state(*named) for named in zip(names, initial, strict=True)]
        for row, name in enumerate(names):
            factors = block.a[row].copy()
            near_one = abs(factors[row] - 1) < _NEAR_ONE
            factors[row] -= near_one
            change = _sum([*factors, block.b[row, 0]], [*states, value])
            self.builder.follow(name, states[row] + change if near_one else change)
        return _sum([*block.c[0], block.d[0, 0]], [*states, value])

    def force(self, piece: p.Force, position: Expr, growth: Expr) -> Expr:
        """Return the force of a piece, positive against +x."""
        if isinstance(piece, p.Spring):
            width = piece.dead_zone_m
            beyond = position - ca.fmin(ca.fmax(position, -width), width) if width else position
            return piece.stiffness_n_per_m * beyond
        if isinstance(piece, p.Integral):
            return self._integrated(piece, position)
        if isinstance(piece, p.FrictionCompensation):
            share = growth / (piece.velocity_m_per_s * self.period_s)
            return -piece.force_n * ca.fmin(ca.fmax(share, -1), 1)
        return self.linear(piece.of_growth(self.period_s), growth)

    def _integrated(self, piece: p.Integral, position: Expr) -> Expr:
        """Return the force of an integral, which is its state."""
        self._integral = self.builder.state("integral_n")
        force = self._integral + piece.integral_n_per_m_s * self.period_s * position
        if piece.limit_n is not None:
            force = ca.fmin(ca.fmax(force, -piece.limit_n), piece.limit_n)
        self.builder.follow("integral_n", force)
        self._integral = force
        return force

    def empty_integral_unless(self, inside: Expr) -> None:
        """Let the integral begin anew where the device is outside the wall."""
        if self._integral is not None:
            self.builder.follow("integral_n", ca.if_else(inside, self._integral, 0))

    def _ticks(self, timeout: int, position: Expr) -> Expr:
        """Return the growth by the time between two changes of the position, as `law_pieces.Ticks` defines it."""
        builder = self.builder
        place = builder.state("changed_m", self.start_m)
        waited, kept = builder.state("waited", timeout), builder.state("growth_m")
        way, time = position - place, ca.fmin(waited + 1, timeout + 1)
        changed = ca.fabs(way) > 0
        growth = ca.if_else(changed, way / time, ca.if_else(time > timeout, 0, kept))
        builder.follow("changed_m", ca.if_else(changed, position, place))
        builder.follow("waited", ca.if_else(changed, 0, time))
        builder.follow("growth_m", growth)
        return growth


def _sum(factors: list[float], values: list[Expr]) -> Expr:
    """Return the sum of values times factors, without those that are 0."""
    terms = [value if factor == 1 else factor * value for factor, value in zip(factors, values, strict=True) if factor]
    return sum(terms[1:], terms[0]) if terms else ca.SX(0)
