"""Norms, one for each row of gains, in which every allowed change of rows shrinks every state, for all hands of a box.

From a row a to a row b the matrix A(a, hand) must contract from the norm |R_a x| into |R_b x|. In a cell of hands the
matrix is affine in 1/mass, damping and stiffness up to enclosed slopes; a norm is convex, so that the vertices of the
affine part decide, and the error of the slopes is added. The norms come from a semidefinite programme at the vertices;
a cell that is not verified is bisected. Within a cell the hand may even vary in time.

The loop is that in sustained contact whose row of gains changes from sample to sample. Its state is that of
`stability.joint_rendering`: position, velocity times T, the previous position, the joint between coupling and wall,
delayed forces. Its meaning is the same with every row. Mechanics G, shape (2, 3), is all that depends on the hand: with
beta = B T/M, kappa = k T^2/M and phi, psi of `frozen_loop`,

    G = [[1 - kappa psi, phi, psi T^2/M], [-kappa phi, 1 - beta phi - kappa psi, phi T^2/M]],
    A(row) = base(row) + [G; 0] select(row).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from avc_casadi._errors import MissingExtraError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.prove.frozen_loop import oscillator
from avc_casadi.claims.prove.interval import Interval, Jet
from avc_casadi.claims.prove.joint_radius import ellipsoid
from avc_casadi.claims.stability.frozen_loop import joint_rendering

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


LIGHTNESS, DAMPING, STIFFNESS = range(3)
"""Rows of a cell: 1 over the total moving mass, 1/kg, in which the loop is almost linear; total damping, N.s/m;
stiffness of the hand, N/m."""


@dataclass(frozen=True)
class ChangingLoop:
    """Loops of some rows of gains; s states.

    Attributes:
        sample_time_s: T.
        base: the part independent of the hand, shape (rows, s, s).
        select: inputs of the mechanics: position, velocity, force; shape (rows, 3, s).
    """

    sample_time_s: float
    base: FloatArray
    select: FloatArray

    @classmethod
    def of(cls, problem: Problem, gains: FloatArray) -> ChangingLoop:
        """Return the loops of gains b, k and b_p, shape (3, rows); a whole number of samples of delay.

        Delayed forces are scaled to the displacement of the lightest mass in a sample.
        """
        t = problem.device.sample_time_s
        rendering = joint_rendering(problem, *gains)
        late = int(problem.device.delay_samples)
        rows, size = gains.shape[1], 4 + late
        unit = t**2 / (problem.device.mass_kg + problem.hands.mass_kg[0])
        base, select = np.zeros((rows, size, size)), np.zeros((rows, 3, size))
        base[:, 2, 0] = 1.0
        base[:, 3, [0, 2, 3]] = rendering.state
        select[:, 0, 0] = select[:, 1, 1] = 1.0
        if late:
            base[:, 4, [0, 2, 3]] = rendering.force * unit
            base[:, np.arange(5, size), np.arange(4, size - 1)] = 1.0
            select[:, 2, -1] = -1.0 / unit
        else:
            select[:, 2, [0, 2, 3]] = -rendering.force
        return cls(t, base, select)

    @property
    def rows(self) -> int:
        """Number of rows of gains."""
        return len(self.base)

    def matrices(self, mechanics: FloatArray) -> FloatArray:
        """Return A of every row with mechanics G of shape (n, 2, 3): shape (n, rows, s, s)."""
        found = np.repeat(self.base[None], len(mechanics), axis=0)
        found[:, :, :2] += mechanics[:, None] @ self.select
        return found

    def at(self, points: FloatArray) -> FloatArray:
        """Return A of every row at points of shape (3, n): shape (n, rows, s, s)."""
        return self.matrices(_stacked(self._mechanics(Interval.of(points)))[0].middle)

    def over(self, cells: Interval) -> tuple[FloatArray, Interval]:
        """Return A of every row at the middles of n cells, and enclosed slopes of G there.

        Args:
            cells: shape (3, n).

        Returns:
            Shape (n, rows, s, s), and (3, n, 2, 3): along 1/mass, damping and stiffness.
        """
        _, slopes = _stacked(self._mechanics(cells))
        return self.at(cells.middle), slopes

    def _mechanics(self, cells: Interval) -> list[list[Jet[Interval]]]:
        t, count = self.sample_time_s, cells.shape[1]
        unit = [Interval.of(np.eye(3)[:, row : row + 1] * np.ones(count)) for row in range(3)]
        per_mass = Jet(cells[LIGHTNESS], unit[LIGHTNESS])
        beta = Jet(cells[DAMPING], unit[DAMPING]) * per_mass.times(t)
        push = per_mass.times(Interval.of(t).square())
        kappa = Jet(cells[STIFFNESS], unit[STIFFNESS]) * push
        phi, psi = (
            Jet(one.value, one.slope[0] * beta.slope + one.slope[1] * kappa.slope)
            for one in oscillator(beta.value, kappa.value)
        )
        left = (-(kappa * psi)).plus(1.0)
        return [[left, phi, psi * push], [-(kappa * phi), left - beta * phi, phi * push]]


def _stacked(entries: list[list[Jet[Interval]]]) -> tuple[Interval, Interval]:
    """Return values, shape (n, 2, 3), and slopes, shape (3, n, 2, 3)."""

    def joined(parts: list[list[FloatArray]]) -> FloatArray:
        return np.stack([np.stack(row, axis=-1) for row in parts], axis=-2)

    return (
        Interval(
            joined([[one.value.low for one in row] for row in entries]),
            joined([[one.value.high for one in row] for row in entries]),
        ),
        Interval(
            joined([[one.slope.low for one in row] for row in entries]),
            joined([[one.slope.high for one in row] for row in entries]),
        ),
    )


_SHRINKS = 1 - 1e-8
"""Contraction factor: its distance from 1 exceeds by far, by `_WORST_CONDITION`, the rounding of small products."""
_WORST_CONDITION = 1e6
_VERTICES = np.array(list(product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True, eq=False)
class NormedCell:
    """Hands with their norms.

    Attributes:
        low: lower corner, shape (3,): 1 over the moving mass, 1/kg; damping, N.s/m; stiffness, N/m.
        high: upper corner.
        roots: R of every row, shape (rows, s, s).
    """

    low: FloatArray
    high: FloatArray
    roots: FloatArray

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NormedCell) and all(
            np.array_equal(value, vars(other)[name]) for name, value in vars(self).items()
        )

    __hash__ = None  # type: ignore[assignment]


def normed_cells(
    loop: ChangingLoop,
    follows: BoolArray,
    low: FloatArray,
    high: FloatArray,
    most_cells: int,
    progress: Progress = SILENT,
) -> list[NormedCell] | None:
    """Return cells with verified norms that fill a box of hands; None where that takes more cells than allowed.

    Args:
        loop: the rows.
        follows: shape (rows, rows): whether the second may act after the first.
        low: lower corner of the box, shape (3,).
        high: upper corner.
        most_cells: largest number of evaluated cells.
        progress: reported over the cells.

    Raises:
        MissingExtraError: clarabel is not installed.
    """
    # Without a norm for one hand, the lightest and least damped, there is none for the box.
    worst = np.array([high[LIGHTNESS], *low[1:]])
    if _norms(loop, follows, worst, worst) is None:
        return None
    left, found = [(low, high)], []
    for looked_at in range(1, most_cells + 1):
        progress.advance(looked_at, most_cells, "cells of hands")
        one, other = left.pop()
        roots = _norms(loop, follows, one, other)
        if roots is not None and shrinks(loop, follows, NormedCell(one, other, roots)):
            found.append(NormedCell(one, other, roots))
            if not left:
                return found
            continue
        left += _halves(loop, one, other)
        if len(left) + looked_at > most_cells:
            return None
    return None


def shrinks(loop: ChangingLoop, follows: BoolArray, cell: NormedCell) -> bool:
    """Return whether every allowed change of rows contracts every state with every hand of a cell."""
    roots = cell.roots
    if roots.shape != loop.base.shape or not np.isfinite(roots).all():
        return False
    if (cell.low > cell.high).any() or np.linalg.cond(roots).max() > _WORST_CONDITION:
        return False
    vertices, spread = _affine(loop, cell.low, cell.high)
    before, after = np.nonzero(follows)
    inverse = np.linalg.inv(roots)
    moved = roots[after] @ vertices[:, before] @ inverse[before]
    steady = np.linalg.norm(moved, 2, axis=(-2, -1)).max(axis=0)
    loose = np.abs(roots[after][:, :, :2]) @ spread @ np.abs(loop.select[before] @ inverse[before])
    return bool((steady + np.linalg.norm(loose, axis=(-2, -1)) < _SHRINKS).all())


def covers(cells: list[NormedCell], low: FloatArray, high: FloatArray) -> bool:
    """Return whether cells fill a box: cut at every side of any cell, every piece lies in one."""
    if not cells:
        return False
    lows, highs = np.array([cell.low for cell in cells]), np.array([cell.high for cell in cells])
    cuts = []
    for side in range(3):
        ends = np.unique(np.concatenate([lows[:, side], highs[:, side], [low[side], high[side]]]))
        ends = ends[(ends >= low[side]) & (ends <= high[side])]
        cuts.append(0.5 * (ends[:-1] + ends[1:]) if len(ends) > 1 else ends)
    across = np.stack(np.meshgrid(cuts[1], cuts[2], indexing="ij")).reshape(2, -1, 1)
    for first in cuts[0]:
        near = (lows[:, 0] <= first) & (first <= highs[:, 0])
        inside = (lows[near, 1:].T[:, None] <= across) & (across <= highs[near, 1:].T[:, None])
        if not np.any(np.all(inside, axis=0), axis=1).all():
            return False
    return True


def _affine(loop: ChangingLoop, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the affine part at the vertices of a cell, (8, rows, s, s), and the error of the mechanics, (2, 3)."""
    middle, slopes = loop.over(Interval.of(low[:, None], high[:, None]))
    reach = 0.5 * (high - low) * (1 + 1e-9)
    steady = slopes.middle[:, 0]
    spread = np.maximum(slopes.high[:, 0] - steady, steady - slopes.low[:, 0])
    moved = np.einsum("vj,jab->vab", _VERTICES * reach, steady)
    vertices = np.repeat(middle, len(_VERTICES), axis=0)
    vertices[:, :, :2] += moved[:, None] @ loop.select
    return vertices, np.einsum("j,jab->ab", reach, spread) * (1 + 1e-9)


def _halves(loop: ChangingLoop, low: FloatArray, high: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Bisect a cell across the side along which the mechanics varies most."""
    _, slopes = loop.over(Interval.of(low[:, None], high[:, None]))
    weight = np.abs(loop.select).max(axis=(0, 2))
    moved = (high - low) * (slopes.magnitude[:, 0] * weight).max(axis=(-2, -1))
    side = int(moved.argmax())
    middle = 0.5 * (low[side] + high[side])
    below, above = high.copy(), low.copy()
    below[side] = above[side] = middle
    return [(low, below), (above, high)]


def _norms(loop: ChangingLoop, follows: BoolArray, low: FloatArray, high: FloatArray) -> FloatArray | None:
    """Return R of every row from P_a - A' P_b A >= t at the vertices of a cell with the largest t; None if t <= 0."""
    try:
        import clarabel  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError(
            "proofs for changing gains solve a semidefinite programme by clarabel, which is not installed; "
            "pip install 'avc-casadi[proof]'"
        ) from error
    vertices = _affine(loop, low, high)[0]
    if (low == high).all():
        vertices = vertices[:1]
    rows, size = loop.base.shape[:2]
    first = ellipsoid(vertices.mean(axis=0), sweeps=1)
    scaled = first @ vertices @ np.linalg.inv(first)
    upper = np.triu_indices(size)
    # Clarabel stacks the upper triangle by columns, off the diagonal times the root of 2.
    order = np.lexsort((upper[0], upper[1]))
    i, j = upper[0][order], upper[1][order]
    count = len(i)
    basis = np.zeros((count, size, size))
    basis[np.arange(count), i, j] = basis[np.arange(count), j, i] = 1.0
    stacked = np.where(i == j, 1.0, np.sqrt(2.0))

    def vector(matrices: FloatArray) -> FloatArray:
        return np.asarray(matrices[..., i, j] * stacked)

    # Unknowns: the triangles of all P, then t. Rows of the programme say b - A x in the cone.
    own, unit = vector(basis).T, vector(np.eye(size))[:, None]
    blocks = []
    for before, after in zip(*np.nonzero(follows), strict=True):
        for vertex in scaled[:, before]:
            row: list[sparse.coo_array | None] = [None] * rows + [sparse.coo_array(unit)]
            moved = vector(vertex.T @ basis @ vertex).T
            row[after] = sparse.coo_array(moved - own if after == before else moved)
            if after != before:
                row[before] = sparse.coo_array(-own)
            blocks.append(row)
    pairs = len(blocks)
    trace = sparse.coo_array(np.tile(np.where(i == j, 1.0, 0.0), rows)[None])
    equation = sparse.hstack([trace, sparse.coo_array((1, 1))])
    whole = sparse.csc_matrix(sparse.vstack([sparse.block_array(blocks), equation]))
    right = np.zeros(whole.shape[0])
    right[-1] = rows * size
    goal = np.zeros(whole.shape[1])
    goal[-1] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.PSDTriangleConeT(size)] * pairs + [clarabel.ZeroConeT(1)]
    none = sparse.csc_matrix((len(goal), len(goal)))
    solution = np.array(clarabel.DefaultSolver(none, goal, whole, right, cones, settings).solve().x)
    if not np.isfinite(solution).all() or solution[-1] <= 0:
        return None
    found = np.einsum("rc,cij->rij", solution[:-1].reshape(rows, count), basis)
    values, vectors = np.linalg.eigh(found)
    if values.min() <= 0:
        return None
    return np.asarray(np.sqrt(values)[:, :, None] * np.swapaxes(vectors, 1, 2) @ first)
