"""C (z - A)^-1 B at many z, by substitution along the graph of A: a chain of delays costs an operation a state.

State i follows from state j where a_ij is not 0. States that follow from each other are one block, and blocks in the
order in which they feed each other make A block triangular, so that each block is solved from those before it. A sum
of filters in series has blocks of one and two states; a solution of the whole pencil at each z takes n^3 operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from graphlib import TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from avc_casadi._util.arrays import BoolArray, ComplexArray

Matrix = NDArray[Any]

_KEPT = 64
"""Orders of substitution that are kept: loops of one search have the same pattern."""


@dataclass(frozen=True)
class _Block:
    """States that are solved together.

    Attributes:
        states: these states.
        feeding: by state, the states of earlier blocks that feed it.
        last_read: states of which this block is the last reader.
    """

    states: tuple[int, ...]
    feeding: tuple[tuple[int, ...], ...]
    last_read: tuple[int, ...]


@lru_cache(maxsize=_KEPT)
def _blocks(pattern: bytes, size: int) -> tuple[_Block, ...]:
    """Return the blocks of a pattern (size, size) of entries that are not 0, in the order of substitution."""
    fed = np.frombuffer(pattern, dtype=np.bool_).reshape(size, size)
    count, block_of = connected_components(fed, directed=True, connection="strong")
    members = [tuple(np.flatnonzero(block_of == block).tolist()) for block in range(count)]
    feeders: dict[int, set[int]] = {block: set() for block in range(count)}
    for state, feeder in np.argwhere(fed).tolist():
        if block_of[state] != block_of[feeder]:
            feeders[int(block_of[state])].add(int(block_of[feeder]))
    order = tuple(TopologicalSorter(feeders).static_order())
    last_reader = {block: block for block in order}
    for block in order:
        last_reader |= dict.fromkeys(feeders[block], block)
    return tuple(
        _Block(
            states=members[block],
            feeding=tuple(
                tuple(feeder for feeder in np.flatnonzero(fed[state]).tolist() if block_of[feeder] != block)
                for state in members[block]
            ),
            last_read=tuple(
                state for read, reader in last_reader.items() if reader == block for state in members[read]
            ),
        )
        for block in order
    )


def response(z: ComplexArray, a: Matrix, b: Matrix, c: Matrix) -> ComplexArray:
    """Return C (z - A)^-1 B of one input, shape (k, ...).

    Args:
        z: where, shape (...).
        a: A, shape (..., n, n), whose leading axes broadcast with z.
        b: B, shape (..., n).
        c: C, shape (..., k, n).
    """
    size = a.shape[-1]
    shape = np.broadcast_shapes(z.shape, a.shape[:-2], b.shape[:-1], c.shape[:-2])
    outputs = np.zeros((c.shape[-2], *shape), dtype=np.complex128)
    read = _nonzero(c, 2)
    states: dict[int, ComplexArray] = {}
    for block in _blocks(_nonzero(a, 2).tobytes(), size):
        driven = []
        for state, feeders in zip(block.states, block.feeding, strict=True):
            drive = b[..., state]
            for feeder in feeders:
                drive = drive + a[..., state, feeder] * states[feeder]
            driven.append(drive)
        states |= dict(zip(block.states, _solved(z, a, block.states, driven), strict=True))
        for output, state in np.argwhere(read[:, block.states]).tolist():
            outputs[output] += c[..., output, block.states[state]] * states[block.states[state]]
        for state in block.last_read:
            del states[state]
    return outputs


def _nonzero(matrix: Matrix, axes: int) -> BoolArray:
    """Return which entries of the last axes are not 0 in some of the matrices."""
    return np.asarray((matrix != 0).any(axis=tuple(range(matrix.ndim - axes))))


def _solved(z: ComplexArray, a: Matrix, states: tuple[int, ...], driven: Sequence[Matrix]) -> list[ComplexArray]:
    """Return (z - A)^-1 times what drives a block; two states by Cramer's rule."""
    if len(states) == 1:
        (only,) = states
        return [driven[0] / (z - a[..., only, only])]
    if len(states) == 2:
        i, j = states
        at_first, at_second = z - a[..., i, i], z - a[..., j, j]
        determinant = at_first * at_second - a[..., i, j] * a[..., j, i]
        first = (at_second * driven[0] + a[..., i, j] * driven[1]) / determinant
        second = (at_first * driven[1] + a[..., j, i] * driven[0]) / determinant
        return [first, second]
    inner = a[..., states, :][..., states]
    pencil = z[..., None, None] * np.eye(len(states)) - inner
    drive = np.stack(np.broadcast_arrays(*driven, z)[:-1], axis=-1)
    drive = np.broadcast_to(drive, (*np.broadcast_shapes(pencil.shape[:-2], drive.shape[:-1]), len(states)))
    return list(np.moveaxis(np.linalg.solve(pencil, drive[..., None].astype(np.complex128))[..., 0], -1, 0))
