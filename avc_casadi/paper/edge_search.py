"""The package's own solver of (11)-(12): root finding along the edges of the gain box, all frequencies at once.

(11)-(12) has its minimum at an interior point that the impedance itself tells (see `_wanted`), or on an edge of the
box: where |Z| meets |Z_h_ds|, Re Z meets the margin, or |Z| is stationary. Along an edge the moving gain t becomes
x = t/(c + t), c the value at which coupling and environment weigh the same. For passive elements the pole of Z(x) then
stays at least 1/2 away from the real axis, so that a dozen samples see every change of sign of a derivative; between
stationary points |Z| and Re Z are monotone and each has at most one root, which a bracket encloses to the last bit.
Nothing here uses the quadratics of `exact`, so that each method checks the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.model.corners import margin_over_range
from avc_casadi.paper.curves import Curves, Pieces, Points, find_roots, join
from avc_casadi.paper.equations import coupling_gains
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.numbers import abs2
from avc_casadi.paper.rows import GainArrays, best_candidate, guarded_margin, wanted_points

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.paper.curves import Function, Index

_ROWS_AT_ONCE = 2000
"""Frequencies searched at a time: enough to be quick, and few enough to be held and told of."""
_STATIONARY = {"tolerance": 1e-9, "rounding": 1e-13}
"""Stationary points: the square of their last bracket's width is below the rounding of Z, and so is what |Z|^2 gains
between an end of a piece and a stationary point so near that the slope has almost vanished there."""


def edge_search_gains(
    problem: Problem, loop: Loop, margin_ns_per_m: float | None = None, progress: Progress = SILENT
) -> GainArrays:
    """Return the optimal (b, k, b_p), each (n,); not a number where the search meets no feasible gains.

    Args:
        problem: the problem.
        loop: its loop at n frequencies.
        margin_ns_per_m: least Re Z_h; None is the problem's, kept by every device of its range.
        progress: told of the frequencies.
    """
    margin = margin_over_range(problem) if margin_ns_per_m is None else margin_ns_per_m
    rows = np.arange(len(loop.target))
    found = [
        _searched(problem, loop.rows(rows[some]), margin)
        for some in chunks(len(rows), _ROWS_AT_ONCE, progress, "frequencies")
    ]
    b, k, p = (np.concatenate(gain) for gain in zip(*found, strict=True))
    return b, k, p


def _searched(problem: Problem, loop: Loop, margin: float) -> GainArrays:
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    groups = [
        _inner_points(problem, loop, margin),
        *_curve_points(_box_edges(problem, loop, {lowest, highest}, margin), margin),
    ]
    if highest > lowest:
        groups += _swept_points(problem, loop, margin)
    return best_candidate(problem, loop, *_dense(join(groups), len(loop.target)), margin)


def _box_edges(problem: Problem, loop: Loop, contacts: set[float], margin: float) -> Curves:
    """The four edges of the (b, k) box at each contact damping, for every frequency."""
    (b0, b1), (k0, k1) = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
    shapes = [
        (b, k, p, moving, low, high)
        for p in sorted(contacts)
        for b, k, moving, low, high in (
            (b0, 0, 1, k0, k1),
            (b1, 0, 1, k0, k1),
            (0, k0, 0, b0, b1),
            (0, k1, 0, b0, b1),
        )
    ]
    n = len(loop.target)
    b, k, p, moving, low, high = (np.repeat(np.array(column), n) for column in zip(*shapes, strict=True))
    row = np.tile(np.arange(n), len(shapes))
    return Curves.of(loop, Points(row, b.astype(float), k.astype(float), p), moving, low, high, margin)


def _curve_points(curves: Curves, margin: float) -> list[Points]:
    """Ends, points of the goal's magnitude, points just inside the margin, and stationary points of |Z|."""
    loop = curves.loop
    device, hold, radius2 = loop.device, loop.hold, abs2(loop.target)

    def magnitude(z: ComplexArray, _: ComplexArray, at: Index) -> FloatArray:
        value: FloatArray = abs2(device[at] + hold[at] * z) - radius2[at]
        return value

    def magnitude_slope(z: ComplexArray, dz: ComplexArray, at: Index) -> FloatArray:
        value: FloatArray = (np.conj(device[at] + hold[at] * z) * hold[at] * dz).real
        return value

    def real_part(z: ComplexArray, _: ComplexArray, at: Index) -> FloatArray:
        d, h = device[at], hold[at]
        value: FloatArray = d.real + (h * z).real - guarded_margin(d, h, z, margin)
        return value

    def real_part_slope(_: ComplexArray, dz: ComplexArray, at: Index) -> FloatArray:
        value: FloatArray = (hold[at] * dz).real
        return value

    pieces = Pieces.sampled(curves)
    flat, level = find_roots(curves, [(pieces, magnitude_slope), (pieces, real_part_slope)], **_STATIONARY)
    on_circle, on_line = find_roots(
        curves,
        [
            (pieces.split(curves, flat.piece, flat.above), magnitude),
            (pieces.split(curves, level.piece, level.above), real_part),
        ],
    )
    return [
        curves.ends(),
        curves.points(flat.above, flat.curve),
        curves.points(on_circle.above, on_circle.curve),
        curves.points(on_circle.below, on_circle.curve),
        curves.points(on_line.above, on_line.curve),
    ]


def _inner_points(problem: Problem, loop: Loop, margin: float) -> Points:
    """Gains that render the wanted impedances with the least contact damping."""
    lowest = problem.coupling.contact_damping_ns_per_m[0]
    wanted, gap = wanted_points(loop, np.abs(loop.target), margin)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        b, k = coupling_gains(loop.angle, loop.environment * (wanted - lowest) / (gap + lowest))
    row = np.broadcast_to(np.arange(b.shape[1]), b.shape).ravel()
    return Points(row, b.ravel(), k.ravel(), np.full(b.size, lowest))


def _swept_points(problem: Problem, loop: Loop, margin: float) -> list[Points]:
    """What contact damping adds: it sweeps corners and edges along H and reaches inner points from an edge."""
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    edges = _box_edges(problem, loop, {lowest}, margin)
    pieces = Pieces.sampled(edges)
    (fold,) = find_roots(edges, [(pieces, lambda _z, dz, _at: dz.imag)], **_STATIONARY)
    starts = join([edges.ends(), edges.points(fold.above, fold.curve)])
    low, high = np.full(starts.row.shape, lowest), np.full(starts.row.shape, highest)
    lifts = Curves.of(loop, starts, np.full(starts.row.shape, 2), low, high, margin)

    split = pieces.split(edges, fold.piece, fold.above)
    wanted = wanted_points(loop, np.abs(loop.target), margin)[0][:, edges.row]
    crossings = find_roots(edges, [(split, _height_above(point.imag)) for point in wanted])
    groups = _curve_points(lifts, margin)
    for point, crossing in zip(wanted, crossings, strict=True):
        on_edge = edges.points(crossing.above, crossing.curve)
        rendered = edges.loop.rows(crossing.curve).rendered(on_edge.b, on_edge.k)
        groups.append(Points(on_edge.row, on_edge.b, on_edge.k, point.real[crossing.curve] - rendered.real))
    return groups


def _height_above(level: FloatArray) -> Function:
    return lambda z, _dz, at: z.imag - level[at]


def _dense(points: Points, rows: int) -> GainArrays:
    """Turn flat points into (most points of a row, rows) arrays, filled up with not a number."""
    order = np.argsort(points.row, kind="stable")
    row = points.row[order]
    place = np.arange(len(row)) - np.searchsorted(row, row)
    shape = (int(place.max()) + 1, rows)
    b, k, p = (np.full(shape, np.nan) for _ in range(3))
    for dense, gain in ((b, points.b), (k, points.k), (p, points.p)):
        dense[place, row] = gain[order]
    return b, k, p
