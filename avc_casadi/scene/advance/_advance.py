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
class MatrixExponential:
    """Linear plant whose force is held for the whole sample: exact to rounding.

    Attributes:
        substeps: equal steps a sample; the result does not depend on them.
        held: whether a force acts at all.
        driven: whether a hand moves the plant.
    """

    substeps: int
    held: bool
    driven: bool

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the transition matrices and return the state one sample later."""
        import casadi as ca  # noqa: PLC0415

        n = len(state)
        matrix = tick.parameter("transition", ca.Sparsity.dense(n, n))
        of_force: Expr = tick.parameter("transition_of_force", ca.Sparsity.dense(n, 1)) if self.held else None
        of_target: Expr = tick.parameter("transition_of_target", ca.Sparsity.dense(n, 2)) if self.driven else None
        x = ca.vertcat(*state)
        for substep in range(self.substeps):
            x = ca.mtimes(matrix, x)
            if self.held:
                x += of_force * drive.force
            if drive.target is not None:
                position, velocity = drive.target
                elapsed = tick.sample_time_s * substep / self.substeps
                x += ca.mtimes(of_target, ca.vertcat(position + velocity * elapsed if substep else position, velocity))
        return list(ca.vertsplit(x))

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the transition matrices, columns first, as CasADi stores them."""
        moves = transition(plant, sample_time_s / self.substeps)
        parts = [_columns_first(moves.matrix)]
        if self.held:
            parts.append(moves.force)
        if self.driven:
            parts.append(_columns_first(moves.target))
        return np.concatenate(parts, axis=-1)


def _columns_first(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2).reshape(*matrix.shape[:-2], -1)
