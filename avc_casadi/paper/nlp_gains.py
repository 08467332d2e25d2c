"""Solve (11)-(12) as CasADi's NLP: from several starts at each frequency, with ties broken in order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.closed_form import Quotient
from avc_casadi.paper.equations import ImpedanceLoop, coupling_gains, coupling_impedance
from avc_casadi.paper.nlp_solver import NlpRows, NlpSolvers, nlp_solvers
from avc_casadi.paper.rows import TIE, GainArrays, best_candidate, guarded_margin, in_parts


@dataclass(frozen=True)
class Lattice:
    """Density of the lattice, and number of its best nodes taken as starts.

    Attributes:
        series: nodes along b and k.
        damped: nodes along b, k and b_p.
        error: starts of least magnitude error on either side of |Z_h| = |Z_h_ds|.
        turn: starts nearest to Z_h_ds on either side of its direction, for the ties.
    """

    series: tuple[int, int]
    damped: tuple[int, int, int]
    error: int
    turn: int


COARSE = Lattice((17, 17), (9, 9, 7), error=2, turn=2)
FINE = Lattice((49, 49), (21, 21, 15), error=8, turn=4)

_AXIS_CENTRE = 0.5
"""Decades about the natural scale of a gain in which nodes are evenly spaced; farther away they are sparser."""
_AXIS_DECADES = 5.0
"""Farthest node from the natural scale, in decades, inside the ends of the box."""
_FREQUENCIES_AT_ONCE = 50
"""Frequencies whose starts are in memory at a time."""
_CURVE = 1e-4
"""An error below this share of |Z_h_ds| counts as a curve of minimisers, whose ties are then broken."""
_SAME_IMPEDANCE = 1e-10
"""Z_h within this share of |Z_h_ds| is the same: a solver meets the equality with the previous Z_h no better."""
_PULLS = 4
"""Steps along the gradient that move gains onto (12)."""


@dataclass(frozen=True)
class Starts:
    """Gains (3, m) to start from, and the frequency of each, (m,)."""

    gains: FloatArray
    row: IndexArray

    def only(self, chosen: BoolArray) -> Starts:
        """Return a subset, by a mask of shape (m,)."""
        return Starts(self.gains[:, chosen], self.row[chosen])


def starts_of(nlp: NlpRows, lattice: Lattice) -> tuple[Starts, Starts]:
    """Return starts of (11)-(12), best or least infeasible nodes and the closed form, and further ones of its ties."""
    nodes, shape = _nodes(nlp, lattice)
    z = nlp.perceived(nodes)
    target = nlp.loop.target / nlp.size
    excess = np.abs(z) - np.abs(target)
    feasible = z.real >= nlp.margin
    error = np.where(feasible, np.abs(excess), np.inf)
    # Away from the circle |Z_h| = |Z_h_ds| a node predicts its solution less well.
    distance = np.where(feasible, np.abs(z - target) + 2 * np.abs(excess), np.inf)
    anticlockwise = (z * np.conj(target)).imag >= 0
    infeasible = np.flatnonzero(~feasible.any(axis=0))
    first = [
        *(_least(nodes, error, shape, lattice.error, side) for side in (excess < 0, excess >= 0)),
        Starts(nodes[:, z.real.argmax(axis=0)[infeasible], infeasible], infeasible),
        _closed_form(nlp),
    ]
    ties = [_least(nodes, distance, shape, lattice.turn, side) for side in (~anticlockwise, anticlockwise)]
    return joined(first), joined(ties)


def joined(parts: list[Starts]) -> Starts:
    """Return the concatenation of starts."""
    gains = np.concatenate([part.gains for part in parts], axis=1)
    return Starts(gains, np.concatenate([part.row for part in parts]))


def _nodes(nlp: NlpRows, lattice: Lattice) -> tuple[FloatArray, tuple[int, ...]]:
    """Return the nodes (3, m, n) and the shape of the lattice, of m nodes."""
    moving = nlp.high[2, 0] > nlp.low[2, 0]
    counts = lattice.damped if moving else (*lattice.series, 1)
    axes = [_axis(*gain) for gain in zip(nlp.low[:, 0], nlp.high[:, 0], nlp.natural, counts, strict=True)]
    shape = tuple(len(axis) for axis in axes)
    grid = np.broadcast_arrays(axes[0][:, None, None], axes[1][None, :, None], axes[2][None, None, :])
    return np.array(grid).reshape(3, -1, nlp.natural.shape[1]), shape


def _axis(low: float, high: float, natural: FloatArray, count: int) -> FloatArray:
    """Return values of one gain, (count, n), both ends among them."""
    if high == low or count == 1:
        return np.full((1, len(natural)), low)
    with np.errstate(divide="ignore"):
        decades = [np.clip(np.log10(end / natural), -_AXIS_DECADES, _AXIS_DECADES) for end in (low, high)]
    first, last = (np.arcsinh(end / _AXIS_CENTRE) for end in decades)
    even = first + (last - first) * np.linspace(0, 1, count)[:, None]
    values = np.clip(natural * 10 ** (_AXIS_CENTRE * np.sinh(even)), low, high)
    values[0] = low
    values[-1] = high
    return values


def _least(nodes: FloatArray, value: FloatArray, shape: tuple[int, ...], count: int, among: BoolArray) -> Starts:
    """Return the ``count`` smallest local minima of the values (m, n) on the lattice."""
    rows = value.shape[1]
    value = np.where(among, value, np.inf)
    on_lattice = value.reshape(*shape, rows)
    least = np.isfinite(on_lattice)
    for axis, length in enumerate(shape):
        outside = np.full_like(on_lattice.take([0], axis), np.inf)
        padded = np.concatenate((outside, on_lattice, outside), axis)
        before = padded.take(range(length), axis)
        after = padded.take(range(2, length + 2), axis)
        # Of equal nodes the first.
        least &= (on_lattice < before) & (on_lattice <= after)
    value = np.where(least.reshape(-1, rows), value, np.inf)
    count = min(count, len(value))
    node = np.argpartition(value, count - 1, axis=0)[:count]
    row = np.broadcast_to(np.arange(rows), node.shape)
    minimum = np.isfinite(value[node, row])
    return Starts(nodes[:, node[minimum], row[minimum]], row[minimum])


def _closed_form(nlp: NlpRows) -> Starts:
    """Return the gains of the paper's projection, where they lie in the box; b_p injects its damping if admitted."""
    loop = nlp.loop
    injected = np.maximum(0.0, nlp.margin * nlp.size - loop.target.real)
    moving = nlp.high[2, 0] > nlp.low[2, 0]
    with np.errstate(all="ignore"):
        rendered = Quotient.of(loop, loop.desired, loop.desired_gap, 0 * injected if moving else injected)
        b, k = coupling_gains(loop.angle, rendered.coupling)
        contact = injected / loop.hold.real if moving else nlp.low[2] * nlp.size + 0 * injected
        gains = np.array([b, k, contact]) / nlp.size
        row = np.flatnonzero(((gains >= nlp.low) & (gains <= nlp.high)).all(axis=0))
    return Starts(gains[:, row], row)


def solvers_for(problem: Problem, name: str, tolerance: float) -> NlpSolvers:
    """Return the solvers that a problem needs: b_p is a variable where its range has a width."""
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    return nlp_solvers(name, tolerance, contact=highest > lowest)


def nlp_gains(
    problem: Problem,
    loop: ImpedanceLoop,
    name: str,
    tolerance: float,
    *,
    lattice: Lattice = COARSE,
    progress: Progress = SILENT,
) -> GainArrays:
    """Return the best (b, k, b_p) that the solver found, each (n,); not a number where none is feasible."""
    solvers = solvers_for(problem, name, tolerance)
    return in_parts(loop, _FREQUENCIES_AT_ONCE, progress, lambda part: _best(NlpRows(problem, part, solvers), lattice))


def _best(nlp: NlpRows, lattice: Lattice) -> GainArrays:
    """Solve the goals one after the other and return the best of all points found."""
    first, tie_starts = starts_of(nlp, lattice)
    ends = Starts(nlp.solve("error", first.gains, first.row), first.row)
    error = np.abs(np.abs(nlp.perceived(ends.gains, ends.row)) * nlp.size - np.abs(nlp.loop.target[ends.row]))
    near = error < _CURVE * nlp.size * nlp.radius[ends.row]
    begin = joined([ends.only(near), tie_starts.only(np.isin(tie_starts.row, ends.row[near]))])
    points = [ends, Starts(nlp.solve("turn", begin.gains, begin.row), begin.row)]
    best = _ranked(nlp, joined(points), TIE)
    row = np.flatnonzero(np.isfinite(best[0]))
    if nlp.solvers.contact is None or not row.size:
        return best
    reached = Starts(np.array(best)[:, row] / nlp.size, row)
    least = Starts(nlp.solve("contact", reached.gains, row), row)
    return _ranked(nlp, joined([reached, least]), _SAME_IMPEDANCE)


def _ranked(nlp: NlpRows, points: Starts, tie: float) -> GainArrays:
    """Return the best of the points and of their likes pulled onto (12), at each frequency."""
    order = np.argsort(points.row, kind="stable")
    row = points.row[order]
    place = np.arange(len(row)) - np.searchsorted(row, row)
    gains = np.full((int(place.max()) + 1, 3, len(nlp.loop.target)), np.nan)
    gains[place, :, row] = nlp.size * points.gains.T[order]
    candidates = np.concatenate((gains, _pulled_inside(nlp, gains)))
    b, k, p = candidates.transpose(1, 0, 2)
    return best_candidate(nlp.problem, nlp.loop, b, k, p, tie=tie)


def _pulled_inside(nlp: NlpRows, solved: FloatArray) -> FloatArray:
    """Move gains (m, 3, n) that violate (12) by a solver's tolerance onto it, along its gradient."""
    loop = nlp.loop
    gains = solved.copy()
    scales = nlp.size * nlp.natural
    margin = margin_over_range(nlp.problem)
    low = nlp.size * nlp.low
    high = nlp.size * nlp.high
    slope_k = coupling_impedance(loop.angle, 0.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(_PULLS):
            b, k, p = gains.transpose(1, 0, 2)
            rendered = loop.rendered(b, k) + p
            missing = guarded_margin(loop.device, loop.hold, rendered, margin)
            missing = missing - (loop.device + loop.hold * rendered).real
            dz = loop.sensitivity(b, k)
            gradient = np.stack((dz.real, (dz * slope_k).real, loop.hold.real + 0 * b), axis=1) * scales
            # A gain at its bound cannot move further out.
            blocked = ((gains <= low) & (gradient < 0)) | ((gains >= high) & (gradient > 0))
            gradient = np.where(blocked, 0.0, gradient)
            step = np.maximum(missing, 0)[:, None] * gradient / (gradient**2).sum(axis=1, keepdims=True)
            gains = np.clip(gains + np.where(np.isfinite(step), step, 0.0) * scales, low, high)
    return gains
