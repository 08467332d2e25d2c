"""From one sample to the next: the device and the hand move while the force is held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from avc_casadi.loop import LinearPlant, transition
from avc_casadi.scene.loop import Expr, Tick
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class Drive:
    """What moves the plant between two samples.

    Attributes:
        force: held force of the actuator, N, positive against +x; None in free space.
        force_before: the force that acts until the new one arrives; None where forces are never late.
        late: when the new force arrives, as a share of the sample.
        target: position (m) and velocity (m/s) of the hand's target at the sample; None without a hand.
    """

    force: Expr
    force_before: Expr
    late: Expr
    target: tuple[Expr, Expr] | None


class Advance(Protocol):
    """How the continuous part gets from one sample to the next."""

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the parameters and return the state one sample later."""

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the parameters for each hand, shape (..., p), in the order in which `step` adds them."""


@dataclass(frozen=True)
class Stretch:
    """A part of the sample in which the force stays.

    Attributes:
        name: what the names of its parameters end with.
        begin: where it begins, as a share of the sample.
        share: its length.
        before: whether the force before the new one acts.
    """

    name: str
    begin: float
    share: float
    before: bool


def stretches(late: float) -> tuple[Stretch, ...]:
    """Return the parts of a sample whose new force arrives at `late`, the same share of every sample."""
    if late == 0:
        return (Stretch("", 0.0, 1.0, False),)
    return (Stretch("_before", 0.0, late, True), Stretch("", late, 1.0 - late, False))


@dataclass(frozen=True)
class MatrixExponential:
    """Linear plant whose force is held, or changes at a moment that is the same in every sample: exact to rounding.

    Attributes:
        substeps: equal steps a stretch; the result does not depend on them.
        held: whether a force acts at all.
        driven: whether a hand moves the plant.
        late: when the new force arrives, as a share of the sample.
    """

    substeps: int
    held: bool
    driven: bool
    late: float = 0.0

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the transition matrices and return the state one sample later."""
        import casadi as ca  # noqa: PLC0415

        x = ca.vertcat(*state)
        for stretch in stretches(self.late):
            x = self._through(tick, stretch, x, drive)
        return list(ca.vertsplit(x))

    def _through(self, tick: Tick, stretch: Stretch, x: Expr, drive: Drive) -> Expr:
        import casadi as ca  # noqa: PLC0415

        n, name = x.numel(), f"transition{stretch.name}"
        matrix = tick.parameter(name, ca.Sparsity.dense(n, n))
        of_force: Expr = tick.parameter(f"{name}_of_force", ca.Sparsity.dense(n, 1)) if self.held else None
        of_target: Expr = tick.parameter(f"{name}_of_target", ca.Sparsity.dense(n, 2)) if self.driven else None
        for substep in range(self.substeps):
            x = ca.mtimes(matrix, x)
            if self.held:
                x += of_force * (drive.force_before if stretch.before else drive.force)
            if drive.target is not None:
                position, velocity = drive.target
                elapsed = tick.sample_time_s * (stretch.begin + stretch.share * substep / self.substeps)
                x += ca.mtimes(of_target, ca.vertcat(position + velocity * elapsed if elapsed else position, velocity))
        return x

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the transition matrices, columns first, as CasADi stores them."""
        parts = []
        for stretch in stretches(self.late):
            moves = transition(plant, sample_time_s * stretch.share / self.substeps)
            parts.append(_columns_first(moves.matrix))
            if self.held:
                parts.append(moves.force)
            if self.driven:
                parts.append(_columns_first(moves.target))
        return np.concatenate(parts, axis=-1)


def _columns_first(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2).reshape(*matrix.shape[:-2], -1)
