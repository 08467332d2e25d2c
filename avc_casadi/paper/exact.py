"""The global optimum of (11)-(12) per frequency, from the geometry of circle arcs.

|Z_h_avc| has no extremum but 0 inside the image of the gain box, so that an optimum lies at a corner, on an edge (an
arc: where |Z| or Re Z has a given value, or |Z| is stationary), at the goal itself, where |Z| = |Z_h_ds| meets
Re Z = margin, or at Z = margin. With contact damping the image is swept along H; its boundary adds segments from
the corners and from the points of an arc where Im Z_eavc is stationary. All candidates are evaluated, only strictly
feasible ones are compared, and ties are broken lexicographically.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.model.corners import margin_over_range
from avc_casadi.model.gains import GainSchedule
from avc_casadi.paper.arcs import Arcs, Edges
from avc_casadi.paper.equations import coupling_gains
from avc_casadi.paper.infeasible import row_reasons
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.numbers import abs2
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import GainArrays, best_candidate, guarded_margin, pointwise_notes, row_status, wanted_points

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


# Frequencies solved at a time: few enough for memory and for progress reports.
_ROWS_AT_ONCE = 10_000


def _edge_candidates(edges: Edges, radius: FloatArray, margin: float) -> list[FloatArray]:
    """Return corners, points of given magnitude and of given real part, extrema of both; one Newton step each.

    The extremum of Re Z is the only candidate where the margin is met without slack.
    """
    loop, arcs = edges.loop, edges.perceived()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        on_circle = arcs.magnitude_roots(radius)
        b, k, p = edges.gains(on_circle)
        z = loop.perceived(b, k, p)
        step = (abs2(z) - radius * radius) / (2 * (np.conj(z) * edges.derivative(on_circle)).real)
        on_circle = np.where(np.abs(step) < 1e-3 * on_circle, on_circle - step, on_circle)

        on_line = arcs.level_roots(margin)
        for _ in range(2):
            b, k, p = edges.gains(on_line)
            rendered = loop.rendered(b, k) + p
            z = loop.device + loop.hold * rendered
            step = (z.real - guarded_margin(loop.device, loop.hold, rendered, margin)) / edges.derivative(on_line).real
            on_line = np.where(np.abs(step) < 1e-3 * on_line, on_line - step, on_line)
    ends = np.broadcast_to(np.stack((edges.low, edges.high)), on_line.shape)
    t = np.concatenate((on_circle, on_line, arcs.magnitude_extrema(), arcs.level_extrema(), ends))
    return [gain.reshape(-1, t.shape[-1]) for gain in edges.gains(t)]


def _inner_candidates(
    problem: Problem, loop: Loop, radius: FloatArray, margin: float, edges: Edges
) -> list[list[FloatArray]]:
    """Return gains that render the wanted points, with the smallest admissible contact damping."""
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    wanted, gap = wanted_points(loop, radius, margin)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        b, k = coupling_gains(loop.angle, loop.environment * (wanted - lowest) / (gap + lowest))
        found = [[b, k, np.full(b.shape, lowest)]]
        if highest > lowest:
            arcs = edges.rendered()
            for point in wanted:
                t = arcs.level_roots(point.imag, imaginary=True)
                b, k, _ = edges.gains(t)
                p = point.real - loop.rendered(b, k).real
                shape = (-1, t.shape[-1])
                found.append([b.reshape(shape), k.reshape(shape), p.reshape(shape)])
    return found


def _segment_candidates(
    problem: Problem, loop: Loop, radius: FloatArray, margin: float, edges: Edges
) -> list[FloatArray]:
    """Return points on the straight segments that contact damping sweeps from corners and stationary Im Z_eavc."""
    folds = np.concatenate(
        (
            edges.rendered().level_extrema(imaginary=True),
            np.stack(np.broadcast_arrays(edges.low + 0 * loop.hold.real, edges.high + 0 * loop.hold.real)),
        )
    )
    b, k, _ = edges.gains(folds)
    b, k = b.reshape(-1, b.shape[-1]), k.reshape(-1, k.shape[-1])
    rendered = loop.rendered(b, k)
    start = loop.device + loop.hold * rendered
    one, zero = np.ones_like(start), np.zeros_like(start)
    line = Arcs(start, loop.hold * one, one, zero, loop.hold * one)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        on_line = (margin - start.real) / loop.hold.real
        on_line += (guarded_margin(loop.device, loop.hold, rendered + on_line, margin) - margin) / loop.hold.real
        ends = [np.full(b.shape, end) for end in problem.coupling.contact_damping_ns_per_m]
        nearest = -(start * np.conj(loop.hold)).real / abs2(loop.hold)
        p = np.stack((*line.magnitude_roots(radius), on_line, nearest, *ends))
    return [gain.reshape(-1, p.shape[-1]) for gain in np.broadcast_arrays(b, k, p)]


def exact_gains(problem: Problem, loop: Loop, *, progress: Progress = SILENT) -> GainArrays:
    """Return the optimal (b, k, b_p), each (n,); not a number where no gains of the box meet the constraint."""
    margin = margin_over_range(problem)
    rows = np.arange(len(loop.target))
    found = [
        _by_arcs(problem, loop.rows(rows[some]), margin)
        for some in chunks(len(rows), _ROWS_AT_ONCE, progress, "frequencies")
    ]
    b, k, p = (np.concatenate(gain) for gain in zip(*found, strict=True))
    return b, k, p


def _by_arcs(problem: Problem, loop: Loop, margin: float) -> GainArrays:
    radius = np.abs(loop.target)
    contacts = problem.coupling.contact_damping_ns_per_m
    edges = Edges.of(problem, loop, contacts if contacts[1] > contacts[0] else contacts[:1])
    groups = [_edge_candidates(edges, radius, margin)]
    plain_edges = Edges.of(problem, loop, contacts[:1])
    groups += _inner_candidates(problem, loop, radius, margin, plain_edges)
    if contacts[1] > contacts[0]:
        groups.append(_segment_candidates(problem, loop, radius, margin, plain_edges))
    b, k, p = (np.concatenate(column) for column in zip(*groups, strict=True))
    return best_candidate(problem, loop, b, k, p, margin)


def solve_exact(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve (11)-(12) at every frequency by arc geometry: the global optimum, without iteration."""
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    gains = exact_gains(problem, loop, progress=progress)
    status = row_status(problem, *gains)
    seconds = time.perf_counter() - started
    return gain_schedule(
        problem,
        "exact",
        gains,
        status,
        reason=row_reasons(problem, status),
        solve_seconds=seconds,
        notes=pointwise_notes(problem),
    )
