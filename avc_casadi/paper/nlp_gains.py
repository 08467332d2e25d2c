"""Solve (11)-(12) as CasADi's NLP: from several starts at each frequency, with ties broken in order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.model.corners import margin_over_range
from avc_casadi.paper.backends import DEFAULT_SOLVER, DEFAULT_TOLERANCE
from avc_casadi.paper.equations import coupling_impedance
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.nlp_solver import NlpRows, NlpSolvers, nlp_solvers
from avc_casadi.paper.rows import TIE, GainArrays, best_candidate, guarded_margin
from avc_casadi.paper.starts import COARSE, Lattice, Starts, joined, starts_of

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

_ROWS_AT_ONCE = 50
"""Frequencies solved at a time: few enough for progress reports."""
_ROOT = 1e-4
"""A magnitude error below this share of |Z_h_ds| counts as a curve of minimisers, whose ties are then broken."""
_SAME = 1e-10
"""Z_h within this share of |Z_h_ds| is the same: a solver meets the equality with the previous Z_h no better."""


def solvers_for(problem: Problem, name: str = DEFAULT_SOLVER, tolerance: float = DEFAULT_TOLERANCE) -> NlpSolvers:
    """Return the solvers that a problem needs: b_p is a variable where its range has a width."""
    lowest, highest = problem.coupling.contact_damping_ns_per_m
    return nlp_solvers(name, tolerance, contact=highest > lowest)


def nlp_gains(
    problem: Problem,
    loop: Loop,
    name: str = DEFAULT_SOLVER,
    tolerance: float = DEFAULT_TOLERANCE,
    *,
    lattice: Lattice = COARSE,
    progress: Progress = SILENT,
) -> GainArrays:
    """Return the best (b, k, b_p) that the solver found, each (n,); not a number where none is feasible."""
    margin = margin_over_range(problem)
    solvers = solvers_for(problem, name, tolerance)
    rows = np.arange(len(loop.target))
    found = [
        _Search(problem, loop.rows(rows[some]), margin, solvers, lattice).best()
        for some in chunks(len(rows), _ROWS_AT_ONCE, progress, "frequencies")
    ]
    b, k, p = (np.concatenate(gain) for gain in zip(*found, strict=True))
    return b, k, p


@dataclass(frozen=True)
class _Search:
    problem: Problem
    loop: Loop
    margin: float
    solvers: NlpSolvers
    lattice: Lattice

    def best(self) -> GainArrays:
        """Solve the goals one after the other and return the best of all points found."""
        nlp = NlpRows(self.problem, self.loop, self.margin, self.solvers)
        first, elsewhere = starts_of(nlp, self.lattice)
        ends = Starts(nlp.solve("error", first.gains, first.row), first.row)
        error = np.abs(np.abs(nlp.perceived(ends.gains, ends.row)) * nlp.size - np.abs(self.loop.target[ends.row]))
        near = error < _ROOT * nlp.size * nlp.radius[ends.row]
        begin = joined([ends.only(near), elsewhere.only(np.isin(elsewhere.row, ends.row[near]))])
        points = [ends, Starts(nlp.solve("turn", begin.gains, begin.row), begin.row)]
        best = self._ranked(nlp, joined(points), TIE)
        row = np.flatnonzero(np.isfinite(best[0]))
        if self.solvers.contact is None or not row.size:
            return best
        reached = Starts(np.array(best)[:, row] / nlp.size, row)
        least = Starts(nlp.solve("contact", reached.gains, row), row)
        return self._ranked(nlp, joined([reached, least]), _SAME)

    def _ranked(self, nlp: NlpRows, found: Starts, tie: float) -> GainArrays:
        order = np.argsort(found.row, kind="stable")
        row = found.row[order]
        place = np.arange(len(row)) - np.searchsorted(row, row)
        gains = np.full((int(place.max()) + 1, 3, len(self.loop.target)), np.nan)
        gains[place, :, row] = nlp.size * found.gains.T[order]
        every = np.concatenate((gains, self._pulled_inside(nlp, gains)))
        return best_candidate(self.problem, self.loop, every[:, 0], every[:, 1], every[:, 2], self.margin, tie=tie)

    def _pulled_inside(self, nlp: NlpRows, found: FloatArray) -> FloatArray:
        """Move gains (m, 3, n) that violate (12) by a solver's tolerance onto it, along its gradient."""
        loop, gains, scales = self.loop, found.copy(), nlp.size * nlp.natural
        low, high = nlp.size * nlp.low, nlp.size * nlp.high
        slope_k = coupling_impedance(loop.angle, 0.0, 1.0)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for _ in range(4):
                b, k, p = gains[:, 0], gains[:, 1], gains[:, 2]
                rendered = loop.rendered(b, k) + p
                missing = guarded_margin(loop.device, loop.hold, rendered, self.margin)
                missing = missing - (loop.device + loop.hold * rendered).real
                dz = loop.sensitivity(b, k)
                gradient = np.stack((dz.real, (dz * slope_k).real, loop.hold.real + 0 * b), axis=1) * scales
                # A gain at its bound cannot move further out.
                blocked = ((gains <= low) & (gradient < 0)) | ((gains >= high) & (gradient > 0))
                gradient = np.where(blocked, 0.0, gradient)
                step = np.maximum(missing, 0)[:, None] * gradient / (gradient**2).sum(axis=1, keepdims=True)
                gains = np.clip(gains + np.where(np.isfinite(step), step, 0.0) * scales, low, high)
        return gains
